"""The picture of `insula-server inspect --png`, drawn from decoded columns, and a reader of such PNG files."""
import struct, zlib
from .shapes import COLUMNS, EXPOSED, OCCUPIED, SIDE

SCALE, MARGIN, WALL_WIDTH, WALL_HEIGHT_MAX = 4, 4, 256, 1024
BACKGROUND, BLACK, HOLE = (40, 40, 48), (0, 0, 0), (255, 0, 255)


def draw(tile):
    """Rows of (r, g, b), before they are enlarged: geometry map, roof map and wall map."""
    maps = [column_map(tile, geometry(tile)), column_map(tile, [t and shade(t) for t in tile.roof]), wall_map(tile)]
    height = max(map(len, maps))
    rows = [[BACKGROUND] * (sum(len(m[0]) for m in maps) + 4 * MARGIN) for _ in range(height + 2 * MARGIN)]
    left = MARGIN
    for part in maps:
        for y, row in enumerate(part):
            rows[MARGIN + y][left:left + len(row)] = row
        left += len(part[0]) + MARGIN
    return rows


def geometry(tile):
    highest, texels, start = max(1, *tile.z_max), sum(len(strip or []) for strip in tile.strip), 0
    colours = []
    for i in range(COLUMNS):
        blue = 64 + start * 191 // max(1, texels) if tile.has(i, EXPOSED) else 0
        start += len(tile.strip[i] or [])
        colours.append((tile.z_max[i] * 255 // highest, tile.z_min[i] * 255 // highest, blue))
    return colours


def shade(texel):
    return tuple(v * texel[3] // 63 for v in texel[:3])


def column_map(tile, colours):
    of = lambda i: colours[i] if tile.has(i, OCCUPIED) else BLACK
    return [[of(y * SIDE + x) for x in range(SIDE)] for y in reversed(range(SIDE))]


def wall_map(tile):
    texels = [shade(t) if t[4] else HOLE for strip in tile.strip for t in strip or []]
    height = min(max(SIDE, -(-len(texels) // WALL_WIDTH)), WALL_HEIGHT_MAX)
    texels = texels[:height * WALL_WIDTH] + [BLACK] * (height * WALL_WIDTH - len(texels))
    return [texels[y * WALL_WIDTH:(y + 1) * WALL_WIDTH] for y in range(height)]


def read_png(data):
    """Every fourth pixel of every fourth row of an 8-bit RGB PNG file."""
    at, packed, width = 8, b"", 0
    while at < len(data):
        length, name = struct.unpack_from(">I4s", data, at)
        body = data[at + 8:at + 8 + length]
        if name == b"IHDR":
            width, _, depth, colour = struct.unpack(">IIBB", body[:10])
            assert (depth, colour) == (8, 2), "not an 8-bit RGB image"
        packed += body if name == b"IDAT" else b""
        at += length + 12
    data, stride, rows = zlib.decompress(packed), 3 * width, []
    row = bytearray(stride)
    for y, start in enumerate(range(0, len(data), stride + 1)):
        row = unfilter(data[start], data[start + 1:start + 1 + stride], row)
        if y % SCALE == 0:
            rows.append([tuple(row[x:x + 3]) for x in range(0, stride, 3 * SCALE)])
    return rows


def unfilter(kind, line, above):
    """Undoes a PNG filter of 3-byte pixels."""
    row = bytearray(line)
    if kind == 0:
        return row
    for k in range(len(row)):
        a, b, c = (row[k - 3], above[k], above[k - 3]) if k >= 3 else (0, above[k], 0)
        if kind == 4:
            p = a + b - c
            nearest = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]
        else:
            nearest = [0, a, b, (a + b) // 2][kind]
        row[k] = row[k] + nearest & 255
    return row
