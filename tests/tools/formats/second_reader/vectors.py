"""Footprints of GeoJSON, FlatGeobuf, GeoPackage, Shapefile (pyogrio), GeoParquet (pyarrow) and CSV with WKT (shapely)."""
import csv, gzip, itertools, json, pathlib, sys
import numpy as np
import pyarrow.parquet
import pyogrio
import pyogrio.raw
import shapely
from .footprints import LEVELS, TOP, footprint_object, number
from .shapes import CityObject, triangulate

# A ring whose heights differ by less is level.
LEVEL_M = 0.001
GEOMETRY_COLUMNS = ["wkt", "the_geom", "geom", "geometry", "wkt_geometry", "_wkt"]


def polygons_of(geometry):
    """All polygons of a geometry and of the collections in it."""
    if geometry is None or geometry.is_empty:
        return []
    if geometry.geom_type == "Polygon":
        return [geometry]
    return [found for part in getattr(geometry, "geoms", []) for found in polygons_of(part)]


def layers(path):
    """For each layer its features as (name, geometry, attributes) and its coordinate system."""
    if path.lower().endswith((".parquet", ".geoparquet")):
        yield parquet(path)
    elif ".csv" in path.lower():
        yield table(path)
    else:
        for name, kind in pyogrio.list_layers(path):
            if kind is not None:
                yield layer(path, name)


def layer(path, name):
    meta, fids, geometries, columns = pyogrio.raw.read(path, layer=name, return_fids=True)
    names = [str(field) for field in meta["fields"]]

    def features():
        for i, wkb in enumerate(geometries):
            values = {name: plain(column[i]) for name, column in zip(names, columns)}
            yield f"{name} {fids[i]}", shapely.from_wkb(wkb) if wkb is not None else None, values

    return features(), meta["crs"]


def plain(value):
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and value != value else value


def parquet(path):
    file = pyarrow.parquet.ParquetFile(path)
    geo = json.loads(file.schema_arrow.metadata[b"geo"])
    name = geo["primary_column"]
    crs = geo["columns"][name].get("crs", "EPSG:4326")

    def features():
        for batch in file.iter_batches():
            for i, row in enumerate(batch.to_pylist()):
                wkb = row.pop(name)
                yield str(row.get("id") or i), shapely.from_wkb(wkb) if wkb else None, row

    return features(), json.dumps(crs) if isinstance(crs, dict) else crs


def table(path):
    csv.field_size_limit(sys.maxsize)
    opened = gzip.open(path, "rt", encoding="utf-8-sig") if path.endswith(".gz") else open(path, encoding="utf-8-sig")
    with opened as file:
        dialect = csv.Sniffer().sniff(file.readline(), delimiters=",;\t|")
        file.seek(0)
        rows = list(csv.DictReader(file, dialect=dialect))
    name = next(name for wanted in GEOMETRY_COLUMNS for name in rows[0] if name.lower() == wanted)
    return ((str(i), shapely.from_wkt(row.pop(name)), row) for i, row in enumerate(rows)), "EPSG:4326"


def is_in_space(polygons, attributes):
    """Whether polygons of (n, 3) rings are surfaces. A single one of a building with a height is its plan."""
    level = all(np.ptp(ring[:, 2]) < LEVEL_M for rings in polygons for ring in rings)
    has_height = any(number(attributes.get(name)) is not None for name in TOP + LEVELS)
    return not level and not (len(polygons) == 1 and has_height)


def placed_features(features, target, crs):
    """Features with their geometries in world coordinates, moved by the thousand because each call of pyproj takes time."""
    place = lambda points: target.place(np.nan_to_num(points), crs)
    while batch := list(itertools.islice(features, 4096)):
        shapes = shapely.force_3d(np.array([feature[1] for feature in batch], dtype=object))
        shapes = shapely.transform(shapes, place, include_z=True)
        yield from ((name, shape, attributes) for (name, _, attributes), shape in zip(batch, shapes))


def has_wall(placed):
    """Whether a layer has an upright polygon: then all of its polygons are surfaces in space."""
    for _, geometry, _ in placed:
        if geometry is not None and geometry.geom_type == "Polygon":
            ring = shapely.get_coordinates(geometry.exterior, include_z=True)
            extent = np.ptp(ring, axis=0)
            if extent[2] >= LEVEL_M and shapely.Polygon(ring[:, :2]).area < 1e-3 * (extent[0] ** 2 + extent[1] ** 2):
                return True
    return False


def read(path, target, options):
    is_multipatch = path.lower().endswith(".shp") and pathlib.Path(path).read_bytes()[32] == 31
    for features, crs in layers(path):
        placed = list(placed_features(features, target, options.source_crs or crs))
        is_in_layer_of_surfaces = is_multipatch or has_wall(placed)
        for name, geometry, attributes in placed:
            polygons = []
            for polygon in polygons_of(geometry):
                rings = [polygon.exterior, *polygon.interiors]
                polygons.append([shapely.get_coordinates(ring, include_z=True) for ring in rings])
            if not polygons:
                continue
            if is_in_layer_of_surfaces or is_in_space(polygons, attributes):
                made = CityObject(name, triangles=[t for t in map(triangulate, polygons) if len(t)])
                if made.triangles:
                    yield made
            else:
                made = footprint_object(name, polygons, attributes, options.height_field)
                if made:
                    yield made
