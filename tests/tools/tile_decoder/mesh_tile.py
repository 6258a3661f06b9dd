"""Mesh tile (docs/formats.md, "Mesh tile"). Of its texture, a WebP file, only the size is read."""
import struct
from .container import BadTile, Bytes
from .mesh import read_mesh
from .object_names import read_triangle_objects

META, MESH, TEXTURE, OBJECTS, LANDMARKS = 1, 2, 3, 4, 5
MAX_LODS = 6
MAX_TRIANGLES = 1_048_576
MAX_LANDMARKS, LANDMARK_BYTES, MAX_STONES, NO_STONE = 64, 17, 16, 255
MAX_ANCHOR_M = 1e5
OCCLUSION_BITS = 5
MAX_PART_BYTES = 4 << 20
MAX_SIDE_PX, MAX_PX = 4096, 1 << 22
# How far texture coordinates may lie outside 0 to 1.
TOLERANCE = 0.001


def read_name(tile_id, sections):
    """The leaf and the level of detail."""
    meta = sections.get(META, b"")
    if tile_id is None or len(meta) != (5 if sections.get(TEXTURE) else 1) or meta[0] >= MAX_LODS:
        raise BadTile("a mesh tile has no id, or its meta has another length or level of detail")
    return "/".join(map(str, tile_id)), meta[0]


def read_mesh_tile(tile_id, sections):
    leaf, lod = read_name(tile_id, sections)
    meta, mesh, texture = (sections.get(tag, b"") for tag in (META, MESH, TEXTURE))
    if max(len(mesh), len(texture)) > MAX_PART_BYTES:
        raise BadTile("a mesh tile's mesh or texture is too large")
    values = {"kind": "mesh", "leaf": leaf, "lod": lod} | read_mesh(Bytes(mesh), MAX_TRIANGLES)
    if not values["triangles"]:
        raise BadTile("a mesh tile has no triangles")
    check_attribute(values["attributes"], bool(texture))
    if sections.get(OBJECTS):
        if len(sections[OBJECTS]) > MAX_PART_BYTES:
            raise BadTile("a mesh tile's objects are too large")
        values["objects"] = read_triangle_objects(sections[OBJECTS], values["triangles"])
    if sections.get(LANDMARKS):
        values["landmarks"] = read_landmarks(sections[LANDMARKS], values.get("objects", []))
    if texture:
        values["texture"] = {"size_px": read_size(meta, texture), "bytes": len(texture)}
    return values


def read_landmarks(section, objects):
    """Object, stone (or None) and anchor of each landmark."""
    count, rest = divmod(len(section), LANDMARK_BYTES)
    if rest or count > MAX_LANDMARKS:
        raise BadTile("a mesh tile's landmarks are too many, or cut")
    landmarks = []
    for number, stone, *anchor in struct.iter_unpack("<IB3f", section):
        is_near = all(abs(v) <= MAX_ANCHOR_M for v in anchor)
        if number not in objects or (stone != NO_STONE and stone >= MAX_STONES) or not is_near:
            raise BadTile("a landmark has a number out of range, or no triangle")
        landmarks.append({"object": number, "stone": None if stone == NO_STONE else stone, "anchor_m": anchor})
    numbers = [landmark["object"] for landmark in landmarks]
    if numbers != sorted(set(numbers)):
        raise BadTile("a mesh tile's landmarks are not in order")
    return landmarks


def check_attribute(attributes, is_textured):
    if len(attributes) not in (1, 2):
        raise BadTile("a mesh tile has another number of attributes than one or two")
    if len(attributes) == 2:
        occlusion = attributes[1]
        if (occlusion["kind"], occlusion["components"], occlusion["bits"]) != ("other", 1, OCCLUSION_BITS):
            raise BadTile("a mesh tile's second attribute is not occlusion")
    attribute = attributes[0]
    found = attribute["kind"], attribute["components"]
    if not is_textured:
        if found != ("colour", 3) or attribute["bits"] != 8:
            raise BadTile("a mesh tile without texture has no colours")
        return
    lowest, step = attribute["range"]
    ends = lowest, lowest + step * ((1 << attribute["bits"]) - 1)
    if found != ("texture coordinate", 2) or not all(-TOLERANCE <= end <= 1 + TOLERANCE for end in ends):
        raise BadTile("a mesh tile with texture has no texture coordinates from 0 to 1")


def read_size(meta, texture):
    """The size in meta, checked against the format's limits. Only the first bytes of the texture are checked."""
    width, height = struct.unpack("<HH", meta[1:])
    if not (1 <= width <= MAX_SIDE_PX and 1 <= height <= MAX_SIDE_PX and width * height <= MAX_PX):
        raise BadTile("a texture's size is out of range")
    if texture[:4] != b"RIFF" or texture[8:16] not in (b"WEBPVP8 ", b"WEBPVP8L"):
        raise BadTile("a texture is not a WebP file of one chunk")
    return width, height


def webp_size(texture):
    """Width and height in a WebP file of one chunk (RFC 9649, 2.5 and 3.4, and RFC 6386, 9.1)."""
    reader = Bytes(texture)
    _, riff_bytes, _, chunk, chunk_bytes = struct.unpack("<4sI4s4sI", reader.take(20))
    if riff_bytes + 8 != len(texture) or chunk_bytes + chunk_bytes % 2 + 20 != len(texture):
        raise BadTile("a WebP file has another length than it says")
    if chunk == b"VP8L":
        signature, bits = reader.one("B"), reader.one("I")
        if signature != 0x2F:
            raise BadTile("a WebP file has no picture")
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    frame = reader.take(10)
    if frame[0] & 1 or frame[3:6] != b"\x9d\x01\x2a":
        raise BadTile("a WebP file has no picture")
    width, height = struct.unpack("<HH", frame[6:])
    return width & 0x3FFF, height & 0x3FFF
