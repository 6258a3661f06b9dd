"""Differences of 16-bit numbers in coded meshes (docs/formats.md, "Differences")."""
from .symbol_coder import SymbolModel, even_model

# The number of values of `digits`.
DIGITS = 18


def digits(value):
    return min(abs(value).bit_length(), DIGITS - 1)


class DifferenceReader:
    def __init__(self, coder, contexts):
        """`contexts` are the numbers of models of both lists."""
        self.coder = coder
        self.size = [[SymbolModel([4] * 26 + [1] * 6) for _ in range(count)] for count in contexts]
        self.second = [even_model(2) for _ in range(17)]

    def read(self, contexts, expected):
        """A number from 0 to 65535."""
        a, b = (models[context] for models, context in zip(self.size, contexts))
        symbol = self.coder.pair(a, b)
        count = (symbol + 1) // 2
        size = min(count, 1)
        if count > 1:
            size = 2 + self.coder.symbol(self.second[count])
            size = self.coder.digits(count - 2, size)
        return expected + (size if symbol % 2 else -size) & 65535
