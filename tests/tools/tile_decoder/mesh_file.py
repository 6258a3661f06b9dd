"""Files of coded meshes (docs/formats.md, "Meshes"), and what `insula-server decompress` makes of them."""
import collections, math, pathlib, struct, subprocess, tempfile, zlib
from .container import BadTile, Bytes
from .single import Single, dot, larger, single

MAGIC = b"INSM"


def to_file(coded):
    return MAGIC + coded + struct.pack("<I", zlib.crc32(coded))


def from_file(data):
    """The coded mesh of a file."""
    reader = Bytes(data)
    magic, coded, crc = reader.take(4), reader.take(max(len(data) - 8, 0)), reader.one("I")
    if magic != MAGIC or zlib.crc32(coded) != crc:
        raise BadTile("not a mesh file, or its checksum is wrong")
    return coded


def what_differs(program, coded, values):
    """Compares the values of a coded mesh with the OBJ and PLY files that `decompress` writes. Returns the names of what
    differs, or why the program refuses the mesh.
    """
    with tempfile.TemporaryDirectory() as folder:
        source, obj, ply = (pathlib.Path(folder) / name for name in ("mesh.insm", "mesh.obj", "mesh.ply"))
        source.write_bytes(to_file(coded))
        for out in (obj, ply):
            result = subprocess.run([program, "decompress", source, out], capture_output=True, text=True)
            if result.returncode:
                return [result.stderr.strip()]
        return differing_in_obj(obj.read_text(), values) + differing_in_ply(ply.read_bytes(), values)


def differing_in_obj(text, values):
    """Compares points, triangles, texture coordinates and normals."""
    rows = collections.defaultdict(list)
    for line in text.splitlines():
        name, *words = line.split()
        rows[name].append(words)
    points = [tuple(map(float, words[:3])) for words in rows["v"]]
    corners = [word.split("/") + ["", ""] for words in rows["f"] for word in words]
    vertices = [int(corner[0]) - 1 for corner in corners]
    found = {
        "positions": points == positions_m(values),
        "triangles": vertices == [vertex for triangle in values["triangles"] for vertex in triangle],
    }
    for k, name, kind, decoded in (1, "vt", "texture coordinate", texture_coordinates), (2, "vn", "normal", normal):
        attribute = attribute_of(values, kind)
        listed = [tuple(single(float(word)) for word in words) for words in rows[name]]
        own = [listed[int(corner[k]) - 1] if corner[k] else None for corner in corners]
        found[name] = not any(own) if attribute is None else own == [decoded(v, attribute) for v in attribute["values"]]
    return [name for name, equal in found.items() if not equal]


def differing_in_ply(data, values):
    """Compares the positions and colours of corners."""
    head, _, body = data.partition(b"end_header\n")
    lines = [line.split() for line in head.decode().splitlines()]
    layout = struct.Struct("<" + "".join({"double": "d", "float": "f", "uchar": "B"}[line[1]] for line in lines
                                         if line[0] == "property" and line[1] != "list"))
    counts = {line[1]: int(line[2]) for line in lines if line[0] == "element"}
    names = [line[2] for line in lines if line[0] == "property" and line[1] != "list"]
    rows = [dict(zip(names, row)) for row in layout.iter_unpack(body[:counts["vertex"] * layout.size])]
    faces = struct.iter_unpack("<B3I", body[counts["vertex"] * layout.size:])
    corners = [rows[vertex] for face in faces for vertex in face[1:]]
    points = positions_m(values)
    expected = [points[vertex] for triangle in values["triangles"] for vertex in triangle]
    differing = [] if [(row["x"], row["y"], row["z"]) for row in corners] == expected else ["corners' positions"]
    attribute = attribute_of(values, "colour")
    if attribute:
        names = ["red", "green", "blue", "alpha"][:attribute["components"]]
        own = [colour(value, attribute) for value in attribute["values"]]
        if [tuple(row.get(name) for name in names) for row in corners] != own:
            differing.append("colours")
    return differing


def attribute_of(values, kind):
    """The first attribute of a kind."""
    return next((attribute for attribute in values["attributes"] if attribute["kind"] == kind), None)


def positions_m(values):
    step, low = values["grid_step"], values["grid_min"]
    return [tuple(low[axis] + point[axis] * step for axis in range(3)) for point in values["points"]]


def real_value(value, attribute):
    """The range of an attribute applied in f32."""
    low, step = map(Single, attribute["range"])
    return tuple(low + Single(component) * step for component in value)


def colour(value, attribute):
    """Bytes, as PLY files have them."""
    return tuple(math.floor(min(larger(component * 255, 0), 255) + 0.5) for component in real_value(value, attribute))


def texture_coordinates(value, attribute):
    """The program marks corners without a value by a third component."""
    return None if any(value[2:3]) else real_value(value[:2], attribute)


def normal(value, _):
    """The octahedral map of docs/formats.md, "Columns", in f32."""
    if any(value[2:3]):
        return None
    one = Single(1)
    code = value[0] | value[1] << 8
    u, v = (Single(min(byte, 254) - 127) / 127 for byte in (code & 255, code >> 8 & 255))
    z = one - abs(u) - abs(v)
    if z < 0:
        u, v = (one - abs(v)) * (-1 if u < 0 else 1), (one - abs(u)) * (-1 if v < 0 else 1)
    length = single(math.sqrt(dot((u, v, z), (u, v, z))))
    return tuple(component / length for component in (u, v, z))
