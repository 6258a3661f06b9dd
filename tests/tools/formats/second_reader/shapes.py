"""Objects of triangles, the triangulation of polygons, and OBJ files."""
from dataclasses import dataclass, field
import mapbox_earcut
import numpy as np


@dataclass
class CityObject:
    """Triangles of one object, as arrays of (n, 3, 3) world positions in metres."""
    id: str
    kind: str = "Building"
    triangles: list = field(default_factory=list)
    # Level of detail that was chosen; None if the format has no levels.
    lod: float | None = None

    def all_triangles(self):
        return np.concatenate(self.triangles) if self.triangles else np.zeros((0, 3, 3))


def newell(ring):
    """Normal of a ring of (n, 3); its length is twice the area."""
    after = np.roll(ring, -1, axis=0)
    less, more = ring - after, ring + after
    return np.array([
        np.sum(less[:, 1] * more[:, 2]), np.sum(less[:, 2] * more[:, 0]), np.sum(less[:, 0] * more[:, 1]),
    ])


def open_ring(ring):
    """The ring without equal neighbours and without a repeated first point."""
    ring = np.asarray(ring, dtype=float)
    if len(ring) < 2:
        return ring
    differs = np.any(ring != np.roll(ring, 1, axis=0), axis=1)
    return ring[differs] if differs.any() else ring[:1]


def triangulate(rings):
    """Triangles of a polygon in space: the outer ring, then holes, of (n, 3). Empty without an area."""
    rings = [open_ring(ring) for ring in rings]
    if not rings or len(rings[0]) < 3:
        return np.zeros((0, 3, 3))
    rings = [ring for ring in rings if len(ring) >= 3]
    points = np.concatenate(rings)
    if not np.isfinite(points).all():
        return np.zeros((0, 3, 3))
    normal = newell(rings[0] - rings[0][0])
    length = np.linalg.norm(normal)
    if length < 2e-8:
        return np.zeros((0, 3, 3))
    normal /= length
    if len(points) == 3:
        return points[None]
    helper = np.eye(3)[np.argmin(np.abs(normal))]
    u = np.cross(helper, normal)
    u /= np.linalg.norm(u)
    flat = (points - points[0]) @ np.stack([u, np.cross(normal, u)], axis=1)
    ends = np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
    corners = mapbox_earcut.triangulate_float64(flat, ends).reshape(-1, 3)
    return points[corners]


def write_obj(path, objects):
    """Writes objects with seven digits after the point; those of kind `Relief` have names that make them terrain."""
    with open(path, "w") as out:
        vertices = 0
        for number, item in enumerate(objects):
            triangles = item.all_triangles()
            if not len(triangles):
                continue
            prefix = "terrain" if item.kind == "Relief" else "object"
            out.write(f"o {prefix} {number} {' '.join(str(item.id).split())}\n")
            points, numbers = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
            out.writelines(f"v {x:.7f} {y:.7f} {z:.7f}\n" for x, y, z in points)
            corners = numbers.reshape(-1, 3) + 1 + vertices
            out.writelines(f"f {a} {b} {c}\n" for a, b, c in corners)
            vertices += len(points)
