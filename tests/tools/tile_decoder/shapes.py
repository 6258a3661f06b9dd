"""Shapes of a V-BlockMap's columns (docs/formats.md, "The columns section", passes `tops`, `bottoms`, `facades`, `walls`).

Columns are numbered row-major. A neighbour outside the node does not exist.
"""
import math
from .container import BadTile
from .range_coder import bit_model, bit_models, number_models

SIDE = 64
COLUMNS = SIDE * SIDE
CODE_MAX = 4095
OCCUPIED, EXPOSED, INCLINED, GAP, HOLES, SUSPENDED, CLIPPED, REFLECTIVE = (1 << k for k in range(8))
PLANE = OCCUPIED | INCLINED
UP = 0x7F7F
RECENT = 16
# The eight neighbours in facade order.
AROUND = [(1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)]
SIDES = AROUND[:4]
# West, south, south-west, south-east.
KNOWN = [(-1, 0), (0, -1), (-1, -1), (1, -1)]


def clamp(value, low, high):
    return max(low, min(high, value))


def loco_i(a, b, c):
    """A + B - C, clamped to lie between A and B."""
    return clamp(a + b - c, min(a, b), max(a, b))


def neighbour(i, dx, dy):
    x, y = i % SIDE + dx, i // SIDE + dy
    return y * SIDE + x if 0 <= x < SIDE and 0 <= y < SIDE else None


class Map:
    """The values of a node's columns, by column."""

    def __init__(self, cell_m, z_base_cells, z_shift):
        self.cell_m, self.z_base_cells, self.z_shift = cell_m, z_base_cells, z_shift
        self.codes_per_cell = 16 >> z_shift
        self.flags, self.z_min, self.z_max = [0] * COLUMNS, [0] * COLUMNS, [0] * COLUMNS
        self.normal, self.azimuth = [0] * COLUMNS, [0] * COLUMNS
        self.slope = [(0, 0)] * COLUMNS
        self.gap, self.clip = [None] * COLUMNS, [None] * COLUMNS
        # Texels are (r, g, b, ao, coverage).
        self.roof, self.strip = [None] * COLUMNS, [None] * COLUMNS
        # Shares of the sides and of the top of thin columns, in 256ths.
        self.thin = [None] * COLUMNS
        # The numbers of the objects that the columns show, if the tile has them.
        self.objects = None

    def has(self, i, flag):
        return i is not None and self.flags[i] & flag != 0

    def plane_at(self, i, dx, dy):
        """The height code of the plane of a column's top, some cells from its centre."""
        return self.z_max[i] + (self.slope[i][0] * dx + self.slope[i][1] * dy + 8 >> 4)

    def rows(self, i):
        """First row and number of rows of a column's wall strip."""
        k = self.codes_per_cell
        return self.z_min[i] // k, (self.z_max[i] - 1) // k + 1 - self.z_min[i] // k


# Pass `tops`


