"""Positions of scanned surfaces (docs/formats.md, "Scan positions"). All numbers with fractions are f32."""
import functools
from .completed import completed_triangles
from .container import BadTile
from .single import Single, add, cross, dot, larger, nearest, products, single, sub, times, vector
from .symbol_coder import SymbolModel, even_model

SCALES = 36
NEAR, FAR = 7, 15
ONE, HALF, TENTH, PRIOR = Single(1), Single(0.5), single(0.1), Single(2)


@functools.cache
def typical(scale, symbol):
    """The weight of a symbol of an error."""
    variance = 1 << scale if scale < 6 else 64 << scale % 2
    distance = 12 if symbol == FAR else symbol - NEAR
    width = variance + 16 * distance * distance
    return 30 + 1_000_000 // width * variance // width * variance


def unzigzag(number):
    return number >> 1 ^ -(number & 1)


def wrapped(number):
    """As a signed number of 32 bits."""
    return (number + (1 << 31)) % (1 << 32) - (1 << 31)


def read_scan_positions(coder, surface, originals, weights, bits):
    return ScanReader(coder, surface, weights, bits).read(originals)


class ScanReader:
    def __init__(self, coder, surface, weights, bits):
        self.coder, self.surface, self.bits = coder, surface, bits
        self.weights = [Single(weight / 64) for weight in weights]
        vertices = len(surface.degree)
        self.points, self.squares = [None] * vertices, [(Single(0),) * 6] * vertices
        self.tangential, self.normal = Single(64), Single(16)
        self.first = [even_model(32) for _ in range(3)]
        self.far = even_model(32)
        scales = [[typical(scale, symbol) for symbol in range(16)] for scale in range(SCALES)]
        self.error = [[SymbolModel(weights) for weights in scales] for _ in range(3)]

    def read(self, originals):
        last = (1 << self.bits - 1,) * 3
        for vertex in filter(self.surface.is_real, range(len(originals))):
            if originals[vertex] != vertex:
                point = self.points[originals[vertex]]
            elif completed := completed_triangles(self.surface, vertex):
                point = self.read_predicted(vertex, completed)
            else:
                point = tuple(value + unzigzag(self.coder.number(model)) for value, model in zip(last, self.first))
            if not all(0 <= value < 1 << self.bits for value in point):
                raise BadTile("a vertex lies outside its grid")
            self.points[vertex] = last = point
        return self.points

    def read_predicted(self, vertex, completed):
        expected = self.expected(vertex, completed)
        plane = self.plane(completed[0])
        point = self.read_near(self.covariance(completed, plane), expected)
        error = sub(vector(point), expected)
        self.squares[vertex] = products(error)
        self.adapt(error, plane)
        return point

    def total(self, vertices):
        """The sum of the positions of vertices. It is exact."""
        return vector(map(sum, zip(*(self.points[vertex] for vertex in vertices))))

    def expected(self, vertex, completed):
        count = len(completed)
        share = ONE / count
        mean = times(self.total([v for triangle in completed for v in (triangle.a, triangle.b)]), HALF * share)
        outward = sub(mean, times(self.total([triangle.beyond for triangle in completed]), share))
        middle = vector((0, 0, 0))
        if count > 1:
            middle = sub(times(self.total([triangle.full for triangle in completed[1:]]), ONE / (count - 1)), mean)
        k = 2 * self.weight_class(vertex, completed)
        return add(mean, add(times(outward, self.weights[k]), times(middle, self.weights[k + 1])))

    def weight_class(self, vertex, completed):
        degree = self.surface.degree
        by_degree = min(max(degree[vertex], 5), 7) - 5
        if len(completed) == 2:
            return 3 + 3 * (min(max(degree[completed[1].full], 4), 7) - 4) + by_degree
        return by_degree if len(completed) == 1 else 15 + by_degree

    def plane(self, triangle):
        """The normal of the triangle beyond the vertex, and its squared length."""
        a, b, beyond = (vector(self.points[v]) for v in (triangle.a, triangle.b, triangle.beyond))
        normal = cross(sub(b, a), sub(beyond, a))
        return normal, larger(dot(normal, normal), ONE)

    def covariance(self, completed, plane):
        normal, squared_length = plane
        first = completed[0]
        known = [first.beyond, first.other, first.full]
        known += [v for triangle in completed[1:] for v in (triangle.beyond, triangle.other)]
        sums = (Single(0),) * 6
        for vertex in known:
            sums = add(sums, self.squares[vertex])
        share = ONE / (2 + len(known))
        tilt = (self.normal - self.tangential) * (PRIOR * share) / squared_length
        prior = self.tangential * PRIOR * share + TENTH
        none = Single(0)
        priors = (prior, none, none, prior, none, prior)
        return add(add(times(sums, share), priors), times(products(normal), tilt))

    def read_near(self, covariance, expected):
        """Each coordinate is expected from those before it."""
        xx, xy, xz, yy, yz, zz = covariance
        inverse = ONE / xx
        y_x, z_x = xy * inverse, xz * inverse
        minor = larger(xx * yy - xy * xy, TENTH * xx)
        mixed = xx * yz - xy * xz
        z_y = mixed / minor
        variances = xx, minor * inverse, larger((xx * zz - xz * xz - mixed * z_y) * inverse, TENTH)
        x_error, y_error, z_error = (single(error) for error in self.read_errors(variances))
        x_start = nearest(expected[0])
        rounding = x_start - expected[0]
        z_x = z_x - z_y * y_x
        y_start = expected[1] + y_x * rounding
        z_start = expected[2] - z_y * expected[1] + z_x * rounding
        x = x_error + x_start
        y = y_error + nearest(y_start + y_x * x_error)
        z = z_error + nearest(z_start + z_x * x_error + z_y * y)
        return int(x), int(y), int(z)

    def read_errors(self, variances):
        scales = [min(max(variance.exponent() - 123, 0), SCALES - 1) for variance in variances]
        symbols = [self.coder.symbol(self.error[axis][scales[axis]], lane=1 + axis) for axis in range(3)]
        errors = [self.read_far() if symbol == FAR else symbol - NEAR for symbol in symbols]
        shifts = [max(scale // 2 - 3, 0) for scale in scales]
        return [wrapped(error << shift) | low for error, shift, low in zip(errors, shifts, self.read_low(shifts))]

    def read_far(self):
        number = self.coder.number(self.far)
        size = wrapped((number >> 1) + NEAR + 1)
        return -size if number & 1 else size

    def read_low(self, shifts):
        a, b, c = shifts
        if a + b + c > 15:
            return [self.coder.raw(shift) for shift in shifts]
        bits = self.coder.raw(a + b + c)
        return [bits >> b + c, bits >> c & (1 << b) - 1, bits & (1 << c) - 1]

    def adapt(self, error, plane):
        """Moves the mean squared errors towards the last one."""
        normal, squared_length = plane
        across = dot(error, normal)
        across = across * across / squared_length
        self.normal = self.normal + (across - self.normal) * TENTH
        along = (dot(error, error) - across) * HALF
        self.tangential = larger(self.tangential + (along - self.tangential) * TENTH, Single(0))
