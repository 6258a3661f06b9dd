"""V-BlockMap tile (docs/formats.md, "V-BlockMap tile")."""
import math
from .appearance import read_appearance
from .container import BadTile, Bytes
from .ground import read_ground
from .object_names import read_column_objects
from .range_coder import RangeReader, bit_models, number_models
from .shapes import (CLIPPED, COLUMNS, EXPOSED, HOLES, INCLINED, OCCUPIED, REFLECTIVE, Map, clamp, facade_order, neighbour, read_bottoms, read_exposed, read_tops,
                     read_walls)


def read_blockmap(tile_id, sections):
    """Returns the columns as the tile has them, and its ground or None."""
    if tile_id is not None:
        raise BadTile("a V-BlockMap tile has an id")
    tile, luma_step, ao_step = read_meta(Bytes(sections.get(1, b"")))
    read_columns(sections.get(2, b""), tile, luma_step, ao_step)
    ground = read_section(sections[3], read_ground) if 3 in sections else None
    if 4 in sections:
        read_section(sections[4], lambda coder: read_reflective(coder, tile))
    if 5 in sections:
        tile.objects = read_column_objects(sections[5], tile)
    if 6 in sections:
        read_section(sections[6], lambda coder: read_thin(coder, tile))
    check_columns(tile)
    return tile, ground


def check_columns(tile):
    """The rules of "Columns" that passes do not ensure."""
    for i in (i for i in range(COLUMNS) if tile.has(i, OCCUPIED)):
        low, high, gap, clip = tile.z_min[i], tile.z_max[i], tile.gap[i], tile.clip[i]
        if gap and not low < gap[0] < gap[1] < high:
            raise BadTile("a gap lies outside its column")
        if clip and clip["outer"] and not low < clip["outer"][0] < high:
            raise BadTile("an outer top is not between its column's ends")


def read_section(data, read):
    coder = RangeReader(data)
    result = read(coder)
    coder.finish()
    return result


def read_meta(reader):
    """The table "offset in meta"."""
    cell_m, z_base_cells, z_shift = reader.one("f"), reader.one("i"), reader.one("B")
    luma_step, ao_step = reader.one("H"), reader.one("B")
    reader.finish()
    if not (0 < cell_m < math.inf and z_shift <= 4 and 4 <= luma_step <= 512 and 1 <= ao_step <= 63):
        raise BadTile("a number in meta is out of range")
    return Map(cell_m, z_base_cells, z_shift), luma_step, ao_step


def read_columns(data, tile, luma_step, ao_step):
    """"The columns section": its passes."""
    coder = RangeReader(data)
    read_tops(coder, tile)
    read_bottoms(coder, tile)
    read_exposed(coder, tile)
    order = facade_order(tile)
    read_walls(coder, tile, order)
    read_appearance(coder, tile, order, luma_step, ao_step)
    coder.finish()


def read_reflective(coder, tile):
    """"The reflective section"."""
    share, models = coder.group(bit_models(2)), bit_models(3)
    for i in range(COLUMNS):
        if tile.has(i, OCCUPIED):
            before = sum(tile.has(neighbour(i, dx, dy), REFLECTIVE) for dx, dy in ((-1, 0), (0, -1)))
            if coder.member(share, models[before]):
                tile.flags[i] |= REFLECTIVE
    if not any(flags & REFLECTIVE for flags in tile.flags):
        raise BadTile("no column is reflective")


def read_thin(coder, tile):
    """"The thin section"."""
    is_thin, shares, last = bit_models(3), number_models(2), (0, 0)
    for i in range(COLUMNS):
        if tile.flags[i] & (EXPOSED | HOLES | CLIPPED | INCLINED) != EXPOSED | HOLES:
            continue
        west, south = (None if j is None else tile.thin[j] for j in (neighbour(i, -1, 0), neighbour(i, 0, -1)))
        if coder.bit(is_thin[sum(share is not None for share in (west, south))]):
            expected = west or south or last
            side, top = (clamp(expected[k] + coder.number(shares[k]), 0, 255) for k in range(2))
            last = tile.thin[i] = max(side, 1), top
    if not any(tile.thin):
        raise BadTile("no column is thin")
