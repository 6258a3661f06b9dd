"""Footprints become prisms or level water. The rules are those of docs/inputs.md, section Footprints."""
import math, re
import numpy as np
from shapely.geometry import Polygon
from shapely.geometry.polygon import orient
from .shapes import CityObject, triangulate

TOP = ["height", "building:height", "measuredHeight", "est_height"]
LEVELS = ["building:levels", "levels", "num_floors"]
BASE = ["min_height", "building:min_height"]
BASE_LEVEL = ["building:min_level", "min_level", "min_floor"]
LEVEL_M, UNKNOWN_M, WELD_M = 3.0, 6.0, 1e-3
UNITS = {"": 1.0, "m": 1.0, "metre": 1.0, "metres": 1.0, "meter": 1.0, "meters": 1.0}
UNITS |= dict.fromkeys(["ft", "foot", "feet", "'"], 0.3048)
WATER = {
    "natural": {"water", "bay", "strait"}, "waterway": {"riverbank", "dock", "river", "canal", "stream"},
    "landuse": {"reservoir", "basin"},
}


def number(value):
    """The number of an attribute, in metres where it has a unit; None if it has none."""
    if value is None or isinstance(value, bool):
        return None
    if isinstance(value, str):
        found = re.fullmatch(r"\s*([-+]?[\d.]+)\s*(\S*)\s*", value.split(";")[0].replace(",", "."))
        if not found or found[2].lower() not in UNITS:
            return None
        try:
            return float(found[1]) * UNITS[found[2].lower()]
        except ValueError:
            return None
    try:
        value = float(value)
    except (TypeError, ValueError):
        return None
    return value if math.isfinite(value) else None


def first(attributes, names, low, high):
    """The first of the named attributes that is a number in the range."""
    for name in names:
        value = number(attributes.get(name))
        if value is not None and low <= value <= high:
            return value
    return None


def base_and_top(attributes, height_field=None):
    base = first(attributes, BASE, -500.0, 2000.0)
    if base is None:
        level = first(attributes, BASE_LEVEL, -20.0, 400.0)
        base = level * LEVEL_M if level is not None else 0.0
    top = first(attributes, [height_field] * bool(height_field) + TOP, 0.01, 2000.0)
    if top is not None:
        return (base, top) if base < top else (0.0, top)
    levels = first(attributes, LEVELS, 0.1, 400.0)
    if levels is not None:
        top = (levels + (first(attributes, ["roof:levels"], 0.1, 400.0) or 0.0)) * LEVEL_M
        if base < top:
            return base, top
    return base, base + UNKNOWN_M


def is_water(attributes):
    text = lambda name: attributes.get(name) if isinstance(attributes.get(name), str) else None
    if text("building") not in (None, "no") or text("building:part") not in (None, "no"):
        return False
    if text("water") not in (None, "no"):
        return True
    return any(text(name) in values for name, values in WATER.items())


def clean_ring(ring):
    """Corners nearer than the welding distance to the one before are left out."""
    kept = []
    for point in ring:
        if not kept or np.abs(point - kept[-1]).max() >= WELD_M:
            kept.append(point)
    while len(kept) > 1 and np.abs(kept[0] - kept[-1]).max() < WELD_M:
        kept.pop()
    return np.array(kept)


def plan(rings):
    """Rings in metres, the outer one counter-clockwise and holes clockwise. None if the outer one is none."""
    rings = [clean_ring(np.asarray(ring, dtype=float)[:, :2]) for ring in rings]
    rings = [ring for i, ring in enumerate(rings) if i == 0 or len(ring) >= 3 and Polygon(ring).area >= 0.01]
    if len(rings[0]) < 3 or Polygon(rings[0]).area < 0.01:
        return None
    turned = orient(Polygon(rings[0], rings[1:]))
    return [np.asarray(ring.coords)[:-1] for ring in [turned.exterior, *turned.interiors]]


def level(rings, z):
    return triangulate([np.column_stack([ring, np.full(len(ring), z)]) for ring in rings])


def prism(rings, base, top):
    """Triangles of a closed prism over rings of a plan."""
    roof = level(rings, top)
    parts = [roof, level(rings, base)[:, ::-1]]
    for ring in rings:
        after = np.roll(ring, -1, axis=0)
        at = lambda points, z: np.column_stack([points, np.full(len(points), z)])
        a, b, c, d = at(ring, base), at(after, base), at(after, top), at(ring, top)
        parts += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    return np.concatenate(parts)


def footprint_object(name, polygons, attributes, height_field=None):
    """An object of polygons in world coordinates, each a list of rings; None without an area."""
    water = is_water(attributes)
    made = CityObject(name, "WaterBody" if water else "Building")
    base, top = base_and_top(attributes, height_field)
    for rings in filter(None, map(plan, polygons)):
        made.triangles.append(level(rings, 0.0) if water else prism(rings, base, top))
    return made if made.triangles else None
