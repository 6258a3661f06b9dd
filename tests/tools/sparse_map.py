#!/usr/bin/env python3
"""Writes a map of wide, sparse land, always the same one: few houses and winding roads on 34 x 40 km.

    tests/tools/sparse_map.py sparse.osm
    insula-server bake sparse.osm --out sparse --cell 1
"""

import argparse
import math
import random

HOUSES = 292
ROADS = 1671
# Degrees and kilometres of the land, and the points of a road with their distance in metres.
SOUTH, WEST = 42.4, 1.4
SIZE_KM = (34, 40)
POINTS = 12
STEP_M = 60
METRES_OF_DEGREE = 111_320
KINDS = ["residential", "tertiary", "track", "path", "service", "unclassified"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", help="file to write")
    args = parser.parse_args()
    rng = random.Random(5)
    nodes, ways = [], []

    def node(east_m, north_m):
        lat = SOUTH + north_m / METRES_OF_DEGREE
        lon = WEST + east_m / (METRES_OF_DEGREE * math.cos(math.radians(SOUTH)))
        nodes.append(f'<node id="{len(nodes) + 1}" lat="{lat:.7f}" lon="{lon:.7f}"/>')
        return len(nodes)

    def way(points, tags):
        refs = "".join(f'<nd ref="{point}"/>' for point in points)
        tags = "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())
        ways.append(f'<way id="{len(ways) + 1}">{refs}{tags}</way>')

    def place():
        return [rng.uniform(0, 1000 * side) for side in SIZE_KM]

    for _ in range(HOUSES):
        east, north = place()
        width, depth = rng.uniform(8, 20), rng.uniform(8, 20)
        corners = [node(east + x * width, north + y * depth) for x, y in [(0, 0), (1, 0), (1, 1), (0, 1)]]
        way(corners + corners[:1], {"building": "yes", "height": f"{rng.uniform(4, 12):.1f}"})
    for _ in range(ROADS):
        (east, north), angle, points = place(), rng.uniform(0, math.tau), []
        for _ in range(POINTS):
            points.append(node(east, north))
            angle += rng.uniform(-0.6, 0.6)
            east, north = east + STEP_M * math.cos(angle), north + STEP_M * math.sin(angle)
        way(points, {"highway": rng.choice(KINDS)})

    with open(args.out, "w", encoding="utf-8") as out:
        print('<osm version="0.6">', *nodes, *ways, "</osm>", sep="\n", file=out)


if __name__ == "__main__":
    main()
