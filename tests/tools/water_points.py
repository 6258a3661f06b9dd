#!/usr/bin/env python3
"""Compares water and land of a baked city with those of its OpenStreetMap file at random points.

water_points.py CITY MAP.osm.pbf [--points 200] [--seed 1] [--bbox W,S,E,N]

Half of the points are water and half are land by the map: the sea lies right of the ways with `natural=coastline`, other water
within its areas. A point is land or sea by the nearest segment of the coast. This script reads the map itself, and `tile_decoder` reads
the city's tiles, so neither shares code with Insula. Points are left out where the map is not certain: near a shore, near or below
objects in the water, and where an end of the coast is nearer than twice the distance to the coast itself. Prints the share of right
points, and each wrong point. Exits with 1 if there is one.

Needs Python 3.9; zstandard or the program `zstd`
"""
import argparse, collections, json, math, pathlib, random, struct, sys, zlib

from drawn_terrain import Columns, SIDE
from tile_decoder.shapes import OCCUPIED, REFLECTIVE

# A point is at least so far from a shore, and from the middle of what may stand in the water.
SHORE_M = 4.0
OBJECT_M = 15.0
# A missing piece of coast may be nearer than what is known of it.
LOOSE_SHARE = 2.0
CELL_M = 100.0
TRIES = 400_000
WATER = {"natural": {"water", "bay", "strait"}, "waterway": {"riverbank", "dock"}, "landuse": {"basin", "reservoir"},
         "leisure": {"swimming_pool", "marina"}, "amenity": {"fountain"}}
HIDDEN = {"location": {"underground", "indoor"}, "tunnel": {"yes", "culvert"}, "indoor": {"yes"}}
STANDING = ("building", "building:part", "man_made", "highway", "bridge", "railway", "amenity", "leisure", "barrier",
            "aeroway", "public_transport", "natural", "place")


def fields(data):
    """Numbers and values of the fields of a message of protocol buffers."""
    at, end = 0, len(data)

    def varint():
        nonlocal at
        value = shift = 0
        while True:
            byte = data[at]
            at += 1
            value |= (byte & 127) << shift
            if byte < 128:
                return value
            shift += 7

    while at < end:
        key = varint()
        kind = key & 7
        if kind == 0:
            yield key >> 3, varint()
        elif kind == 2:
            length = varint()
            at += length
            yield key >> 3, data[at - length:at]
        else:
            length = {1: 8, 5: 4}[kind]
            at += length
            yield key >> 3, data[at - length:at]


def packed(data, is_signed=False):
    values, value, shift = [], 0, 0
    for byte in data:
        value |= (byte & 127) << shift
        if byte < 128:
            values.append((value >> 1) ^ -(value & 1) if is_signed else value)
            value = shift = 0
        else:
            shift += 7
    return values


def running(values):
    total, sums = 0, []
    for value in values:
        total += value
        sums.append(total)
    return sums


class Map:
    """Nodes, ways and multipolygons of an .osm.pbf file."""

    def __init__(self, path):
        self.nodes, self.ways, self.relations, self.bbox = {}, {}, [], None
        with open(path, "rb") as file:
            while size := file.read(4):
                head = dict(fields(file.read(struct.unpack(">I", size)[0])))
                blob = dict(fields(file.read(head[3])))
                data = blob[1] if 1 in blob else zlib.decompress(blob[3])
                if head[1] == b"OSMData":
                    self.block(data)
                elif box := dict(fields(data)).get(1):
                    left, right, top, bottom = (packed_box * 1e-9 for packed_box in self.box(box))
                    self.bbox = [left, bottom, right, top]

    @staticmethod
    def box(data):
        values = {number: (value >> 1) ^ -(value & 1) for number, value in fields(data)}
        return [values[number] for number in (1, 2, 3, 4)]

    def block(self, data):
        groups, texts, granularity, offsets = [], [], 100, {19: 0, 20: 0}
        for number, value in fields(data):
            if number == 1:
                texts = [text.decode("utf-8", "replace") for _, text in fields(value)]
            elif number == 2:
                groups.append(value)
            elif number == 17:
                granularity = value
            elif number in offsets:
                offsets[number] = value
        degrees = lambda value, offset: (value * granularity + offset) * 1e-9
        for group in groups:
            for number, value in fields(group):
                if number == 1:
                    raise SystemExit("plain nodes are not supported, only dense ones")
                if number == 2:
                    dense = dict(fields(value))
                    ids, lats, lons = (running(packed(dense.get(key, b""), True)) for key in (1, 8, 9))
                    for node, lat, lon in zip(ids, lats, lons):
                        self.nodes[node] = (degrees(lon, offsets[20]), degrees(lat, offsets[19]))
                elif number in (3, 4):
                    item = {1: 0, 2: b"", 3: b"", 8: b"", 9: b"", 10: b"", **dict(fields(value))}
                    tags = {texts[k]: texts[v] for k, v in zip(packed(item[2]), packed(item[3]))}
                    if number == 3:
                        self.ways[item[1]] = (tags, running(packed(item[8], True)))
                    elif tags.get("type") == "multipolygon":
                        members = running(packed(item[9], True))
                        ways = [member for member, kind in zip(members, packed(item[10])) if kind == 1]
                        self.relations.append((tags, ways))


