"""Reads the GeoTIFF files that Insula writes: one band of float32 in tiles, Deflate after the floating-point predictor."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ._programs import Error

# Types of TIFF 6.0 that these files have: texts, and numbers by their format in `struct`.
_TEXT = 2
_NUMBERS = {3: "H", 4: "I", 12: "d", 16: "Q"}
_PROJECTED_CRS = 3072


class TiffContent(NamedTuple):
    """What such a file has."""

    values: np.ndarray
    cell_m: float
    north_west: tuple[float, float]
    epsg: int | None
    nodata: float | None
    title: str
    attribution: str


def read(path: Path) -> TiffContent:
    """Reads a file. Fails with `Error` if it is not one that Insula writes."""
    data = path.read_bytes()
    try:
        tags = _directory(data)
        if (tags[259], tags[317], tags[258], tags[339]) != ((8,), (3,), (32,), (3,)):
            raise ValueError("not float32 by Deflate with the predictor of floats")
        values = _values(data, tags)
        place, keys = tags[33922], tags[34735]
        epsg = [keys[i + 3] for i in range(4, len(keys), 4) if keys[i] == _PROJECTED_CRS]
        nodata = float(tags[42113]) if 42113 in tags else None
        texts = tags.get(270, ""), tags.get(33432, "")
        return TiffContent(values, tags[33550][0], (place[3], place[4]), epsg[0] if epsg else None, nodata, *texts)
    except (ValueError, KeyError, IndexError, struct.error, zlib.error) as error:
        raise Error(f"{path}: not a raster that Insula wrote ({error}): read it with rasterio") from error


def _directory(data: bytes) -> dict[int, Any]:
    """The first directory: a text, or a tuple of numbers for each tag."""
    if data[:2] != b"II" or data[2] not in (42, 43):
        raise ValueError("not a little-endian TIFF")
    is_big = data[2] == 43
    at, entry, width, count = (8, 20, "Q", "<Q") if is_big else (4, 12, "I", "<H")
    field = 8 if is_big else 4
    (place,) = struct.unpack_from(f"<{width}", data, at)
    (entries,) = struct.unpack_from(count, data, place)
    place += struct.calcsize(count)
    tags: dict[int, Any] = {}
    for start in range(place, place + entries * entry, entry):
        tag, kind, number = struct.unpack_from(f"<HH{width}", data, start)
        size = number * (1 if kind == _TEXT else struct.calcsize(_NUMBERS[kind]))
        where = start + 4 + field
        if size > field:
            (where,) = struct.unpack_from(f"<{width}", data, where)
        if where + size > len(data):
            raise ValueError("cut off")
        if kind == _TEXT:
            tags[tag] = data[where : where + number].rstrip(b"\0").decode("utf-8", "replace")
        else:
            tags[tag] = struct.unpack_from(f"<{number}{_NUMBERS[kind]}", data, where)
    return tags


def _values(data: bytes, tags: dict[int, Any]) -> np.ndarray:
    (width,), (height,), (side,) = tags[256], tags[257], tags[322]
    columns = -(-width // side)
    tiles = columns * -(-height // side)
    if (side,) != tags[323] or len(tags[324]) != tiles or len(tags[325]) != tiles:
        raise ValueError("tiles are missing")
    values = np.empty((height, width), np.float32)
    for number, (offset, size) in enumerate(zip(tags[324], tags[325])):
        content = zlib.decompressobj().decompress(data[offset : offset + size], side * side * 4)
        # Bytes of all values of a row from the most to the least significant, each as the difference from the one before.
        rows = np.frombuffer(content, np.uint8).reshape(side, 4 * side)
        planes = np.cumsum(rows, axis=1, dtype=np.uint8).reshape(side, 4, side)
        tile = np.ascontiguousarray(planes.transpose(0, 2, 1)).view(">f4")[..., 0]
        y, x = number // columns * side, number % columns * side
        values[y : y + side, x : x + side] = tile[: height - y, : width - x]
    return values
