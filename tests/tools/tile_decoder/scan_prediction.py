"""What a vertex of a scan is predicted from (docs/formats.md, "Scan positions")."""
import math
from .scan_weights import BY_DEGREES, DEGREES, FIRST_OF_MANY, OF_ONE
from .single import Single, add, cross, dot, larger, single, sub, times, vector

ANGLES = 4
EDGES_AND_MIDDLE = 1
ONE, HALF = Single(1), Single(0.5)
NOTHING = vector((0, 0, 0))


class Prediction:
    def __init__(self, vertex_class, base, offsets, plane, neighbours):
        """`plane` is an edge and the vector to the vertex beyond it, from the same vertex."""
        self.vertex_class, self.base, self.neighbours = vertex_class, base, neighbours
        self.offsets = [*offsets, *[NOTHING] * (5 - len(offsets))]
        self.normal = cross(*plane)
        self.inverse = ONE / larger(dot(self.normal, self.normal), ONE)

    def turned(self, edge):
        """The edge, turned by a right angle within the plane."""
        return times(cross(edge, self.normal), single(math.sqrt(self.inverse)))

    def position(self, weights):
        a, b, c, d, e = map(times, self.offsets, weights)
        return add(add(self.base, e), add(add(a, b), add(c, d)))


def clamped(degree):
    return min(max(degree, 5), 7) - 5


def longest(shared, other, opposite):
    """Which edge of a triangle is longest, from their squares."""
    if shared > (other if other > opposite else opposite):
        return 0
    return 1 if other > opposite else 2


def squared(edge):
    return dot(edge, edge)


def predict(surface, points, vertex, completed, classes):
    def at(other):
        return vector(points[other])

    degree, of_degree = surface.degree, clamped(surface.degree[vertex])
    if len(completed) == 1:
        return from_one(completed[0], at, degree, of_degree, classes)
    if len(completed) == 2:
        return from_two(*completed, at, degree, of_degree, classes)
    return from_many(completed, at, of_degree)


def from_one(only, at, degree, of_degree, classes):
    base = at(only.a)
    to_b, to_beyond = sub(at(only.b), base), sub(at(only.beyond), base)
    found = Prediction(0, base, [to_b, to_beyond], (to_b, to_beyond), [only.a, only.b, only.beyond])
    if classes == BY_DEGREES:
        kind = clamped(degree[only.a])
        found.offsets[4] = found.turned(to_b)
    else:
        kind = longest(squared(to_b), squared(to_beyond), squared(sub(to_b, to_beyond)))
    found.vertex_class = kind * DEGREES + of_degree
    return found


def from_two(first, second, at, degree, of_degree, classes):
    middle, other = second.full, second.other
    is_after = middle == first.a
    outer = first.b if is_after else first.a
    base = at(middle)
    u, x, v, y = (sub(at(vertex), base) for vertex in (outer, first.beyond, other, second.beyond))
    neighbours = [middle, outer, first.beyond, other, second.beyond]
    found = Prediction(0, base, [u, x, v, y], (u, x) if is_after else (x, u), neighbours)
    gap = sub(u, v)
    if classes == BY_DEGREES:
        pair = clamped(degree[outer]) * DEGREES + clamped(degree[other])
        angle = min(max(degree[middle], 4), 7) - 4
        across = found.turned(gap)
        found.offsets[4] = across if is_after else times(across, Single(-1))
    else:
        uu, vv = squared(u), squared(v)
        pair = longest(uu, squared(x), squared(sub(u, x))) * 3 + longest(vv, squared(y), squared(sub(v, y)))
        sides, between = uu + vv, squared(gap)
        angle = sum(between > single(limit) * sides for limit in (0.6, 1.3, 1.75))
    if classes == EDGES_AND_MIDDLE:
        of_degree = clamped(degree[middle])
    found.vertex_class = OF_ONE + (pair * ANGLES + angle) * DEGREES + of_degree
    return found


def from_many(completed, at, of_degree):
    first, *rest = completed
    a, b, beyond = at(first.a), at(first.b), at(first.beyond)
    plane = sub(b, a), sub(beyond, a)
    neighbours, middles = [first.a, first.b, first.beyond], NOTHING
    for triangle in rest:
        middles, beyond = add(middles, at(triangle.full)), add(beyond, at(triangle.beyond))
        neighbours += [triangle.beyond, triangle.other]
    count = Single(len(rest))
    base = times(middles, ONE / count)
    outer = b if rest[0].full == first.a else a
    ends = times(add(outer, at(rest[-1].other)), HALF)
    beyond = times(beyond, ONE / (count + ONE))
    return Prediction(FIRST_OF_MANY + of_degree, base, [sub(ends, base), sub(beyond, base)], plane, neighbours)
