#!/usr/bin/env python3
"""Opens exports of one city with programs of other people, and compares them.

exports.py FILE... [--source FILE] [--min-area M2] [--json]

FILEs are exports of the same city and selection by `insula-server export`: `.csv`, `.geojson`, `.parquet`, `.fgb`, `.jsonl`
(CityJSON text sequence), `.glb` and `.tif`, at least one of them a table. Needs Python with numpy, shapely, pyarrow, geopandas, pyogrio,
pyproj, rasterio and trimesh; checks of a file whose reader is missing are left out, and said so. With cjio, CityJSON is also read by it,
and with the program cjval on the PATH (`cargo install cjval --features build-binary`) validated.

Checks, of each object by its number:
- all tables have the same objects (FlatGeobuf: those with a footprint), values and areas;
- footprints are valid, outer rings are counter-clockwise, and their area is `area_m2`;
- GeoJSON, projected to the system that GeoParquet names, has the same areas within 0.1%;
- CityJSON: vertices and links exist, parts have parents, roofs are not above `roof_z_m`;
- GeoTIFF: inside a footprint, no height exceeds the object's `roof_z_m` by more than a cell;
- GLB: it is as high as the objects from the lowest `ground_z_m` to the highest `roof_z_m`, within 0.5 m;
- with `--source`, the CityJSON or CityJSON text sequence that was baked: the first table has its objects, with the values of all
  attributes that are texts, numbers or booleans.

Prints a line for each file and each difference (at most 20 a file). Exits with 1 if there is a difference.
"""
import argparse, csv, importlib, json, math, pathlib, shutil, subprocess, sys


def module(name):
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


class Report:
    def __init__(self):
        self.failures = {}
        self.notes = []

    def fail(self, file, text):
        self.failures.setdefault(file, []).append(text)

    def check(self, condition, file, text):
        if not condition:
            self.fail(file, text)


