"""Mesh tile (docs/formats.md, "Mesh tile") and the fields of a coded mesh (docs/formats.md, "Meshes") before its symbols."""
import hashlib, math, struct
from .container import BadTile, Bytes

KINDS = ["normal", "colour", "texture coordinate", "other"]


def read_mesh_tile(tile_id, sections):
    if not {1, 2} <= set(sections) or len(sections[1]) != (5 if 3 in sections else 1):
        raise BadTile("a mesh tile lacks its mesh, or its meta has another length")
    meta = sections[1]
    values = {"kind": "mesh", "leaf": "/".join(map(str, tile_id)), "lod": meta[0]} | read_mesh_fields(Bytes(sections[2]))
    if 3 in sections:
        values["texture"] = {"size_px": struct.unpack("<HH", meta[1:]), "bytes": len(sections[3])}
    return values


def read_mesh_fields(reader):
    """The table "bytes, field" of "Meshes". The symbols are not decoded, only hashed."""
    version, flags, bits, attributes = (reader.one("B") for _ in range(4))
    if version != 2 or flags > 3 or not 8 <= bits <= 16 or attributes > 8:
        raise BadTile("not a coded mesh of version 2")
    grid = [reader.one("d" if flags & 2 else "f") for _ in range(4)]
    if not all(map(math.isfinite, grid)) or grid[3] <= 0:
        raise BadTile("a mesh's grid is not finite, or its step is not positive")
    values = {
        "positions": "architectural" if flags & 1 else "scan", "bits": bits, "grid_min": grid[:3], "grid_step": grid[3],
        "vertices": reader.leb128(), "triangles_with_dummies": reader.leb128(),
        "attributes": [read_attribute(reader) for _ in range(attributes)],
    }
    if not flags & 1:
        values["weights"] = [reader.one("b") for _ in range(36)]
    return values | {"symbols_sha256": hashlib.sha256(reader.data[reader.at:]).hexdigest()}


def read_attribute(reader):
    kind, components, bits = (reader.one("B") for _ in range(3))
    if kind > 3 or not 1 <= components <= 4 or not 1 <= bits <= 16:
        raise BadTile("a mesh's attribute is out of range")
    return {"kind": KINDS[kind], "components": components, "bits": bits, "range": [reader.one("f"), reader.one("f")]}
