"""Tile container and city folder's archives (docs/formats.md, "Tile container" and "The archives")."""
import gzip, struct, subprocess, zlib

VERSION = 4
KINDS = {1: "blockmap", 2: "subtree", 3: "mesh", 4: "objects", 5: "visibility"}
MAX_HEADER_BYTES = 1 << 20
MAX_SECTIONS = 16
MAX_SECTION_BYTES = 16 << 20


class BadTile(Exception):
    """The bytes are not a tile of the format."""


class Bytes:
    """Reads little-endian values one after the other."""

    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, count):
        if self.at + count > len(self.data):
            raise BadTile("the bytes end too early")
        self.at += count
        return self.data[self.at - count:self.at]

    def one(self, layout):
        """One value of a struct layout, such as `I` for u32."""
        layout = "<" + layout
        return struct.unpack(layout, self.take(struct.calcsize(layout)))[0]

    def bincode_varint(self):
        first = self.one("B")
        if first > 253:
            raise BadTile("a varint is too long")
        return first if first <= 250 else self.one({251: "H", 252: "I", 253: "Q"}[first])

    def leb128(self, bits=32):
        value = 0
        for shift in range(0, bits + 3, 7):
            byte = self.one("B")
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                break
        if byte >= 0x80 or value >> bits:
            raise BadTile(f"a varint has more than {bits} bits")
        return value

    def rest(self):
        """All further bytes."""
        return self.take(len(self.data) - self.at)

    def finish(self):
        if self.at != len(self.data):
            raise BadTile(f"{len(self.data) - self.at} bytes follow the last value")


def unpack_zstd(packed):
    """Unpacks with the `zstandard` module if it is installed, else with the `zstd` program."""
    try:
        import zstandard
    except ImportError:
        result = subprocess.run(["zstd", "-dcq"], input=packed, capture_output=True)
        if result.returncode:
            raise BadTile("a zstd frame is damaged")
        return result.stdout
    try:
        return zstandard.ZstdDecompressor().decompressobj().decompress(packed)
    except zstandard.ZstdError as error:
        raise BadTile("a zstd frame is damaged") from error


def read_container(data):
    """"Tile container": returns the kind, the id (level, x, y) or None, and the sections by tag."""
    reader = Bytes(data)
    magic, version, kind, reserved, header_bytes, header_crc = struct.unpack("<4sHBBII", reader.take(16))
    if magic != b"INSU" or version != VERSION or kind not in KINDS or reserved != 0 or header_bytes > MAX_HEADER_BYTES:
        raise BadTile("not a tile of version 4")
    header = reader.take(header_bytes)
    if zlib.crc32(header) != header_crc:
        raise BadTile("the header's checksum is wrong")
    tile_id, entries = read_header(header)
    sections = {}
    for tag, packing, packed_bytes, raw_bytes, crc in entries:
        packed = reader.take(packed_bytes)
        if zlib.crc32(packed) != crc:
            raise BadTile(f"the checksum of section {tag} is wrong")
        raw = packed if packing == 0 else unpack_zstd(packed)
        if len(raw) != raw_bytes or tag in sections:
            raise BadTile(f"section {tag} has another length or comes twice")
        sections[tag] = raw
    reader.finish()
    return KINDS[kind], tile_id, sections


def read_header(header):
    """The table "The header is bincode 2" of "Tile container"."""
    reader = Bytes(header)
    has_id = reader.one("B")
    if has_id > 1:
        raise BadTile("an id is neither present nor absent")
    tile_id = (reader.one("B"), reader.bincode_varint(), reader.bincode_varint()) if has_id else None
    count = reader.bincode_varint()
    if count > MAX_SECTIONS:
        raise BadTile("too many sections")
    entries = []
    for _ in range(count):
        tag, packing, packed_bytes, raw_bytes, crc = reader.one("B"), *(reader.bincode_varint() for _ in range(4))
        if packing > 1 or max(packed_bytes, raw_bytes) > MAX_SECTION_BYTES:
            raise BadTile(f"section {tag} has an unknown packing or is too large")
        entries.append((tag, packing, packed_bytes, raw_bytes, crc))
    reader.finish()
    return tile_id, entries


def read_archive(path):
    """"The archives": yields (z, x, y, bytes) of each tile of a PMTiles archive."""
    data = path.read_bytes()
    if data[:8] != b"PMTiles\x03" or data[98] != 1:
        raise BadTile(f"{path} is not a PMTiles archive of uncompressed tiles")
    root_at, root_bytes, _, _, leaves_at, _, tiles_at = struct.unpack_from("<7Q", data, 8)
    unpack = {1: bytes, 2: gzip.decompress}[data[97]]

    def entries(packed):
        for number, run, length, offset in read_directory(unpack(packed)):
            if run == 0:
                yield from entries(data[leaves_at + offset:leaves_at + offset + length])
            else:
                yield from ((number + k, offset, length) for k in range(run))

    for number, offset, length in entries(data[root_at:root_at + root_bytes]):
        yield *zxy_of(number), data[tiles_at + offset:tiles_at + offset + length]


def read_directory(data):
    """A PMTiles directory as (tile number, run length, length, offset)."""
    reader = Bytes(data)
    count = reader.leb128(64)
    columns = [[reader.leb128(64) for _ in range(count)] for _ in range(4)]
    number, end, entries = 0, 0, []
    for step, run, length, offset in zip(*columns):
        number += step
        start = end if offset == 0 else offset - 1
        end = start + length
        entries.append((number, run, length, start))
    return entries


def zxy_of(number):
    """Level and position of a PMTiles tile number: levels one after the other, each along a Hilbert curve."""
    level = 0
    while number >= 4 ** level:
        number -= 4 ** level
        level += 1
    x = y = 0
    for k in range(level):
        side = 1 << k
        right = number >> 1 & 1
        up = (number ^ right) & 1
        if up == 0:
            if right:
                x, y = side - 1 - x, side - 1 - y
            x, y = y, x
        x, y = x + side * right, y + side * up
        number >>= 2
    return level, x, y