def read_csv(path):
    csv.field_size_limit(1 << 30)
    shapely = module("shapely")
    rows = {}
    with open(path, newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            wkt = row.pop("wkt")
            row["geometry"] = shapely.from_wkt(wkt) if wkt else None
            rows[int(row["object"])] = row
    return rows, None


def read_geojson(path):
    from shapely.geometry import shape
    features = json.loads(path.read_text(encoding="utf-8"))["features"]
    rows = {}
    for feature in features:
        geometry = feature["geometry"] and shape(feature["geometry"])
        rows[feature["id"]] = dict(feature["properties"]) | {"geometry": geometry}
    return rows, "OGC:CRS84"


def frame_rows(frame):
    rows = {}
    for row in frame.drop(columns=[c for c in ("bbox",) if c in frame]).to_dict("records"):
        rows[int(row["object"])] = row
    return rows


def read_parquet(path):
    frame = module("geopandas").read_parquet(path)
    table = module("pyarrow.parquet").read_table(path, columns=["object", "bbox"])
    boxes = dict(zip(table["object"].to_pylist(), table["bbox"].to_pylist()))
    rows = frame_rows(frame)
    for number, row in rows.items():
        row["bbox"] = boxes[number]
    return rows, frame.crs


def read_flatgeobuf(path):
    frame = module("pyogrio").read_dataframe(path)
    return frame_rows(frame), frame.crs


TABLES = {".csv": (read_csv, "shapely"), ".geojson": (read_geojson, "shapely"), ".parquet": (read_parquet, "geopandas"),
          ".fgb": (read_flatgeobuf, "pyogrio")}


def text_of(value):
    """A value as the CSV file has it."""
    if value is None or value is module("pandas").NaT or (isinstance(value, float) and math.isnan(value)):
        return ""
    if hasattr(value, "isoformat"):
        return value.isoformat()[:10]
    if isinstance(value, bool) or type(value).__name__ == "bool_":
        return "true" if value else "false"
    return str(value)


def same(a, b):
    a, b = text_of(a), text_of(b)
    if a == b or {a.lower(), b.lower()} in ({"true", "1.0"}, {"false", "0.0"}, {"true", "1"}, {"false", "0"}):
        return True
    try:
        return math.isclose(float(a), float(b), rel_tol=1e-12, abs_tol=1e-12)
    except ValueError:
        return False


def check_geometry(report, name, number, row):
    geometry = row["geometry"]
    if geometry is None or geometry.is_empty:
        return
    report.check(geometry.is_valid, name, f"{number}: the footprint is not valid")
    report.check(geometry.geom_type in ("Polygon", "MultiPolygon"), name, f"{number}: a {geometry.geom_type}")
    for polygon in getattr(geometry, "geoms", [geometry]):
        turns = polygon.exterior.is_ccw and not any(hole.is_ccw for hole in polygon.interiors)
        report.check(turns, name, f"{number}: rings turn the wrong way")
    area = float(row["area_m2"])
    report.check(abs(geometry.area - area) <= max(0.002, 1e-6 * area), name, f"{number}: area {geometry.area}, not {area}")
    if "bbox" in row:
        box = [row["bbox"][k] for k in ("xmin", "ymin", "xmax", "ymax")]
        report.check(list(geometry.bounds) == box, name, f"{number}: bbox is {box}, not {geometry.bounds}")


def compare_tables(report, tables):
    (first_name, (first, _)), *others = tables.items()
    for name, (rows, _) in others:
        wanted = {n for n, row in first.items() if not name.endswith(".fgb") or row["geometry"] is not None}
        report.check(set(rows) == wanted, name, f"{len(rows)} objects, {len(wanted)} in {first_name}")
        for number in sorted(set(rows) & wanted):
            for field in (f for f in first[number] if f not in ("geometry", "bbox")):
                a, b = first[number][field], rows[number].get(field)
                report.check(same(a, b), name, f"{number}: {field} is {text_of(b)!r}, in {first_name} {text_of(a)!r}")
    for name, (rows, crs) in tables.items():
        if crs == "OGC:CRS84":
            continue
        for number, row in rows.items():
            check_geometry(report, name, number, row)


def check_lon_lat(report, tables, min_area):
    degrees = [(name, rows) for name, (rows, crs) in tables.items() if crs == "OGC:CRS84"]
    planes = [(name, crs) for name, (_, crs) in tables.items() if crs is not None and crs != "OGC:CRS84"]
    if not degrees or not planes or not module("pyproj"):
        return
    (name, rows), (plane, crs) = degrees[0], planes[0]
    import numpy, pyproj, shapely
    to_plane = pyproj.Transformer.from_crs("OGC:CRS84", crs, always_xy=True)
    for number, row in rows.items():
        if row["geometry"] is None or row["area_m2"] < min_area:
            continue
        report.check(row["geometry"].is_valid, name, f"{number}: the footprint is not valid")
        back = shapely.transform(row["geometry"], lambda p: numpy.column_stack(to_plane.transform(p[:, 0], p[:, 1])))
        other = tables[plane][0][number]["geometry"]
        shift = back.centroid.distance(other.centroid)
        is_near = abs(back.area - row["area_m2"]) <= 1e-3 * row["area_m2"] and shift < 2.0
        report.check(is_near, name, f"{number}: area {back.area:.2f} and {shift:.2f} m away in the system of {plane}")


def check_cityjson(report, path, table):
    name = path.name
    head, *features = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    report.check(head["type"] == "CityJSON" and head["version"] == "2.0", name, "the first line is not CityJSON 2.0")
    scale, move = head["transform"]["scale"], head["transform"]["translate"]
    by_identifier = {row["identifier"]: row for row in table.values() if text_of(row["identifier"])}
    surfaces = objects = 0
    for feature in features:
        members = feature["CityObjects"]
        report.check(feature["id"] in members, name, f"{feature['id']}: not among its objects")
        used = set()
        for key, member in members.items():
            objects += 1
            for parent in member.get("parents", []):
                report.check(key in members.get(parent, {}).get("children", []), name, f"{key}: its parent has it not")
            for child in member.get("children", []):
                report.check(key in members.get(child, {}).get("parents", []), name, f"{key}: its child has it not")
            is_part = member["type"].endswith("Part")
            report.check(not is_part or "parents" in member, name, f"{key}: a part without a parent")
            heights = []
            for geometry in member.get("geometry", []):
                for ring in (ring for rings in geometry["boundaries"] for ring in rings):
                    surfaces += 1
                    used.update(ring)
                    is_ring = len(set(ring)) == len(ring) >= 3 and max(ring) < len(feature["vertices"])
                    report.check(is_ring, name, f"{key}: a ring is not valid")
                    heights += [feature["vertices"][v][2] * scale[2] + move[2] for v in ring]
            row = by_identifier.get(key)
            if row and heights and text_of(row["roof_z_m"]):
                over = max(heights) - float(row["roof_z_m"])
                report.check(over < 0.005, name, f"{key}: {over:.3f} m above roof_z_m")
        report.check(len(used) == len(feature["vertices"]), name, f"{feature['id']}: has unused vertices")
    report.notes.append(f"{name}: {len(features)} features, {objects} objects, {surfaces} rings")
    validate_cityjson(report, path)
    cityjson = module("cjio.cityjson")
    if cityjson is None:
        report.notes.append(f"{name}: cjio is not installed, only own checks")
        return
    # Its reader of sequences reads the standard input.
    with open(path, encoding="utf-8") as sys.stdin:
        model = cityjson.read_stdin()
    sys.stdin = sys.__stdin__
    found = len(model.j["CityObjects"])
    report.check(found == objects, name, f"cjio finds {found} objects of {objects}: identifiers are not unique")
    report.notes.append(f"{name}: cjio reads {found} objects, EPSG:{model.get_epsg()}")


def validate_cityjson(report, path):
    """By the schemas of CityJSON, each feature on its own; cjval exits with 0 whatever it finds."""
    name = path.name
    if shutil.which("cjval") is None:
        report.notes.append(f"{name}: cjval is not installed, not validated")
        return
    with open(path, "rb") as file:
        done = subprocess.run(["cjval", "--report"], stdin=file, capture_output=True, text=True, check=True)
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.strip()]
    for line in lines:
        wrong = [kind for kinds in line["checks"].values() for kind, found in kinds.items() if not found["valid"]]
        report.check(line["valid"] and not line["has_warnings"], name, f"cjval, {line['file']}: {', '.join(wrong)}")
    report.check(lines, name, "cjval reports nothing")
    report.notes.append(f"{name}: cjval validates {len(lines)} lines")


