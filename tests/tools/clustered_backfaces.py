#!/usr/bin/env python3
"""What clusters with normal cones would save a ray-caster of meshes.

    insula-server export CITY --format glb --bbox W,S,E,N --out part.glb
    tests/tools/clustered_backfaces.py part.glb [--rays 2000]

Triangles are divided at the median of their longest axis into clusters of at most 3 (the leaves of the ray-caster's tree), 16 and 64. Rays
go from random places 1.7 m and 60 m above the lowest point into random directions. A ray tests the triangles of each cluster whose box it
enters before its nearest hit. A cluster is turned away if the cone around its normals is, so that all of its triangles show their backs
(Shirman and Abi-Ezzi 1993). Needs numpy.
"""
import argparse
import json
import pathlib
import struct

import numpy as np

SIZES = [3, 16, 64]


def read_triangles(path):
    """Corners of all triangles of a GLB file, in metres: an array of (n, 3, 3), y up."""
    data = pathlib.Path(path).read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    types = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32, 5122: np.int16}

    def accessor(index):
        a = document["accessors"][index]
        view = document["bufferViews"][a["bufferView"]]
        kind, width = np.dtype(types[a["componentType"]]), {"SCALAR": 1, "VEC3": 3}[a["type"]]
        start, stride = view.get("byteOffset", 0) + a.get("byteOffset", 0), view.get("byteStride", kind.itemsize * width)
        rows = np.lib.stride_tricks.as_strided(np.frombuffer(binary, np.uint8, offset=start), (a["count"], kind.itemsize * width), (stride, 1))
        return np.ascontiguousarray(rows).view(kind).reshape(a["count"], width)

    parts = []
    for node in document["nodes"]:
        if "mesh" not in node:
            continue
        scale, shift = np.array(node.get("scale", [1, 1, 1])), np.array(node.get("translation", [0, 0, 0]))
        for primitive in document["meshes"][node["mesh"]]["primitives"]:
            positions = accessor(primitive["attributes"]["POSITION"]).astype(float) * scale + shift
            parts.append(positions[accessor(primitive["indices"]).reshape(-1, 3).astype(int)])
    return np.concatenate(parts)


def clusters(triangles, size):
    """Lists of indices of triangles."""
    centres, done, todo = triangles.mean(axis=1), [], [np.arange(len(triangles))]
    while todo:
        part = todo.pop()
        if len(part) <= size:
            done.append(part)
            continue
        axis = np.ptp(centres[part], axis=0).argmax()
        order = part[np.argsort(centres[part][:, axis], kind="stable")]
        todo += [order[: len(order) // 2], order[len(order) // 2 :]]
    return done


def hits(triangles, normals, origin, direction):
    """Distance of the nearest triangle, and whether it shows its front; infinite without any."""
    a, edges = triangles[:, 0], triangles[:, 1:] - triangles[:, :1]
    p = np.cross(direction, edges[:, 1])
    determinant = (edges[:, 0] * p).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = origin - a
        u = (s * p).sum(axis=1) / determinant
        q = np.cross(s, edges[:, 0])
        v, t = q @ direction / determinant, (edges[:, 1] * q).sum(axis=1) / determinant
    t = np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-3), t, np.inf)
    nearest = np.nanargmin(t)
    return t[nearest], normals[nearest] @ direction < 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("glb")
    parser.add_argument("--rays", type=int, default=2000)
    args = parser.parse_args()
    triangles = read_triangles(args.glb)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(normals, axis=1)
    triangles, normals = triangles[length > 1e-9], normals[length > 1e-9] / length[length > 1e-9, None]
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    random = np.random.default_rng(1)
    rays = []
    for k in range(args.rays):
        place = low + random.random(3) * (high - low)
        place[1] = low[1] + (1.7 if k % 2 else 60.0)
        direction = random.normal(size=3) * (1.0, 0.3, 1.0)
        direction /= np.linalg.norm(direction)
        rays.append((place, direction, *hits(triangles, normals, place, direction)))
    fronts = [front for *_, t, front in rays if np.isfinite(t)]
    print(f"{len(triangles)} triangles, {len(fronts)} of {len(rays)} rays hit, {100 * (1 - np.mean(fronts)):.1f}% of them a back")
    for size in SIZES:
        groups = clusters(triangles, size)
        boxes = np.array([[triangles[g].min(axis=(0, 1)), triangles[g].max(axis=(0, 1))] for g in groups])
        counts = np.array([len(g) for g in groups])
        axes = np.array([normals[g].sum(axis=0) for g in groups])
        axes /= np.maximum(np.linalg.norm(axes, axis=1), 1e-9)[:, None]
        cosines = np.array([(normals[g] @ axis).min() for g, axis in zip(groups, axes)])
        sines = np.sqrt(np.maximum(0.0, 1 - cosines**2))
        tested = saved = exact = 0
        for place, direction, t, _ in rays:
            with np.errstate(divide="ignore", invalid="ignore"):
                spans = (boxes - place) / direction
            enter, leave = spans.min(axis=1).max(axis=1), spans.max(axis=1).min(axis=1)
            met = (enter <= leave) & (leave >= 0) & (enter <= t)
            is_away = (cosines > 0) & (axes @ direction > sines)
            tested += counts[met].sum()
            saved += counts[met & is_away].sum()
            exact += sum((normals[g] @ direction > 0).sum() for g, is_met in zip(groups, met) if is_met)
        print(f"clusters of {size}: {tested / len(rays):.1f} triangles a ray, {100 * exact / tested:.0f}% turned away, {100 * saved / tested:.0f}% in clusters that are")


if __name__ == "__main__":
    main()
