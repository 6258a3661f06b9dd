"""Coded meshes (docs/formats.md, "Meshes")."""
import math
from .architectural_positions import read_architectural_positions
from .attributes import read_attribute
from .connectivity import read_connectivity
from .container import BadTile
from .copies import read_copies
from .scan_positions import read_scan_positions
from .symbol_coder import SymbolReader

VERSION = 3
ARCHITECTURAL, WIDE_GRID, CLASSES_SHIFT, CLASS_KINDS = 1, 2, 2, 3
MAX_TRIANGLES, MAX_VERTICES, MAX_ATTRIBUTES = 1 << 24, 1 << 23, 8
KINDS = ["normal", "colour", "texture coordinate", "other"]


def read_mesh(reader, max_triangles=MAX_TRIANGLES):
    """All values of a coded mesh, without dummies and copies: `points` on the grid, `triangles`, and the attributes' `values`
    by corner. No more than `max_triangles` triangles and vertices are read.
    """
    values, classes = read_fields(reader, max_triangles)
    coder = SymbolReader(reader.rest(), 1 if classes is None else 4)
    surface = read_connectivity(coder, values["triangles_with_dummies"])
    vertices = len(surface.degree) - len(surface.dummies)
    if len(surface.triangles) != values["triangles_with_dummies"] or vertices != values["vertices_with_copies"]:
        raise BadTile("a mesh has other numbers of triangles and vertices than it says")
    originals = read_copies(coder, surface)
    if classes is None:
        points = read_architectural_positions(coder, surface, originals, values["bits"])
    else:
        points = read_scan_positions(coder, surface, originals, classes, values["bits"])
    for attribute in values["attributes"]:
        attribute["values"] = read_attribute(coder, surface, points, attribute)
    coder.finish()
    values["points"], values["triangles"] = without_copies_and_dummies(surface, originals, points)
    return values


def read_fields(reader, max_triangles):
    """The table "bytes, field". Returns the values and the kind of classes of scan positions, None for architectural ones."""
    version, flags, bits, attributes = (reader.one("B") for _ in range(4))
    classes = flags >> CLASSES_SHIFT
    if version != VERSION or classes >= (1 if flags & ARCHITECTURAL else CLASS_KINDS):
        raise BadTile("not a coded mesh of version 3")
    if not 8 <= bits <= 16 or attributes > MAX_ATTRIBUTES:
        raise BadTile("a mesh has too many bits or attributes")
    grid = [reader.one("d" if flags & WIDE_GRID else "f") for _ in range(4)]
    if not all(map(math.isfinite, grid)) or grid[3] <= 0:
        raise BadTile("a mesh's grid is not finite, or its step is not positive")
    vertices, triangles = reader.leb128(), reader.leb128()
    if vertices > min(max_triangles, MAX_VERTICES) or triangles > max_triangles:
        raise BadTile("a mesh has too many vertices or triangles")
    attributes = [read_attribute_fields(reader) for _ in range(attributes)]
    return {
        "position_coder": "architectural" if flags & ARCHITECTURAL else "scan", "bits": bits, "grid_min": grid[:3],
        "grid_step": grid[3], "vertices_with_copies": vertices, "triangles_with_dummies": triangles, "attributes": attributes,
    }, None if flags & ARCHITECTURAL else classes


def read_attribute_fields(reader):
    kind, components, bits = (reader.one("B") for _ in range(3))
    scale = [reader.one("f"), reader.one("f")]
    if kind > 3 or not 1 <= components <= 4 or not 1 <= bits <= 16 or not all(map(math.isfinite, scale)):
        raise BadTile("a mesh's attribute is out of range")
    return {"kind": KINDS[kind], "components": components, "bits": bits, "range": scale}


def without_copies_and_dummies(surface, originals, points):
    """The points of other vertices, and the triangles between these points."""
    numbers, kept = [None] * len(originals), []
    for vertex, original in enumerate(originals):
        if original != vertex:
            numbers[vertex] = numbers[original]
        elif surface.is_real(vertex):
            numbers[vertex] = len(kept)
            kept.append(points[vertex])
    triangles = [tuple(numbers[vertex] for vertex in corners) for corners in surface.triangles]
    return kept, [triangle for triangle in triangles if None not in triangle]
