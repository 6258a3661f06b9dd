#!/usr/bin/env python3
"""Decodes tiles without Insula's own decoder, which shares its code with the encoder.

decode_tile.py VECTORS_OR_CITY [--tiles N] [--seed S] [--json] [--program INSULA_SERVER]

Decodes all `.bin` and `.insm` files of a folder; or N random V-BlockMap tiles, N random mesh tiles, and all subtree, object and
visibility tiles of a city folder. Everything is decoded but the pictures of textures, which are WebP: of these, the size is checked. Prints
one line per tile: its kind, the number of its columns, nodes, triangles, objects or attributes, the CRC-32 of its texels as
`protocol/tests/integration/vectors.rs` computes it, and the SHA-256 of all decoded values as JSON; with --json the values themselves.
Compares a city's tiles with its subtree tiles: all sizes, and of the decoded mesh tiles the numbers of triangles and of a
texture's pixels; and the objects that decoded tiles name with those of the object tiles.

With --program, compares each V-BlockMap tile of a city with `inspect --png`, the levels with `inspect --json`, each mesh with
the OBJ and PLY files of `decompress`, and all objects with `objects --json`. Exits with 1 if a tile cannot be decoded or differs.
"""
import argparse, hashlib, json, pathlib, random, struct, sys, zlib

from tile_decoder import city_checks
from tile_decoder.blockmap import read_blockmap
from tile_decoder.container import BadTile, Bytes, read_archive, read_container
from tile_decoder.mesh import read_mesh
from tile_decoder.mesh_file import MAGIC, from_file, what_differs
from tile_decoder.mesh_tile import MESH, read_mesh_tile
from tile_decoder.object_names import NONE
from tile_decoder.object_tile import read_object_tile
from tile_decoder.shapes import CLIPPED, COLUMNS, EXPOSED, GAP, OCCUPIED
from tile_decoder.subtree import read_subtree
from tile_decoder.visibility import read_visibility


def packed_texel(texel):
    r, g, b, ao, coverage = texel
    return r | g << 8 | b << 16 | (ao << 2 | coverage) << 24


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
        if tile.thin[i]:
            column["thin"] = tile.thin[i]
        if tile.objects:
            column["objects"] = [tile.objects.roof[i], tile.objects.wall[i], tile.objects.lower[i]]
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
    if kind == "objects":
        return read_object_tile(tile_id, sections)
    if kind == "visibility":
        return read_visibility(tile_id, sections)
    return blockmap_values(*read_blockmap(tile_id, sections))


def show(name, values, as_json):
    text = json.dumps(values, sort_keys=True)
    if as_json:
        print(json.dumps({"tile": name, "values": values}, sort_keys=True))
        return
    parts = values["schema"] if "schema" in values else values
    count = next(len(parts[key]) for key in ("columns", "nodes", "triangles", "attributes", "objects", "cells") if key in parts)
    texels = f"texels {texels_crc32(values):08x}" if "columns" in values else "-"
    print(f"{name:<40} {values['kind']:<9} {count:>5} {texels:<16} {hashlib.sha256(text.encode()).hexdigest()[:16]}")


def named_objects(values):
    """The numbers that a V-BlockMap or mesh names."""
    columns = [number for column in values.get("columns", []) for number in column.get("objects", [])]
    return {*columns, *values.get("objects", [])} - {NONE}


def is_equal_to_decompress(program, name, coded, values):
    """Compares a mesh with the mesh files that `decompress` makes of its coded bytes."""
    differing = what_differs(program, coded, values)
    if differing:
        print(f"{name}: other than of decompress:", *differing)
    return not differing


