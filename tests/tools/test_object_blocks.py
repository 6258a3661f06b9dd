"""Blocks of objects that are written by hand after docs/formats.md, "Blocks of objects". No test needs a program of this
repository: python3 -m unittest discover tests/tools
"""
import itertools, math, random, struct, unittest, zlib

from tile_decoder.container import BadTile, Bytes
from tile_decoder.number_columns import History, RowSets, read_numbers
from tile_decoder.object_tile import BlockReader, block_of_place, float_of, order, read_block, read_schema
from tile_decoder.text_lists import TextReader

# Numbers without any: coding 0, base 0, width 0.
EMPTY = b"\0\0\0"


def varint(value):
    out = b""
    while value > 127:
        out, value = out + bytes([value & 127 | 128]), value >> 7
    return out + bytes([value])


def signed(value):
    return varint(2 * value if value >= 0 else -2 * value - 1)


def plain(numbers):
    """Numbers of coding 0 with planes."""
    base = min(numbers, default=0)
    width = (max(numbers, default=0) - base).bit_length() + 7 >> 3
    planes = [bytes(number - base >> 8 * plane & 255 for number in numbers) for plane in range(width)]
    return b"\4" + signed(base) + bytes([width]) + b"".join(planes)


def front(texts):
    """A list of texts that share nothing."""
    rests = [text.encode() for text in texts]
    return plain([0] * len(rests)) + plain([len(rest) for rest in rests]) + b"".join(rests)


def payload(columns=(), kinds=(0, 0, 0), identifiers=("a", "b7", "")):
    """Three objects in slots 1, 2 and 4 of 5; the second has a parent and the third bounds."""
    parts = [
        varint(5), b"\1\x16", plain(kinds), b"\0", front(identifiers), b"\1\2", plain([-513]), b"\1\4",
        *(plain([number]) for number in (-7, 10, 2 ** 31 - 9, 8, 0, 0)), varint(len(columns)), *columns,
    ]
    return b"".join(parts)


def decode(data, first=512):
    return BlockReader(Bytes(data), first).read(None)


def numbers(data, count, *context):
    reader = Bytes(data)
    found = read_numbers(reader, count, *context)
    reader.finish()
    return found


def texts(data, count, rows=None, identifiers=None, history=None):
    reader = Bytes(data)
    coder = TextReader(reader, history or History(count))
    coder.identifiers = identifiers
    found = coder.read(count, rows)
    reader.finish()
    return found


def values(*column):
    """The values of an attribute of three objects."""
    objects = decode(payload([varint(0) + b"".join(column)]))
    return [item["attributes"].get(0) for item in objects]


