#!/usr/bin/env python3
"""Checks that one building lands at the same place from CityGML, CityJSON, GeoJSON and 3D Tiles.

    place.py make CITYGML --id GML_ID --crs EPSG:6677 --geoid GRID.tif --out DIR
    place.py check DIR --program target/release/insula-server [--grids DIR] [--tolerance 0.05]

`make` writes the building's CityGML as it is; CityJSON in the projected system with heights above the geoid; GeoJSON in
degrees, with the plan's outline between the lowest and the highest height; and 3D Tiles 1.1 with geocentric positions and
heights above the ellipsoid. `check` bakes each and compares the bounds of the cities. The tolerance should be 1 without the
geoid grid by which the files were made. Exits with 1 if a difference is larger.

Needs: pip install numpy lxml pyproj rasterio shapely mapbox_earcut (make); nothing (check)
"""
import argparse, json, pathlib, struct, subprocess, sys, tempfile

FILES = {"CityGML": "building.gml", "CityJSON": "building.city.json", "GeoJSON": "building.geojson",
         "3D Tiles": "3dtiles/tileset.json"}


def write_citygml(source, building_id, path):
    """The file with all members removed but that of the building. Returns nothing."""
    from lxml import etree
    tree = etree.parse(source)
    for member in list(tree.getroot().iter("{*}cityObjectMember")):
        ids = [value for child in member for name, value in child.attrib.items() if name.endswith("}id")]
        if building_id not in ids:
            member.getparent().remove(member)
    tree.write(str(path), encoding="UTF-8", xml_declaration=True)


def polygons_of(path, target):
    """The rings of the building's polygons at the best level, in world positions."""
    from second_reader import citygml
    found = []
    document = citygml.Document(citygml.open_tree(str(path))[0], target)
    document.triangles = lambda surface: found.append(surface) or []
    list(document.read())
    rings = []
    for polygon, _, crs_of in found:
        crs = document.inherited(polygon if crs_of is None else crs_of, "srsName") or document.city_crs
        own = [document.ring(ring) for ring in polygon.iter("{*}LinearRing")]
        rings.append([target.place(ring, crs, authority_order=True)[:-1] for ring in own])
    return rings


def write_cityjson(polygons, building_id, crs, path):
    import numpy as np
    points = np.concatenate([ring for rings in polygons for ring in rings])
    low, scale = np.floor(points.min(axis=0)), 1e-4
    vertices, number, boundaries = [], {}, []
    for rings in polygons:
        boundaries.append([[] for _ in rings])
        for ring, out in zip(rings, boundaries[-1]):
            for point in ring:
                key = tuple(int(v) for v in np.rint((point - low) / scale))
                out.append(number.setdefault(key, len(number)))
                if len(vertices) < len(number):
                    vertices.append(key)
    geometry = {"type": "MultiSurface", "lod": "2", "boundaries": boundaries}
    code = crs.split(":")[1]
    path.write_text(json.dumps({
        "type": "CityJSON", "version": "2.0", "transform": {"scale": [scale] * 3, "translate": list(map(float, low))},
        "metadata": {"referenceSystem": f"https://www.opengis.net/def/crs/EPSG/0/{code}"},
        "CityObjects": {building_id: {"type": "Building", "geometry": [geometry]}}, "vertices": vertices,
    }))


def write_geojson(polygons, building_id, crs, path):
    import numpy as np, pyproj, shapely
    points = np.concatenate([ring for rings in polygons for ring in rings])
    plans = [shapely.Polygon(rings[0][:, :2]) for rings in polygons]
    # Walls have no area in plan.
    plan = shapely.union_all([plan.buffer(0) for plan in plans if plan.is_valid and plan.area > 1e-3])
    degrees = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    plan = shapely.transform(plan, lambda xy: np.stack(degrees.transform(*xy.T), axis=1))
    properties = {"id": building_id, "min_height": float(points[:, 2].min()), "height": float(points[:, 2].max())}
    feature = {"type": "Feature", "properties": properties, "geometry": json.loads(shapely.to_geojson(plan))}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))


