#!/usr/bin/env python3
"""Writes one small block of buildings in every vector format, CityGML, CityJSON and OpenStreetMap.

Needs geopandas, pyogrio, pyarrow, pyproj, shapely (PyPI). The files in server/bake/tests/data/formats were made by it.
"""
import argparse
import gzip
import json
import os
from pathlib import Path

import geopandas
import pandas
from pyproj import Transformer
from shapely.geometry import MultiPolygon, Polygon

ORIGIN = (500_000.0, 5_400_000.0)
CRS = "EPSG:25832"


def rectangle(x, y, width, depth):
    x, y = ORIGIN[0] + x, ORIGIN[1] + y
    return [(x, y), (x + width, y), (x + width, y + depth), (x, y + depth)]


BUILDINGS = [
    ("court", [Polygon(rectangle(0, 0, 40, 30), [rectangle(10, 10, 20, 10)])], 18.5, 5, "residential"),
    ("halls", [Polygon(rectangle(60, 0, 30, 20)), Polygon(rectangle(60, 30, 30, 20))], 9.25, 2, "industrial"),
    ("tower", [Polygon(rectangle(110, 10, 12, 12))], 64.0, 20, "office"),
]


def write_vectors(out):
    shapes = [polygons[0] if len(polygons) == 1 else MultiPolygon(polygons) for _, polygons, *_ in BUILDINGS]
    columns = {name: [row[i] for row in BUILDINGS] for name, i in [("id", 0), ("height", 2), ("levels", 3), ("usage", 4)]}
    frame = geopandas.GeoDataFrame(columns, geometry=shapes, crs=CRS)
    frame.to_file(out / "block.fgb", driver="FlatGeobuf", engine="pyogrio")
    frame.to_file(out / "block.gpkg", driver="GPKG", engine="pyogrio", layer="buildings")
    frame.to_file(out / "block.shp", driver="ESRI Shapefile", engine="pyogrio")
    frame.to_parquet(out / "block.parquet", compression="snappy")
    table = pandas.DataFrame(columns)
    table["wkt"] = [f"SRID=25832;{shape.wkt}" for shape in shapes]
    table.to_csv(out / "block.csv", index=False)
    features = json.loads(frame.to_json(drop_id=True))
    # The first member, so that readers know it before the features.
    features = {"crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}, **features}
    (out / "block.geojson").write_text(json.dumps(features))
    with gzip.GzipFile(out / "block.gpkg.gz", "wb", mtime=0) as packed:
        packed.write((out / "block.gpkg").read_bytes())
    os.remove(out / "block.gpkg")


def faces(polygon, height):
    """Rings of each face of a prism, outward."""
    outer = list(polygon.exterior.coords)[:-1]
    holes = [list(ring.coords)[:-1] for ring in polygon.interiors]
    outer = outer if polygon.exterior.is_ccw else outer[::-1]
    holes = [hole[::-1] if ring.is_ccw else hole for hole, ring in zip(holes, polygon.interiors)]
    rings = [outer, *holes]
    at = lambda ring, z: [(x, y, z) for x, y in ring]
    yield "Roof", [at(ring, height) for ring in rings]
    yield "Ground", [at(ring[::-1], 0.0) for ring in rings]
    for ring in rings:
        for a, b in zip(ring, ring[1:] + ring[:1]):
            yield "Wall", [[(*a, 0.0), (*b, 0.0), (*b, height), (*a, height)]]


def write_citygml(out):
    lines = ['<?xml version="1.0" encoding="UTF-8"?>',
             '<CityModel xmlns="http://www.opengis.net/citygml/2.0" xmlns:gml="http://www.opengis.net/gml"',
             ' xmlns:bldg="http://www.opengis.net/citygml/building/2.0">',
             '<gml:boundedBy><gml:Envelope srsName="urn:ogc:def:crs:EPSG::25832" srsDimension="3">'
             '<gml:lowerCorner>500000 5400000 0</gml:lowerCorner><gml:upperCorner>500122 5400050 64</gml:upperCorner>'
             '</gml:Envelope></gml:boundedBy>']
    for name, polygons, height, levels, usage in BUILDINGS:
        lines.append(f'<cityObjectMember><bldg:Building gml:id="{name}"><bldg:usage>{usage}</bldg:usage>'
                     f'<bldg:measuredHeight uom="m">{height}</bldg:measuredHeight>'
                     f'<bldg:storeysAboveGround>{levels}</bldg:storeysAboveGround>')
        for polygon in polygons:
            for kind, rings in faces(polygon, height):
                lines.append(f'<bldg:boundedBy><bldg:{kind}Surface><bldg:lod2MultiSurface><gml:MultiSurface>'
                             '<gml:surfaceMember><gml:Polygon>')
                for i, ring in enumerate(rings):
                    tag = "interior" if i else "exterior"
                    text = " ".join(f"{c:.3f}" for point in ring + ring[:1] for c in point)
                    lines.append(f'<gml:{tag}><gml:LinearRing><gml:posList>{text}</gml:posList></gml:LinearRing></gml:{tag}>')
                lines.append('</gml:Polygon></gml:surfaceMember></gml:MultiSurface></bldg:lod2MultiSurface>'
                             f'</bldg:{kind}Surface></bldg:boundedBy>')
        lines.append('</bldg:Building></cityObjectMember>')
    lines.append('</CityModel>')
    (out / "block.gml").write_text("\n".join(lines) + "\n")


def write_cityjson(out):
    vertices, objects = [], {}
    for name, polygons, height, levels, usage in BUILDINGS:
        boundaries = []
        for polygon in polygons:
            for _, rings in faces(polygon, height):
                start = len(vertices)
                vertices += [[round((c - o) * 1000) for c, o in zip(point, (*ORIGIN, 0.0))] for ring in rings for point in ring]
                face = []
                for ring in rings:
                    face.append(list(range(start, start + len(ring))))
                    start += len(ring)
                boundaries.append(face)
        objects[name] = {"type": "Building", "attributes": {"usage": usage, "height": height, "levels": levels},
                         "geometry": [{"type": "MultiSurface", "lod": "2", "boundaries": boundaries}]}
    city = {"type": "CityJSON", "version": "2.0", "CityObjects": objects, "vertices": vertices,
            "transform": {"scale": [0.001] * 3, "translate": [*ORIGIN, 0.0]},
            "metadata": {"referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/25832"}}
    (out / "block.city.json").write_text(json.dumps(city))


def write_osm(out):
    to_degrees = Transformer.from_crs(CRS, "OGC:CRS84", always_xy=True).transform
    nodes, ways, relations = [], [], []

    def way(ring, tags):
        first = len(nodes) + 1
        for x, y in ring:
            lon, lat = to_degrees(x, y)
            nodes.append(f'<node id="{len(nodes) + 1}" lat="{lat:.7f}" lon="{lon:.7f}"/>')
        refs = [*range(first, len(nodes) + 1), first]
        number = len(ways) + 1
        ways.append(f'<way id="{number}">' + "".join(f'<nd ref="{ref}"/>' for ref in refs) + tags + "</way>")
        return number

    for name, polygons, height, levels, usage in BUILDINGS:
        tags = "".join(f'<tag k="{k}" v="{v}"/>' for k, v in
                       [("building", usage), ("name", name), ("height", height), ("building:levels", levels)])
        if len(polygons) == 1 and not polygons[0].interiors:
            way(list(polygons[0].exterior.coords)[:-1], tags)
            continue
        members = []
        for polygon in polygons:
            members.append(("outer", way(list(polygon.exterior.coords)[:-1], "")))
            members += [("inner", way(list(ring.coords)[:-1], "")) for ring in polygon.interiors]
        inside = "".join(f'<member type="way" ref="{ref}" role="{role}"/>' for role, ref in members)
        relations.append(f'<relation id="{len(relations) + 1}">{inside}<tag k="type" v="multipolygon"/>{tags}</relation>')
    body = "\n".join(nodes + ways + relations)
    (out / "block.osm").write_text(f'<?xml version="1.0" encoding="UTF-8"?>\n<osm version="0.6">\n{body}\n</osm>\n')


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder to write the files to")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    for write in [write_vectors, write_citygml, write_cityjson, write_osm]:
        write(out)


if __name__ == "__main__":
    main()
