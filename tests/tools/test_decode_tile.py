"""Frozen tiles, decoded by the second decoder, have the values that protocol/tests/integration/vectors.rs wrote. No test needs a program
of this repository: python3 -m unittest discover tests/tools
"""
import pathlib, random, struct, unittest, zlib

from decode_tile import decode, texels_crc32
from tile_decoder.container import BadTile, Bytes, read_container
from tile_decoder.group import ABSENT, LEFT_OUT, read_group
from tile_decoder.mesh import read_mesh
from tile_decoder.mesh_tile import OBJECTS, webp_size
from tile_decoder.object_names import NONE, read_triangle_objects

VECTORS = pathlib.Path(__file__).parents[2] / "protocol/tests/vectors"
UP, EAST_SLOPE = 0x7F7F, 0x7FB5


def vector(name):
    return (VECTORS / f"v4_{name}.bin").read_bytes()


def texel(r, g, b, ao, coverage=3):
    return r | g << 8 | b << 16 | (ao << 2 | coverage) << 24


def f32(value):
    return struct.unpack("f", struct.pack("f", value))[0]


# Kind, components, bits, range.
COLOUR = ("colour", 3, 8, [0.0, f32(1 / 255)])
TEXTURE_COORDINATE = ("texture coordinate", 2, 12, [0.0, f32(1 / 4095)])
# The corners of each side, counter-clockwise from outside. Bit 0 of a corner is east, bit 1 north, bit 2 up.
SIDES = [[0, 2, 3, 1], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6], [4, 5, 7, 6]]


def halves(square):
    a, b, c, d = square
    return [(a, b, c), (a, c, d)]


def cuboid(colour, attribute):
    """A box of 8 x 12.5 x 24 m on a grid of 12 bits, with one colour, or with the whole texture on each side."""
    step = 24 / 4095
    size = [int(side / step + 0.5) for side in (8, 12.5, 24)]
    points = [tuple(size[axis] * (i >> axis & 1) for axis in range(3)) for i in range(8)]
    texture = [(0, 4095), (4095, 4095), (4095, 0), (0, 0)]
    values = [colour or texture[i] for _ in SIDES for triangle in halves(range(4)) for i in triangle]
    triangles = [triangle for side in SIDES for triangle in halves(side)]
    return ([1.0, 2.0, -3.0], step, 12), points, triangles, [(*attribute, values)]