def write_tiles(polygons, target, crs, path):
    import numpy as np, pyproj
    from second_reader.meshes import east_north_up
    from second_reader.shapes import triangulate
    corners = np.concatenate([triangulate(rings) for rings in polygons]).reshape(-1, 3)
    lon, lat = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform(*corners[:, :2].T)
    ellipsoidal = corners[:, 2] + target.geoid(lon, lat)
    to_ecef = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    ecef = np.stack(to_ecef.transform(lon, lat, ellipsoidal), axis=1)
    middle = ecef.mean(axis=0)
    degrees = to_ecef.transform(*middle, direction="INVERSE")
    axes = east_north_up(degrees[0], degrees[1])
    local = (ecef - middle) @ axes
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = axes, middle
    # glTF has y up.
    positions = np.stack([local[:, 0], local[:, 2], -local[:, 1]], axis=1).astype("<f4")
    path.parent.mkdir(exist_ok=True)
    (path.parent / "building.glb").write_bytes(glb(positions))
    half = np.abs(local).max(axis=0) + 1.0
    box = [0, 0, 0, half[0], 0, 0, 0, half[1], 0, 0, 0, half[2]]
    root = {"transform": transform.T.reshape(-1).tolist(), "boundingVolume": {"box": [float(v) for v in box]},
            "geometricError": 0, "refine": "ADD", "content": {"uri": "building.glb"}}
    path.write_text(json.dumps({"asset": {"version": "1.1"}, "geometricError": 100, "root": root}))


def glb(positions):
    """A file with one mesh of separate triangles."""
    data = positions.tobytes()
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 4}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": len(positions), "type": "VEC3",
                       "min": positions.min(axis=0).tolist(), "max": positions.max(axis=0).tolist()}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": len(data)}], "buffers": [{"byteLength": len(data)}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4s2I", b"glTF", 2, 12 + len(chunks)) + chunks


def make(options):
    from second_reader.coordinates import Target
    target, out = Target(options.crs, options.geoid), pathlib.Path(options.out)
    out.mkdir(parents=True, exist_ok=True)
    write_citygml(options.citygml, options.id, out / FILES["CityGML"])
    polygons = polygons_of(out / FILES["CityGML"], target)
    if not polygons:
        sys.exit(f"{options.id} has no polygon")
    write_cityjson(polygons, options.id, options.crs, out / FILES["CityJSON"])
    write_geojson(polygons, options.id, options.crs, out / FILES["GeoJSON"])
    write_tiles(polygons, target, options.crs, out / FILES["3D Tiles"])
    (out / "crs.txt").write_text(options.crs)


def check(options):
    folder = pathlib.Path(options.folder)
    crs = (folder / "crs.txt").read_text().strip()
    grids = ["--grids", options.grids] if options.grids else []
    bounds, worst = {}, 0.0
    with tempfile.TemporaryDirectory() as scratch:
        for name, file in FILES.items():
            city = f"{scratch}/{name.replace(' ', '_')}"
            command = [options.program, "bake", str(folder / file), "--out", city, "--crs", crs, "--ground", "none", *grids]
            made = subprocess.run(command, capture_output=True, text=True)
            if made.returncode:
                sys.exit(f"{name}: {made.stderr.strip()}")
            bounds[name] = json.loads(pathlib.Path(city, "city.json").read_text())["bounds"]
    first = bounds["CityGML"]
    print(f"| format | {' | '.join(f'{end} {axis}' for end in ('low', 'high') for axis in 'xyz')} | largest difference |")
    print("|---|---|---|---|---|---|---|---|")
    for name, of in bounds.items():
        differences = [of[end][axis] - first[end][axis] for end in range(2) for axis in range(3)]
        largest = max(map(abs, differences))
        worst = max(worst, largest)
        print(f"| {name} | {' | '.join(f'{v:.4f}' for end in of for v in end)} | {largest:.4f} |")
    print(f"largest difference {worst:.4f} m, tolerance {options.tolerance} m")
    sys.exit(worst > options.tolerance)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    making = commands.add_parser("make")
    making.add_argument("citygml")
    making.add_argument("--id", required=True)
    making.add_argument("--crs", required=True)
    making.add_argument("--geoid", required=True)
    making.add_argument("--out", required=True)
    making.set_defaults(run=make)
    checking = commands.add_parser("check")
    checking.add_argument("folder")
    checking.add_argument("--program", required=True)
    checking.add_argument("--grids")
    checking.add_argument("--tolerance", type=float, default=0.05)
    checking.set_defaults(run=check)
    options = parser.parse_args()
    options.run(options)


if __name__ == "__main__":
    main()
