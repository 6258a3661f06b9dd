"""Objects of columns and triangles (docs/formats.md, "The objects section", "Lists and names of objects" and "Mesh tile")."""
from .container import BadTile
from .range_coder import RangeReader, bit_model, bit_models
from .shapes import CLIPPED, COLUMNS, EXPOSED, GAP, OCCUPIED, SIDES, neighbour

NONE = 2 ** 32 - 1
ROOF, WALL, LOWER = range(3)
ASKED = 6
STEP_ENDS = [0, 8, 32]


class NameReader:
    """Reads a section's list, then names."""

    def __init__(self, coder, limit):
        self.coder, self.recent = coder, []
        self.objects = self.read_list(limit)
        self.is_candidate = [[bit_models(ASKED) for _ in range(12)] for _ in range(3)]
        self.is_none = bit_models(3)

    def read_list(self, limit):
        models = bit_models(63), bit_models(63)
        count, objects, least = self.magnitude(models[0]), [], 0
        if not 1 <= count <= limit:
            raise BadTile("a list of objects is empty or too long")
        for _ in range(count):
            objects.append(least + self.magnitude(models[1]))
            least = objects[-1] + 1
        if objects[-1] >= NONE:
            raise BadTile("an object's number is out of range")
        return objects

    def magnitude(self, models):
        count = min(self.coder.choice(models), 32)
        return self.digits(count - 1, 1) if count else 0

    def digits(self, count, value=0):
        for _ in range(count):
            value = value << 1 | self.coder.bit(bit_model())
        return value

    def name(self, part, context, candidates):
        found = self.read(part, context, list(dict.fromkeys([*candidates, *self.recent]))[:ASKED])
        self.recent = [found, *(other for other in self.recent if other != found)][:ASKED]
        return found

    def read(self, part, context, candidates):
        for model, candidate in zip(self.is_candidate[part][context], candidates):
            if self.coder.bit(model):
                return candidate
        if self.coder.bit(self.is_none[part]):
            return NONE
        last = len(self.objects) - 1
        return self.objects[min(self.digits(last.bit_length()), last)]


def step(a, b):
    return sum(abs(a - b) > end for end in STEP_ENDS)


class ColumnObjects:
    """Numbers of objects by column; `NONE` for parts that show none or do not exist."""

    def __init__(self, tile, names):
        self.tile, self.names = tile, names
        self.roof, self.wall, self.lower = ([NONE] * COLUMNS for _ in range(3))

    def read(self):
        tile = self.tile
        for i in range(COLUMNS):
            if tile.has(i, OCCUPIED):
                self.roof[i] = self.read_roof(i)
        for i in range(COLUMNS):
            if tile.has(i, EXPOSED):
                self.wall[i] = self.read_wall(i)
        for i in range(COLUMNS):
            z = lower_top(tile, i)
            if z is not None:
                self.lower[i] = self.read_lower(i, z)
        return self

    def read_roof(self, i):
        tile = self.tile
        beside = [neighbour(i, -1, 0), neighbour(i, 0, -1)]
        steps = [step(tile.z_max[i], tile.z_max[j]) if tile.has(j, OCCUPIED) else 3 for j in beside]
        if steps[1] < steps[0]:
            beside.reverse()
        known = [self.roof[j] for j in beside if tile.has(j, OCCUPIED)]
        agree = len(known) == 2 and known[0] == known[1]
        return self.names.name(ROOF, min(steps) + 4 * agree + 4 * (agree and tile.has(i, EXPOSED)), known)

    def read_wall(self, i):
        tile, habit = self.tile, 0
        for j in (neighbour(i, -1, 0), neighbour(i, 0, -1)):
            if tile.has(j, EXPOSED):
                habit = 2 if self.wall[j] == self.roof[j] else 1
                break
        around = self.around(i, lambda j: -tile.z_max[j])
        known = [self.roof[i], *(self.roof[j] for j in around)]
        return self.names.name(WALL, 2 * habit + tile.has(i, CLIPPED), known)

    def read_lower(self, i, z):
        tile = self.tile
        around = self.around(i, lambda j: abs(tile.z_max[j] - z))
        context = step(tile.z_max[around[0]], z) if around else 3
        return self.names.name(LOWER, context, [*(self.roof[j] for j in around), self.roof[i]])

    def around(self, i, key):
        """The neighbours E, N, W, S that exist, by a key."""
        beside = (neighbour(i, dx, dy) for dx, dy in SIDES)
        return sorted((j for j in beside if self.tile.has(j, OCCUPIED)), key=key)


def lower_top(tile, i):
    """The height of a column's lower top, or None."""
    if tile.has(i, CLIPPED) and tile.clip[i]["outer"]:
        return tile.clip[i]["outer"][0]
    return tile.gap[i][0] if tile.has(i, GAP) else None


def read_column_objects(data, tile):
    coder = RangeReader(data)
    objects = ColumnObjects(tile, NameReader(coder, 3 * COLUMNS)).read()
    coder.finish()
    if set(objects.roof) | set(objects.wall) | set(objects.lower) == {NONE}:
        raise BadTile("a section of objects that no column shows")
    return objects


def read_triangle_objects(data, triangles):
    """The object of each triangle."""
    coder = RangeReader(data)
    names, latest, objects = NameReader(coder, len(triangles)), {}, []
    for t, triangle in enumerate(triangles):
        before = sorted((latest[vertex] for vertex in triangle if vertex in latest), reverse=True)
        known = [objects[other] for other in before]
        objects.append(names.name(ROOF, len(known) + 4 * (len(set(known)) < 2), known))
        latest.update(dict.fromkeys(triangle, t))
    coder.finish()
    if set(objects) == {NONE}:
        raise BadTile("a section of objects that no triangle shows")
    return objects
