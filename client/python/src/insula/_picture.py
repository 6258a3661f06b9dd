"""Pictures of a city: colours, distances and objects of pixels."""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from ._programs import Error

NO_OBJECT = 0xFFFF_FFFF
"""Number of pixels that show no object."""


class Picture(np.ndarray):
    """Height x width x 3 bytes of red, green and blue, which notebooks show. Parts and copies of it are plain arrays of numbers."""

    distance: np.ndarray | None
    """Metres along the ray of each pixel, infinity for the sky (float32)."""
    objects: np.ndarray | None
    """Number of each pixel's object, `insula.NO_OBJECT` where there is none (uint32)."""
    seen: list[dict[str, Any]]
    """What is known of the objects in the picture, those with the most pixels first."""
    png: bytes | None
    """The file of the picture, with the names of its sources."""

    def __new__(cls, png: bytes) -> Picture:
        picture = decode_png(png).view(cls)
        picture.png = png
        return picture

    def __array_finalize__(self, _: Any) -> None:
        self.distance = self.objects = self.png = None
        self.seen = []

    def _repr_png_(self) -> bytes | None:
        return self.png


def read_distance(path: Path) -> np.ndarray:
    """Reads a PFM file of one channel, whose rows go from the bottom to the top."""
    data = path.read_bytes()
    kind, size, scale, values = data.split(b"\n", 3)
    width, height = (int(side) for side in size.split())
    if kind != b"Pf" or float(scale) >= 0 or len(values) != 4 * width * height:
        raise Error(f"{path}: not a file of distances")
    return np.frombuffer(values, "<f4").reshape(height, width)[::-1].astype(np.float32)


def read_objects(path: Path, shape: tuple[int, int]) -> np.ndarray:
    """Reads the numbers of objects."""
    return np.frombuffer(path.read_bytes(), "<u4").reshape(shape).astype(np.uint32)


def read_list(path: Path) -> list[dict[str, Any]]:
    """Reads what is known of objects."""
    return json.loads(path.read_text(encoding="utf-8"))


def decode_png(data: bytes) -> np.ndarray:
    """Decodes a PNG file of 8 bits a channel, red, green and blue, without interlace: those of Insula. Fails if it is another one."""
    if data[:8] != b"\x89PNG\r\n\x1a\n":
        raise Error("not a PNG file")
    width, height, depth, colour, _, _, interlace = struct.unpack_from(">IIBBBBB", data, 16)
    if (depth, colour, interlace) != (8, 2, 0):
        raise Error("a PNG file of another kind than Insula writes")
    packed, at = [], 8
    while at + 8 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        if kind == b"IDAT":
            packed.append(data[at + 8 : at + 8 + length])
        at += 12 + length
    rows = np.frombuffer(zlib.decompress(b"".join(packed)), np.uint8).reshape(height, 1 + 3 * width)
    return _unfiltered(rows[:, 1:].reshape(height, width, 3), rows[:, 0])


def _unfiltered(raw: np.ndarray, filters: np.ndarray) -> np.ndarray:
    """Undoes the filters of PNG (RFC 2083, section 6), each of which needs the pixels to the left, above, and above those.

    All pixels of a diagonal are done at once: in `skewed`, row y begins at step y.
    """
    height, width, channels = raw.shape
    y, x = np.ogrid[:height, :width]
    skewed = np.zeros((width + height - 1, height, channels), np.int16)
    skewed[y + x, y] = raw
    filters = filters[:, None]
    before = last = np.zeros((height + 1, channels), np.int16)
    for step, row in enumerate(skewed):
        low, high = max(0, step - width + 1), min(height, step + 1)
        left, above, corner = last[low + 1 : high + 1], last[low:high], before[low:high]
        sum_less_corner = left + above - corner
        to_left, to_above, to_corner = (np.abs(sum_less_corner - v) for v in (left, above, corner))
        nearest = np.where(to_above <= to_corner, above, corner)
        nearest = np.where((to_left <= to_above) & (to_left <= to_corner), left, nearest)
        guesses = (np.zeros_like(left), left, above, (left + above) >> 1, nearest)
        row[low:high] = (row[low:high] + np.choose(filters[low:high], guesses)) & 255
        before, last = last, np.zeros_like(last)
        last[low + 1 : high + 1] = row[low:high]
    return skewed[y + x, y].astype(np.uint8)
