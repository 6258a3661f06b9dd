#!/usr/bin/env python3
"""Decodes tiles without Insula's own decoder, which shares its code with the encoder.

decode_tile.py VECTORS_OR_CITY [--tiles N] [--seed S] [--json] [--program INSULA_SERVER]

Decodes all `.bin` files of a folder, or N random V-BlockMap tiles and all subtree tiles of a city folder. Prints one line
per tile: its kind, the CRC-32 of its texels as `protocol/tests/vectors.rs` computes it, and the SHA-256 of all decoded
values as JSON; with --json the values themselves. With --program, compares each V-BlockMap tile of a city with
`inspect --png` and the levels with `inspect --json`. Exits with 1 if a tile cannot be decoded or differs.
Of coded meshes only the fields before the symbols are decoded. Sizes of tiles are compared with the subtree tiles.
"""
import argparse, hashlib, json, pathlib, random, struct, subprocess, sys, tempfile, zlib

from tile_decoder import map_image
from tile_decoder.blockmap import read_blockmap
from tile_decoder.container import BadTile, Bytes, read_archive, read_container
from tile_decoder.ground_columns import stand_on_ground
from tile_decoder.mesh import read_mesh_fields, read_mesh_tile
from tile_decoder.shapes import CLIPPED, COLUMNS, EXPOSED, GAP, OCCUPIED
from tile_decoder.subtree import read_subtree


def packed_texel(texel):
    r, g, b, ao, alpha = texel
    return r | g << 8 | b << 16 | (ao << 2 | alpha) << 24


def blockmap_values(tile, ground):
    """All values of a V-BlockMap as its tile has them."""
    columns = []
    for i in (i for i in range(COLUMNS) if tile.has(i, OCCUPIED)):
        column = {
            "column": i, "flags": tile.flags[i], "z": [tile.z_min[i], tile.z_max[i]], "normal": tile.normal[i],
            "roof": packed_texel(tile.roof[i]),
        }
        if tile.has(i, EXPOSED):
            column |= {"azimuth": tile.azimuth[i], "strip": [packed_texel(texel) for texel in tile.strip[i]]}
        if tile.has(i, GAP):
            column["gap"] = tile.gap[i]
        if tile.has(i, CLIPPED):
            outer = tile.clip[i]["outer"]
            column["clip"] = tile.clip[i] | {"outer": outer and [outer[0], packed_texel(outer[1])]}
        columns.append(column)
    values = {"kind": "blockmap", "cell_m": tile.cell_m, "z_base_cells": tile.z_base_cells, "z_shift": tile.z_shift}
    values["columns"] = columns
    if ground:
        values["ground"] = {
            "squares": sorted(ground.squares), "heights": sorted(ground.heights.items()), "sky": sorted(ground.sky.items()),
        }
    return values


def texels_crc32(values):
    """CRC-32 of the roofs of all cells, 0 where there is no column, then of all strips."""
    roofs = [0] * COLUMNS
    for column in values["columns"]:
        roofs[column["column"]] = column["roof"]
    strips = [texel for column in values["columns"] for texel in column.get("strip", [])]
    return zlib.crc32(struct.pack(f"<{len(roofs) + len(strips)}I", *roofs, *strips))


def decode(data):
    """The values of any tile."""
    kind, tile_id, sections = read_container(data)
    if kind == "subtree":
        return read_subtree(tile_id, sections)
    if kind == "mesh":
        return read_mesh_tile(tile_id, sections)
    return blockmap_values(*read_blockmap(tile_id, sections))


def show(name, values, as_json):
    text = json.dumps(values, sort_keys=True)
    if as_json:
        print(json.dumps({"tile": name, "values": values}, sort_keys=True))
        return
    count = len(values.get("columns", values.get("nodes", [])))
    texels = f"texels {texels_crc32(values):08x}" if "columns" in values else "-"
    print(f"{name:<40} {values['kind']:<9} {count:>5} {texels:<16} {hashlib.sha256(text.encode()).hexdigest()[:16]}")


def is_equal_to_inspect(program, city, name, data):
    """Compares a tile, with its ground, with the three maps that `inspect` draws."""
    _, tile_id, sections = read_container(data)
    tile, ground = read_blockmap(tile_id, sections)
    if ground:
        stand_on_ground(tile, ground)
    with tempfile.TemporaryDirectory() as folder:
        png = pathlib.Path(folder) / "node.png"
        subprocess.run([program, "inspect", city, "--tile", name, "--png", png], check=True, stdout=subprocess.DEVNULL)
        expected = map_image.read_png(png.read_bytes())
    found = map_image.draw(tile)
    if found == expected:
        return True
    rows = zip(found, expected)
    differing = [(x, y, a, b) for y, row in enumerate(rows) for x, (a, b) in enumerate(zip(*row)) if a != b]
    print(f"{name}: {len(differing)} pixels differ; x, y, found, expected of the first:", *differing[:3])
    return False


