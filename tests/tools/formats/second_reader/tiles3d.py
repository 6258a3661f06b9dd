"""3D Tiles 1.0 and 1.1: b3dm, i3dm, cmpt, glTF, explicit and implicit tiling, in a folder or a .3tz."""
import gzip, json, pathlib, posixpath, struct, sys, zipfile
import numpy as np
from .gltf import Gltf, composed, moved
from .shapes import CityObject

MAX_DEPTH = 64


class Files:
    """Files of a folder or of an archive, unpacked where they are gzipped."""

    def __init__(self, path):
        self.archive = zipfile.ZipFile(path) if path.lower().endswith(".3tz") else None
        self.folder = pathlib.Path(path).parent
        self.root = "tileset.json" if self.archive else pathlib.Path(path).name

    def read(self, name):
        data = self.archive.read(name) if self.archive else (self.folder / name).read_bytes()
        return gzip.decompress(data) if data[:2] == b"\x1f\x8b" else data


def joined(base, uri):
    return posixpath.normpath(posixpath.join(posixpath.dirname(base), uri.split("?")[0]))


def table(data, at, json_bytes, binary_bytes):
    """A feature table: its JSON and its binary body."""
    text = data[at:at + json_bytes]
    return (json.loads(text) if text.strip() else {}), data[at + json_bytes:at + json_bytes + binary_bytes]


def values(of, name, body, count, width, kind="<f4"):
    """A property of a feature table as (count, width); None if it has none."""
    entry = of.get(name)
    if entry is None:
        return None
    if isinstance(entry, dict):
        return np.frombuffer(body, kind, count * width, entry["byteOffset"]).reshape(count, width)
    return np.array(entry, dtype=float).reshape(-1, width)


def contents(data, files, name):
    """Pairs of a name and triangles in the tile's system."""
    magic = data[:4]
    load = lambda uri: files.read(joined(name, uri))
    if magic == b"cmpt":
        at = 16
        for _ in range(struct.unpack_from("<I", data, 12)[0]):
            length = struct.unpack_from("<I", data, at + 8)[0]
            yield from contents(data[at:at + length], files, name)
            at += length
    elif magic == b"b3dm":
        sizes = struct.unpack_from("<4I", data, 12)
        features, body = table(data, 28, *sizes[:2])
        yield from shifted(Gltf(data[28 + sum(sizes):], load), features, body)
    elif magic == b"i3dm":
        yield from instanced(data, load)
    elif magic == b"glTF" or data.lstrip()[:1] == b"{":
        yield from Gltf(data, load).meshes()


def shifted(file, features, body):
    centre = values(features, "RTC_CENTER", body, 1, 3)
    for name, triangles in file.meshes():
        yield name, triangles if centre is None else triangles + centre[0]


def instanced(data, load):
    sizes = struct.unpack_from("<4I", data, 12)
    by_uri = struct.unpack_from("<I", data, 28)[0] == 0
    features, body = table(data, 32, *sizes[:2])
    model = data[32 + sum(sizes):]
    if by_uri:
        model = load(model.rstrip(b" \0").decode())
    meshes = list(Gltf(model, load).meshes())
    count = features["INSTANCES_LENGTH"]
    get = lambda name, width, kind="<f4": values(features, name, body, count, width, kind)
    places = get("POSITION", 3)
    if places is None:
        steps = get("POSITION_QUANTIZED", 3, "<u2").astype(float) / 65535
        places = steps * get("QUANTIZED_VOLUME_SCALE", 3)[0] + get("QUANTIZED_VOLUME_OFFSET", 3)[0]
    centre = get("RTC_CENTER", 3)
    places = places.astype(float) + (0 if centre is None else centre[0])
    turns = orientations(features, get, places)
    size, sizes3 = get("SCALE", 1), get("SCALE_NON_UNIFORM", 3)
    for i in range(count):
        matrix = np.eye(4)
        scale = (1.0 if size is None else size[i]) * (np.ones(3) if sizes3 is None else sizes3[i])
        matrix[:3, :3] = turns[i] * scale
        matrix[:3, 3] = places[i]
        for name, triangles in meshes:
            yield f"{name} {i}", moved(matrix, triangles)


def orientations(features, get, places):
    up, right = get("NORMAL_UP", 3), get("NORMAL_RIGHT", 3)
    if up is None and "NORMAL_UP_OCT32P" in features:
        up, right = (octahedron(get(name, 2, "<u2")) for name in ("NORMAL_UP_OCT32P", "NORMAL_RIGHT_OCT32P"))
    if up is not None:
        return [np.column_stack([r, u, np.cross(r, u)]) @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]).T
                for u, r in zip(up.astype(float), right.astype(float))]
    if features.get("EAST_NORTH_UP"):
        from .meshes import east_north_up
        import pyproj
        lon, lat, _ = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True).transform(*places.T)
        return [east_north_up(*at) for at in zip(lon, lat)]
    return [np.eye(3)] * len(places)


def octahedron(packed):
    """Unit vectors of octahedral coordinates of 16 bits."""
    x, y = (packed.astype(float) / 65535 * 2 - 1).T
    z = 1 - np.abs(x) - np.abs(y)
    fold = z < 0
    x[fold], y[fold] = ((1 - np.abs(y)) * np.where(x < 0, -1, 1))[fold], ((1 - np.abs(x)) * np.where(y < 0, -1, 1))[fold]
    vectors = np.column_stack([x, y, z])
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


