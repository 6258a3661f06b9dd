"""STL, OBJ and OFF, by trimesh; PLY, whose faces may be polygons, by itself; and the place of models that have none."""
import pathlib, struct
import numpy as np
import trimesh
from .shapes import CityObject, triangulate

PLY_TYPES = {
    "char": "b", "int8": "b", "uchar": "B", "uint8": "B", "short": "h", "int16": "h", "ushort": "H", "uint16": "H", "int": "i",
    "int32": "i", "uint": "I", "uint32": "I", "float": "f", "float32": "f", "double": "d", "float64": "d",
}


def east_north_up(lon_deg, lat_deg):
    """Columns: unit vectors to the east, to the north and up, in geocentric coordinates."""
    lon, lat = np.radians([lon_deg, lat_deg])
    sin, cos = np.sin, np.cos
    return np.array([
        [-sin(lon), -sin(lat) * cos(lon), cos(lat) * cos(lon)],
        [cos(lon), -sin(lat) * sin(lon), cos(lat) * sin(lon)],
        [0.0, cos(lat), sin(lat)],
    ])


def placed_at(triangles, target, at):
    """Moves triangles with x east, y north and z up in metres to LON,LAT,H, where H is above the geoid. Without a place they
    stay."""
    if not at:
        return triangles
    lon, lat, height = map(float, at.split(","))
    import pyproj
    to_ecef = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    # Up is along the normal of the ellipsoid at the origin, and the geoid is not parallel to it.
    above_m = height + (target.geoid([lon], [lat])[0] if target.geoid else 0.0)
    origin = np.array(to_ecef.transform(lon, lat, above_m))
    points = triangles.reshape(-1, 3) @ east_north_up(lon, lat).T + origin
    degrees = np.stack(to_ecef.transform(*points.T, direction="INVERSE"), axis=1)
    return target.place(degrees, "EPSG:4979" if target.geoid else "EPSG:4326").reshape(-1, 3, 3)


def ply_elements(data):
    """The elements of a PLY file: for each its name and its rows, as dictionaries."""
    head, _, body = data.partition(b"end_header")
    body = body[body.index(b"\n") + 1:]
    lines = [line.split() for line in head.decode("ascii", "replace").splitlines()]
    form = next(line[1] for line in lines if line[:1] == ["format"])
    order = ">" if form == "binary_big_endian" else "<"
    words, at = iter(body.split()) if form == "ascii" else None, 0

    def value(kind):
        nonlocal at
        if words:
            return float(next(words)) if kind in "fd" else int(next(words))
        at += struct.calcsize(kind)
        return struct.unpack_from(order + kind, body, at - struct.calcsize(kind))[0]

    for number, line in enumerate(lines):
        if line[:1] == ["element"]:
            after = lines[number + 1:]
            end = next((i for i, other in enumerate(after) if other[:1] == ["element"]), len(after))
            properties = [other for other in after[:end] if other[:1] == ["property"]]
            rows = []
            for _ in range(int(line[2])):
                row = {}
                for of in properties:
                    if of[1] == "list":
                        row[of[4]] = [value(PLY_TYPES[of[3]]) for _ in range(value(PLY_TYPES[of[2]]))]
                    else:
                        row[of[2]] = value(PLY_TYPES[of[1]])
                rows.append(row)
            yield line[1], rows


def ply_triangles(path):
    elements = dict(ply_elements(pathlib.Path(path).read_bytes()))
    points = np.array([[row["x"], row["y"], row["z"]] for row in elements["vertex"]], dtype=float)
    faces = [row.get("vertex_indices", row.get("vertex_index")) for row in elements["face"]]
    return np.concatenate([triangulate([points[face]]) for face in faces])


def read(path, target, options):
    if path.lower().endswith(".ply"):
        triangles = ply_triangles(path)
    else:
        mesh = trimesh.load(path, process=False, force="mesh")
        triangles = np.asarray(mesh.vertices, dtype=float)[np.asarray(mesh.faces)]
    if options.up == "y":
        triangles = np.stack([triangles[..., 0], -triangles[..., 2], triangles[..., 1]], axis=-1)
    yield CityObject("mesh", triangles=[placed_at(triangles, target, options.at)])
