#!/usr/bin/env python3
"""Embree beside Insula: primary rays on the finest triangles of a baked city, from the same cameras, in turn.

    tests/tools/embree/run.py --city CITY --camera tests/paths/tokyo-street-camera.json... [--size 640 360] [--turns 3] [--threads N]

Needs g++ and Embree 3 (Debian: libembree-dev); without them it says so and measures nothing. Insula's rays are those of the program
`rays`, the triangles those of `insula-server export --format glb`. Each camera is measured in turn by both, several times; the best
counts. Embree shades with one product for each pixel; Insula's time has its light, haze, sky, exposure and tone curve.
"""

import argparse
import array
import json
import os
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).parent
# Bytes and array codes of what a GLB file of Insula has.
U16, U32 = 5123, 5125
# Embree's devices: with the widest instructions of the processor, and with those that Insula's packets of 8 have.
INSTRUCTION_SETS = {"widest": "", "AVX2": "isa=avx2"}


def read_glb(path):
    """The JSON and the binary part."""
    data = path.read_bytes()
    magic, _, _ = struct.unpack_from("<4sII", data)
    if magic != b"glTF":
        sys.exit(f"{path} is no GLB file")
    length, _ = struct.unpack_from("<II", data, 12)
    binary = 20 + length
    size, _ = struct.unpack_from("<II", data, binary)
    return json.loads(data[20 : 20 + length]), memoryview(data)[binary + 8 : binary + 8 + size]


def values(gltf, binary, number, width):
    """The values of an accessor, `width` in each element."""
    accessor = gltf["accessors"][number]
    view = gltf["bufferViews"][accessor["bufferView"]]
    code, size = ("H", 2) if accessor["componentType"] == U16 else ("I", 4) if accessor["componentType"] == U32 else ("f", 4)
    first = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    stride = view.get("byteStride", width * size)
    if stride == width * size:
        return array.array(code, bytes(binary[first : first + accessor["count"] * stride]))
    return array.array(code, b"".join(bytes(binary[at : at + width * size]) for at in range(first, first + accessor["count"] * stride, stride)))


def write_triangles(glb, out):
    """Writes nine floats for each triangle, relative to the origin in the file, Z up. Returns the origin."""
    gltf, binary = read_glb(glb)
    floats = array.array("f")
    for node in gltf["nodes"]:
        if "mesh" not in node:
            continue
        m = node.get("matrix", [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1])
        for primitive in gltf["meshes"][node["mesh"]]["primitives"]:
            at = values(gltf, binary, primitive["attributes"]["POSITION"], 3)
            corners = [
                [m[i] * at[k] + m[4 + i] * at[k + 1] + m[8 + i] * at[k + 2] + m[12 + i] for i in range(3)]
                for k in range(0, len(at), 3)
            ]
            for index in values(gltf, binary, primitive["indices"], 1):
                floats.extend(corners[index])
    out.write_bytes(floats.tobytes())
    return gltf["asset"]["extras"]["origin"], len(floats) // 9


def camera_text(path, origin):
    camera = json.loads(path.read_text())
    numbers = [v - o for key in ("position", "target") for v, o in zip(camera[key], origin)] + [camera.get("fov_y_deg", 60)]
    return ",".join([path.stem, *map(str, numbers)])


def insula_mrays(args, camera, ways):
    """The best of a few rounds of `rays`, by the name of the way."""
    width, height = map(str, args.size)
    command = [args.rays, "--city", args.city, "--camera", camera, "--frames", "primary", "--rounds", "5", "--size", width, height]
    environment = os.environ | {"RAYON_NUM_THREADS": str(args.threads)}
    lines = subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout.splitlines()[1:]
    found = {}
    for line in lines:
        name = next((way for way in ways if f" {way}" in line), None)
        if name:
            found[name] = float(line.split(name, 1)[1].split()[1])
    return found


def rays_of(*command):
    """What a program says of its rays."""
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--city", required=True)
    parser.add_argument("--camera", nargs="+", type=pathlib.Path, required=True)
    parser.add_argument("--size", nargs=2, type=int, default=[640, 360])
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--threads", type=int, default=os.cpu_count(), help="of both; one is the least disturbed by other programs")
    parser.add_argument("--rays", default="target/release/rays")
    parser.add_argument("--server", default="target/release/insula-server")
    args = parser.parse_args()
    header = any(pathlib.Path(root, "embree3/rtcore.h").exists() for root in ("/usr/include", "/usr/local/include"))
    if not shutil.which("g++") or not header:
        print("skipped: g++ or Embree 3 (libembree-dev) is missing")
        return
    ways = ["AVX-512, 16 rays", "AVX2, 8 rays", "NEON, 4 rays", "single rays"]
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        subprocess.run([args.server, "export", args.city, "--format", "glb", "--out", folder / "city.glb"], check=True, capture_output=True)
        origin, count = write_triangles(folder / "city.glb", folder / "triangles")
        program = folder / "rays"
        subprocess.run(["g++", "-O3", "-march=native", "-o", program, HERE / "rays.cpp", "-lembree3", "-lpthread"], check=True)
        print(f"{count} triangles; millions of rays a second")
        for camera in args.camera:
            best = {}
            for _ in range(args.turns):
                options = [folder / "triangles", *map(str, args.size), "5", str(args.threads)]
                text = camera_text(camera, origin)
                found = {}
                for name, isa in INSTRUCTION_SETS.items():
                    embree = rays_of(program, *options, isa, text)
                    found[f"Embree, {name}, packets of 8"] = embree["packets_mrays"]
                    found[f"Embree, {name}, single rays"] = embree["single_mrays"]
                for way, mrays in (found | insula_mrays(args, camera, ways)).items():
                    best[way] = max(best.get(way, 0.0), mrays)
            print(camera.stem, *(f"{way}: {mrays:.1f}" for way, mrays in best.items()), sep="\n  ")


if __name__ == "__main__":
    main()