def boxes_with_objects():
    """Six boxes on a line: points, triangles and the object of each triangle."""
    _, box, _, _ = cuboid((200, 90, 60), COLOUR)
    points = box + [(x // 8 + 500 * k, y, z) for k in range(1, 6) for x, y, z in box]
    sides = [SIDES[side] for side in (0, 5, 1, 2, 3, 4)]
    triangles = [tuple(8 * k + i for i in triangle) for k in range(6) for side in sides for triangle in halves(side)]
    objects = [[number] * 12 for number in (7, 9, 1_000_000, 7, 0, 8)]
    objects[1][3:5] = [70_000] * 2
    objects[2][6:] = [NONE] * 6
    objects[4] = [9, 9, 1_000_000, 1_000_000, NONE - 1, NONE - 1] * 2
    return points, triangles, sum(objects, [])


def all_attributes(triangles):
    """One of each kind. Each 31st corner has the value of the next vertex."""
    corners = [vertex for triangle in triangles for vertex in triangle]
    corners = [vertex + (i % 31 == 0) for i, vertex in enumerate(corners)]
    kinds = [("normal", 2, 8), ("colour", 3, 8), ("texture coordinate", 2, 12), ("other", 4, 16)]
    return [
        (kind, components, bits, [0.5, 0.25], [tuple(v * (1 + 2 * c) % 2 ** bits for c in range(components)) for v in corners])
        for kind, components, bits in kinds
    ]


def scan():
    """A curved surface of 16 x 16 vertices with a hole and a fin on an edge."""
    def noise(i):
        number = i * 2_654_435_761 % 2 ** 32
        number = (number ^ number >> 15) * 2_246_822_519 % 2 ** 32
        return (number ^ number >> 13) >> 29

    points = []
    for i in range(256):
        x, y = i % 16, i // 16
        points.append((x * 130 + noise(3 * i), y * 130 + noise(3 * i + 1), 1000 + x * y * 3 + noise(3 * i + 2)))
    squares = [16 * y + x for y in range(15) for x in range(15) if (x, y) != (3, 3)]
    triangles = [triangle for a in squares for triangle in halves([a, a + 1, a + 17, a + 16])]
    triangles.append((85, 86, 256))
    grid = [84_123.456, 447_000.1, -1.2], 0.01, 12
    return grid, points + [(1400, 1300, 3100)], triangles, all_attributes(triangles)


def architecture():
    """Two boxes that share a vertex, which the second has as its own first one. The second lacks its last side."""
    points, triangles = [], []
    for low, size, sides in [((0, 0, 0), (900, 500, 300), SIDES), ((900, 500, 300), (200, 350, 450), SIDES[:5])]:
        first = len(points)
        points += [tuple(low[axis] + size[axis] * (i >> axis & 1) for axis in range(3)) for i in range(8)]
        for side in sides:
            triangles += halves([7 if (first, i) == (8, 0) else first + i for i in side])
    return ([1.0, 2.0, 3.0], 0.5, 11), points, triangles, all_attributes(triangles)


def corners_of(points, triangles, values):
    """The sorted triangles, as the position and the values of each corner, from the lowest corner on."""
    out = []
    for t, triangle in enumerate(triangles):
        corners = [(points[vertex], *(own[3 * t + k] for own in values)) for k, vertex in enumerate(triangle)]
        first = corners.index(min(corners))
        out.append(corners[first:] + corners[:first])
    return sorted(out)


class FrozenTiles(unittest.TestCase):
    def test_every_kind_of_column(self):
        values = decode(vector("blockmap"))
        self.assertEqual((values["cell_m"], values["z_base_cells"], values["z_shift"]), (0.5, -7, 1))
        plain = {"z": [5, 90], "normal": UP, "roof": texel(200, 90, 60, 63)}
        wall = {"azimuth": 64, "strip": [texel(row, 100, 255 - row, 40) for row in range(12)]}
        holed = wall | {"strip": [0 if row == 1 else t for row, t in enumerate(wall["strip"])]}
        clip = {"offset": -20, "corner": (3, 40, 1), "outer": [12, texel(10, 20, 30, 50)]}
        self.assertEqual(values["columns"], [
            {"column": 0, "flags": 1} | plain,
            {"column": 1, "flags": 5} | plain | {"normal": EAST_SLOPE},
            {"column": 63, "flags": 3} | plain | wall,
            {"column": 4032, "flags": 51} | plain | holed,
            {"column": 4033, "flags": 67} | plain | wall | {"clip": clip},
            {"column": 4095, "flags": 11} | plain | wall | {"gap": (20, 60)},
        ])

    def test_a_town(self):
        values = decode(vector("town_blockmap"))
        shapes = [0] * (4 * 4096)
        for column in values["columns"]:
            at = 4 * column["column"]
            shapes[at:at + 4] = [column["flags"], *column["z"], column["normal"]]
        self.assertEqual(texels_crc32(values), 4_232_154_836)
        self.assertEqual(zlib.crc32(struct.pack("<16384H", *shapes)), 405_737_478)

    def test_thin_columns(self):
        columns = decode(vector("thin_blockmap"))["columns"]
        thin = {column["column"]: column["thin"] for column in columns if "thin" in column}
        railing = {20 * 64 + x: (33 + x % 3, 14) for x in range(5, 40)}
        self.assertEqual(thin, railing | {20 * 64 + 40: (51, 10), 30 * 64: (255, 0)})
        self.assertEqual(len(columns), 38)

    def test_a_town_with_objects(self):
        values = decode(vector("town_with_objects"))
        parts = [[NONE] * 4096 for _ in range(3)]
        for column in values["columns"]:
            for part, number in zip(parts, column.pop("objects")):
                part[column["column"]] = number
        found = [zlib.crc32(struct.pack("<4096I", *part)) for part in parts]
        self.assertEqual(found, [3_607_479_904, 2_173_267_658, 3_328_196_466])
        self.assertEqual(values, decode(vector("town_blockmap")))

    def test_lossy_texels(self):
        values = decode(vector("lossy_blockmap"))
        self.assertEqual(texels_crc32(values), 2_826_750_924)
        self.assertEqual([column["column"] for column in values["columns"]], [y * 64 + x for y in range(9) for x in range(12)])
        for column in values["columns"]:
            self.assertEqual(column["z"], [3, 40 + column["column"] % 7])
            self.assertEqual(column["flags"], 3 if column["column"] % 64 == 11 else 1)

    def test_tiles_that_the_encoder_never_writes(self):
        column = {"flags": 1, "z": [0, 100], "normal": UP, "roof": texel(10, 200, 30, 63)}
        found = decode(vector("blockmap_by_hand"))["columns"]
        self.assertEqual(found, [{"column": i} | column for i in range(4096)])
        self.assertEqual(decode(vector("subtree_by_hand")), decode(vector("subtree_with_meshes")))

    def test_subtree_with_meshes(self):
        root, child = decode(vector("subtree_with_meshes"))["nodes"]
        same = {"z_min_m": -2.5, "z_max_m": 71.25, "error_m": 3.5, "radius_m": 200.0, "blockmap_bytes": 4321}
        lods = [
            {"error_m": 0.125 * (1 + k), "bytes": 100_000 >> k, "triangles": 5000 >> k, "texture_px": px}
            for k, px in enumerate([1 << 20, 64, 0, 0])
        ]
        self.assertEqual(root, {"id": "5/17/30", "child_mask": 4} | same)
        self.assertEqual(child, {"id": "6/34/61", "child_mask": 0, "meshes": lods} | same)

    def test_plain_mesh_tile(self):
        values = decode(vector("plain_mesh_tile"))
        self.assertEqual((values["leaf"], values["lod"]), ("7/100/3", 1))
        self.check_mesh(values, *cuboid((200, 90, 60), COLOUR))
        self.assertNotIn("texture", values)

    def test_textured_mesh_tile(self):
        values = decode(vector("textured_mesh_tile"))
        self.assertEqual((values["leaf"], values["lod"]), ("7/100/3", 0))
        self.check_mesh(values, *cuboid(None, TEXTURE_COORDINATE))
        self.assertEqual(values["texture"], {"size_px": (640, 20), "bytes": 56})

    def test_mesh_tile_with_landmarks(self):
        values = decode(vector("mesh_tile_with_landmarks"))
        self.assertEqual(values["landmarks"], [
            {"object": 7, "stone": None, "anchor_m": [0.0, -7.5, 1e5]},
            {"object": 1_000_000, "stone": 15, "anchor_m": [12.25, 3.0, -0.125]},
        ])
        self.assertEqual([attribute["kind"] for attribute in values["attributes"]], ["colour", "other"])

    def test_mesh_tile_with_objects(self):
        values = decode(vector("mesh_tile_with_objects"))
        points, triangles, objects = boxes_with_objects()
        grid = cuboid((200, 90, 60), COLOUR)[0]
        self.check_mesh(values, grid, points, triangles, [(*COLOUR, [(200, 90, 60)] * 216)])
        own, given = ([number for number in numbers for _ in range(3)] for numbers in (values["objects"], objects))
        found = corners_of(values["points"], values["triangles"], [own])
        self.assertEqual(found, corners_of(points, triangles, [given]))

    def test_object_schema(self):
        values = decode(vector("object_schema"))["schema"]
        self.assertEqual((values["objects"], values["searchable"]), (1029, ["text", "code"]))
        found = [(attribute["name"], attribute["type"], attribute.get("unit")) for attribute in values["attributes"]]
        self.assertEqual(found, [
            ("text", "text", None), ("integer", "integer", None), ("float", "float", "m"), ("bool", "bool", None),
            ("date", "date", None), ("code", "text", None),
        ])

    def test_object_block(self):
        """Three buildings, of which the first two have a part."""
        values = decode(vector("object_block"))
        expected = []
        for number, time, year, size, is_old, day, end, low, high in [
            (1024, "00:00", 1850, 0.0, True, 0, "10000", [0, 0, 3], [80, 90, 60]),
            (1026, "49:14", 1929, 688.89, False, 8889, "18889", [889, 1889, 3], [978, 1979, 149]),
            (1028, "23:09", 1923, 605.63, False, 563, "10563", [563, 5563, 3], [646, 5653, 123]),
        ]:
            identifier = f"NL.IMBAG.Pand.05031000000{end}"
            attributes = [f"2010-10-13T12:{time}Z", year, size, is_old, day, identifier]
            item = {"number": number, "kind": "building", "identifier": identifier, "bounds_dm": [low, high]}
            part = item | {"number": number + 1, "kind": "building-part", "identifier": identifier + "-0", "parent": number}
            expected += [item | {"attributes": dict(enumerate(attributes))}, part | {"attributes": {}}]
        self.assertEqual((values["block"], values["objects"]), (2, expected[:5]))

    def test_visibility(self):
        def scale(i, s):
            return [0 if k == 12 else min((k * 7 + i) % 5, 3) for k in range(25 * s, 25 * s + 25)]

        values = decode(vector("visibility"))
        self.assertEqual((values["depth"], values["reach"], values["layers_dm"]), (6, 2, [30, 80, 200]))
        expected = [
            None if i % 9 == 5 else {"ground": -7 + i // 4, "seen": [scale(i, s) for s in range(3)]}
            for i in range(100)
        ]
        self.assertEqual(values["cells"], expected)

    def test_group(self):
        data = (VECTORS / "v4_group.group").read_bytes()
        expected = [bytes((k * 31 + i) % 251 for k in range(2 * i * i)) for i in range(16)]
        expected[3] = expected[7] = ABSENT
        expected[12] = LEFT_OUT
        self.assertEqual(read_group(data, 16), expected)
        for damaged in (data[:-1], data + b"\0", b"INSU" + data[4:], data[:4] + b"\xff\xff\xff\x7f" + data[8:]):
            with self.assertRaises(BadTile):
                read_group(damaged, 16)

    def test_scan_mesh(self):
        values = read_mesh(Bytes(vector("scan_mesh")))
        self.assertEqual(values["position_coder"], "scan")
        self.check_mesh(values, *scan())

    def test_architectural_mesh(self):
        values = read_mesh(Bytes(vector("architectural_mesh")))
        self.assertEqual(values["position_coder"], "architectural")
        self.check_mesh(values, *architecture())

    def check_mesh(self, values, grid, points, triangles, attributes):
        """Compares all values of a mesh, whose vertices and triangles have another order. `attributes` are (kind, components,
        bits, range, values of corners).
        """
        self.assertEqual((values["grid_min"], values["grid_step"], values["bits"]), grid)
        used = [points[vertex] for vertex in sorted({vertex for triangle in triangles for vertex in triangle})]
        self.assertEqual(sorted(values["points"]), sorted(used))
        self.assertEqual(len(set(used)), len(used), "positions name vertices")
        found = [(a["kind"], a["components"], a["bits"], a["range"]) for a in values["attributes"]]
        self.assertEqual(found, [attribute[:4] for attribute in attributes])
        own = corners_of(values["points"], values["triangles"], [attribute["values"] for attribute in values["attributes"]])
        self.assertEqual(own, corners_of(points, triangles, [attribute[4] for attribute in attributes]))

    def test_shortened_and_lengthened_meshes_are_refused(self):
        for name, step in [("scan_mesh", 61), ("architectural_mesh", 1)]:
            data = vector(name)
            lengths = [*range(0, len(data), step), len(data) - 1]
            for wrong in [data[:length] for length in lengths] + [data + b"\0", data + b"\0\0"]:
                with self.assertRaises(BadTile):
                    read_mesh(Bytes(wrong))

    def test_wrong_bytes_of_meshes_are_refused_or_decoded(self):
        rng = random.Random(1)
        for name in ["scan_mesh", "architectural_mesh"] * 25:
            data = bytearray(vector(name))
            for _ in range(rng.choice([1, 1, 2, 8])):
                data[rng.randrange(len(data))] = rng.randrange(256)
            try:
                read_mesh(Bytes(bytes(data)), 262_144)
            except BadTile:
                pass

    def test_wrong_bytes_of_objects_are_refused_or_decoded(self):
        rng, triangles = random.Random(2), decode(vector("mesh_tile_with_objects"))["triangles"]
        good = read_container(vector("mesh_tile_with_objects"))[2][OBJECTS]
        for length in range(len(good)):
            self.assertNotEqual(self.objects_of(good[:length], triangles), self.objects_of(good, triangles))
        self.assertIsNone(self.objects_of(good + bytes(5), triangles))
        for _ in range(300):
            data = bytearray(good)
            data[rng.randrange(len(data))] = rng.randrange(256)
            self.objects_of(bytes(data), triangles)

    def objects_of(self, data, triangles):
        try:
            return read_triangle_objects(data, triangles)
        except BadTile:
            return None

    def test_meshes_beyond_the_limits_are_refused(self):
        start = vector("architectural_mesh")[:20]
        for vertices, triangles in [(262_145, 1), (1, 262_145)]:
            counts = b"".join(bytes([n & 127 | 128, n >> 7 & 127 | 128, n >> 14]) for n in (vertices, triangles))
            with self.assertRaisesRegex(BadTile, "too many"):
                read_mesh(Bytes(start + counts), 262_144)

    def test_shortened_and_lengthened_tiles_are_refused(self):
        for name in ["blockmap", "lossy_blockmap", "subtree", "subtree_with_meshes", "plain_mesh_tile", "textured_mesh_tile",
                     "mesh_tile_with_objects", "mesh_tile_with_landmarks", "object_schema", "object_block"]:
            data = vector(name)
            for wrong in [data[:length] for length in range(len(data))] + [data + b"\0"]:
                with self.assertRaises(BadTile):
                    decode(wrong)


class WebpSizes(unittest.TestCase):
    LOSSLESS = b"RIFF\x12\0\0\0WEBPVP8L\x05\0\0\0\x2f\x45\x40\x07\0\0"
    LOSSY = b"RIFF\x16\0\0\0WEBPVP8 \x0a\0\0\0\x10\0\0\x9d\x01\x2a\x46\0\x1e\0"

    def test_both_kinds(self):
        self.assertEqual([webp_size(self.LOSSLESS), webp_size(self.LOSSY)], [(70, 30)] * 2)

    def test_shortened_and_lengthened_files_are_refused(self):
        for data in [self.LOSSLESS, self.LOSSY]:
            for wrong in [data[:length] for length in range(len(data))] + [data + b"\0"]:
                with self.assertRaises(BadTile):
                    webp_size(wrong)


if __name__ == "__main__":
    unittest.main()
