"""CityJSON 1.0 to 2.0 and CityJSONSeq."""
import gzip, json
import numpy as np
from .levels import choose
from .shapes import CityObject, triangulate

SURFACES_AT = {"MultiSurface": 0, "CompositeSurface": 0, "Solid": 1, "MultiSolid": 2, "CompositeSolid": 2}


def opened(path):
    return gzip.open(path, "rt", encoding="utf-8-sig") if path.endswith(".gz") else open(path, encoding="utf-8-sig")


def surfaces(boundaries, depth):
    """The polygons of nested boundaries, each a list of rings."""
    if depth == 0:
        yield from boundaries
        return
    for part in boundaries:
        yield from surfaces(part, depth - 1)


def positions(vertices, transform):
    points = np.array(vertices, dtype=float).reshape(-1, 3)
    if transform:
        points = points * np.array(transform["scale"]) + np.array(transform["translate"])
    return points


def polygons(geometry, points, templates):
    """Polygons of a geometry as lists of rings of (n, 3)."""
    if geometry["type"] == "GeometryInstance":
        template = templates["templates"][geometry["template"]]
        matrix = np.array(geometry["transformationMatrix"], dtype=float).reshape(4, 4)
        local = np.array(templates["vertices-templates"], dtype=float) @ matrix[:3, :3].T + matrix[:3, 3]
        yield from polygons(template, local + points[geometry["boundaries"][0]], templates)
    elif geometry["type"] in SURFACES_AT:
        for rings in surfaces(geometry["boundaries"], SURFACES_AT[geometry["type"]]):
            yield [points[ring] for ring in rings if ring]


def level_of(geometry, templates):
    if geometry["type"] == "GeometryInstance":
        geometry = templates["templates"][geometry["template"]]
    return float(geometry.get("lod", 0))


def features(path):
    """Pairs of objects with their vertices, and what belongs to the whole file."""
    with opened(path) as lines:
        if ".jsonl" in path.lower():
            head = json.loads(next(lines))
            for line in lines:
                if line.strip():
                    feature = json.loads(line)
                    yield feature["CityObjects"], feature["vertices"], head
        else:
            head = json.load(lines)
            yield head["CityObjects"], head["vertices"], head


def read(path, target, options):
    for objects, vertices, head in features(path):
        templates = head.get("geometry-templates") or {}
        points = target.place(positions(vertices, head.get("transform")), head.get("metadata", {}).get("referenceSystem"))
        drawn = {name: [g for g in of.get("geometry") or [] if g["type"] in [*SURFACES_AT, "GeometryInstance"]]
                 for name, of in objects.items()}
        best = {name: max(level_of(g, templates) for g in all) for name, all in drawn.items() if all}
        parents = {name: list(of.get("parents") or []) for name, of in objects.items()}
        out = choose(best, parents, lambda name: objects[name]["type"].endswith("Part"))
        for name in best:
            if name in out:
                continue
            kind = "Relief" if objects[name]["type"] == "TINRelief" else objects[name]["type"]
            made = CityObject(name, kind, lod=best[name])
            for geometry in drawn[name]:
                if level_of(geometry, templates) == best[name]:
                    made.triangles += [t for t in map(triangulate, polygons(geometry, points, templates)) if len(t)]
            if made.triangles:
                yield made
