"""Files, options and colours, without the programs."""

import struct
import tempfile
import unittest
import zlib
from pathlib import Path

import numpy as np

import insula
from insula._picture import decode_png
from insula._programs import arguments

FILTERS = 5


def filtered(rows: np.ndarray) -> bytes:
    """Rows of a picture with all filters of PNG in turn, pixel by pixel (RFC 2083, section 6)."""
    height, width, channels = rows.shape
    at = lambda y, x: rows[y, x].astype(int) if y >= 0 and x >= 0 else np.zeros(channels, int)
    out = b""
    for y in range(height):
        kind = y % FILTERS
        out += bytes([kind])
        for x in range(width):
            left, above, corner = at(y, x - 1), at(y - 1, x), at(y - 1, x - 1)
            paeth = [min((l, a, c), key=lambda v: abs(l + a - c - v)) for l, a, c in zip(left, above, corner)]
            guess = (0, left, above, (left + above) // 2, np.array(paeth))[kind]
            out += ((at(y, x) - guess) % 256).astype(np.uint8).tobytes()
    return out


def png(rows: np.ndarray) -> bytes:
    height, width, _ = rows.shape
    chunk = lambda kind, body: struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(filtered(rows))) + chunk(b"IEND", b"")


class Files(unittest.TestCase):
    def test_pictures_are_decoded_with_all_filters(self):
        random = np.random.default_rng(1)
        for size in [(1, 1), (1, 9), (9, 1), (12, 7), (7, 12)]:
            rows = random.integers(0, 256, (*size, 3), dtype=np.uint8)
            np.testing.assert_array_equal(decode_png(png(rows)), rows)

    def test_other_pictures_are_refused(self):
        good = png(np.zeros((2, 2, 3), np.uint8))
        with self.assertRaises(insula.Error):
            decode_png(b"GIF89a" + good)
        with self.assertRaisesRegex(insula.Error, "another kind"):
            decode_png(good[:24] + b"\x10" + good[25:])

    def test_a_picture_is_an_array_that_notebooks_show(self):
        rows = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3)
        picture = insula.Picture(png(rows))
        self.assertEqual((picture.shape, picture.dtype), ((2, 3, 3), np.uint8))
        self.assertEqual(picture._repr_png_(), png(rows))
        self.assertIsNone(picture[:1]._repr_png_(), "a part is another picture")
        self.assertIsNone(picture.distance)

    def test_other_rasters_are_refused(self):
        for content in [b"", b"II", b"II*\0" + b"\xff" * 4, b"MM\0*" + bytes(40), b"II*\0\x08\0\0\0\x01\0" + bytes(16)]:
            with tempfile.TemporaryDirectory() as folder, self.subTest(content):
                path = Path(folder) / "a.tif"
                path.write_bytes(content)
                with self.assertRaises(insula.Error):
                    insula.Raster.read(path)


class Options(unittest.TestCase):
    def test_keywords_are_options(self):
        options = {"cell": 3, "no_meshes": True, "update": False, "crs": None, "bbox": (7.4, -43.5, np.float64(8), 9)}
        expected = ["--cell=3", "--no-meshes", "--bbox=7.4,-43.5,8.0,9"]
        self.assertEqual(arguments(options), expected)
        self.assertEqual(arguments({"drop": ["a*", "b"]}), ["--drop=a*", "--drop=b"])
        self.assertEqual(arguments({"from": (1, 2, 3), "report": Path("a.json")}), ["--from=1,2,3", "--report=a.json"])
        self.assertEqual(arguments({"limit": np.int64(5), "title": "-x"}), ["--limit=5", "--title=-x"])


class Colors(unittest.TestCase):
    def test_numbers_have_a_ramp(self):
        rows = [{"object": 1, "rent": 0}, {"object": 2, "rent": 5.0}, {"object": 3, "rent": None}, {"object": 4, "rent": 10}]
        self.assertEqual(insula.colors(rows, "rent"), {1: "#440154", 2: "#21918c", 4: "#fde725"})
        self.assertEqual(insula.colors(rows, "rent", range=(-10, 0))[2], "#fde725")
        self.assertEqual(insula.colors(rows[:1], "rent"), {1: "#440154"})
        self.assertEqual(insula.colors([], "rent"), {})

    def test_texts_are_classes_or_colours(self):
        rows = [{"object": 1, "use": "shop"}, {"object": 2, "use": "home"}, {"object": 3, "use": "shop"}]
        found = insula.colors(rows, "use")
        self.assertEqual(found[1], found[3])
        self.assertNotEqual(found[1], found[2])
        self.assertEqual(insula.colors([{"id": 7, "c": "#ff0000"}], "c", id="id"), {7: "#ff0000"})


if __name__ == "__main__":
    unittest.main()