class Segments:
    """Segments in a grid of cells, by their position in metres."""

    def __init__(self):
        self.cells = collections.defaultdict(list)

    def add(self, a, b):
        (x0, x1), (y0, y1) = (sorted((a[k], b[k])) for k in (0, 1))
        for i in range(int(x0 // CELL_M), int(x1 // CELL_M) + 1):
            for j in range(int(y0 // CELL_M), int(y1 // CELL_M) + 1):
                self.cells[i, j].append((a, b))

    def nearest(self, point, most_m=math.inf):
        """Distance of the nearest segment, and all segments that are as near."""
        i, j = (int(v // CELL_M) for v in point)
        best, found, most = most_m, [], max(2, min(60, int(most_m / CELL_M) + 2) if most_m < math.inf else 60)
        for ring in range(most):
            if found and best < (ring - 1) * CELL_M:
                break
            for u in range(i - ring, i + ring + 1):
                step = 1 if abs(u - i) == ring else 2 * ring
                for v in range(j - ring, j + ring + 1, step or 1):
                    for segment in self.cells.get((u, v), ()):
                        distance = distance_m(point, *segment)
                        if distance < best - 1e-6:
                            best, found = distance, [segment]
                        elif distance <= best + 1e-6 and segment not in found:
                            found.append(segment)
        return best, found


def cross(a, b, p):
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])


def distance_m(p, a, b):
    dx, dy = b[0] - a[0], b[1] - a[1]
    share = ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / (dx * dx + dy * dy or 1)
    share = min(max(share, 0), 1)
    return math.hypot(p[0] - a[0] - share * dx, p[1] - a[1] - share * dy)


class Area:
    """All segments of an area's rings."""

    def __init__(self, lines):
        self.lines = lines
        points = [point for line in lines for point in line]
        self.low, self.high = ([limit(p[k] for p in points) for k in (0, 1)] for limit in (min, max))

    def has(self, p):
        if not all(self.low[k] <= p[k] <= self.high[k] for k in (0, 1)):
            return False
        inside = False
        for line in self.lines:
            for a, b in zip(line, line[1:]):
                if (a[1] > p[1]) != (b[1] > p[1]) and a[0] + (p[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]) > p[0]:
                    inside = not inside
        return inside


def utm(zone, is_south):
    """From degrees to a zone of UTM, in the series of Krueger."""
    a, f, k0 = 6378137.0, 1 / 298.257222101, 0.9996
    n, e = f / (2 - f), math.sqrt(f * (2 - f))
    radius = a / (1 + n) * (1 + n**2 / 4 + n**4 / 64)
    alphas = [n / 2 - 2 * n**2 / 3 + 5 * n**3 / 16, 13 * n**2 / 48 - 3 * n**3 / 5, 61 * n**3 / 240]

    def project(lon, lat):
        lam, phi = math.radians(lon - (6 * zone - 183)), math.radians(lat)
        t = math.sinh(math.atanh(math.sin(phi)) - e * math.atanh(e * math.sin(phi)))
        xi, eta = math.atan2(t, math.cos(lam)), math.atanh(math.sin(lam) / math.sqrt(1 + t * t))
        north = xi + sum(al * math.sin(2 * j * xi) * math.cosh(2 * j * eta) for j, al in enumerate(alphas, 1))
        east = eta + sum(al * math.cos(2 * j * xi) * math.sinh(2 * j * eta) for j, al in enumerate(alphas, 1))
        return 500000 + k0 * radius * east, k0 * radius * north + (10_000_000 if is_south else 0)

    return project


def projection(crs):
    code = int(crs.partition("+")[0].rpartition(":")[2])
    for first, is_south in ((32600, False), (32700, True), (25800, False)):
        if 1 <= code - first <= 60:
            return utm(code - first, is_south)
    raise SystemExit(f"the city's system {crs} is no zone of UTM")


def tells(tags, table):
    return any(tags.get(key) in values for key, values in table.items())


class Known:
    """What the map says of points."""

    def __init__(self, osm, project):
        self.coast, self.shores, self.standing = Segments(), Segments(), Segments()
        self.waters, self.cover, starts, ends = [], [], collections.Counter(), collections.Counter()
        places = {}

        def line(refs):
            for ref in refs:
                if ref in osm.nodes and ref not in places:
                    places[ref] = project(*osm.nodes[ref])
            return [places[ref] for ref in refs if ref in places]

        has_coast = any(tags.get("natural") == "coastline" for tags, _ in osm.ways.values())
        table = {key: values - {"marina"} if has_coast else values for key, values in WATER.items()}
        lines = {way: line(refs) for way, (_, refs) in osm.ways.items()}
        areas = [(tags, [lines[way]]) for way, (tags, refs) in osm.ways.items() if len(refs) > 3 and refs[0] == refs[-1]]
        for tags, members in osm.relations:
            # With members outside of the file, inside and outside are not known.
            if all(way in lines and len(lines[way]) > 1 for way in members):
                areas.append((tags, [lines[way] for way in members]))
        for tags, rings in areas:
            rings = [ring for ring in rings if len(ring) > 1]
            if not rings:
                continue
            is_water = tells(tags, table) and not tells(tags, HIDDEN) and "building" not in tags
            if is_water:
                self.waters.append(Area(rings))
            if tells(tags, WATER) or tags.get("harbour"):
                self.add(self.shores, rings)
            if not is_water and any(key in tags for key in STANDING):
                self.cover.append(Area(rings))
        for way, (tags, refs) in osm.ways.items():
            if tags.get("natural") == "coastline" and len(lines[way]) > 1:
                self.add(self.coast, [lines[way]])
                self.add(self.shores, [lines[way]])
                starts[lines[way][0]] += 1
                ends[lines[way][-1]] += 1
            elif tags.get("waterway"):
                self.add(self.shores, [lines[way]])
            elif any(key in tags for key in STANDING) and not tells(tags, WATER):
                self.add(self.standing, [lines[way]])
        self.loose = {point for point in starts | ends if starts[point] != ends[point]}
        self.has_coast = has_coast

    @staticmethod
    def add(segments, lines):
        for points in lines:
            for a, b in zip(points, points[1:]):
                segments.add(a, b)

    def is_sea(self, point):
        """Whether the nearest coast has the point on its right; None if that is not known."""
        if not self.has_coast:
            return False
        distance, found = self.coast.nearest(point)
        if not found or any(math.dist(end, point) < LOOSE_SHARE * distance for end in self.loose):
            return None
        sides = {cross(a, b, point) < 0 for a, b in found}
        if len(sides) == 1:
            return sides.pop()
        # Behind a corner: of a turn to the left the right side is outside.
        for a, b in found:
            for c, d in found:
                if b == c:
                    return cross(a, b, d) > 0
        return None

    def is_water(self, point):
        """Whether a point is water; None if the map leaves doubts."""
        if self.shores.nearest(point, SHORE_M)[1]:
            return None
        if any(area.has(point) for area in self.waters):
            water = True
        else:
            water = self.is_sea(point)
        if water and (self.standing.nearest(point, OBJECT_M)[1] or any(area.has(point) for area in self.cover)):
            return None
        return water


def is_drawn_as_water(columns, point):
    """Whether the finest column at a point is water; None without a column or ground."""
    if (found := columns.tile(*point)) is None:
        return None
    tile, side_m, place = found
    cells = [((at - corner) / side_m - k) * SIDE for at, corner, k in zip(point, columns.manifest["origin"], place)]
    column, row = (min(int(cell), SIDE - 1) for cell in cells)
    i = row * SIDE + column
    return tile.has(i, OCCUPIED) and tile.has(i, REFLECTIVE)


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("city", type=pathlib.Path)
    parser.add_argument("map", type=pathlib.Path)
    parser.add_argument("--points", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--bbox", help="W,S,E,N in degrees, where points are drawn, default: the extent of the buildings")
    options = parser.parse_args()
    columns, osm = Columns(options.city), Map(options.map)
    project = projection(columns.manifest["crs"])
    if options.bbox:
        west, south, east, north = map(float, options.bbox.split(","))
    else:
        refs = [ref for tags, refs in osm.ways.values() if "building" in tags for ref in refs if ref in osm.nodes]
        lons, lats = zip(*(osm.nodes[ref] for ref in refs))
        west, south, east, north = min(lons), min(lats), max(lons), max(lats)
    known, draw = Known(osm, project), random.Random(options.seed)
    counts, right, wrong = {True: 0, False: 0}, 0, []
    for _ in range(TRIES):
        if sum(counts.values()) == options.points:
            break
        place = draw.uniform(west, east), draw.uniform(south, north)
        point = project(*place)
        water = known.is_water(point)
        if water is None or counts[water] == options.points // 2:
            continue
        counts[water] += 1
        drawn = is_drawn_as_water(columns, point)
        if drawn == water:
            right += 1
        else:
            names = {True: "water", False: "land", None: "nothing"}
            wrong.append(f"{place[1]:.6f}, {place[0]:.6f}: {names[water]} in the map, {names[drawn]} in the city")
    print("\n".join(wrong + [f"{right} of {sum(counts.values())} right ({counts[True]} water, {counts[False]} land)"]))
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
