#!/usr/bin/env python3
"""What objects cost: the bytes of their sections in the tiles of a baked city, and of their attributes.

Prints, for leaves, parents and meshes, the bytes of all tiles, of their sections of objects with their table entries, and the second
as a share of the rest; then the bytes of `objects.pmtiles` for each object.
"""
import argparse, json, pathlib

from tile_decoder.container import read_archive, read_container

BLOCKMAP_OBJECTS, MESH_OBJECTS = 5, 4
# Of a section below 251 bytes in a tile's table: tag, packing, two lengths, checksum.
ENTRY_BYTES = 9


def sections(path, tag, keep):
    """Number and bytes of tiles, and bytes of their section `tag`."""
    tiles = total = objects = 0
    for level, _, _, data in read_archive(path):
        if not keep(level):
            continue
        tiles, total = tiles + 1, total + len(data)
        section = read_container(data)[-1].get(tag)
        objects += len(section) + ENTRY_BYTES if section else 0
    return tiles, total, objects


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("city", type=pathlib.Path, metavar="CITY", help="folder of a baked city")
    city = parser.parse_args().city
    depth = json.loads((city / "city.json").read_text())["depth"]
    rows = [
        ("leaves", "blockmaps", BLOCKMAP_OBJECTS, lambda level: level == depth),
        ("parents", "blockmaps", BLOCKMAP_OBJECTS, lambda level: level < depth),
        ("meshes", "meshes", MESH_OBJECTS, lambda level: True),
    ]
    for name, archive, tag, keep in rows:
        path = city / f"{archive}.pmtiles"
        if not path.exists():
            continue
        tiles, total, objects = sections(path, tag, keep)
        share = 100 * objects / max(total - objects, 1)
        print(f"{name}: {tiles} tiles, {total} bytes, objects {objects} ({objects / max(tiles, 1):.0f} a tile), {share:.2f}% more")
    path = city / "objects.pmtiles"
    schema = next(data for level, _, _, data in read_archive(path) if level == 0)
    objects = json.loads(read_container(schema)[-1][1])["objects"]
    size = path.stat().st_size
    print(f"objects.pmtiles: {size} bytes, {size / objects:.1f} an object")


if __name__ == "__main__":
    main()