class Availability:
    def __init__(self, entry, subtree, parts):
        self.constant = entry.get("constant")
        if self.constant is None:
            view = subtree["bufferViews"][entry.get("bitstream", entry.get("bufferView"))]
            start = view.get("byteOffset", 0)
            self.bits = parts[view["buffer"]][start:start + view["byteLength"]]

    def __getitem__(self, at):
        return bool(self.constant) if self.constant is not None else bool(self.bits[at >> 3] >> (at & 7) & 1)


class Tileset:
    def __init__(self, files, name, above, depth, found):
        self.files, self.name, self.found, self.depth = files, name, found, depth
        root = json.loads(files.read(name))["root"]
        self.visit(root, above, root.get("refine", "REPLACE"), depth)

    def visit(self, tile, above, refine, depth):
        """Adds the contents of a tile and of its children. Returns whether anything is drawn for it."""
        if depth > MAX_DEPTH:
            return False
        matrix = above
        if "transform" in tile:
            matrix = above @ np.array(tile["transform"], dtype=float).reshape(4, 4).T
        refine = tile.get("refine", refine).upper()
        if "implicitTiling" in tile:
            Implicit(self, tile, matrix, refine).subtree(0, (0, 0, 0))
            return True
        below = [self.visit(child, matrix, refine, depth + 1) for child in tile.get("children", [])]
        if refine == "REPLACE" and any(below):
            return True
        own = [tile["content"]] if "content" in tile else tile.get("contents", [])
        drawn = [self.content(content.get("uri") or content.get("url"), matrix, depth) for content in own]
        return any(below) or any(drawn)

    def content(self, uri, matrix, depth):
        name = joined(self.name, uri)
        try:
            data = self.files.read(name)
        except (FileNotFoundError, KeyError):
            print(f"{name} is missing", file=sys.stderr)
            return False
        if data.lstrip()[:1] == b"{" and b'"root"' in data and b'"geometricError"' in data:
            before = len(self.found)
            Tileset(self.files, name, matrix, depth + 1, self.found)
            return len(self.found) > before
        self.found.append((name, data, matrix))
        return True


class Implicit:
    """The tiles of an implicit root: the deepest ones that have contents, or all if children are added."""

    def __init__(self, tileset, tile, matrix, refine):
        self.tileset, self.matrix, self.adds = tileset, matrix, refine == "ADD"
        tiling = tile["implicitTiling"]
        self.axes = 3 if tiling["subdivisionScheme"] == "OCTREE" else 2
        self.levels = tiling["subtreeLevels"]
        self.most = tiling.get("availableLevels", tiling.get("maximumLevel", 63) + 1)
        self.subtrees = tiling["subtrees"]["uri"]
        self.contents = [tile["content"]["uri"]] if "content" in tile else [c["uri"] for c in tile.get("contents", [])]

    def named(self, template, level, at):
        for key, value in zip(("level", "x", "y", "z"), (level, *at)):
            template = template.replace("{" + key + "}", str(value))
        return template

    def subtree(self, level, at):
        """Draws a subtree. Returns whether anything is drawn."""
        name = joined(self.tileset.name, self.named(self.subtrees, level, at))
        data = self.tileset.files.read(name)
        if data[:4] == b"subt":
            json_bytes, binary_bytes = struct.unpack_from("<2Q", data, 8)
            of, chunk = table(data, 24, json_bytes, binary_bytes)
        else:
            of, chunk = json.loads(data), b""
        parts = [self.tileset.files.read(joined(name, b["uri"])) if "uri" in b else chunk for b in of.get("buffers", [])]
        tiles = Availability(of["tileAvailability"], of, parts)
        entries = of.get("contentAvailability", [])
        entries = entries if isinstance(entries, list) else [entries]
        has = [Availability(entry, of, parts) for entry in entries]
        children = Availability(of["childSubtreeAvailability"], of, parts)
        return self.tile(level, at, 0, 0, tiles, has, children)

    def tile(self, level, at, depth, morton, tiles, has, children):
        if level + depth >= self.most:
            return False
        if depth == self.levels:
            return children[morton] and self.subtree(level + depth, at)
        first = ((1 << self.axes * depth) - 1) // ((1 << self.axes) - 1)
        if not tiles[first + morton]:
            return False
        below = False
        for child in range(1 << self.axes):
            where = tuple(2 * c + (child >> axis & 1) if axis < self.axes else 0 for axis, c in enumerate(at))
            below |= self.tile(level, where, depth + 1, morton << self.axes | child, tiles, has, children)
        if below and not self.adds:
            return True
        drawn = False
        for uri, available in zip(self.contents, has):
            if available[first + morton]:
                drawn |= self.tileset.content(self.named(uri, level + depth, at), self.matrix, 0)
        return below or drawn


def read(path, target, options):
    files, found = Files(path), []
    Tileset(files, files.root, np.eye(4), 0, found)
    for name, data, matrix in found:
        for part, triangles in contents(data, files, name):
            points = moved(matrix, triangles).reshape(-1, 3)
            yield CityObject(f"{name} {part}", triangles=[target.place(points, "ECEF").reshape(-1, 3, 3)])
