#!/usr/bin/env python3
"""Repeats real footprints over a grid until there are as many as wanted, as GeoParquet or OpenStreetMap.

    tile_footprints.py SRC.geojson --count 5000000 --out big.parquet
    tile_footprints.py SRC.geojson --count 5000000 --out big.osm.pbf

Each copy of the city has other heights, and every second one is mirrored. The files are written as a stream: memory does not
depend on the number. The Parquet file has columns of Overture's buildings (id, height, num_floors, class, bbox, geometry) in
groups of 50,000 rows; in the other one, each ring is a closed way with `building` and `height`, and holes are left out.

Needs: pip install numpy shapely pyarrow (Parquet); numpy shapely osmium (PBF)
"""
import argparse, json, math

# Space between two copies, in degrees.
GAP_DEG = 0.002
ROWS = 50_000


def source(path):
    """Polygons and heights of a GeoJSON file."""
    import numpy as np, shapely
    features = json.load(open(path, encoding="utf-8"))["features"]
    features = [f for f in features if f.get("geometry") and f["geometry"]["type"] == "Polygon"]
    shapes = shapely.from_geojson([json.dumps(f["geometry"]) for f in features])
    heights = np.array([f["properties"].get("height") or 6.0 for f in features], dtype=float)
    return shapes, heights


def copies(shapes, heights, count):
    """For each copy its polygons and heights; the last one is cut to the wanted number."""
    import numpy as np, shapely
    west, south, east, north = shapely.total_bounds(shapes)
    number = math.ceil(count / len(shapes))
    side = math.ceil(math.sqrt(number))
    step = np.array([east - west + GAP_DEG, north - south + GAP_DEG])
    for tile in range(number):
        take = min(len(shapes), count - tile * len(shapes))
        shift = np.array([tile % side, tile // side]) * step
        mirror = tile % 2 == 1
        moved = shapely.transform(shapes[:take], lambda xy: np.column_stack([
            (west + east - xy[:, 0] if mirror else xy[:, 0]) + shift[0], xy[:, 1] + shift[1],
        ]))
        # Between 0.7 and 1.3 of the original, the same in every run.
        factor = 0.7 + 0.6 * np.random.default_rng(tile).random(take)
        yield tile, moved, np.round(heights[:take] * factor, 1)


def write_parquet(path, shapes, heights, count):
    import numpy as np, pyarrow as pa, pyarrow.parquet as pq, shapely
    box = pa.struct([(name, pa.float32()) for name in ("xmin", "xmax", "ymin", "ymax")])
    covering = {"bbox": {name: ["bbox", name] for name in ("xmin", "ymin", "xmax", "ymax")}}
    geo = {"version": "1.1.0", "primary_column": "geometry", "columns": {
        "geometry": {"encoding": "WKB", "geometry_types": ["Polygon"], "covering": covering}}}
    schema = pa.schema([
        ("id", pa.string()), ("height", pa.float64()), ("num_floors", pa.int32()), ("class", pa.string()), ("bbox", box),
        ("geometry", pa.binary()),
    ], metadata={"geo": json.dumps(geo)})
    with pq.ParquetWriter(path, schema, compression="snappy") as out:
        for tile, moved, tall in copies(shapes, heights, count):
            for start in range(0, len(moved), ROWS):
                part, top = moved[start:start + ROWS], tall[start:start + ROWS]
                low_x, low_y, high_x, high_y = shapely.bounds(part).T.astype(np.float32)
                boxes = pa.StructArray.from_arrays([low_x, high_x, low_y, high_y], fields=list(box))
                ids = [f"{tile}-{start + i}" for i in range(len(part))]
                floors = np.maximum(1, np.round(top / 3)).astype(np.int32)
                columns = [ids, top, floors, ["residential"] * len(part), boxes, shapely.to_wkb(part).tolist()]
                out.write_table(pa.table(columns, schema=schema), row_group_size=ROWS)


def write_osm(path, shapes, heights, count):
    import osmium, shapely
    with osmium.SimpleWriter(path, overwrite=True) as out:
        node = 0
        for _, moved, _ in copies(shapes, heights, count):
            for ring in shapely.get_exterior_ring(moved):
                for at in shapely.get_coordinates(ring)[:-1].tolist():
                    node += 1
                    out.add_node(osmium.osm.mutable.Node(id=node, location=tuple(at), version=1))
        node = way = 0
        for _, moved, tall in copies(shapes, heights, count):
            sizes = shapely.get_num_points(shapely.get_exterior_ring(moved)) - 1
            for size, height in zip(sizes.tolist(), tall.tolist()):
                refs = [*range(node + 1, node + 1 + size), node + 1]
                node, way = node + size, way + 1
                tags = {"building": "yes", "height": str(height)}
                out.add_way(osmium.osm.mutable.Way(id=way, nodes=refs, version=1, tags=tags))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", metavar="SRC.geojson")
    parser.add_argument("--count", type=int, required=True)
    parser.add_argument("--out", required=True)
    options = parser.parse_args()
    shapes, heights = source(options.source)
    write = write_parquet if options.out.endswith(".parquet") else write_osm
    write(options.out, shapes, heights, options.count)


if __name__ == "__main__":
    main()
