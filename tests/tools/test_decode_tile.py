"""Frozen tiles, decoded by the second decoder, have the values that protocol/tests/vectors.rs wrote. No test needs a program
of this repository: python3 -m unittest discover tests/tools
"""
import pathlib, unittest

from decode_tile import decode, texels_crc32
from tile_decoder.container import BadTile

VECTORS = pathlib.Path(__file__).parents[2] / "protocol/tests/vectors"
UP, EAST_SLOPE = 0x7F7F, 0x7FB5


def vector(name):
    return (VECTORS / f"v2_{name}.bin").read_bytes()


def texel(r, g, b, ao, alpha=3):
    return r | g << 8 | b << 16 | (ao << 2 | alpha) << 24


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

    def test_lossy_texels(self):
        values = decode(vector("lossy_blockmap"))
        self.assertEqual(texels_crc32(values), 275_298_839)
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

    def test_shortened_and_lengthened_tiles_are_refused(self):
        for name in ["blockmap", "lossy_blockmap", "subtree", "subtree_with_meshes", "plain_mesh_tile"]:
            data = vector(name)
            for wrong in [data[:length] for length in range(len(data))] + [data + b"\0"]:
                with self.assertRaises(BadTile):
                    decode(wrong)


if __name__ == "__main__":
    unittest.main()
