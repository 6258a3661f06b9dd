#!/usr/bin/env python3
"""Reads city files with a second reader and writes their triangles as OBJ, in the city's coordinate system.

    truth.py INPUT... --crs EPSG:25832 --out truth.obj [--report counts.json] [--geoid GRID.tif]

INPUT may be CityGML, CityJSON, GeoJSON, FlatGeobuf, GeoPackage, Shapefile, GeoParquet, CSV with WKT, OpenStreetMap, glTF,
3D Tiles (tileset.json), I3S (a folder or SLPK), OBJ, PLY or STL. The OBJ has one `o` per object, x east, y north, z up, in
metres; `fidelity truth.obj --no-bake --out DIR` compares it with the city in DIR/city that `insula-server bake` has made.

Needs: pip install numpy lxml pyproj rasterio pyogrio pyarrow shapely mapbox_earcut osmium trimesh DracoPy meshoptimizer
"""
import argparse, collections, importlib, json, pathlib, sys, time

FORMATS = {
    "citygml": [".gml", ".citygml", ".gml.gz", ".citygml.gz", ".gml.zip", ".xml"],
    "cityjson": [".city.json", ".jsonl", ".city.json.gz", ".jsonl.gz"],
    "vectors": [".geojson", ".fgb", ".gpkg", ".shp", ".parquet", ".geoparquet", ".csv", ".csv.gz"],
    "osm": [".osm", ".osm.pbf", ".osm.gz"],
    "gltf": [".glb", ".gltf"],
    "tiles3d": ["tileset.json", ".3tz"],
    "i3s": [".slpk", "3dscenelayer.json.gz", "/"],
    "meshes": [".ply", ".stl", ".obj", ".off"],
}


def format_of(path):
    name = path.lower()
    if pathlib.Path(path).is_dir():
        return "i3s"
    found = [(len(end), kind) for kind, ends in FORMATS.items() for end in ends if name.endswith(end)]
    if not found:
        with open(path, "rb") as file:
            head = file.read(4096)
        return "cityjson" if b'"CityJSON"' in head else sys.exit(f"{path}: the format is not known by its name")
    return max(found)[1]


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("inputs", nargs="+", metavar="INPUT")
    parser.add_argument("--crs", required=True, help="coordinate system of the city, such as EPSG:25832")
    parser.add_argument("--out", required=True, help="OBJ to write")
    parser.add_argument("--report", help="JSON with numbers of objects and triangles, and the extent")
    parser.add_argument("--geoid", help="GeoTIFF grid of the geoid, for sources with heights above the ellipsoid")
    parser.add_argument("--source-crs", help="system of vector files, whatever they say")
    parser.add_argument("--height-field", help="attribute with the height of footprints")
    parser.add_argument("--at", help="LON,LAT,H of the origin of meshes and glTF")
    parser.add_argument("--up", choices="yz", default="z", help="axis of PLY, STL and OBJ that points up")
    parser.add_argument("--bbox", help="WEST,SOUTH,EAST,NORTH in degrees: only objects whose boxes overlap it on the map")
    parser.add_argument("--only", help="kinds of objects, such as Building,BuildingPart")
    return parser.parse_args()


def within(objects, target, bbox):
    """The objects whose boxes overlap the box on the map around an area in degrees."""
    import numpy as np
    west, south, east, north = map(float, bbox.split(","))
    x, y = (axis.reshape(-1) for axis in np.meshgrid(np.linspace(west, east, 17), np.linspace(south, north, 17)))
    area = target.place(np.column_stack([x, y, 0 * x]), "OGC:CRS84")[:, :2]
    low, high = area.min(axis=0), area.max(axis=0)

    def overlaps(item):
        points = item.all_triangles().reshape(-1, 3)[:, :2]
        return (points.max(axis=0) >= low).all() and (points.min(axis=0) <= high).all()

    return filter(overlaps, objects)


def main():
    options = arguments()
    # After the arguments, so that --help needs no module.
    from second_reader.coordinates import Target
    from second_reader.shapes import write_obj
    target = Target(options.crs, options.geoid)
    started, objects = time.monotonic(), []
    for path in options.inputs:
        reader = importlib.import_module(f"second_reader.{format_of(path)}")
        found = reader.read(path, target, options)
        objects += within(found, target, options.bbox) if options.bbox else found
    if options.only:
        wanted = options.only.split(",")
        objects = [item for item in objects if item.kind in wanted]
    if not objects:
        sys.exit("no object has a surface")
    write_obj(options.out, objects)
    corners = [item.all_triangles().reshape(-1, 3) for item in objects]
    report = {
        "objects": len(objects),
        "kinds": collections.Counter(item.kind for item in objects),
        "levels": collections.Counter(str(item.lod) for item in objects),
        "triangles": sum(map(len, corners)) // 3,
        "low": [float(min(c[:, axis].min() for c in corners)) for axis in range(3)],
        "high": [float(max(c[:, axis].max() for c in corners)) for axis in range(3)],
        "secs": round(time.monotonic() - started, 3),
    }
    text = json.dumps(report, indent=1)
    print(text)
    if options.report:
        pathlib.Path(options.report).write_text(text)


if __name__ == "__main__":
    main()