def are_levels_equal(program, city, subtrees):
    """Compares the nodes of all subtree tiles with the levels that `inspect` counts."""
    text = subprocess.run([program, "inspect", city, "--json"], check=True, capture_output=True).stdout
    nodes = {node["id"]: node for subtree in subtrees for node in subtree["nodes"]}
    equal = True
    for level in json.loads(text)["levels"]:
        own = [node for name, node in nodes.items() if name.startswith(f"{level['level']}/")]
        sizes, errors = [node["blockmap_bytes"] for node in own], [node["error_m"] for node in own]
        found = [len(own), sum(sizes), min(sizes), max(sizes), min(errors), max(errors)]
        names = ["nodes", "bytes", "bytes_min", "bytes_max", "error_m_min", "error_m_max"]
        if found != [level[name] for name in names]:
            equal = False
            print(f"level {level['level']}: found {found}")
    return equal


def are_sizes_equal(city, blockmaps, subtrees):
    """Compares the sizes of all tiles with those in the subtree tiles."""
    depth = json.loads((city / "city.json").read_text())["depth"]
    nodes = {node["id"]: node for subtree in subtrees for node in subtree["nodes"]}
    listed = {name: node["blockmap_bytes"] for name, node in nodes.items()}
    listed_meshes = {(name, k): lod["bytes"] for name, node in nodes.items() for k, lod in enumerate(node.get("meshes", []))}
    meshes = {}
    if (city / "meshes.pmtiles").exists():
        for z, x, y, data in read_archive(city / "meshes.pmtiles"):
            lod, found = z - depth, decode(data)
            meshes[f"{depth}/{x >> lod}/{y >> lod}", lod] = len(data)
            if (found["leaf"], found["lod"]) != (f"{depth}/{x >> lod}/{y >> lod}", lod):
                raise BadTile(f"mesh tile {z}/{x}/{y} names another leaf")
    return listed == {name: len(data) for name, data in blockmaps} and listed_meshes == meshes


def decode_folder(folder, as_json):
    """Frozen files. Those without a tile's container are coded meshes."""
    ok = True
    for path in sorted(folder.glob("*.bin")):
        data = path.read_bytes()
        try:
            is_tile = data[:4] == b"INSU"
            show(path.name, decode(data) if is_tile else {"kind": "mesh"} | read_mesh_fields(Bytes(data)), as_json)
        except BadTile as error:
            ok = False
            print(f"{path.name}: {error}")
    return ok


def decode_city(city, args):
    tiles = [(f"{z}/{x}/{y}", data) for z, x, y, data in read_archive(city / "blockmaps.pmtiles")]
    chosen = random.Random(args.seed).sample(tiles, min(args.tiles, len(tiles)))
    decoded = equal = 0
    for name, data in chosen:
        try:
            show(name, decode(data), args.json)
            decoded += 1
            equal += bool(args.program) and is_equal_to_inspect(args.program, city, name, data)
        except BadTile as error:
            print(f"{name}: {error}")
    subtrees = [decode(data) for _, _, _, data in read_archive(city / "subtrees.pmtiles")]
    for subtree in subtrees:
        show(f"subtree {subtree['root']}", subtree, args.json)
    sizes = are_sizes_equal(city, tiles, subtrees)
    levels = bool(args.program) and are_levels_equal(args.program, city, subtrees)
    compared = f", {equal} equal to inspect, levels {'equal' if levels else 'differ'}" if args.program else ""
    print(f"{len(chosen)} tiles, {decoded} decoded, sizes {'equal' if sizes else 'differ'}{compared}", file=sys.stderr)
    return decoded == len(chosen) and sizes and (not args.program or equal == len(chosen) and levels)


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("folder", type=pathlib.Path)
    ap.add_argument("--tiles", type=int, default=10)
    ap.add_argument("--seed", type=int, default=0)
    ap.add_argument("--json", action="store_true")
    ap.add_argument("--program", help="insula-server, to compare with")
    args = ap.parse_args()
    is_city = (args.folder / "city.json").exists()
    try:
        ok = decode_city(args.folder, args) if is_city else decode_folder(args.folder, args.json)
    except BadTile as error:
        sys.exit(f"{args.folder}: {error}")
    sys.exit(0 if ok else 1)


if __name__ == "__main__":
    main()