def check_geotiff(report, path, table, min_area):
    rasterio, name = module("rasterio"), path.name
    import numpy
    from rasterio import features
    with rasterio.open(path) as raster:
        heights = raster.read(1, masked=True)
        cell = raster.transform.a
        report.check(raster.block_shapes == [(256, 256)] and raster.nodata == -9999, name, "not tiled, or without nodata")
        report.notes.append(f"{name}: {raster.width} x {raster.height}, {raster.crs}, heights {heights.min()} to {heights.max()}")
        shapes = [(row["geometry"], row) for row in table.values() if row["geometry"] is not None and float(row["area_m2"]) >= min_area]
        roofs = numpy.full(heights.shape, -numpy.inf)
        for geometry, row in shapes:
            inside = features.rasterize([geometry], heights.shape, transform=raster.transform, all_touched=True)
            numpy.maximum(roofs, numpy.where(inside == 1, float(row["roof_z_m"]), -numpy.inf), out=roofs)
        covered = numpy.isfinite(roofs) & ~heights.mask
        over = int((covered & (heights.filled(-numpy.inf) > roofs + cell)).sum())
        report.check(over <= 0.001 * covered.sum(), name, f"{over} of {covered.sum()} cells are above the roofs")
        report.check(not shapes or covered.any(), name, "no height is inside a footprint")
        text = raster.tags().get("TIFFTAG_COPYRIGHT", "")
        report.notes.append(f"{name}: copyright {text!r}")


