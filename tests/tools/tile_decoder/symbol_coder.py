"""The symbol coder's reader (docs/formats.md, "Symbols")."""
import functools, struct
from bisect import bisect_right
from .container import BadTile

BITS = 15
ONE = 1 << BITS
LOW = 1 << 16
# By the number of symbols that a model has seen; the last one from then on.
SHIFTS = [3] * 3 + [4] * 7 + [5] * 26 + [6] * 65 + [7]


@functools.cache
def targets(count):
    """For each of `count` symbols, what `starts` would become if only that symbol occurred."""
    return [[i + (ONE - count if i > symbol else 0) for i in range(count)] for symbol in range(count)]


@functools.cache
def first_starts(weights):
    """`start` of each symbol in a new model with these weights."""
    total, free = sum(weights), ONE - 4 * len(weights)
    return [sum(weights[:i]) * free // total + 4 * i for i in range(len(weights))]


class SymbolModel:
    """Adaptive probabilities of as many symbols as there are weights."""

    def __init__(self, weights):
        self.starts = first_starts(tuple(weights))
        self.targets, self.seen = targets(len(weights)), 0

    def learn(self, symbol):
        shift = SHIFTS[self.seen]
        self.seen = min(self.seen + 1, len(SHIFTS) - 1)
        self.starts = [start + (target - start >> shift) for start, target in zip(self.starts, self.targets[symbol])]


def even_model(count):
    """A model whose symbols are equally likely at first."""
    return SymbolModel([1] * count)


class SymbolReader:
    def __init__(self, data, states):
        if len(data) % 2:
            raise BadTile("a mesh's symbols are half a word too long")
        self.words, self.at = struct.unpack(f"<{len(data) // 2}H", data), 0
        self.states = [self.word() << 16 | self.word() for _ in range(states)]

    def word(self):
        if self.at == len(self.words):
            raise BadTile("a mesh's symbols end too early")
        self.at += 1
        return self.words[self.at - 1]

    def take(self, lane, start, width):
        """Removes from a state the symbol with this part of the probability."""
        state = self.states[lane]
        state = width * (state >> BITS) + (state & ONE - 1) - start
        self.states[lane] = state << 16 | self.word() if state < LOW else state

    def find(self, lane, starts):
        """Reads a symbol of a model with these starts."""
        symbol = bisect_right(starts, self.states[lane] & ONE - 1) - 1
        end = starts[symbol + 1] if symbol + 1 < len(starts) else ONE
        self.take(lane, starts[symbol], end - starts[symbol])
        return symbol

    def symbol(self, model, lane=0):
        symbol = self.find(lane, model.starts)
        model.learn(symbol)
        return symbol

    def pair(self, a, b):
        """A symbol with the mean of two models."""
        symbol = self.find(0, [x + y >> 1 for x, y in zip(a.starts, b.starts)])
        a.learn(symbol)
        b.learn(symbol)
        return symbol

    def raw(self, bits):
        """At most 15 raw bits."""
        if bits == 0:
            return 0
        value = (self.states[0] & ONE - 1) >> BITS - bits
        self.take(0, value << BITS - bits, ONE >> bits)
        return value

    def digits(self, bits, value=0):
        """Raw bits after those of `value`, highest first, at most 15 at once."""
        while bits > 0:
            count = min(bits, BITS)
            value = value << count | self.raw(count)
            bits -= count
        return value

    def number(self, model):
        """A number from 0 to 2^32 - 2."""
        return self.digits(self.symbol(model), 1) - 1

    def finish(self):
        if self.at != len(self.words) or any(state != LOW for state in self.states):
            raise BadTile("a mesh's symbols do not end as they must")
