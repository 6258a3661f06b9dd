#!/usr/bin/env python3
"""How the time of `inspect` grows with the number of objects in one place.

coincident.py [--program PATH] [--counts 20000,40000,80000] [--limit 1.5]

Writes squares of GeoJSON that lie on each other, with different heights, and a glTF scene of as many instances of one box in one
place; `inspect` reads each and searches for duplicates. Prints the processor time of each, and how much it grows where the number
doubles, besides that of n log n. Exits with 1 if one of the last growths is more than --limit times that, which the square of n
is. Needs only Python 3.9.
"""
import argparse, base64, json, math, os, pathlib, struct, subprocess, sys, tempfile

HEIGHTS = 900


def geojson(path, count):
    ring = [[16.37, 48.21], [16.3701, 48.21], [16.3701, 48.2101], [16.37, 48.2101], [16.37, 48.21]]
    with open(path, "w", encoding="utf-8") as file:
        file.write('{"type": "FeatureCollection", "features": [\n')
        for i in range(count):
            # Of those with another height none is a duplicate.
            feature = {"type": "Feature", "id": f"b{i}", "properties": {"height": 3 + 2 * (i % HEIGHTS)},
                       "geometry": {"type": "Polygon", "coordinates": [ring]}}
            file.write(json.dumps(feature) + (",\n" if i + 1 < count else "\n"))
        file.write("]}\n")


def gltf(path, count):
    corners = [(x, y, z) for x in (0, 10) for y in (0, 6) for z in (0, 8)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    indices = [k for a, b, c, d in faces for k in (a, b, c, a, c, d)]
    data = b"".join(struct.pack("<3f", *corner) for corner in corners) + struct.pack(f"<{len(indices)}H", *indices)
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    scene = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(count))}],
        "nodes": [{"mesh": 0, "name": f"box {i}", "scale": [1, 1 + i / count, 1]} for i in range(count)],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3", "min": [0, 0, 0], "max": [10, 6, 8]},
            {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 96}, {"buffer": 0, "byteOffset": 96, "byteLength": 72},
        ],
        "buffers": [{"uri": uri, "byteLength": len(data)}],
    }
    path.write_text(json.dumps(scene), encoding="utf-8")


def processor_s(program, path):
    before = os.times()
    result = subprocess.run([program, "inspect", path, "--json"], capture_output=True, text=True)
    after = os.times()
    if result.returncode:
        sys.exit(f"{path.name}: {result.stderr.strip()}")
    objects = json.loads(result.stdout[result.stdout.index("{"):])["objects"]
    return after.children_user + after.children_system - before.children_user - before.children_system, objects


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--program", default="target/release/insula-server", help="insula-server")
    parser.add_argument("--counts", default="20000,40000,80000", help="numbers of objects, each larger than the one before")
    parser.add_argument("--limit", type=float, default=1.5, help="largest growth by that of n log n")
    options = parser.parse_args()
    counts = [int(count) for count in options.counts.split(",")]
    is_slow = False
    with tempfile.TemporaryDirectory() as folder:
        for name, write in (("squares.geojson", geojson), ("instances.gltf", gltf)):
            path, before = pathlib.Path(folder) / name, None
            for count in counts:
                write(path, count)
                seconds, objects = processor_s(options.program, path)
                text = f"{name}: {count} read, {objects} objects, {seconds:.2f} s"
                if before:
                    usual = count * math.log(count) / (before[0] * math.log(before[0]))
                    growth = seconds / before[1]
                    text += f", {growth:.2f} times (n log n: {usual:.2f})"
                    is_slow |= count == counts[-1] and growth > options.limit * usual
                print(text, flush=True)
                before = count, seconds
    sys.exit(1 if is_slow else 0)


if __name__ == "__main__":
    main()
