#!/usr/bin/env python3
"""Makes a dense scan of a mesh: divides each triangle into 9, or the square of another number, and adds noise.

    tests/tools/dense_scan.py nefertiti.obj dense.ply [--parts 3] [--noise 0.12]

Reads an OBJ of triangles, writes a binary PLY. Needs numpy.
"""
import argparse

import numpy as np


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


def divide(positions, triangles, parts):
    """Each edge becomes `parts` edges. Triangles that share an edge share its points."""
    points, of_edge, divided = [tuple(p) for p in positions], {}, []

    def new(*shares):
        points.append(tuple(sum(positions[vertex] * (share / parts) for vertex, share in shares)))
        return len(points) - 1

    def on_edge(a, b, part):
        key = (a, b, part) if a < b else (b, a, parts - part)
        if key not in of_edge:
            of_edge[key] = new((a, parts - part), (b, part))
        return of_edge[key]

    def place(corners, shares):
        """The point with these shares of the three corners, which are `parts` together."""
        kept = [(vertex, share) for vertex, share in zip(corners, shares) if share]
        if len(kept) == 1:
            return kept[0][0]
        return on_edge(kept[0][0], kept[1][0], kept[1][1]) if len(kept) == 2 else new(*kept)

    for corners in triangles:
        grid = {(i, j): place(corners, (parts - i - j, i, j)) for i in range(parts + 1) for j in range(parts + 1 - i)}
        for i, j in grid:
            if i + j < parts:
                divided.append((grid[i, j], grid[i + 1, j], grid[i, j + 1]))
            if i + j < parts - 1:
                divided.append((grid[i + 1, j], grid[i + 1, j + 1], grid[i, j + 1]))
    return np.array(points, dtype="<f4"), np.array(divided, dtype="<i4")


def write(path, points, triangles):
    faces = np.empty(len(triangles), dtype=[("count", "u1"), ("vertices", "<i4", 3)])
    faces["count"], faces["vertices"] = 3, triangles
    header = (f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\nproperty float x\nproperty float y\n"
              f"property float z\nelement face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n")
    with open(path, "wb") as file:
        file.write(header.encode() + points.tobytes() + faces.tobytes())


def make(mesh, out, parts, noise):
    """Writes the scan; `noise` is its standard deviation in units of the mesh."""
    points, triangles = divide(*read(mesh), parts)
    points += np.random.default_rng(1).normal(0, noise, points.shape).astype("<f4")
    write(out, points, triangles)
    print(f"{len(points)} vertices, {len(triangles)} triangles", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mesh")
    parser.add_argument("out")
    parser.add_argument("--parts", type=int, default=3, help="parts of an edge")
    parser.add_argument("--noise", type=float, default=0.12, help="standard deviation, in units of the mesh")
    args = parser.parse_args()
    make(args.mesh, args.out, args.parts, args.noise)


if __name__ == "__main__":
    main()
