"""Command lines from parameters."""

import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))

from insula import commands  # noqa: E402


class Bake(unittest.TestCase):
    def test_all_parameters_are_on_the_command_line(self):
        words = commands.bake(
            ["-a.gml", "b c.city.json"],
            "/x/city",
            crs="EPSG:25832",
            bbox=(-7.418, 43.73, 7.424, 43.734),
            cell_m=0.5,
            title=" Old town ",
            height_field="H",
            mode="update",
            more="--quality 40 --drop 'owner name'",
        )
        options = ["--out=/x/city", "--cell=0.5", "--crs=EPSG:25832", "--bbox=-7.418,43.73,7.424,43.734"]
        options += ["--title=Old town", "--height-field=H", "--update", "--quality", "40", "--drop", "owner name"]
        self.assertEqual(words, ["bake", "--json", *options, "--", "-a.gml", "b c.city.json"])

    def test_what_is_empty_is_left_out(self):
        self.assertEqual(commands.bake(["a"], "c"), ["bake", "--json", "--out=c", "--cell=1", "--", "a"])

    def test_numbers_have_no_exponent(self):
        self.assertIn("--cell=0.00001", commands.bake(["a"], "c", cell_m=1e-5))
        self.assertIn("--bbox=-0.00001,0,0.00001,1", commands.bake(["a"], "c", bbox=(-1e-5, -0.0, 1e-5, 1.0)))

    def test_mistakes_are_named(self):
        for wrong in (
            lambda: commands.bake([], "c"),
            lambda: commands.bake(["a"], "c", bbox=(1, 1, 1, 2)),
            lambda: commands.bake(["a"], "c", mode="anew"),
            lambda: commands.bake(["a"], "c", more="--title 'open"),
        ):
            with self.assertRaises(commands.UsageError):
                wrong()


class OfACity(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.city = self.folder.name
        (pathlib.Path(self.city) / "city.json").write_text("{}")

    def test_each_analysis_has_its_options(self):
        start = ["analyse", self.city]
        sun = commands.sun(self.city, "s.tif", rule="uk-br209-apsh", buildings="b.fgb", proposal="p.toml", more="--reach 500")
        options = ["--rule=uk-br209-apsh", "--buildings=b.fgb", "--proposal=p.toml", "--reach", "500"]
        self.assertEqual(sun, [*start, "sun", "--json", "--out=s.tif", *options])
        self.assertEqual(commands.sky(self.city, "s.tif"), [*start, "sky", "--json", "--out=s.tif"])
        solar = commands.solar(self.city, "s.tif", bbox=(1, 2, 3, 4))
        self.assertEqual(solar, [*start, "solar", "--json", "--out=s.tif", "--bbox=1,2,3,4", "--turbidity=3"])
        clouds = commands.solar(self.city, "s.tif", weather="delft.epw")
        self.assertEqual(clouds, [*start, "solar", "--json", "--out=s.tif", "--weather=delft.epw"])
        shadow = commands.shadow(self.city, "s.tif", time="2025-12-21T10:00", time_zone="Europe/Paris")
        self.assertEqual(shadow[4:], ["--out=s.tif", "--time=2025-12-21T10:00", "--time-zone=Europe/Paris"])
        view = commands.view(self.city, "s.tif", eye=(-7.42, 43.73), eye_height_m=2, target_height_m=1.6)
        self.assertEqual(view[4:], ["--out=s.tif", "--from=-7.42,43.73,2", "--target-height=1.6"])

    def test_exports_have_a_format(self):
        words = commands.export(self.city, "o.fgb", "flatgeobuf", where="height > 20", parts=True)
        options = ["--format=flatgeobuf", "--out=o.fgb", "--filter=height > 20", "--parts"]
        self.assertEqual(words, ["export", self.city, "--json", *options])
        words = commands.export(self.city, "tiles", "3dtiles", plain=True)
        self.assertEqual(words[3:], ["--format=3dtiles", "--out=tiles", "--plain"])

    def test_mistakes_are_named(self):
        for wrong in (
            lambda: commands.sky(self.city + "/none", "s.tif"),
            lambda: commands.shadow(self.city, "s.tif", time=""),
            lambda: commands.view(self.city, "s.tif", eye=None),
        ):
            with self.assertRaises(commands.UsageError):
                wrong()


if __name__ == "__main__":
    unittest.main()