def decode_folder(folder, args):
    """Frozen files and mesh files. Files without a tile's container are coded meshes."""
    ok = True
    for path in sorted([*folder.glob("*.bin"), *folder.glob("*.insm")]):
        data = path.read_bytes()
        try:
            if data[:4] == b"INSU":
                values, coded = decode(data), read_container(data)[2].get(MESH)
            else:
                coded = from_file(data) if data[:4] == MAGIC else data
                values = {"kind": "mesh"} | read_mesh(Bytes(coded))
            show(path.name, values, args.json)
            if args.program and values["kind"] == "mesh":
                ok &= is_equal_to_decompress(args.program, path.name, coded, values)
        except BadTile as error:
            ok = False
            print(f"{path.name}: {error}")
    return ok


def count_correct(tiles, args, is_correct):
    """Decodes and shows tiles; returns the number of those that are correct."""
    correct = 0
    for name, data in tiles:
        try:
            values = decode(data)
            show(name, values, args.json)
            correct += is_correct(name, data, values)
        except BadTile as error:
            print(f"{name}: {error}")
    return correct


def decode_city(city, args):
    program = args.program
    manifest = json.loads((city / "city.json").read_text())
    blockmaps = [(f"{z}/{x}/{y}", data) for z, x, y, data in read_archive(city / "blockmaps.pmtiles")]
    meshes = city_checks.read_mesh_archive(city)
    subtrees = [decode(data) for _, _, _, data in read_archive(city / "subtrees.pmtiles")]
    nodes = city_checks.nodes_of(subtrees)

    objects = city_checks.read_objects(city)

    def draw(tiles):
        return random.Random(args.seed).sample(tiles, min(args.tiles, len(tiles)))

    def has_objects(name, values):
        unknown = named_objects(values) - objects.keys()
        if unknown:
            print(f"{name}: {len(unknown)} objects that no object tile has, such as {min(unknown)}")
        return not unknown

    def is_blockmap_correct(name, data, values):
        return has_objects(name, values) and (not program or city_checks.is_equal_to_inspect(program, city, name, data))

    def is_mesh_correct(name, data, values):
        side_m = manifest["root_side_m"] / 2 ** manifest["depth"]
        return all([
            has_objects(name, values), city_checks.is_equal_to_subtree(name, data, values, nodes),
            city_checks.is_on_common_grid(name, values, side_m),
            not program or is_equal_to_decompress(program, name, read_container(data)[2][MESH], values),
        ])

    chosen, chosen_meshes = draw(blockmaps), draw([(f"mesh {leaf}/{lod}", data) for (leaf, lod), data in meshes.items()])
    correct = count_correct(chosen, args, is_blockmap_correct)
    correct_meshes = count_correct(chosen_meshes, args, is_mesh_correct)
    for subtree in subtrees:
        show(f"subtree {subtree['root']}", subtree, args.json)
    for name, values in city_checks.read_object_archive(city):
        show(name, values, args.json)
    visibility = city / "visibility.pmtiles"
    for z, x, y, data in read_archive(visibility) if visibility.is_file() else ():
        show(f"visibility {z}/{x}/{y}", decode(data), args.json)
    same_objects = not program or not objects or city_checks.are_objects_equal(program, city, objects)
    sizes = city_checks.are_sizes_equal(blockmaps, meshes, subtrees)
    levels = not program or city_checks.are_levels_equal(program, city, subtrees)
    found = {"sizes": sizes} | ({"levels": levels, f"{len(objects)} objects": same_objects} if program else {})
    compared = ", ".join(f"{name} {'equal' if equal else 'differ'}" for name, equal in found.items())
    print(f"{correct} of {len(chosen)} V-BlockMap tiles and {correct_meshes} of {len(chosen_meshes)} mesh tiles correct, "
          f"{compared}{'' if program else '; not compared with a program'}", file=sys.stderr)
    return (correct, correct_meshes) == (len(chosen), len(chosen_meshes)) and sizes and levels and same_objects


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
        ok = decode_city(args.folder, args) if is_city else decode_folder(args.folder, args)
    except BadTile as error:
        sys.exit(f"{args.folder}: {error}")
    sys.exit(0 if ok else 1)


if __name__ == "__main__":
    main()
