#!/usr/bin/env python3
"""Compares the drawn heights of a city's finest nodes with an elevation model at random points.

drawn_terrain.py CITY DEM.tif [--points 100000] [--error M] [--seed S]

CITY is baked from the model alone. Tiles are decoded by `tile_decoder` and the model by
rasterio, so neither shares code with Insula. The height between the model's points is bilinear, on triangles it can be both
of two diagonals; so points are the model's own, moved by at most --within of their distance. Prints percentiles of the
distances in metres and in cells. With --error, exits with 1 if the 95th percentile is larger.

Needs: numpy, rasterio; zstandard or the program `zstd`
"""
import argparse, json, pathlib, sys

from tile_decoder.blockmap import read_blockmap
from tile_decoder.container import read_archive, read_container
from tile_decoder.shapes import CLIPPED, INCLINED, OCCUPIED

SIDE = 64
STEPS_PER_CELL = 16


def normal_of(code):
    """A unit vector from an octahedral code (Cigolle and others 2014)."""
    x, y = ((min(byte, 254) - 127) / 127 for byte in (code & 255, code >> 8))
    z = 1 - abs(x) - abs(y)
    if z < 0:
        x, y = (1 - abs(y)) * (1 if x >= 0 else -1), (1 - abs(x)) * (1 if y >= 0 else -1)
    length = (x * x + y * y + z * z) ** 0.5
    return x / length, y / length, z / length


class Columns:
    """The finest columns of a city, decoded when they are first needed."""

    def __init__(self, city):
        self.manifest = json.loads((city / "city.json").read_text())
        self.packed = {(z, x, y): data for z, x, y, data in read_archive(city / "blockmaps.pmtiles")}
        self.decoded = {}

    def node_side_m(self, level):
        return self.manifest["root_side_m"] / 2**level

    def tile(self, x, y):
        """The finest node at a position, with its place; None beside all nodes."""
        for level in range(self.manifest["depth"], -1, -1):
            side_m = self.node_side_m(level)
            place = tuple(int((at - corner) // side_m) for at, corner in zip((x, y), self.manifest["origin"]))
            if (node := (level, *place)) in self.packed:
                if node not in self.decoded:
                    _, tile_id, sections = read_container(self.packed[node])
                    self.decoded[node] = read_blockmap(tile_id, sections)[0]
                return self.decoded[node], side_m, place
        return None

    def height_m(self, x, y):
        """World height of the top at a position; None without a column."""
        if (found := self.tile(x, y)) is None:
            return None
        tile, side_m, place = found
        origin = self.manifest["origin"]
        cells = [((at - corner) / side_m - k) * SIDE for at, corner, k in zip((x, y), origin, place)]
        column, row = (min(int(cell), SIDE - 1) for cell in cells)
        i = row * SIDE + column
        if not tile.has(i, OCCUPIED) or tile.has(i, CLIPPED):
            return None
        top = tile.z_base_cells * tile.cell_m + tile.z_max[i] * tile.cell_m / STEPS_PER_CELL * 2**tile.z_shift
        if tile.has(i, INCLINED):
            nx, ny, nz = normal_of(tile.normal[i])
            dx, dy = cells[0] - column - 0.5, cells[1] - row - 0.5
            top -= (nx * dx + ny * dy) / nz * tile.cell_m
        return origin[2] + top


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("city", type=pathlib.Path)
    parser.add_argument("dem", type=pathlib.Path)
    parser.add_argument("--points", type=int, default=100_000)
    parser.add_argument("--within", type=float, default=0.1, help="share of the distance of the model's points, default 0.1")
    parser.add_argument("--error", type=float, help="largest 95th percentile in metres")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    import numpy as np, rasterio
    from rasterio import warp

    drawn_columns, dem = Columns(options.city), rasterio.open(options.dem)
    heights, crs = dem.read(1, masked=True), rasterio.CRS.from_user_input(drawn_columns.manifest["crs"])
    # The model's points within the city.
    low, high = (corner[:2] for corner in drawn_columns.manifest["bounds"])
    left, bottom, right, top = warp.transform_bounds(crs, dem.crs, *low, *high)
    (left, top), (right, bottom) = ~dem.transform * (left, top), ~dem.transform * (right, bottom)
    rng = np.random.default_rng(options.seed)
    columns = rng.integers(max(int(left) + 1, 1), min(int(right) - 1, dem.width - 2), 2 * options.points)
    rows = rng.integers(max(int(top) + 1, 1), min(int(bottom) - 1, dem.height - 2), 2 * options.points)
    moved = rng.uniform(-options.within, options.within, (2 * options.points, 2))
    places = warp.transform(dem.crs, crs, *(dem.transform * (columns + 0.5 + moved[:, 0], rows + 0.5 + moved[:, 1])))
    cell_m = drawn_columns.manifest["cell_m"]
    distances, missing = [], 0
    for column, row, (dx, dy), x, y in zip(columns, rows, moved, *places):
        inside = all(a + cell_m < at < b - cell_m for a, at, b in zip(low, (x, y), high))
        x0, y0 = column - (dx < 0), row - (dy < 0)
        square = heights[y0 : y0 + 2, x0 : x0 + 2]
        if not inside or square.mask.any() or len(distances) == options.points:
            continue
        fx, fy = dx - np.floor(dx), dy - np.floor(dy)
        model = (square * np.outer([1 - fy, fy], [1 - fx, fx])).sum()
        drawn = drawn_columns.height_m(x, y)
        if drawn is None:
            missing += 1
        else:
            distances.append(abs(drawn - float(model)))
    shares = [50, 95, 99, 99.9, 100]
    values = np.percentile(distances, shares)
    print(f"{len(distances)} points, {missing} without a column, cells of {cell_m:g} m")
    for share, value in zip(shares, values):
        print(f"{share:>5}%  {value:.3f} m  {value / cell_m:.3f} cells")
    if missing > options.points // 1000 or (options.error is not None and values[1] > options.error):
        sys.exit("the drawn terrain is too far from the model")


if __name__ == "__main__":
    main()
