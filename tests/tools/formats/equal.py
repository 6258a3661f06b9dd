#!/usr/bin/env python3
"""Bakes files that have the same objects in several formats, and compares the columns of the cities.

    equal.py FILE... --crs EPSG:32654 --program target/release/insula-server [--tiles 100] [--steps 1]

Columns are decoded by tests/tools/tile_decoder. Compares each city with the first one: which leaves exist, and in leaves that
are not equal byte for byte (of these at most --tiles, chosen at random) which columns exist and their heights, to --steps of
1/16 of a cell. Colours are not compared: they follow from identifiers, which some formats do not have. Exits with 1 if a leaf
or a column differs.

Needs only Python.
"""
import argparse, json, pathlib, random, subprocess, sys, tempfile

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))


def bake(file, city, options):
    command = [options.program, "bake", file, "--out", str(city), "--crs", options.crs, "--ground", "none", "--no-meshes"]
    made = subprocess.run(command, capture_output=True, text=True)
    if made.returncode:
        sys.exit(f"{file}: {made.stderr.strip()}")


def leaves(city):
    """The manifest, and tiles of the finest level by their world place in whole nodes."""
    from tile_decoder.container import read_archive
    manifest = json.loads((city / "city.json").read_text())
    depth = manifest["depth"]
    return manifest, {(x, y): data for z, x, y, data in read_archive(city / "blockmaps.pmtiles") if z == depth}


def heights(data):
    """Lowest and highest height of each column of a leaf, in sixteenths of a cell above the city's origin."""
    from tile_decoder.blockmap import read_blockmap
    from tile_decoder.container import read_container
    from tile_decoder.shapes import COLUMNS, OCCUPIED
    _, tile_id, sections = read_container(data)
    tile, _ = read_blockmap(tile_id, sections)
    scale, base = 1 << tile.z_shift, tile.z_base_cells * 16
    return {i: (base + tile.z_min[i] * scale, base + tile.z_max[i] * scale) for i in range(COLUMNS) if tile.has(i, OCCUPIED)}


def differences(ours, other, options):
    """Columns of both leaves, and those that only one has or whose heights differ."""
    a, b = heights(ours), heights(other)
    differ = sum(1 for i in a.keys() | b.keys()
                 if i not in a or i not in b or max(abs(p - q) for p, q in zip(a[i], b[i])) > options.steps)
    return len(a.keys() | b.keys()), differ


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", metavar="FILE")
    parser.add_argument("--crs", required=True)
    parser.add_argument("--program", required=True)
    parser.add_argument("--tiles", type=int, default=100)
    parser.add_argument("--steps", type=int, default=1)
    options = parser.parse_args()
    head = ["file", "objects", "leaves", "equal bytes", "only in one", "decoded", "columns", "differ"]
    print(f"| {' | '.join(head)} |\n|{'---|' * len(head)}")
    first, same = None, True
    with tempfile.TemporaryDirectory() as scratch:
        for number, file in enumerate(options.files):
            city = pathlib.Path(scratch, f"city{number}")
            bake(file, city, options)
            manifest, tiles = leaves(city)
            first = first or (manifest, tiles)
            if any(manifest[key] != first[0][key] for key in ("origin", "root_side_m", "depth", "cell_m")):
                sys.exit(f"{file}: the city has another origin or size than that of {options.files[0]}")
            alone = len(tiles.keys() ^ first[1].keys())
            changed = [at for at in sorted(tiles.keys() & first[1].keys()) if tiles[at] != first[1][at]]
            equal = len(tiles.keys() & first[1].keys()) - len(changed)
            chosen = random.Random(0).sample(changed, min(options.tiles, len(changed)))
            counts = [differences(first[1][at], tiles[at], options) for at in chosen]
            columns, differ = (sum(of) for of in zip(*counts)) if counts else (0, 0)
            same &= not alone and not differ
            name, objects = pathlib.Path(file).name, manifest["counts"]["objects"]
            row = [name, objects, len(tiles), equal, alone, len(chosen), columns, differ]
            print(f"| {' | '.join(map(str, row))} |", flush=True)
    sys.exit(not same)


if __name__ == "__main__":
    main()
