"""I3S scene layers of 3D objects and meshes: SLPK files, or folders with the same files. Leaves only."""
import gzip, json, pathlib, struct, zipfile
import DracoPy
import numpy as np
from .shapes import CityObject

NAMES = ["{}", "{}.gz", "{}.json.gz", "{}.json", "{}.bin.gz", "{}.bin", "{}/index.json", "{}/index.bin"]


class Files:
    def __init__(self, path):
        self.archive = zipfile.ZipFile(path) if path.lower().endswith(".slpk") else None
        self.folder = pathlib.Path(path)
        self.names = set(self.archive.namelist()) if self.archive else None

    def read(self, name):
        """The bytes of a file by its name without extension; None if there is none."""
        for form in NAMES:
            at = form.format(name)
            if self.archive and at in self.names:
                data = self.archive.read(at)
            elif not self.archive and (self.folder / at).is_file():
                data = (self.folder / at).read_bytes()
            else:
                continue
            return gzip.decompress(data) if data[:2] == b"\x1f\x8b" else data
        return None

    def json(self, name):
        data = self.read(name)
        return json.loads(data) if data else None


def pages(files, layer):
    nodes, size = {}, layer["nodePages"]["nodesPerPage"]
    page = 0
    while (found := files.json(f"nodepages/{page}")) is not None:
        for i, node in enumerate(found["nodes"]):
            nodes[node.get("index", page * size + i)] = node
        page += 1
    return nodes


def draco_positions(data):
    mesh = DracoPy.decode(data)
    scale = np.ones(3)
    for attribute in getattr(mesh, "attributes", None) or []:
        names = (attribute.get("metadata") or {}).get("entries") or {}
        for axis, key in enumerate(("i3s-scale_x", "i3s-scale_y")):
            if key in names:
                raw = names[key]
                scale[axis] = struct.unpack("<d", raw)[0] if isinstance(raw, bytes) else float(raw)
    points = np.asarray(mesh.points, dtype=float).reshape(-1, 3) * scale
    return points[np.asarray(mesh.faces).reshape(-1, 3)]


def plain_positions(data, buffer):
    """Positions of an uncompressed geometry: the count of vertices, after it perhaps that of features, then attributes."""
    count = struct.unpack_from("<I", data)[0]
    return np.frombuffer(data, "<f4", count * 3, buffer.get("offset", 8)).astype(float).reshape(-1, 3, 3)


def geometry(files, layer, node):
    mesh = node.get("mesh")
    if not mesh or "geometry" not in mesh:
        return None
    buffers = layer["geometryDefinitions"][mesh["geometry"]["definition"]]["geometryBuffers"]
    resource = mesh["geometry"]["resource"]
    order = sorted(range(len(buffers)), key=lambda i: "compressedAttributes" in buffers[i])
    for i in order:
        data = files.read(f"nodes/{resource}/geometries/{i}")
        if data is not None:
            return draco_positions(data) if "compressedAttributes" in buffers[i] else plain_positions(data, buffers[i])
    return None


def read(path, target, options):
    files = Files(path)
    layer = files.json("3dSceneLayer") or files.json("layers/0") or files.json("index")
    system = layer["spatialReference"]
    code = system.get("latestWkid") or system.get("wkid")
    code = 4326 if code in (4326, 104199) else code
    is_above_geoid = (layer.get("heightModelInfo") or {}).get("heightModel", "gravity_related_height").startswith("gravity")
    nodes = pages(files, layer)
    for index, node in sorted(nodes.items()):
        if node.get("children"):
            continue
        triangles = geometry(files, layer, node)
        if triangles is None:
            continue
        points = (triangles + np.array(node["obb"]["center"])).reshape(-1, 3)
        if is_above_geoid:
            placed = target.place(points, f"EPSG:{code}")
        else:
            placed = target.place(points, "EPSG:4979" if code == 4326 else f"EPSG:{code}")
        yield CityObject(f"node {index}", triangles=[placed.reshape(-1, 3, 3)])
