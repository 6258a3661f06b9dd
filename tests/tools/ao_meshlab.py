#!/usr/bin/env python3
"""Compares `insula-server ao` with MeshLab's ambient occlusion: time, and error against traced values.

    cargo run --release -p insula-measure --bin ao_error -- MESH... --truth TRUTH
    ao_meshlab.py --insula target/release/insula-server --truth TRUTH [--views 256] [--map 1024] [--rounds 5] MESH...

Needs pymeshlab and numpy. Both programs run in turn; the least time of all rounds counts, because other programs may
disturb a round. Seconds are those of the computation alone: what `ao` prints, and the filter without reading the mesh.

MeshLab has two filters. `compute_scalar_ambient_occlusion` casts rays (Embree) along N directions over the whole sphere
and stores the sum of cosines, which is N / 4 for an open vertex: it is divided by that. Its best linear fit to the truth
is given as well, so that another scale does not count as an error. `compute_scalar_ambient_occlusion_gpu` renders depth maps
and needs OpenGL: run under `xvfb-run -a`. It runs in a process of its own, because without a context it aborts.
"""

import argparse
import pathlib
import re
import subprocess
import sys
import tempfile
import time

import numpy
import pymeshlab

DEPTH_MAPS = """
import sys, time, numpy, pymeshlab
meshes = pymeshlab.MeshSet()
meshes.load_new_mesh(sys.argv[1])
start = time.perf_counter()
meshes.compute_scalar_ambient_occlusion_gpu(reqviews=int(sys.argv[2]), depthtexsize=int(sys.argv[3]))
print(time.perf_counter() - start)
"""


def read_quality(path):
    """Positions and quality of a PLY file that `ao` wrote."""
    data = path.read_bytes()
    head, body = data.split(b"end_header\n", 1)
    kinds = {"double": "<f8", "float": "<f4", "uchar": "u1"}
    lines = head.decode().split("element face")[0].splitlines()
    fields = [line.split()[1:] for line in lines if line.startswith("property")]
    count = int(re.search(r"element vertex (\d+)", head.decode()).group(1))
    rows = numpy.frombuffer(body, [(name, kinds[kind]) for kind, name in fields], count)
    return numpy.stack([rows[axis] for axis in "xyz"], 1), rows["quality"].astype(float)


def by_position(positions, values):
    """Values of the distinct positions."""
    return dict(zip(map(tuple, numpy.asarray(positions, "<f4").tolist()), values))


def errors(found, truth):
    """RMS, and RMS after the best linear fit, at the positions that both have."""
    keys = [key for key in truth if key in found]
    a, b = (numpy.array([values[key] for key in keys]) for values in (found, truth))
    slope, offset = numpy.polyfit(a, b, 1)
    rms = lambda difference: float(numpy.sqrt((difference**2).mean()))
    return len(keys), rms(a - b), rms(a * slope + offset - b)


def run_insula(arguments, mesh, out):
    command = [arguments.insula, "ao", mesh, "--out", out, "--views", str(arguments.views), "--map", str(arguments.map)]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return float(re.search(r"([\d.]+) s$", text.strip()).group(1))


def run_meshlab(mesh, views):
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(str(mesh))
    start = time.perf_counter()
    meshes.compute_scalar_ambient_occlusion(rays=views)
    seconds = time.perf_counter() - start
    current = meshes.current_mesh()
    return seconds, current.vertex_matrix(), current.vertex_scalar_array() / (views / 4)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--insula", required=True, type=pathlib.Path)
    parser.add_argument("--truth", required=True, type=pathlib.Path)
    parser.add_argument("--views", type=int, default=256)
    parser.add_argument("--map", type=int, default=1024)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("meshes", nargs="+", type=pathlib.Path)
    arguments = parser.parse_args()
    print(f"{arguments.views} views, maps of {arguments.map} texels, least of {arguments.rounds} rounds")
    print("mesh: program, s, RMS, RMS of the best fit, vertices compared")
    for mesh in arguments.meshes:
        with tempfile.TemporaryDirectory() as folder:
            out = pathlib.Path(folder) / "ao.ply"
            ours, theirs = [], []
            for _ in range(arguments.rounds):
                ours.append(run_insula(arguments, mesh, out))
                seconds, positions, quality = run_meshlab(mesh, arguments.views)
                theirs.append(seconds)
            place, share = read_quality(out)
        # The truth has the vertices of the welded mesh, in the order of the file.
        order = list(dict.fromkeys(map(tuple, numpy.asarray(positions, "<f4").tolist())))
        values = numpy.fromfile(arguments.truth / f"{mesh.stem}.f32", "<f4")
        if len(order) != len(values):
            sys.exit(f"{mesh}: {len(order)} distinct vertices, {len(values)} traced values")
        truth = dict(zip(order, values))
        for name, times, found in [
            ("insula", ours, by_position(place, share)),
            ("meshlab, rays", theirs, by_position(positions, quality)),
        ]:
            count, rms, fitted = errors(found, truth)
            print(f"{mesh.stem}: {name}, {min(times):.3f}, {rms:.4f}, {fitted:.4f}, {count}")
        command = [sys.executable, "-c", DEPTH_MAPS, mesh, str(arguments.views), str(arguments.map)]
        drawn = subprocess.run(command, capture_output=True, text=True)
        state = f"{float(drawn.stdout.split()[-1]):.3f}" if drawn.returncode == 0 else "does not run here"
        print(f"{mesh.stem}: meshlab, depth maps, {state}; times as long as insula: {min(theirs) / min(ours):.2f} (rays)")


if __name__ == "__main__":
    main()