def slope_of(normal, codes_per_cell):
    """Rise per cell to the east and north in sixteenths of a height code."""
    u, v = min(normal & 255, 254) - 127, min(normal >> 8, 254) - 127
    up = 127 - abs(u) - abs(v)
    if up <= 0:
        return 0, 0
    return tuple(clamp((-w * codes_per_cell * 32 + up) // (2 * up), -4096, 4096) for w in (u, v))


def read_tops(coder, tile):
    occupied_groups = read_occupied_groups(coder)
    shares = [(flag, coder.group(bit_models(2)), bit_models(9)) for flag in (SUSPENDED, INCLINED)]
    occupied_models, height_models, normals = bit_models(16), number_models(10), NormalReader(coder, tile)
    last = 0
    for i in range(COLUMNS):
        group = occupied_groups[i // SIDE // 8 * 8 + i % SIDE // 8]
        known = [neighbour(i, dx, dy) for dx, dy in KNOWN]
        pattern = sum(tile.has(j, OCCUPIED) << k for k, j in enumerate(known))
        if not coder.member(group, occupied_models[pattern]):
            continue
        flags = OCCUPIED
        for flag, share, models in shares:
            state = [tile.has(j, OCCUPIED) + tile.has(j, flag) for j in known[:2]]
            if coder.member(share, models[state[0] * 3 + state[1]]):
                flags |= flag
        tile.flags[i] = flags
        tile.normal[i] = normals.read(i, [j for j in known if tile.has(j, OCCUPIED)])
        if flags & INCLINED:
            tile.slope[i] = slope_of(tile.normal[i], tile.codes_per_cell)
        expected, confidence = predict_top(tile, i, known, last)
        model = height_models[confidence + (5 if flags & INCLINED else 0)]
        last = tile.z_max[i] = clamp(expected + coder.number(model), 0, 65535)


def read_occupied_groups(coder):
    """The group flags of the 8 x 8 groups of 8 x 8 columns. Groups outside the node count as mixed."""
    models, groups = [bit_models(2) for _ in range(9)], []
    for at in range(64):
        west = groups[at - 1] if at % 8 else 2
        south = groups[at - 8] if at >= 8 else 2
        groups.append(coder.group(models[west * 3 + south]))
    return groups


class NormalReader:
    def __init__(self, coder, tile):
        self.coder, self.tile, self.recent = coder, tile, []
        self.same = [bit_models(4) for _ in range(4)]
        self.is_recent = bit_models(2)
        self.place = [bit_models(RECENT - 1) for _ in range(2)]
        self.bytes = number_models(2)

    def read(self, i, known):
        tile = self.tile
        inclined = int(tile.has(i, INCLINED))
        tried = []
        for j in known:
            normal = tile.normal[j]
            if (tile.flags[i] ^ tile.flags[j]) & PLANE or normal in tried:
                continue
            agreeing = sum(tile.normal[k] == normal for k in known)
            if self.coder.bit(self.same[(2 if tried else 0) + inclined][agreeing - 1]):
                return normal
            tried.append(normal)
        normal = self.read_other(inclined, tried[0] if tried else UP)
        if normal in self.recent:
            self.recent.remove(normal)
        self.recent = [normal] + self.recent[:RECENT - 1]
        return normal

    def read_other(self, inclined, near):
        if self.coder.bit(self.is_recent[inclined]):
            place = self.coder.choice(self.place[inclined])
            return self.recent[place] if place < len(self.recent) else 0
        u, v = (((near >> 8 * k) + self.coder.number(self.bytes[k])) & 255 for k in range(2))
        return u | v << 8


def predict_top(tile, i, known, last):
    """The expected height code of a top, and how sure it is (0 to 4)."""
    west, south, south_west, _ = known
    planes = [
        tile.plane_at(j, -dx, -dy) for j, (dx, dy) in zip(known, KNOWN)
        if tile.has(j, OCCUPIED) and tile.normal[j] == tile.normal[i] and not (tile.flags[i] ^ tile.flags[j]) & PLANE
    ]
    if not planes:
        w, s, sw = (tile.has(j, OCCUPIED) for j in (west, south, south_west))
        if w and s and sw:
            expected = loco_i(tile.z_max[west], tile.z_max[south], tile.z_max[south_west])
        else:
            expected = tile.z_max[west] if w else tile.z_max[south] if s else last
        confidence = 0
    elif len(planes) == 1:
        expected, confidence = planes[0], 1
    elif max(planes) - min(planes) > 2:
        expected, confidence = planes[0], 2
    else:
        # The mean, rounded to the nearest integer, halves up.
        expected = (2 * sum(planes) + len(planes)) // (2 * len(planes))
        confidence = 4 if max(planes) == min(planes) else 3
    return clamp(expected, 0, CODE_MAX), confidence


# Pass `bottoms`


def read_bottoms(coder, tile):
    is_ground, near_ground, heights = bit_models(18), bit_models(18), number_models(4)
    lowest = [lowest_point(tile, i) for i in range(COLUMNS)]
    # 0: no column; 1: nearer to the neighbour's bottom; 2: nearer to the ground.
    nearer = [0] * COLUMNS
    last = 0
    for i in range(COLUMNS):
        if not tile.has(i, OCCUPIED):
            continue
        around = (neighbour(i, dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1))
        ground = min(lowest[j] for j in around if j is not None) - tile.codes_per_cell // 4
        ground = clamp(ground, 0, CODE_MAX)
        west, south = neighbour(i, -1, 0), neighbour(i, 0, -1)
        of_west, of_south = (0 if j is None else nearer[j] for j in (west, south))
        beside = tile.z_min[west] if of_west else tile.z_min[south] if of_south else last
        suspended, inclined = int(tile.has(i, SUSPENDED)), int(tile.has(i, INCLINED))
        context = suspended * 9 + of_west * 3 + of_south
        if coder.bit(is_ground[context]):
            nearer[i], z = 2, ground
        elif coder.bit(near_ground[context]):
            nearer[i], z = 2, ground + coder.number(heights[2 + inclined])
        else:
            nearer[i], z = 1, beside + coder.number(heights[suspended])
        last = tile.z_min[i] = clamp(z, 0, 65535)


def lowest_point(tile, i):
    """The height code of the lowest point of a top inside its cell."""
    if not tile.has(i, OCCUPIED):
        return math.inf
    return tile.z_max[i] - ((abs(tile.slope[i][0]) + abs(tile.slope[i][1])) * 3 >> 7)


# Pass `facades`

CLASS_ENDS = [-12, -6, -3, -1, 0, 2, 5, 12, 32]


def read_exposed(coder, tile):
    group_models = [bit_models(2) for _ in range(20)]
    groups = [coder.group(models) for models in group_models]
    models = bit_models(20)
    for i in range(COLUMNS):
        if tile.has(i, OCCUPIED):
            openness = class_of_openness(tile, i)
            if coder.member(groups[openness], models[openness]):
                tile.flags[i] |= EXPOSED
    check_heights(tile)


def class_of_openness(tile, i):
    """0 to 9 by the codes that stand free on the most open side; 10 more on the node's rim."""
    low, high = tile.z_min[i], tile.z_max[i]
    open_codes = 0
    for dx, dy in SIDES:
        j = neighbour(i, dx, dy)
        if j is not None:
            covered = min(high, tile.z_max[j]) - max(low, tile.z_min[j])
            open_codes = max(open_codes, high - low - max(covered, 0))
    bounds = (tile.codes_per_cell + (end >> tile.z_shift) for end in CLASS_ENDS)
    is_rim = i % SIDE in (0, SIDE - 1) or i // SIDE in (0, SIDE - 1)
    return sum(open_codes > bound for bound in bounds) + (10 if is_rim else 0)


def check_heights(tile):
    for i in range(COLUMNS):
        if tile.has(i, OCCUPIED) and not tile.z_min[i] < tile.z_max[i] <= CODE_MAX:
            raise BadTile("a column's heights are inverted or out of range")


def facade_order(tile):
    """"Facade order": the exposed columns with their predecessors."""
    visited, order = set(), []
    for start in range(COLUMNS):
        stack = [(start, None)]
        while stack:
            i, predecessor = stack.pop()
            if i in visited or not tile.has(i, EXPOSED):
                continue
            visited.add(i)
            order.append((i, predecessor))
            stack += [(j, i) for j in (neighbour(i, dx, dy) for dx, dy in reversed(AROUND)) if j is not None]
    return order


# Pass `walls`


def direction(azimuth):
    """The unit vector of an azimuth, each component rounded to 1/16384."""
    turn = 2 * math.pi * azimuth / 256
    return tuple(round(16384 * v) for v in (math.cos(turn), math.sin(turn)))


def facing_of(azimuth):
    """The neighbour that a wall faces: directions within 67.5 degrees of an axis count."""
    return tuple((v > 0) - (v < 0) if abs(v) > 6270 else 0 for v in direction(azimuth))


def read_walls(coder, tile, order):
    WallReader(coder, tile).read(order)


class WallReader:
    def __init__(self, coder, tile):
        self.coder, self.tile = coder, tile
        self.azimuths = AzimuthReader(coder)
        self.gap_height = number_models(2)
        self.offset, self.corner_offset = number_models(2), number_models(2)
        self.corner, self.concave = bit_models(4), bit_model()
        self.outer, self.outer_height = bit_models(6), number_models(3)
        self.coded = set()

    def read(self, order):
        coder, tile = self.coder, self.tile
        flags = [(flag, coder.group(bit_models(2)), bit_models(3)) for flag in (GAP, HOLES, CLIPPED)]
        for i, predecessor in order:
            for flag, share, models in flags:
                context = 0 if predecessor is None else 1 + tile.has(predecessor, flag)
                if coder.member(share, models[context]):
                    tile.flags[i] |= flag
            nearby = self.nearby_walls(i, predecessor)
            tile.azimuth[i] = self.azimuths.read(list(nearby), None)
            if tile.has(i, GAP):
                tile.gap[i] = self.read_gap(i, predecessor)
            if tile.has(i, CLIPPED):
                tile.clip[i] = self.read_clip(i, predecessor, nearby)
            self.coded.add(i)

    def nearby_walls(self, i, predecessor):
        """Offsets by azimuth of the walls of coded neighbours, continued to column i; None for walls without a plane."""
        around = [neighbour(i, dx, dy) for dx, dy in AROUND]
        others = [j for j in around if j in self.coded and j != predecessor]
        walls = {}

        def add(azimuth, offset):
            if walls.get(azimuth) is None:
                walls[azimuth] = offset

        for j in ([] if predecessor is None else [predecessor]) + others:
            clip = self.tile.clip[j]
            if clip is None:
                add(self.tile.azimuth[j], None)
                continue
            add(self.tile.azimuth[j], continued(j, i, self.tile.azimuth[j], clip["offset"]))
            if clip["corner"]:
                azimuth, offset, _ = clip["corner"]
                add(azimuth, continued(j, i, azimuth, offset))
        return walls

    def read_gap(self, i, predecessor):
        known = None if predecessor is None else self.tile.gap[predecessor]
        if known in (None, (0, 0)):
            known = self.tile.z_min[i], self.tile.z_max[i]
        return tuple(clamp(known[k] + self.coder.number(self.gap_height[k]), 0, 65535) for k in range(2))

    def read_clip(self, i, predecessor, nearby):
        azimuth = self.tile.azimuth[i]
        return {
            "offset": self.read_offset(self.offset, nearby, azimuth),
            "corner": self.read_corner(nearby, azimuth),
            "outer": self.read_outer(i, predecessor),
        }

    def read_offset(self, models, nearby, azimuth):
        known = nearby.get(azimuth)
        expected, model = (0, 1) if known is None else (known, 0)
        return clamp(expected + self.coder.number(models[model]), -128, 127)

    def read_corner(self, nearby, own):
        has_other, has_same = any(azimuth != own for azimuth in nearby), own in nearby
        if not self.coder.bit(self.corner[has_other + 2 * has_same]):
            return None
        concave = self.coder.bit(self.concave)
        azimuth = self.azimuths.read(list(nearby), own)
        return azimuth, self.read_offset(self.corner_offset, nearby, azimuth), concave

    def read_outer(self, i, predecessor):
        """The height code of the outer top, or None."""
        tile, facing = self.tile, facing_of(self.tile.azimuth[i])
        before = tile.clip[predecessor] if predecessor is not None else None
        context = 0 if before is None else 1 + (before["outer"] is not None)
        faces_column = tile.has(neighbour(i, *facing), OCCUPIED)
        if not self.coder.bit(self.outer[context * 2 + faces_column]):
            return None
        expected, model = self.lower_top(i, facing), 0
        if expected is None:
            expected, model = (before["outer"], 1) if before and before["outer"] is not None else (tile.z_min[i], 2)
        ends = tile.z_min[i] + 1, tile.z_max[i] - 1
        expected = clamp(expected, min(ends), max(ends))
        return clamp(expected + self.coder.number(self.outer_height[model]), 0, CODE_MAX)

    def lower_top(self, i, facing):
        """The top of the first of the two columns in front of the wall that is more than half a row lower."""
        tile = self.tile
        for k in (1, 2):
            dx, dy = facing[0] * k, facing[1] * k
            j = neighbour(i, dx, dy)
            if tile.has(j, OCCUPIED):
                top = clamp(tile.plane_at(j, -dx, -dy), 0, CODE_MAX)
                if top < tile.z_max[i] - tile.codes_per_cell // 2:
                    return top
        return None


def continued(j, i, azimuth, offset):
    """The offset from column i's centre of a plane that has `offset` from column j's."""
    nx, ny = direction(azimuth)
    along = nx * (j % SIDE - i % SIDE) + ny * (j // SIDE - i // SIDE)
    return offset + (along * 128 + 8192 >> 14)


class AzimuthReader:
    """Models are for a column's own wall, then for a corner's."""

    def __init__(self, coder):
        self.coder, self.recent = coder, []
        self.nearby = [bit_models(3) for _ in range(2)]
        self.is_recent = bit_models(2)
        self.place = [bit_models(RECENT - 1) for _ in range(2)]
        self.turn = number_models(2)

    def read(self, nearby, own):
        """`own` is the azimuth of the column's own wall if this is a corner's."""
        coder, is_corner = self.coder, int(own is not None)
        for k, azimuth in enumerate(azimuth for azimuth in nearby if azimuth != own):
            if coder.bit(self.nearby[is_corner][min(k, 2)]):
                return azimuth
        if coder.bit(self.is_recent[is_corner]):
            place = coder.choice(self.place[is_corner])
            if not self.recent:
                return 0
            azimuth = self.recent.pop(min(place, len(self.recent) - 1))
        else:
            latest = self.recent[0] if self.recent else 0
            azimuth = latest + coder.number(self.turn[is_corner]) & 255
        self.recent = [azimuth] + self.recent[:RECENT - 1]
        return azimuth