def check_glb(report, path, table):
    scene, name = module("trimesh").load(path), path.name
    triangles = sum(len(geometry.faces) for geometry in scene.geometry.values())
    low, high = scene.bounds
    rows = [row for row in table.values() if row["geometry"] is not None]
    height = max(float(row["roof_z_m"]) for row in rows) - min(float(row["ground_z_m"]) for row in rows)
    # y is up.
    report.check(abs(high[1] - low[1] - height) < 0.5, name, f"{high[1] - low[1]:.2f} m high, the objects {height:.2f} m")
    report.notes.append(f"{name}: {triangles} triangles, {high[1] - low[1]:.2f} m high")


def check_source(report, source, name, rows):
    """The objects and values of a table are those of the baked CityJSON."""
    text = source.read_text(encoding="utf-8")
    documents = map(json.loads, text.splitlines()) if source.suffix == ".jsonl" else [json.loads(text)]
    objects = {key: found for document in documents for key, found in document["CityObjects"].items()}
    known = {row["identifier"]: row for row in rows.values()}
    report.check(set(known) == set(objects), name, f"{len(known)} objects, {len(objects)} in {source.name}")
    compared = 0
    for key in sorted(set(known) & set(objects)):
        for field, value in objects[key].get("attributes", {}).items():
            if isinstance(value, (dict, list)) or value is None:
                continue
            compared += 1
            found = known[key].get(field)
            report.check(same(value, found), name, f"{key}: {field} is {text_of(found)!r}, in {source.name} {text_of(value)!r}")
    report.notes.append(f"{source.name}: {len(objects)} objects, {compared} values")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", type=pathlib.Path)
    parser.add_argument("--min-area", type=float, default=1.0, help="smallest footprint that is compared with others, in m2")
    parser.add_argument("--source", type=pathlib.Path, metavar="FILE", help="the CityJSON that was baked")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    report, tables = Report(), {}
    for path in options.files:
        reader, needs = TABLES.get(path.suffix, (None, None))
        if reader and not module(needs):
            report.notes.append(f"{path.name}: {needs} is not installed, not checked")
        elif reader:
            tables[path.name] = reader(path)
            rows, crs = tables[path.name]
            report.notes.append(f"{path.name}: {len(rows)} objects, {getattr(crs, 'name', crs)}")
    if not tables:
        sys.exit("no table among the files: export one as csv, geojson, geoparquet or flatgeobuf")
    compare_tables(report, tables)
    check_lon_lat(report, tables, options.min_area)
    if options.source:
        name, (rows, _) = next(iter(tables.items()))
        check_source(report, options.source, name, rows)
    world = next((rows for rows, crs in tables.values() if crs != "OGC:CRS84"), {})
    for path in options.files:
        if path.suffix == ".jsonl":
            check_cityjson(report, path, world)
        elif path.suffix == ".tif" and module("rasterio"):
            check_geotiff(report, path, world, options.min_area)
        elif path.suffix == ".glb" and module("trimesh"):
            check_glb(report, path, world)
    if options.json:
        print(json.dumps({"notes": report.notes, "differences": report.failures}, indent=1, ensure_ascii=False))
    else:
        print("\n".join(report.notes))
        for name, failures in report.failures.items():
            print("\n".join(f"DIFFERS {name}: {text}" for text in failures[:20]))
            if len(failures) > 20:
                print(f"DIFFERS {name}: {len(failures) - 20} more")
    sys.exit(1 if report.failures else 0)


if __name__ == "__main__":
    main()
