"""glTF 2.0 as .gltf or .glb, with Draco (DracoPy), meshopt (meshoptimizer) and quantised accessors."""
import base64, json, pathlib, struct, urllib.parse
import DracoPy
import meshoptimizer
import numpy as np
from .shapes import CityObject

TYPES = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
SIZES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
DRACO, MESHOPT = "KHR_draco_mesh_compression", ("EXT_meshopt_compression", "KHR_meshopt_compression")
FILTERS = {
    "OCTAHEDRAL": meshoptimizer.decode_filter_oct, "QUATERNION": meshoptimizer.decode_filter_quat,
    "EXPONENTIAL": meshoptimizer.decode_filter_exp,
}


class Gltf:
    def __init__(self, data, load):
        """`data` is the file; `load` returns the bytes of another file by its address."""
        chunk = None
        if data[:4] == b"glTF":
            version, at = struct.unpack_from("<I", data, 4)[0], 12
            if version != 2:
                raise ValueError(f"glTF version {version}")
            length = struct.unpack_from("<I", data, at)[0]
            self.json = json.loads(data[at + 8:at + 8 + length])
            at += 8 + length
            if at + 8 <= len(data):
                chunk = data[at + 8:at + 8 + struct.unpack_from("<I", data, at)[0]]
        else:
            self.json = json.loads(data)
        self.chunk, self.load, self.buffers, self.views = chunk, load, {}, {}

    def list(self, name):
        return self.json.get(name, [])

    def buffer(self, number):
        if number not in self.buffers:
            uri = self.list("buffers")[number].get("uri")
            if uri is None:
                self.buffers[number] = self.chunk or b""
            elif uri.startswith("data:"):
                self.buffers[number] = base64.b64decode(uri.split(",", 1)[1])
            else:
                self.buffers[number] = self.load(urllib.parse.unquote(uri))
        return self.buffers[number]

    def view(self, number):
        if number not in self.views:
            view = self.list("bufferViews")[number]
            packed = next((e for name, e in view.get("extensions", {}).items() if name in MESHOPT), None)
            of = packed or view
            start = of.get("byteOffset", 0)
            data = self.buffer(of["buffer"])[start:start + of["byteLength"]]
            self.views[number] = self.unpack(packed, data) if packed else data
        return self.views[number]

    @staticmethod
    def unpack(packed, data):
        count, stride = packed["count"], packed["byteStride"]
        if packed["mode"] == "ATTRIBUTES":
            values = meshoptimizer.decode_vertex_buffer(count, stride, data)
            decoded = np.ascontiguousarray(values).view(np.uint8).reshape(-1)[:count * stride].copy()
            which = packed.get("filter", "NONE")
            if which != "NONE":
                changed = FILTERS[which](decoded, count, stride)
                decoded = decoded if changed is None else np.ascontiguousarray(changed).view(np.uint8)
            return decoded.tobytes()
        is_list = packed["mode"] == "TRIANGLES"
        decode = meshoptimizer.decode_index_buffer if is_list else meshoptimizer.decode_index_sequence
        values = np.asarray(decode(count, stride, data)).reshape(-1)
        return values.astype(np.uint16 if stride == 2 else np.uint32).tobytes()

    def accessor(self, number):
        """Values of an accessor as (count, components); normalised ones are floats."""
        accessor = self.list("accessors")[number]
        kind, size, count = TYPES[accessor["componentType"]], SIZES[accessor["type"]], accessor["count"]
        width = np.dtype(kind).itemsize * size
        values = np.zeros((count, size), dtype=kind)
        if "bufferView" in accessor:
            stride = self.list("bufferViews")[accessor["bufferView"]].get("byteStride") or width
            data = self.view(accessor["bufferView"])
            start, steps = accessor.get("byteOffset", 0), (stride, np.dtype(kind).itemsize)
            values = np.ndarray((count, size), kind, data, start, steps).copy()
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            part = lambda of, kind, size: np.frombuffer(
                self.view(of["bufferView"]), kind, sparse["count"] * size, of.get("byteOffset", 0))
            at = part(sparse["indices"], TYPES[sparse["indices"]["componentType"]], 1)
            values[at] = part(sparse["values"], kind, size).reshape(-1, size)
        if accessor.get("normalized") and kind is not np.float32:
            return np.maximum(values.astype(float) / np.iinfo(kind).max, -1.0)
        return values

    def primitive(self, primitive):
        """Triangles of a primitive as (n, 3, 3); empty for points and lines."""
        mode = primitive.get("mode", 4)
        if mode not in (4, 5, 6) or "POSITION" not in primitive["attributes"]:
            return np.zeros((0, 3, 3))
        draco = primitive.get("extensions", {}).get(DRACO)
        if draco:
            mesh = DracoPy.decode(bytes(self.view(draco["bufferView"])))
            return np.asarray(mesh.points, dtype=float).reshape(-1, 3)[np.asarray(mesh.faces).reshape(-1, 3)]
        points = self.accessor(primitive["attributes"]["POSITION"]).astype(float)
        corners = np.arange(len(points))
        if "indices" in primitive:
            corners = self.accessor(primitive["indices"]).reshape(-1).astype(int)
        if mode == 4:
            corners = corners[:len(corners) // 3 * 3].reshape(-1, 3)
        elif mode == 5:
            order = [(i, i + 1 + i % 2, i + 2 - i % 2) for i in range(len(corners) - 2)]
            corners = corners[np.array(order, dtype=int).reshape(-1, 3)]
        else:
            order = [(0, i, i + 1) for i in range(1, len(corners) - 1)]
            corners = corners[np.array(order, dtype=int).reshape(-1, 3)]
        return points[corners.reshape(-1, 3)]

    def matrix(self, node):
        if "matrix" in node:
            return np.array(node["matrix"], dtype=float).reshape(4, 4).T
        return composed(node.get("translation"), node.get("rotation"), node.get("scale"))

    def instances(self, node):
        """Matrices of EXT_mesh_gpu_instancing; one that does nothing without."""
        attributes = node.get("extensions", {}).get("EXT_mesh_gpu_instancing", {}).get("attributes")
        if not attributes:
            return [np.eye(4)]
        lists = {name: self.accessor(number).astype(float) for name, number in attributes.items()}
        count = len(next(iter(lists.values())))
        of = lambda name, i: lists[name][i] if name in lists else None
        return [composed(of("TRANSLATION", i), of("ROTATION", i), of("SCALE", i)) for i in range(count)]

    def meshes(self):
        """Pairs of a name and triangles in the file's z-up system, one for each mesh of each node."""
        scenes = self.list("scenes")
        roots = scenes[self.json.get("scene", 0)].get("nodes", []) if scenes else range(len(self.list("nodes")))
        centre = self.json.get("extensions", {}).get("CESIUM_RTC", {}).get("center")
        base = np.eye(4)
        if centre:
            base[:3, 3] = centre
        yield from self.walk(roots, base @ Z_UP, 0)

    def walk(self, numbers, above, depth):
        for number in numbers if depth < 64 else []:
            node = self.list("nodes")[number]
            world = above @ self.matrix(node)
            if "mesh" in node:
                mesh = self.list("meshes")[node["mesh"]]
                parts = [self.primitive(primitive) for primitive in mesh["primitives"]]
                for instance in self.instances(node):
                    placed = world @ instance
                    triangles = [moved(placed, part) for part in parts if len(part)]
                    if triangles:
                        yield node.get("name") or mesh.get("name") or f"node {number}", np.concatenate(triangles)
            yield from self.walk(node.get("children", []), world, depth + 1)


def composed(translation, rotation, scale):
    x, y, z, w = (0, 0, 0, 1) if rotation is None else rotation
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])
    matrix = np.eye(4)
    matrix[:3, :3] = turn * (np.ones(3) if scale is None else np.asarray(scale))
    matrix[:3, 3] = 0 if translation is None else translation
    return matrix


def moved(matrix, triangles):
    return triangles @ matrix[:3, :3].T + matrix[:3, 3]


def read(path, target, options):
    from .meshes import placed_at
    folder = pathlib.Path(path).parent
    file = Gltf(pathlib.Path(path).read_bytes(), lambda uri: (folder / uri).read_bytes())
    for name, triangles in file.meshes():
        yield CityObject(name, triangles=[placed_at(triangles, target, options.at)])
