"""Columns that readers make from the ground section (docs/formats.md, "Where a square has ground")."""
from .ground import ground_at, half_up, surface_heights
from .shapes import (CODE_MAX, COLUMNS, EXPOSED, GAP, INCLINED, OCCUPIED, REFLECTIVE, SIDE, SUSPENDED, clamp)

COLOUR = (190, 191, 186)
MAX_TEXELS = 1 << 20


def stand_on_ground(tile, ground):
    """Changes the tile's columns to those with the ground, unless these would have too many strip texels."""
    without_ground = {name: list(value) for name, value in vars(tile).items() if isinstance(value, list)}
    heights = surface_heights(ground)
    for i in range(COLUMNS):
        point = ground_at(ground, heights, i % SIDE + 0.5, i // SIDE + 0.5)
        if point is None:
            continue
        made = ground_column(tile, point)
        margin = tile.codes_per_cell if tile.has(i, REFLECTIVE) else 0
        if not tile.has(i, OCCUPIED) or tile.z_max[i] + margin <= made["z_max"]:
            put_ground(tile, i, made)
        else:
            extend(tile, i, made)
    if sum(len(strip) for strip in tile.strip if strip) > MAX_TEXELS:
        vars(tile).update(without_ground)


def ground_column(tile, point):
    z, (east, north), ao = point
    code = lambda z: clamp(half_up(z * tile.codes_per_cell), 0, CODE_MAX)
    rise = (abs(east) + abs(north)) / 2
    z_max = max(1, code(z))
    return {
        "z_max": z_max, "z_min": min(code(z - rise - 1), z_max - 1), "rise": rise, "roof": (*COLOUR, ao, 3),
    }


def put_ground(tile, i, made):
    tile.flags[i] = OCCUPIED | (INCLINED if made["rise"] > 0 else 0)
    tile.z_min[i], tile.z_max[i], tile.roof[i] = made["z_min"], made["z_max"], made["roof"]
    tile.gap[i] = tile.clip[i] = tile.strip[i] = tile.thin[i] = None


def extend(tile, i, made):
    """Continues a column down to the ground, and fills what is beyond its clip."""
    if tile.thin[i] and extend_thin(tile, i, made):
        return
    foot = tile.z_min[i]
    if foot > made["z_min"]:
        lower(tile, i, made)
        if hangs(tile, i, foot - made["z_max"]):
            tile.gap[i] = made["z_max"], foot
            tile.flags[i] |= GAP | EXPOSED
            tile.strip[i] = tile.strip[i] or [tile.roof[i]] * tile.rows(i)[1]
    if tile.clip[i] is not None:
        outer = tile.clip[i]["outer"]
        is_covered = outer is not None and outer[0] > made["z_max"]
        if not is_covered and tile.z_min[i] < made["z_max"] < tile.z_max[i]:
            tile.clip[i] = tile.clip[i] | {"outer": (made["z_max"], made["roof"])}


def extend_thin(tile, i, made):
    """The same for a thin column, with the ground below what is thin. False if only the rest of the column is left to extend."""
    top, foot = tile.gap[i] or (tile.z_min[i], tile.z_min[i])
    if tile.gap[i] and top > made["z_max"]:
        if hangs(tile, i, tile.z_min[i] - made["z_max"]):
            tile.z_max[i], tile.gap[i], tile.thin[i] = top, None, None
            tile.flags[i] &= ~GAP
            tile.strip[i] = tile.strip[i][:tile.rows(i)[1]]
            return False
        lower(tile, i, made)
        return True
    foot = max(foot, made["z_max"] + 1)
    if tile.z_max[i] <= foot:
        put_ground(tile, i, made)
        return True
    lower(tile, i, made)
    hidden = (made["z_max"] - 1) // tile.codes_per_cell + 1 - tile.rows(i)[0]
    tile.strip[i][:hidden] = [made["roof"]] * hidden
    tile.gap[i] = made["z_max"], foot
    tile.flags[i] |= GAP
    return True


def lower(tile, i, made):
    """Continues a column and its wall down to the bottom of the ground."""
    old_first, _ = tile.rows(i)
    tile.z_min[i] = min(tile.z_min[i], made["z_min"])
    if tile.strip[i] is not None:
        added = next((texel for texel in tile.strip[i] if texel[4] == 3), tile.roof[i])
        tile.strip[i] = [added] * (old_first - tile.rows(i)[0]) + tile.strip[i]


def hangs(tile, i, above):
    """Whether a column whose bottom is so many codes above the ground does not stand on it."""
    code_m = tile.cell_m / 16 * 2 ** tile.z_shift
    return tile.has(i, SUSPENDED) and above > 1 or above > max(3 / code_m, tile.codes_per_cell)
