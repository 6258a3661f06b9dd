"""Buildings and parts of OpenStreetMap, by pyosmium, which assembles the multipolygons. All roofs are flat."""
import osmium
import shapely
from shapely.strtree import STRtree
import numpy as np
from .footprints import footprint_object

# An outline is left out if its parts cover this share of it. Its parts are those that a relation of type building names, and
# those that are within it by this share.
COVERED_SHARE = WITHIN_SHARE = 0.5


def tags_of(thing):
    return {tag.k: tag.v for tag in thing.tags}


def says(tags, key):
    return tags.get(key, "no") != "no"


def named_parts(path):
    """The parts that relations of type building give to outlines; both are named by (is it a way, id)."""
    found = {}
    for relation in osmium.FileProcessor(path, osmium.osm.RELATION):
        if relation.tags.get("type") == "building":
            members = [(member.role, (member.type == "w", member.ref)) for member in relation.members]
            parts = [key for role, key in members if role == "part"]
            for role, key in members:
                if role == "outline":
                    found.setdefault(key, []).extend(parts)
    return found


def areas(path):
    """Areas of buildings and parts as (id, is it a way, tags, polygon in degrees)."""
    factory = osmium.geom.WKBFactory()
    # Areas that are no buildings are not needed.
    wanted = osmium.filter.KeyFilter("building", "building:part").enable_for(osmium.osm.AREA)
    for area in osmium.FileProcessor(path).with_areas().with_filter(wanted):
        if not area.is_area():
            continue
        tags = tags_of(area)
        if says(tags, "building") or says(tags, "building:part"):
            yield area.orig_id(), area.from_way(), tags, shapely.from_wkb(factory.create_multipolygon(area))


def without_covered(found, named):
    """Leaves out the outlines that parts replace."""
    parts = {(from_way, area_id): shape for area_id, from_way, tags, shape in found if says(tags, "building:part")}
    keys, shapes = list(parts), list(parts.values())
    tree, taken = STRtree(shapes), {key for of in named.values() for key in of}
    for area_id, from_way, tags, shape in found:
        key = (from_way, area_id)
        if says(tags, "building:part"):
            yield area_id, from_way, tags, shape
            continue
        own = [parts[part] for part in named.get(key, []) if part in parts]
        for i in tree.query(shape):
            if keys[i] not in taken and shapes[i].intersection(shape).area >= WITHIN_SHARE * shapes[i].area > 0:
                own.append(shapes[i])
        if not own or shapely.union_all(own).intersection(shape).area < COVERED_SHARE * shape.area:
            yield area_id, from_way, tags, shape


def read(path, target, options):
    found = [(*area[:3], shapely.make_valid(area[3])) for area in areas(path)]
    for area_id, from_way, tags, shape in without_covered(found, named_parts(path)):
        placed = []
        for polygon in getattr(shape, "geoms", [shape]):
            if polygon.geom_type == "Polygon":
                rings = [np.asarray(ring.coords) for ring in [polygon.exterior, *polygon.interiors]]
                deep = [np.column_stack([ring, np.zeros(len(ring))]) for ring in rings]
                placed.append([target.place(ring, "EPSG:4326") for ring in deep])
        made = footprint_object(f"{'way' if from_way else 'relation'}/{area_id}", placed, tags) if placed else None
        if made:
            made.kind = "BuildingPart" if says(tags, "building:part") else "Building"
            yield made
