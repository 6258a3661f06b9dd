#!/usr/bin/env python3
"""Writes the buildings of a CityJSON or CityJSONSeq file as CityGML 2.0 or 3.0, for bakes that must give equal columns.

    convert_cityjson.py IN.city.jsonl --out OUT.gml --version 3.0

Levels of detail become whole ones; of 1.2 and 1.3 the finer is kept. Level 2 has its polygons in boundary surfaces, and a
solid of links to them, as the German surveying agencies write it.

Needs: pip install numpy (and what second_reader/shapes.py needs)
"""
import argparse
from xml.sax.saxutils import escape, quoteattr

NAMESPACES = {
    "2.0": {"core": "http://www.opengis.net/citygml/2.0", "bldg": "http://www.opengis.net/citygml/building/2.0",
            "gen": "http://www.opengis.net/citygml/generics/2.0", "gml": "http://www.opengis.net/gml"},
    "3.0": {"core": "http://www.opengis.net/citygml/3.0", "bldg": "http://www.opengis.net/citygml/building/3.0",
            "con": "http://www.opengis.net/citygml/construction/3.0", "gen": "http://www.opengis.net/citygml/generics/3.0",
            "gml": "http://www.opengis.net/gml/3.2"},
}
NAMES = {
    "2.0": {"geometry": "bldg", "surface": "bldg", "boundary": "bldg:boundedBy", "part": "bldg:consistsOfBuildingPart",
            "attribute": "gen:stringAttribute"},
    "3.0": {"geometry": "core", "surface": "con", "boundary": "core:boundary", "part": "bldg:buildingPart",
            "attribute": "gen:StringAttribute"},
}


class Writer:
    def __init__(self, version, points):
        self.version, self.of, self.points = version, NAMES[version], points

    def polygon(self, rings, polygon_id):
        text = []
        for i, ring in enumerate(rings):
            side = "interior" if i else "exterior"
            values = " ".join(f"{v:.4f}" for point in self.points[[*ring, ring[0]]] for v in point)
            text.append(f'<gml:{side}><gml:LinearRing><gml:posList srsDimension="3">{values}</gml:posList></gml:LinearRing>'
                        f"</gml:{side}>")
        return f"<gml:Polygon gml:id={quoteattr(polygon_id)}>{''.join(text)}</gml:Polygon>"

    def multi_surface(self, prop, polygons):
        members = "".join(f"<gml:surfaceMember>{polygon}</gml:surfaceMember>" for polygon in polygons)
        return f"<{prop}><gml:MultiSurface>{members}</gml:MultiSurface></{prop}>"

    def solid(self, level, members):
        name, shell = f"{self.of['geometry']}:lod{level}Solid", "CompositeSurface" if self.version == "2.0" else "Shell"
        return (f"<{name}><gml:Solid><gml:exterior><gml:{shell}>{members}</gml:{shell}></gml:exterior></gml:Solid></{name}>")

    def geometry(self, level, geometry, key):
        from second_reader.cityjson import SURFACES_AT, surfaces
        faces = list(surfaces(geometry["boundaries"], SURFACES_AT[geometry["type"]]))
        named = [(f"{key}_{level}_{i}", rings) for i, rings in enumerate(faces)]
        if level == 0:
            prop = "bldg:lod0FootPrint" if self.version == "2.0" else "core:lod0MultiSurface"
            return self.multi_surface(prop, [self.polygon(rings, name) for name, rings in named])
        if level == 1:
            polygons = [self.polygon(rings, name) for name, rings in named]
            return self.solid(level, "".join(f"<gml:surfaceMember>{polygon}</gml:surfaceMember>" for polygon in polygons))
        links = "".join(f"<gml:surfaceMember xlink:href={quoteattr('#' + name)}/>" for name, _ in named)
        kinds = self.semantics(geometry, len(faces))
        parts = []
        for (name, rings), kind in zip(named, kinds):
            surface = self.multi_surface(f"{self.of['geometry']}:lod{level}MultiSurface", [self.polygon(rings, name)])
            kind = f"{self.of['surface']}:{kind}"
            parts.append(f"<{self.of['boundary']}><{kind}>{surface}</{kind}></{self.of['boundary']}>")
        solid = self.solid(level, links)
        return solid + "".join(parts) if self.version == "2.0" else "".join(parts) + solid

    @staticmethod
    def semantics(geometry, count):
        values = (geometry.get("semantics") or {}).get("values")
        while values and isinstance(values[0], list):
            values = [value for part in values for value in part]
        kinds = geometry["semantics"]["surfaces"] if values else []
        name = lambda value: "WallSurface" if value is None else kinds[value]["type"]
        return [name(value) for value in values] if values else ["WallSurface"] * count

    def attributes(self, item):
        name, text = self.of["attribute"], []
        for key, value in (item.get("attributes") or {}).items():
            if self.version == "2.0":
                text.append(f"<{name} name={quoteattr(key)}><gen:value>{escape(str(value))}</gen:value></{name}>")
            else:
                text.append(f"<core:genericAttribute><{name}><gen:name>{escape(key)}</gen:name>"
                            f"<gen:value>{escape(str(value))}</gen:value></{name}></core:genericAttribute>")
        return "".join(text)

    def building(self, key, objects):
        item, levels = objects[key], {}
        for geometry in item.get("geometry") or []:
            lod = float(geometry["lod"])
            if int(lod) not in levels or levels[int(lod)][0] < lod:
                levels[int(lod)] = (lod, geometry)
        name = "bldg:BuildingPart" if item["type"] == "BuildingPart" else "bldg:Building"
        safe = "id_" + key
        shapes = "".join(self.geometry(level, geometry, safe) for level, (_, geometry) in sorted(levels.items()))
        part = self.of["part"]
        parts = "".join(f"<{part}>{self.building(child, objects)}</{part}>" for child in item.get("children", []))
        return f"<{name} gml:id={quoteattr(safe)}>{self.attributes(item)}{shapes}{parts}</{name}>"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("input")
    parser.add_argument("--out", required=True)
    parser.add_argument("--version", choices=["2.0", "3.0"], default="2.0")
    options = parser.parse_args()
    from second_reader.cityjson import features, positions
    spaces = "".join(f' xmlns:{name}="{uri}"' for name, uri in NAMESPACES[options.version].items())
    with open(options.out, "w", encoding="utf-8") as out:
        for number, (objects, vertices, head) in enumerate(features(options.input)):
            points = positions(vertices, head.get("transform"))
            if number == 0:
                system = head["metadata"]["referenceSystem"]
                out.write('<?xml version="1.0" encoding="UTF-8"?>\n'
                          f'<core:CityModel{spaces} xmlns:xlink="http://www.w3.org/1999/xlink">'
                          f'<gml:boundedBy><gml:Envelope srsName={quoteattr(system)} srsDimension="3"><gml:lowerCorner>0 0 0'
                          "</gml:lowerCorner><gml:upperCorner>0 0 0</gml:upperCorner></gml:Envelope></gml:boundedBy>\n")
            writer = Writer(options.version, points)
            for key, item in objects.items():
                if item["type"] == "Building":
                    out.write(f"<core:cityObjectMember>{writer.building(key, objects)}</core:cityObjectMember>\n")
        out.write("</core:CityModel>\n")


if __name__ == "__main__":
    main()
