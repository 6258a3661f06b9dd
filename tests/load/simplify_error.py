#!/usr/bin/env python3
"""Simplifies meshes within limits and measures the results with `insula-server compare` and with MeshLab.

    tests/load/simplify_error.py MESH... [--shares 0.001 0.005] [--server BIN]

A limit is a share of the mesh's diagonal. MeshLab (pip install pymeshlab) measures the Hausdorff distance in both directions at
200,000 points. Prints Markdown; exits with 1 if a limit is exceeded.
"""

import argparse, os, pathlib, re, subprocess, sys, tempfile
import pymeshlab

TARGET = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", pathlib.Path(__file__).resolve().parents[2] / "target")) / "release"


def run(*command):
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def meshlab(a, b):
    """The Hausdorff distance: the larger one of both directions."""
    meshes = pymeshlab.MeshSet()
    for path in (a, b):
        meshes.load_new_mesh(str(path))
        # Vertices without triangles belong to no surface.
        meshes.meshing_remove_unreferenced_vertices()
    count = 200_000
    sides = [meshes.get_hausdorff_distance(sampledmesh=i, targetmesh=1 - i, samplenum=count, maxdist=pymeshlab.PercentageValue(100)) for i in (0, 1)]
    return max(side["max"] for side in sides)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("meshes", nargs="+", type=pathlib.Path)
    parser.add_argument("--shares", nargs="+", type=float, default=[0.001, 0.005])
    parser.add_argument("--server", default=TARGET / "insula-server")
    args = parser.parse_args()
    is_kept = True
    print("| mesh | limit | triangles | stated | compare | MeshLab | s |\n|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for mesh in args.meshes:
            out = pathlib.Path(folder) / "out.ply"
            diagonal = float(re.search(r"is ([\d.]+)$", run(args.server, "compare", mesh, mesh, "--samples", "1").strip())[1])
            for share in args.shares:
                limit = diagonal * share
                text = run(args.server, "simplify", mesh, out, "--error", repr(limit))
                left, before, stated, seconds = re.search(r"(\d+) of (\d+) triangles, largest distance ([\d.]+).* ([\d.]+) s", text).groups()
                compared = float(re.search(r"Hausdorff distance ([\d.]+)", run(args.server, "compare", mesh, out))[1])
                other = meshlab(mesh, out)
                is_kept &= max(compared, other) <= limit
                print(f"| {mesh.stem} | {limit:.5g} | {left} of {before} | {float(stated) / limit:.2f} | {compared / limit:.2f} | {other / limit:.2f} | {seconds} |", flush=True)
    sys.exit(0 if is_kept else 1)


if __name__ == "__main__":
    main()
