"""The run of a program, by one that is made up; and of insula-server itself, if INSULA_SERVER names it."""

import os
import pathlib
import sys
import tempfile
import unittest
from unittest import mock

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))

from insula import answers, commands, program  # noqa: E402

TOWN = """{"type":"FeatureCollection","features":[
{"type":"Feature","id":"a","properties":{"height":9,"name":"Hall"},"geometry":{"type":"Polygon",
"coordinates":[[[4.36,52.01],[4.3602,52.01],[4.3602,52.0101],[4.36,52.0101],[4.36,52.01]]]}}]}"""


def made_up(text):
    return [sys.executable, "-B", "-c", text]


class MadeUp(unittest.TestCase):
    def test_answers_and_lines_arrive(self):
        lines = []
        text = "import sys; print('note: one', file=sys.stderr); print('{\"out\": \"\\u00e9\"}'); print('warning: two', file=sys.stderr)"
        self.assertEqual(program.run(made_up(text), lines.append), [{"out": "\u00e9"}])
        self.assertEqual(lines, ["note: one", "warning: two"])

    def test_a_failure_has_the_words_of_the_program(self):
        text = "import sys; print('note: hm', file=sys.stderr); print('error: bake: a.gml is damaged', file=sys.stderr); sys.exit(1)"
        with self.assertRaises(program.ProgramError) as failed:
            program.run(made_up(text))
        self.assertEqual(str(failed.exception), "bake: a.gml is damaged")
        with self.assertRaises(program.ProgramError) as failed:
            program.run(made_up("raise SystemExit(3)"))
        self.assertIn("code 3", str(failed.exception))
        with self.assertRaises(program.ProgramError):
            program.run(made_up("print('served')"))
        with self.assertRaises(program.ProgramError):
            program.run([os.path.join(os.path.dirname(__file__), "none")])

    def test_a_program_that_is_stopped_ends(self):
        text = "import sys, threading; print('baking: sample 1% after 1 s', file=sys.stderr, flush=True); threading.Event().wait()"
        seen = []
        with self.assertRaises(program.Cancelled):
            program.run(made_up(text), seen.append, lambda: bool(seen))
        self.assertEqual(len(seen), 1)

    def test_much_text_stops_nothing(self):
        text = "import sys; sys.stderr.write('x' * 300000 + '\\n'); print('{\"out\": \"' + 'y' * 300000 + '\"}')"
        (answer,) = program.run(made_up(text))
        self.assertEqual(len(answer["out"]), 300000)

    def test_the_program_is_that_of_the_setting_or_the_variable(self):
        with mock.patch.dict(os.environ, {program.VARIABLE: sys.executable}):
            self.assertEqual(program.find(), sys.executable)
            self.assertEqual(program.find(__file__), __file__)
            with self.assertRaises(program.ProgramError):
                program.find(__file__ + ".none")
        with mock.patch.dict(os.environ, {program.VARIABLE: "", "PATH": ""}):
            with self.assertRaises(program.ProgramError):
                program.find()


@unittest.skipUnless(os.environ.get(program.VARIABLE), "INSULA_SERVER does not name the program")
class OfInsula(unittest.TestCase):
    """Each command line is one that the program takes, and its answer has what the plugin reads."""

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        (cls.folder / "town.geojson").write_text(TOWN)
        cls.city = cls.path("city")
        cls.report = cls.run_one(commands.bake([cls.path("town.geojson")], cls.city, cell_m=4, title="Town"))

    @classmethod
    def path(cls, name):
        return str(cls.folder / name)

    @classmethod
    def run_one(cls, words):
        (answer,) = program.run([program.find(), *words])
        return answer

    def test_a_bake_reports_its_city(self):
        self.assertEqual((self.report["name"], self.report["buildings"]), ("city", 1))
        self.assertIn("1 building", self.report["size"])

    def test_analyses_have_units_and_ranges(self):
        table = self.path("sun.fgb")
        for name, words in {
            "hours": commands.sun(self.city, self.path("sun.tif"), buildings=table),
            "sky": commands.sky(self.city, self.path("sky.tif")),
            "kwh_m2": commands.solar(self.city, self.path("solar.tif")),
        }.items():
            answer = self.run_one(words)
            self.assertEqual(answer["unit"], name)
            low, high = answers.value_range(answer)
            self.assertLessEqual(low, high)
            self.assertTrue(answers.sentences(answer))
        self.assertTrue(os.path.getsize(table) > 0)

    def test_shadows_and_views_have_no_table(self):
        shadow = commands.shadow(self.city, self.path("shadow.tif"), time="2025-12-21T10:00", time_zone="Europe/Amsterdam")
        view = commands.view(self.city, self.path("view.tif"), eye=(4.3601, 52.01005))
        for words in (shadow, view):
            answer = self.run_one(words)
            low, high = answers.value_range(answer)
            self.assertTrue(0 <= low <= high <= 1 and answer["title"])

    def test_exports_write_layers(self):
        for form, name in (("flatgeobuf", "o.fgb"), ("geotiff", "h.tif"), ("glb", "m.glb")):
            answer = self.run_one(commands.export(self.city, self.path(name), form))
            self.assertEqual(answer["out"], self.path(name))
            self.assertGreater(os.path.getsize(self.path(name)), 0)
        filtered = commands.export(self.city, self.path("f.geojson"), "geojson", where="height > 5")
        self.assertEqual(self.run_one(filtered)["objects"], 1)
        self.run_one(commands.export(self.city, self.path("p.geojson"), "geojson", parts=True))

    def test_rules_are_those_of_the_program(self):
        with self.assertRaises(program.ProgramError) as failed:
            self.run_one(commands.sun(self.city, self.path("rule.tif"), rule="none"))
        self.assertIn("built in are " + ", ".join(sorted(commands.RULES)), str(failed.exception))

    def test_a_mistake_is_told(self):
        with self.assertRaises(program.ProgramError) as failed:
            self.run_one(commands.export(self.city, self.path("x.fgb"), "flatgeobuf", where="height >"))
        self.assertIn("--filter", str(failed.exception))


if __name__ == "__main__":
    unittest.main()
