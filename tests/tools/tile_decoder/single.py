"""Numbers that compute in IEEE single precision: each operation rounds its result to f32."""
import math, struct

FORMAT = struct.Struct("<f")


def single(value):
    """The nearest f32."""
    try:
        return Single(FORMAT.unpack(FORMAT.pack(value))[0])
    except OverflowError:
        return Single(math.copysign(math.inf, value))


class Single(float):
    # An f64 has more than twice the digits of an f32, so to round twice is to round once.
    def __add__(self, other):
        return single(float.__add__(self, other))

    def __sub__(self, other):
        return single(float.__sub__(self, other))

    def __mul__(self, other):
        return single(float.__mul__(self, other))

    def __truediv__(self, other):
        if other != 0:
            return single(float.__truediv__(self, other))
        sign = math.copysign(1, self) * math.copysign(1, other)
        return Single(math.nan if self == 0 or math.isnan(self) else sign * math.inf)

    __radd__, __rmul__ = __add__, __mul__

    def exponent(self):
        """The bits above the 23 lowest, which are the sign and the exponent."""
        return int.from_bytes(FORMAT.pack(self), "little") >> 23


def vector(numbers):
    """Three whole numbers of at most 24 bits."""
    return tuple(map(Single, numbers))


def add(a, b):
    return tuple(x + y for x, y in zip(a, b))


def sub(a, b):
    return tuple(x - y for x, y in zip(a, b))


def times(a, by):
    return tuple(x * by for x in a)


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def products(a):
    """xx, xy, xz, yy, yz, zz."""
    x, y, z = a
    return x * x, x * y, x * z, y * y, y * z, z * z


def larger(a, b):
    """The larger number, or b if one is not a number."""
    return a if a > b else b


def nearest(value, limit=1 << 20):
    """The nearest whole number, the even one of two, between both limits. What is not a number becomes the lower one."""
    value = value if value > -limit else -limit
    return Single(round(value if value < limit else limit))
