"""Attributes of corners in coded meshes (docs/formats.md, "Attributes")."""
import math
from .connectivity import next_half_edge, previous_half_edge
from .container import BadTile
from .differences import DifferenceReader
from .symbol_coder import SymbolModel

NEW = 3
LAST_VALUE, FIRST_CORNER, OWN_TRIANGLE, NEIGHBOUR = range(4)
TEXTURE_COORDINATE = "texture coordinate"


def read_attribute(coder, surface, points, attribute):
    """One value per corner of the triangles without dummies."""
    return AttributeReader(coder, surface, points, attribute).read()


def sub(a, b):
    return [x - y for x, y in zip(a, b)]


def dot(a, b):
    return float(sum(x * y for x, y in zip(a, b)))


class AttributeReader:
    def __init__(self, coder, surface, points, attribute):
        self.coder, self.surface, self.points = coder, surface, points
        self.is_texture = attribute["kind"] == TEXTURE_COORDINATE
        self.components, self.bits = attribute["components"], attribute["bits"]
        self.shared = [SymbolModel([12, 2, 1, 2]) for _ in range(6)]
        self.differences = DifferenceReader(coder, [16, 4])
        # By corner, and by vertex.
        self.values, self.latest = [None] * len(surface.twins), [None] * len(surface.degree)
        self.last_new = (1 << self.bits - 1,) * self.components

    def read(self):
        corners = []
        for t, triangle in enumerate(self.surface.triangles):
            if all(map(self.surface.is_real, triangle)):
                at_seam = False
                for corner in range(3 * t, 3 * t + 3):
                    at_seam = self.read_corner(corner, triangle[corner % 3], at_seam)
                corners += self.values[3 * t:3 * t + 3]
        return corners

    def read_corner(self, corner, vertex, at_seam):
        """Returns whether the triangle has a seam, as far as it is known."""
        candidates, value = self.candidates(corner, vertex), None
        if candidates:
            symbol = self.coder.symbol(self.shared[(len(candidates) - 1) * 2 + at_seam])
            at_seam = symbol != 0
            if symbol != NEW:
                if symbol >= len(candidates):
                    raise BadTile("a corner shares a value that does not exist")
                value = candidates[symbol]
        if value is None:
            value = self.last_new = self.read_new(corner)
        self.values[corner] = self.latest[vertex] = value
        return at_seam

    def candidates(self, corner, vertex):
        """The different values that are known beside a corner."""
        twins = self.surface.twins
        beside = [next_half_edge(twins[corner]), twins[previous_half_edge(corner)]]
        known = [self.values[other] for other in beside] + [self.latest[vertex]]
        return list(dict.fromkeys(value for value in known if value is not None))

    def read_new(self, corner):
        expected, by = self.expected(corner)
        value = tuple(self.differences.read([by * 4 + c, by], expected[c]) for c in range(self.components))
        if any(v >> self.bits for v in value):
            raise BadTile("an attribute has a value outside its bits")
        return value

    def expected(self, corner):
        first = corner - corner % 3
        if corner == first:
            return self.last_new, LAST_VALUE
        if corner == first + 1:
            return self.values[first], FIRST_CORNER
        a, b = self.values[first:first + 2]
        across = self.across_edge(first, a, b)
        return (across, NEIGHBOUR) if across else (self.by_shape(first, a, b) or b, OWN_TRIANGLE)

    def position(self, corner):
        return self.points[self.surface.triangles[corner // 3][corner % 3]]

    def across_edge(self, first, a, b):
        """From the triangle beyond the first edge, if that has the values a and b there."""
        at_b = self.surface.twins[first]
        far = previous_half_edge(at_b)
        beyond = self.values[far]
        if beyond is None or self.values[next_half_edge(at_b)] != a or self.values[at_b] != b:
            return None
        factors = self.affine_factors(first, far) if self.is_texture else None
        if factors is None:
            return tuple(self.rounded(float(p + q - r)) for p, q, r in zip(a, b, beyond))
        s, t = factors
        return tuple(self.rounded(p + s * (q - p) + t * (r - p)) for p, q, r in zip(a, b, beyond))

    def affine_factors(self, first, far):
        """The factors of two edges of the triangle beyond that lead to the third corner; None if they are parallel."""
        p, q, r = (self.position(first + k) for k in range(3))
        e, f, d = sub(q, p), sub(self.position(far), p), sub(r, p)
        ee, ef, ff, de, df = dot(e, e), dot(e, f), dot(f, f), dot(d, e), dot(d, f)
        area = ee * ff - ef * ef
        return ((de * ff - df * ef) / area, (df * ee - de * ef) / area) if area > 0 else None

    def by_shape(self, first, a, b):
        """Texture coordinates from the shape of the triangle in space; None if that says nothing."""
        p, q, r = (self.position(first + k) for k in range(3))
        e, d = sub(q, p), sub(r, p)
        ee, es, ss = dot(e, e), dot(e, d), dot(d, d)
        if not self.is_texture or self.components != 2 or ee == 0:
            return None
        along, across = es / ee, math.sqrt(max(ss * ee - es * es, 0.0)) / ee
        du, dv = b[0] - a[0], b[1] - a[1]
        return self.rounded(a[0] + along * du - across * dv), self.rounded(a[1] + along * dv + across * du)

    def rounded(self, value):
        return min(max(math.floor(value + 0.5), 0), (1 << self.bits) - 1)
