"""The range coder's reader (docs/formats.md, "The range coder")."""
from .container import BadTile

STEPS = [131072 // (2 * seen + 3) for seen in range(41)]
UNARY = 12
UNSET, SET, MIXED = 0, 1, 2


def bit_model():
    """`set` and `seen`."""
    return [32768, 0]


def bit_models(count):
    return [bit_model() for _ in range(count)]


class NumberModel:
    def __init__(self):
        self.zero, self.negative = bit_model(), bit_model()
        self.greater = bit_models(UNARY)
        self.digits, self.high = bit_models(16), bit_models(16)


def number_models(count):
    return [NumberModel() for _ in range(count)]


class RangeReader:
    def __init__(self, data):
        self.data, self.at, self.range = data, 4, 0xFFFFFFFF
        self.code = int.from_bytes(data[:4].ljust(4, b"\0"), "big")

    def bit(self, model):
        probability, seen = model
        bound = (self.range >> 15) * (probability >> 1)
        if self.code < bound:
            bit = 1
            self.range = bound
            model[0] = probability + ((65535 - probability) * STEPS[seen] >> 16)
        else:
            bit = 0
            self.code -= bound
            self.range -= bound
            model[0] = probability - (probability * STEPS[seen] >> 16)
        if seen < 40:
            model[1] = seen + 1
        while self.range < 1 << 24:
            self.range <<= 8
            self.code = self.code << 8 | (self.data[self.at] if self.at < len(self.data) else 0)
            self.at += 1
        return bit

    def number(self, model):
        if self.bit(model.zero):
            return 0
        negative = self.bit(model.negative)
        value = 1
        while value <= UNARY and self.bit(model.greater[value - 1]):
            value += 1
        if value > UNARY:
            length = 0
            while length < 15 and self.bit(model.digits[length]):
                length += 1
            rest = 1
            for digit in reversed(range(length)):
                rest = rest << 1 | self.bit(model.high[length] if digit + 1 == length else bit_model())
            value = UNARY + rest
        return -value if negative else value

    def choice(self, models):
        """One of `len(models) + 1` values, a power of two. Prefix 1, 10, 11, 100, ... has model 0, 1, 2, 3, ..."""
        prefix = 1
        while prefix <= len(models):
            prefix = prefix << 1 | self.bit(models[prefix - 1])
        return prefix - len(models) - 1

    def group(self, models):
        """A group flag."""
        return UNSET if self.bit(models[0]) else SET if self.bit(models[1]) else MIXED

    def member(self, group, model):
        """A member's bit."""
        return self.bit(model) if group == MIXED else group

    def finish(self):
        if self.at < len(self.data):
            raise BadTile(f"{len(self.data) - self.at} bytes of the range coder were not read")
