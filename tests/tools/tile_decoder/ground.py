"""The ground section (docs/formats.md, "The ground section")."""
import math
from .container import BadTile
from .range_coder import bit_models, number_models

SQUARES, VERTICES = 8, 9
MAX_HEIGHT, MAX_SKY = 16380, 7
CORNERS = [(0, 0), (SQUARES, 0), (0, SQUARES), (SQUARES, SQUARES)]


class Ground:
    """Squares with ground, heights in quarters of a cell at the corners of the surface, sky in sevenths."""

    def __init__(self):
        self.squares, self.heights, self.sky = set(), {}, {}

    def touches(self, x, y):
        """Whether a vertex belongs to a square with ground."""
        return any((x - dx, y - dy) in self.squares for dx in (0, 1) for dy in (0, 1))


def middles():
    """Vertices that may halve triangles: (depth, vertex, ends of the halved edge, right angles at that edge)."""
    for depth in range(6):
        half = SQUARES >> depth // 2 + 1
        for y in range(0, VERTICES, half):
            for x in range(0, VERTICES, half):
                odd_x, odd_y = x // half % 2, y // half % 2
                rising = [(x - half, y - half), (x + half, y + half)]
                falling = [(x + half, y - half), (x - half, y + half)]
                level = [(x - half, y), (x + half, y)]
                upright = [(x, y - half), (x, y + half)]
                if depth % 2 == 0 and odd_x and odd_y:
                    is_rising = (x // half // 2 + y // half // 2) % 2 == 0
                    ends, apexes = (rising, falling) if is_rising else (falling, rising)
                elif depth % 2 == 1 and odd_x != odd_y:
                    ends, apexes = (level, upright) if odd_x else (upright, level)
                else:
                    continue
                yield depth, (x, y), ends, [v for v in apexes if 0 <= min(v) and max(v) <= SQUARES]


def read_ground(coder):
    ground = Ground()
    read_squares(coder, ground)
    read_heights(coder, ground)
    read_sky(coder, ground)
    return ground


def read_squares(coder, ground):
    share, models = coder.group(bit_models(2)), bit_models(3)
    for y in range(SQUARES):
        for x in range(SQUARES):
            before = ((x - 1, y) in ground.squares) + ((x, y - 1) in ground.squares)
            if coder.member(share, models[before]):
                ground.squares.add((x, y))
    if not ground.squares:
        raise BadTile("a ground without squares")


def read_heights(coder, ground):
    def check(z):
        if not 0 <= z <= MAX_HEIGHT:
            raise BadTile("a ground's height is out of range")
        return z

    (corner_model,), heights, is_corner, last = number_models(1), number_models(2), bit_models(6), 0
    for vertex in CORNERS:
        last = ground.heights[vertex] = check(last + coder.number(corner_model))
    for depth, vertex, ends, apexes in middles():
        if all(apex in ground.heights for apex in apexes) and coder.bit(is_corner[depth]):
            expected = sum(ground.heights[end] for end in ends) // 2
            ground.heights[vertex] = check(expected + coder.number(heights[depth > 1]))


def read_sky(coder, ground):
    models, last = number_models(2), MAX_SKY
    for y in range(VERTICES):
        for x in range(VERTICES):
            if not ground.touches(x, y):
                continue
            known = [ground.sky[v] for v in ((x - 1, y), (x, y - 1)) if v in ground.sky]
            expected = sum(known) // len(known) if known else last
            is_mixed = len(set(known)) == 2
            last = ground.sky[x, y] = expected + coder.number(models[is_mixed])
            if not 0 <= last <= MAX_SKY:
                raise BadTile("a ground's share of the sky is out of range")


def surface_heights(ground):
    """Heights of all vertices in cells: those that are no corner of the surface lie on it."""
    heights = {vertex: z / 4 for vertex, z in ground.heights.items()}
    for _, vertex, (a, b), _ in middles():
        if vertex not in heights:
            heights[vertex] = (heights[a] + heights[b]) / 2
    return heights


def half_up(value):
    return math.floor(value + 0.5)


def ground_at(ground, heights, x, y):
    """Height, rise to the east and north per cell, and occlusion at a point in cells; None without ground."""
    sx, sy = int(x) // 8, int(y) // 8
    if (sx, sy) not in ground.squares:
        return None
    u, v = x / 8 - sx, y / 8 - sy
    sw, se, nw, ne = (heights[sx + dx, sy + dy] for dy in (0, 1) for dx in (0, 1))
    if (sx + sy) % 2 == 0:
        east, north = (se - sw, ne - se) if u >= v else (ne - nw, nw - sw)
        z = sw + east * u + north * v
    elif u + v <= 1:
        east, north = se - sw, nw - sw
        z = sw + east * u + north * v
    else:
        east, north = ne - nw, ne - se
        z = nw + se - ne + east * u + north * v
    s00, s10, s01, s11 = (ground.sky[sx + dx, sy + dy] for dy in (0, 1) for dx in (0, 1))
    share = ((s00 * (1 - u) + s10 * u) * (1 - v) + (s01 * (1 - u) + s11 * u) * v) / MAX_SKY
    return z, (east / 8, north / 8), half_up(63 * share * (1 - 0.3 * (1 - share)))
