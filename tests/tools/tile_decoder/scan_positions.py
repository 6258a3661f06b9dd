"""Positions of scanned surfaces (docs/formats.md, "Scan positions"). All numbers with fractions are f32."""
from .completed import completed_triangles
from .container import BadTile
from .scan_prediction import predict
from .scan_weights import read_weights
from .single import Single, add, dot, larger, nearest, products, single, sub, times, vector
from .symbol_coder import SymbolModel, even_model

SCALES = 36
NEAR, FAR = 7, 15
SHAPES = [
    (20, 100, 100, 1), (25, 140, 100, 1), (70, 290, 100, 1), (150, 400, 130, 2), (330, 590, 270, 6), (420, 650, 410, 13),
    (550, 550, 560, 55), (600, 600, 670, 200),
]
SETTLED = 32
ZERO, ONE, HALF, TENTH, PRIOR = Single(0), Single(1), Single(0.5), single(0.1), Single(3)


def typical(scale, symbol):
    """The weight of a symbol of an error."""
    below, above, step, far = SHAPES[scale if scale < 6 else 6 + scale % 2]
    if symbol == FAR:
        return 1000 * far
    count = 1_000_000
    for distance in range(abs(symbol - NEAR)):
        count = count // 1000 * ((below if symbol < NEAR else above) if distance == 0 else step)
    return count + 100


def unzigzag(number):
    return number >> 1 ^ -(number & 1)


def side(expected):
    """On which side of the nearest whole number an expected value lies."""
    return Single(-1) if expected < nearest(expected) else ONE


def wrapped(number):
    """As a signed number of 32 bits."""
    return (number + (1 << 31)) % (1 << 32) - (1 << 31)


def read_scan_positions(coder, surface, originals, classes, bits):
    return ScanReader(coder, surface, classes, bits).read(originals)


class ClassState:
    """The weights of a class, and its mean squared errors."""

    def __init__(self, weights):
        self.weights, self.along, self.across, self.count = weights, Single(64), Single(16), 0


class ScanReader:
    def __init__(self, coder, surface, classes, bits):
        self.coder, self.surface, self.classes, self.bits = coder, surface, classes, bits
        vertices = len(surface.degree)
        self.points, self.squares = [None] * vertices, [(ZERO,) * 6] * vertices
        self.states = [ClassState(weights) for weights in read_weights(coder, classes)]
        self.last_class = {}
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
        found = predict(self.surface, self.points, vertex, completed, self.classes)
        count = len(found.neighbours)
        state = self.states[found.vertex_class]
        if state.count == 0:
            like = self.states[self.last_class.get(count, 0)]
            state.along, state.across = like.along, like.across
        self.last_class[count] = found.vertex_class
        expected = found.position(state.weights)
        level = (state.along + state.along + state.across) * (ONE / Single(3)) + ONE
        point = self.read_near(self.covariance(found, state, level), expected)
        error = sub(vector(point), expected)
        self.squares[vertex] = times(products(error), ONE / level)
        self.adapt(state, error, found)
        return point

    def covariance(self, found, state, level):
        sums = (ZERO,) * 6
        for vertex in found.neighbours:
            sums = add(sums, self.squares[vertex])
        share = ONE / (Single(len(found.neighbours)) + PRIOR)
        tilt = (state.across - state.along) * (PRIOR * share) * found.inverse
        prior = state.along * (PRIOR * share) + TENTH
        priors = (prior, ZERO, ZERO, prior, ZERO, prior)
        return add(add(times(sums, share * level), priors), times(products(found.normal), tilt))

    def read_near(self, covariance, expected):
        """Each coordinate is expected from those before it."""
        xx, xy, xz, yy, yz, zz = covariance
        inverse = ONE / xx
        y_x, z_x = xy * inverse, xz * inverse
        minor = larger(xx * yy - xy * xy, TENTH * xx)
        mixed = xx * yz - xy * xz
        z_y = mixed / minor
        variances = xx, minor * inverse, larger((xx * zz - xz * xz - mixed * z_y) * inverse, TENTH)
        x_coded, y_coded, z_coded = (single(error) for error in self.read_errors(variances))
        x_start, x_side = nearest(expected[0]), side(expected[0])
        rounding = x_start - expected[0]
        z_x = z_x - z_y * y_x
        y_start = expected[1] + y_x * rounding
        z_start = expected[2] - z_y * expected[1] + z_x * rounding
        x_error = x_coded * x_side
        x = x_error + x_start
        y_expected = y_start + y_x * x_error
        y = y_coded * side(y_expected) + nearest(y_expected)
        z_expected = z_start + z_x * x_error + z_y * y
        z = z_coded * side(z_expected) + nearest(z_expected)
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

    def adapt(self, state, error, found):
        """Moves the mean squared errors towards the last one."""
        across = dot(error, found.normal)
        across = across * across * found.inverse
        along = (dot(error, error) - across) * HALF
        rate = ONE / single(state.count + 1.5)
        state.across = state.across + (across - state.across) * rate
        state.along = larger(state.along + (along - state.along) * rate, ZERO)
        state.count = min(state.count + 1, SETTLED)
