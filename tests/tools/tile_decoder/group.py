"""Groups of tiles (docs/formats.md, "Groups of tiles")."""
from .container import BadTile, Bytes

MAX_TILES_BYTES = 65_536
ABSENT, LEFT_OUT = "absent", "left out"


def read_group(data, count):
    """The tiles of a group of `count` nodes, or ABSENT or LEFT_OUT."""
    if count not in (2, 4, 8, 16, 32, 64):
        raise BadTile("no group has so many nodes")
    reader = Bytes(data)
    if reader.take(4) != b"INSG":
        raise BadTile("not a group of tiles")
    lengths = [reader.leb128() for _ in range(count)]
    if sum(length - 2 for length in lengths if length >= 2) > MAX_TILES_BYTES:
        raise BadTile("a group has too many bytes")
    tiles = [reader.take(length - 2) if length >= 2 else (ABSENT, LEFT_OUT)[length] for length in lengths]
    reader.finish()
    return tiles