class Blocks(unittest.TestCase):
    def refused(self, call, *arguments):
        with self.assertRaises(BadTile):
            call(*arguments)

    def test_fields(self):
        self.assertEqual(decode(payload()), [
            {"number": 513, "kind": "building", "identifier": "a", "attributes": {}},
            {"number": 514, "kind": "building", "identifier": "b7", "parent": 1, "attributes": {}},
            {"number": 516, "kind": "building", "identifier": "", "bounds_dm": [[-7, 2 ** 31 - 9, 0], [3, 2 ** 31 - 1, 0]],
             "attributes": {}},
        ])
        self.refused(decode, payload(kinds=(0, 12, 0)))
        self.refused(decode, payload(), 0)
        self.refused(decode, payload() + b"\0")
        for length in range(len(payload())):
            self.refused(decode, payload()[:length])

    def test_wrong_bytes_are_refused_or_decoded(self):
        columns = [b"\0\1\0" + plain([1, 2, 3]), b"\0\2\0\x22" + plain([1, 2, 3]) + plain([1, 2, 3]), b"\0\0\0\0\2"]
        good, rng = payload(columns, identifiers=("a", "b", "c")), random.Random(1)
        decode(good)
        for _ in range(2000):
            data = bytearray(good)
            for _ in range(rng.choice([1, 1, 2, 8])):
                data[rng.randrange(len(data))] = rng.randrange(256)
            try:
                decode(bytes(data))
            except BadTile:
                pass

    def test_places(self):
        self.assertEqual([block_of_place((12, *at)) for at in [(0, 0), (1, 0), (0, 1), (3, 2), (4095, 4095)]],
                         [0, 1, 2, 13, (1 << 24) - 1])
        self.refused(block_of_place, (11, 0, 0))

    def test_header(self):
        # A zstd frame of one block that is not compressed.
        packed = b"\x28\xb5\x2f\xfd\0\0" + struct.pack("<I", len(payload()) << 3 | 1)[:3] + payload()
        checked = struct.pack("<II", 1, len(payload())) + packed
        block = b"INSO\1\0" + struct.pack("<I", zlib.crc32(checked)) + checked
        self.assertEqual(read_block(block, 1), decode(payload()))
        self.refused(read_block, block, 2)
        for at in range(len(block)):
            self.refused(read_block, block[:at] + bytes([block[at] ^ 16]) + block[at + 1:], 1)

    def test_schemas(self):
        attribute = '{"name":"a","type":"date","count":1,"min":-3,"max":2}'
        self.assertEqual(read_schema(b'{"objects":1,"attributes":[%s]}' % attribute.encode())["objects"], 1)
        for wrong in ['{"objects":1}', "[]", '{"objects":1,"attributes":[1]}', '{"objects":1,"attributes":[],"more":1}', "[", '{"objects":1,"attributes":[%s,%s]}' % (
                attribute, attribute), '{"objects":1,"attributes":[%s]}' % attribute.replace("-3", "3")]:
            self.refused(read_schema, wrong.encode())

    def test_row_sets(self):
        reader = Bytes(b"\0\1\x05\x02\1\x00\x00\3\2")
        sets = RowSets(10)
        found = [sets.read(reader) for _ in range(5)]
        self.assertEqual(found, [list(range(10)), [0, 2, 9], [], [], [0, 2, 9]])
        self.refused(RowSets(3).read, Bytes(b"\1\x08"))
        self.refused(RowSets(3).read, Bytes(b"\2"))

    def test_numbers(self):
        self.assertEqual(numbers(b"\0" + signed(-5) + b"\3\x08\1", 3), [-5, -4, -1])
        self.assertEqual(numbers(b"\4" + signed(7) + b"\2\0\1\2\1\0\0", 3), [263, 8, 9])
        self.assertEqual(numbers(b"\1" + signed(1000) + signed(-1) + b"\2\x1b", 4), [1000, 1002, 1003, 1003])
        self.assertEqual(numbers(b"\3\3" + b"\1" + signed(5) + signed(1) + b"\1\2" + b"\0\2\x24", 3), [5, 6, 8])
        self.assertEqual(numbers(b"\1\0\0", 0), [])
        self.assertEqual(numbers(b"\0" + signed(2 ** 63 - 1) + b"\1\1", 1), [-2 ** 63])
        for wrong in [b"\0\0\x41", b"\4\0\x09", b"\7\0\0", b"\x08\0\0", b"\3\1\0\0\0\0\0", b"\3\1\1\0\0\0\2\0", b"\2\1\0\0"]:
            self.refused(numbers, wrong, 1)

    def test_earlier_columns(self):
        history = History(4)
        history.add([1, 3], [10, -2])
        history.add([0], [5])
        earlier = [numbers(b"\2" + bytes([distance]) + b"\0\1\2", 3, [0, 1, 3], history) for distance in (1, 2)]
        self.assertEqual(earlier, [[5, 6, 5], [0, 11, -2]])
        for distance in (0, 3):
            self.refused(numbers, b"\2" + bytes([distance]) + b"\0\0", 3, [0, 1, 3], history)
        for _ in range(70):
            history.add([], [])
        self.assertEqual(numbers(b"\2\x40\0\0", 1, [0], history), [0])
        self.refused(numbers, b"\2\x41\0\0", 1, [0], history)

    def test_texts(self):
        self.assertEqual(texts(b"\0" + front(["ä", "", "x"]), 3), ["ä", "", "x"])
        self.assertEqual(texts(b"\0" + plain([0, 2, 1]) + plain([2, 1, 0]) + b"abc", 3), ["ab", "abc", "a"])
        self.assertEqual(texts(b"\2", 2, [2, 0], ["a", "b", "c"]), ["c", "a"])
        history = History(4)
        pattern = b"\1\2" + front(["x00-0", "0" * 20]) + plain([1, 0, 0]) + plain([7, 5, 99]) + plain([42, 0, 3])
        self.assertEqual(texts(pattern, 3, [0, 1, 3], [], history), ["0" * 17 + "742", "x05-0", "x99-3"])
        self.assertEqual(history.columns, [[42, 0, 0, 3], [7, 5, 5, 99]])
        self.assertEqual(texts(b"\1\1" + front(["00"]) + plain([0]) + plain([9]), 1, None, [], history), ["09"])
        self.assertEqual(len(history.columns), 2)
        for wrong in [b"\3", b"\2", b"\0" + plain([1]) + plain([1]) + b"x", b"\0" + plain([0]) + plain([1]) + b"\xff",
                      b"\0" + plain([0]) + plain([4097]) + b"x" * 4097, b"\1\1" + front(["0"]) + plain([1]) + plain([0]),
                      b"\1\1" + front(["0"]) + plain([0]) + plain([10]), b"\1\1" + front(["0"]) + plain([0]) + plain([-1]),
                      b"\1\1" + front(["0-" * 17]) + plain([0]) + plain([0]) * 17, b"\1" + varint(65) + front(["a"] * 65) + plain([0])]:
            self.refused(texts, wrong, 1)

    def test_texts_of_a_payload_are_bounded(self):
        reader = TextReader(Bytes((b"\0" + front(["x" * 4096] * 512)) * 9), History(0))
        for _ in range(8):
            reader.read(512)
        self.refused(reader.read, 512)

    def test_attributes(self):
        self.assertEqual(values(b"\1\0", plain([-1, 0, 9])), [-1, 0, 9])
        self.assertEqual(values(b"\3\1\5", plain([1, 0])), [True, None, False])
        self.assertEqual(values(b"\4\2", plain([-2 ** 31])), [None, -2 ** 31, None])
        self.assertEqual(values(b"\0\0\0", b"\2"), ["a", "b7", ""])
        self.assertEqual(values(b"\0\0\1", varint(2), b"\0", front(["u", "v"]), plain([0, 0, 1])), ["u", "v", "u"])
        two = decode(payload([varint(3) + b"\1\0" + plain([1, 2, 3]), varint(1) + b"\1\0" + b"\2\1\0\0"]))
        self.assertEqual([item["attributes"] for item in two], [{3: k, 5: k} for k in (1, 2, 3)])
        for wrong in [[b"\5\0", plain([0] * 3)], [b"\3\0", plain([0, 2, 0])], [b"\4\0", plain([0, 2 ** 31, 0])], [b"\0\0\2"],
                      [b"\0\0\1", varint(1), b"\0", front(["u"]), plain([0, 2, 1])],
                      [b"\0\0\1", varint(2), b"\0", front(["u", "v"]), plain([0, 1, 1])],
                      [b"\0\0\1", varint(1), b"\2", plain([0, 1, 1])]]:
            self.refused(values, *wrong)

    def test_floats(self):
        self.assertEqual(values(b"\2\0\2", plain([0, 123, -5])), [0.0, 1.23, -0.05])
        self.assertEqual(values(b"\2\0\x22", plain([0, 123, -5]), plain([0, 1, 0])), [0.0, math.nextafter(1.23, 2), -0.05])
        self.assertEqual(values(b"\2\0\x09", plain([1, 2, 3])), list(struct.unpack("<3f", struct.pack("<3f", 0.1, 0.2, 0.3))))
        bits = struct.unpack("<i", struct.pack("<f", 2.5))[0]
        self.assertEqual([float_of(16, bits), float_of(16, -bits - 1), float_of(16, -1)], [2.5, -2.5, 0.0])
        ascending = [-1e300, -1.0, -5e-324, -0.0, 0.0, 5e-324, 1.0]
        self.assertTrue(all(order(a) < order(b) for a, b in itertools.pairwise(ascending)))
        self.assertEqual([float_of(17, order(value)) for value in ascending], ascending)
        self.assertEqual((order(0.0), order(-0.0)), (0, -1))
        for kind, number in [(7, 0), (15, 0), (18, 0), (64, 0), (16, 1 << 31), (16, 0x7F800000), (17, order(math.inf))]:
            self.refused(float_of, kind, number)


if __name__ == "__main__":
    unittest.main()
