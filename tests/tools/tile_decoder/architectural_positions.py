"""Positions of buildings (docs/formats.md, "Architectural positions")."""
from .completed import completed_triangles
from .container import BadTile
from .differences import DIGITS, DifferenceReader, digits
from .symbol_coder import SymbolModel

NONE, NEIGHBOURS = 0, 4


def are_aligned(p, q):
    return p[:2] == q[:2]


def are_level(p, q):
    return p[2] == q[2]


class Neighbours:
    """What a vertex is predicted from: four points and the numbers of digits of the differences there."""

    def __init__(self, completed, points, coded, last):
        self.is_first = not completed
        if self.is_first:
            self.points, self.expected, self.digits = [last[0], last[1], last[0], last[0]], last[0], [0, 0]
            return
        triangle = completed[0]
        near = [triangle.a, triangle.b, triangle.beyond]
        a, b, beyond = (points[vertex] for vertex in near)
        self.points = [b, a, points[completed[1].other] if len(completed) > 1 else b, beyond]
        self.expected = [p + q - r for p, q, r in zip(a, b, beyond)]
        self.digits = [max(coded[vertex][k] for vertex in near) for k in range(2)]

    def pattern(self, agree):
        """Which points agree with each other."""
        b, a, following, beyond = self.points
        pairs = [(a, b), (beyond, a), (beyond, b), (following, b), (following, a)]
        return sum(agree(*pair) << k for k, pair in enumerate(pairs)) + 32 * self.is_first

    def extent(self, axis):
        """Digits of the triangle's size along an axis."""
        b, a, _, beyond = (point[axis] for point in self.points)
        return digits(max(abs(a - b), abs(beyond - b)))


def read_architectural_positions(coder, surface, originals, bits):
    return ArchitecturalReader(coder, surface, bits).read(originals)


class ArchitecturalReader:
    def __init__(self, coder, surface, bits):
        self.coder, self.surface, self.bits = coder, surface, bits
        self.aligned = [SymbolModel([8, 8, 3, 3, 3, 1, 1, 1]) for _ in range(64)]
        self.level = [SymbolModel([8, 4, 4, 3, 3, 1, 1, 1]) for _ in range(320)]
        self.differences = DifferenceReader(coder, [4 * DIGITS] * 2)
        self.points = [None] * len(surface.degree)
        self.coded = [None] * len(surface.degree)

    def read(self, originals):
        last = [(1 << self.bits - 1,) * 3] * 2
        for vertex in filter(self.surface.is_real, range(len(originals))):
            original = originals[vertex]
            if original != vertex:
                point, self.coded[vertex] = self.points[original], self.coded[original]
            else:
                completed = completed_triangles(self.surface, vertex)
                point, self.coded[vertex] = self.read_point(Neighbours(completed, self.points, self.coded, last))
            if not all(0 <= value < 1 << self.bits for value in point):
                raise BadTile("a vertex lies outside its grid")
            self.points[vertex] = point
            last = [point, last[0]]
        return self.points

    def read_point(self, near):
        """The point, and the numbers of digits of its differences, horizontal and vertical."""
        coded = [0, 0]
        aligned = self.read_neighbour(self.aligned[near.pattern(are_aligned)])
        if aligned == NONE:
            size = max(near.extent(0), near.extent(1))
            models = [DIGITS * (2 if near.is_first else axis) for axis in range(2)]
            x, y = (self.read_difference(near, axis, models[axis], size, 0, coded) for axis in range(2))
        else:
            x, y, _ = near.points[aligned - 1]
        level = self.read_neighbour(self.level[near.pattern(are_level) * (NEIGHBOURS + 1) + aligned])
        if level == NONE:
            z = self.read_difference(near, 2, DIGITS * 3, near.extent(2), 1, coded)
        else:
            z = near.points[level - 1][2]
        return (x, y, z), coded

    def read_neighbour(self, model):
        symbol = self.coder.symbol(model)
        if symbol > NEIGHBOURS:
            raise BadTile("a vertex agrees with a neighbour that does not exist")
        return symbol

    def read_difference(self, near, axis, models, size, k, coded):
        value = self.differences.read([models + size, models + near.digits[k]], near.expected[axis])
        coded[k] = max(coded[k], digits(value - near.expected[axis]))
        return value
