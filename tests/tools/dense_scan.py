#!/usr/bin/env python3
"""Makes a dense scan of a mesh: divides each triangle into nine and adds noise.

    tests/tools/dense_scan.py nefertiti.obj dense.ply [--noise 0.12]

Reads an OBJ of triangles, writes a binary PLY. Needs numpy.
"""
import argparse

import numpy as np

PARTS = 3


def read(path):
    positions, triangles = [], []
    with open(path) as file:
        for line in file:
            words = line.split()
            if words[:1] == ["v"]:
                positions.append([float(word) for word in words[1:4]])
            elif words[:1] == ["f"]:
                triangles.append([int(word.split("/")[0]) - 1 for word in words[1:4]])
    return np.array(positions), triangles


def divide(positions, triangles):
    points, of_edge, divided = [tuple(p) for p in positions], {}, []

    def on_edge(a, b, part):
        key = (a, b, part) if a < b else (b, a, PARTS - part)
        if key not in of_edge:
            of_edge[key] = len(points)
            share = part / PARTS
            points.append(tuple(positions[a] * (1 - share) + positions[b] * share))
        return of_edge[key]

    for a, b, c in triangles:
        ab, bc, ca = ([on_edge(p, q, part) for part in (1, 2)] for p, q in ((a, b), (b, c), (c, a)))
        middle = len(points)
        points.append(tuple((positions[a] + positions[b] + positions[c]) / 3))
        divided += [(a, ab[0], ca[1]), (ab[0], ab[1], middle), (ab[0], middle, ca[1]), (ab[1], b, bc[0]),
                    (ab[1], bc[0], middle), (middle, bc[0], bc[1]), (ca[1], middle, ca[0]), (middle, bc[1], ca[0]),
                    (ca[0], bc[1], c)]
    return np.array(points, dtype="<f4"), np.array(divided, dtype="<i4")


def write(path, points, triangles):
    faces = np.empty(len(triangles), dtype=[("count", "u1"), ("vertices", "<i4", 3)])
    faces["count"], faces["vertices"] = 3, triangles
    header = (f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\nproperty float x\nproperty float y\n"
              f"property float z\nelement face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n")
    with open(path, "wb") as file:
        file.write(header.encode() + points.tobytes() + faces.tobytes())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mesh")
    parser.add_argument("out")
    parser.add_argument("--noise", type=float, default=0.12, help="standard deviation, in units of the mesh")
    args = parser.parse_args()
    points, triangles = divide(*read(args.mesh))
    points += np.random.default_rng(1).normal(0, args.noise, points.shape).astype("<f4")
    write(args.out, points, triangles)
    print(f"{len(points)} vertices, {len(triangles)} triangles")


if __name__ == "__main__":
    main()
