#!/usr/bin/env python3
"""Bakes a city with several numbers of views, and compares the leaves with those of the most views. Prints Markdown.

    tests/load/views.py INPUT... [--views 32,64,128,256,512,1024] [--cell 1] [--program INSULA_SERVER]

Columns are those of both bakes divided by those of either; occlusion is that of the roofs of these columns, from 0 to 63.
Decodes with the second decoder (tests/tools), which takes minutes for a city of hundreds of leaves.
"""
import argparse, json, math, os, pathlib, subprocess, sys, tempfile

HERE = pathlib.Path(__file__).resolve().parent
TARGET = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", HERE.parent.parent / "target")) / "release"
sys.path.insert(0, str(HERE.parent / "tools"))

from tile_decoder.blockmap import read_blockmap
from tile_decoder.container import read_archive, read_container
from tile_decoder.shapes import COLUMNS, OCCUPIED


def leaves(city):
    """For each column of the leaves, its roof's occlusion by tile and place."""
    depth = json.loads((city / "city.json").read_text())["depth"]
    found = {}
    for z, x, y, data in read_archive(city / "blockmaps.pmtiles"):
        if z == depth:
            _, tile_id, sections = read_container(data)
            tile, _ = read_blockmap(tile_id, sections)
            found.update({(x, y, i): tile.roof[i][3] for i in range(COLUMNS) if tile.has(i, OCCUPIED)})
    return found


def bake(args, views, out):
    report = out.with_suffix(".json")
    command = [args.program, "bake", *args.input, "--out", out, "--views", str(views), "--cell", str(args.cell), "--no-meshes",
               "--quality", "lossless", "--ground", "none", "--threads", "2", "--report", report]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return json.loads(report.read_text())["seconds"]


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("input", nargs="+")
    ap.add_argument("--views", default="32,64,128,256,512,1024")
    ap.add_argument("--cell", type=float, default=1.0)
    ap.add_argument("--program", default=TARGET / "insula-server")
    args = ap.parse_args()
    views = sorted(int(number) for number in args.views.split(","))
    with tempfile.TemporaryDirectory() as folder:
        cities = [(number, pathlib.Path(folder) / f"views-{number}") for number in views]
        rows = [(number, bake(args, number, city), leaves(city)) for number, city in cities]
    _, _, best = rows[-1]
    print("| views | columns, of those of the most | occlusion RMS | 99% within | bake, s |\n|---|---|---|---|---|")
    for number, seconds, found in rows:
        shared = found.keys() & best.keys()
        errors = sorted(abs(found[place] - best[place]) for place in shared)
        rms = math.sqrt(sum(error * error for error in errors) / max(len(errors), 1))
        p99 = errors[int(len(errors) * 0.99)] if errors else 0
        share = len(shared) / max(len(found.keys() | best.keys()), 1)
        print(f"| {number} | {share:.5f} | {rms:.2f} | {p99} | {seconds:.1f} |")


if __name__ == "__main__":
    main()
