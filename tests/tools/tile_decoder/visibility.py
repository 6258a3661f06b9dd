"""Visibility tiles (docs/formats.md, "Visibility tiles")."""
import struct

from .container import BadTile
from .range_coder import NumberModel, RangeReader, bit_models

META, SETS = 1, 2
LEVELS_OF_A_TILE = 3
SCALES = 3
UNSEEN, ABSENT = 3, 4
MAX_REACH = 16


def read_visibility(tile_id, sections):
    """The cells of a tile: None for squares without a leaf, otherwise the ground and the lowest layers by leaf square."""
    meta = sections.get(META, b"")
    if len(meta) != 9 or SETS not in sections:
        raise BadTile("a visibility tile has no meta or no sets")
    version, depth, reach, *layers_dm = struct.unpack("<BBB3H", meta)
    level, *place = tile_id
    levels = depth - level
    is_level = levels == LEVELS_OF_A_TILE or 0 <= levels < LEVELS_OF_A_TILE and level == 0
    if version != 1 or reach > MAX_REACH or layers_dm != sorted(layers_dm) or not is_level:
        raise BadTile("the meta of a visibility tile is invalid")
    across = 2 ** levels + 2
    corner = [(v << levels) - 1 for v in place]
    reader, cells, ground = RangeReader(sections[SETS]), [], 0
    exists, grounds, values = bit_models(3), NumberModel(), [[bit_models(3) for _ in range(125)] for _ in range(SCALES)]
    for index in range(across * across):
        west = cells[index - 1] if index % across else None
        south = cells[index - across] if index >= across else None
        if not reader.bit(exists[(west is not None) + (south is not None)]):
            cells.append(None)
            continue
        ground += reader.number(grounds)
        if not -32768 <= ground <= 32767:
            raise BadTile("a cell's ground is beyond 16 bits")
        leaf = corner[0] + index % across, corner[1] + index // across
        scales = [read_scale(reader, values[s], s, 2 * reach + 1, leaf, west, south) for s in range(SCALES)]
        cells.append({"ground": ground, "seen": scales})
    return {"kind": "visibility", "depth": depth, "reach": reach, "layers_dm": layers_dm, "cells": cells}


def read_scale(reader, models, scale, side, leaf, west, south):
    """The values of one scale: of the squares that are 4 ** `scale` leaves wide."""
    to_east, to_north = ((v >> 2 * scale) - (v - 1 >> 2 * scale) for v in leaf)
    seen = []

    def of(cell, column, row):
        return cell["seen"][scale][row * side + column] if cell and column < side and row < side else ABSENT

    for row in range(side):
        for column in range(side):
            a, b = of(west, column + to_east, row), of(south, column, row + to_north)
            c = seen[-1] if column else ABSENT
            d = seen[-side] if row else ABSENT
            model = models[(a * 5 + b) * 5 + min(c, d)]
            seen.append(next((layer for layer in range(UNSEEN) if reader.bit(model[layer])), UNSEEN))
    return seen
