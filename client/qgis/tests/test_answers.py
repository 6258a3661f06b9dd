"""What the program says, and the colours of it."""

import json
import pathlib
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))

from insula import answers, colours  # noqa: E402

ANSWER = {
    "out": "sun.tif",
    "unit": "hours",
    "title": "hours of sun",
    "notes": ["1.5 hours are asked for"],
    "roofs": {"count": 4, "least": 0.5, "mean": 5.25, "most": 9.0, "share_reaching": 0.75},
    "walls": {"count": 9, "least": 0.0, "mean": 3.0, "most": 12.0, "share_reaching": None},
    "ground": {"count": 9, "least": 0.0, "mean": 3.0, "most": 8.5, "share_reaching": None},
    "attribution": "Office of Maps (CC BY 4.0)",
}


class Answers(unittest.TestCase):
    def test_progress_of_stages_with_and_without_a_known_length(self):
        found = [
            (one.stage, one.percent, one.text)
            for one in map(
                answers.progress,
                [
                    "baking: sample 10% after 70 s, 11 min left",
                    "baking: ground after 2001 s",
                    "analysing: 12% after 70 s",
                ],
            )
        ]
        expected = [("sample", 10, "sample, 70 s, 11 min left"), ("ground", None, "ground, 2001 s"), ("", 12, "computing, 70 s")]
        self.assertEqual(found, expected)
        for other in ("warning: baking: bread", "note: 3 s", ""):
            self.assertIsNone(answers.progress(other))

    def test_lines_have_a_level(self):
        self.assertEqual(answers.level("error: bake: no such file"), ("error", "bake: no such file"))
        self.assertEqual(answers.level("warning: heights are guessed"), ("warning", "heights are guessed"))
        self.assertEqual(answers.level("something else: 1"), ("", "something else: 1"))

    def test_each_line_is_an_answer(self):
        text = json.dumps(ANSWER) + "\n\n" + json.dumps({"out": "b.tif"}) + "\n"
        self.assertEqual([answer["out"] for answer in answers.parse(text)], ["sun.tif", "b.tif"])
        for wrong in ("served", "[1]", "{"):
            with self.assertRaises(ValueError):
                answers.parse(wrong)

    def test_ranges_are_those_of_cells(self):
        self.assertEqual(answers.value_range(ANSWER), (0.0, 9.0))
        self.assertIsNone(answers.value_range({"roofs": None, "ground": {"least": None, "most": None}}))

    def test_answers_are_told_in_sentences(self):
        told = answers.sentences(ANSWER)
        self.assertIn("roofs: 5.25 on average, 0.5 to 9", told)
        self.assertIn("roofs: 75.0% reach what the rule asks for", told)
        self.assertIn("name the source wherever this is shown: Office of Maps (CC BY 4.0)", told)
        self.assertEqual(answers.sentences({"out": "a"}), [])
        self.assertEqual([answers.number(value) for value in (1628.4, -0.01234, 9.999, 0)], ["1628", "-0.0123", "10", "0"])


class Colours(unittest.TestCase):
    def test_stops_go_from_the_lowest_to_the_highest_value(self):
        stops = colours.stops("sun", (2.0, 12.0))
        self.assertEqual((stops[0][0], stops[-1][0], len(stops)), (2.0, 12.0, len(colours.EVEN)))
        self.assertEqual(sorted(stops), stops)
        # A city with one value has a ramp, too.
        self.assertLess(colours.stops("sky", (1.0, 1.0))[0][0], colours.stops("sky", (1.0, 1.0))[-1][0])

    def test_changes_are_white_where_nothing_changes(self):
        stops = colours.stops("sun", (-3.0, 1.0), is_change=True)
        self.assertEqual([stop[0] for stop in stops], [-3.0, -1.5, 0.0, 1.5, 3.0])
        self.assertEqual(stops[2][1], "#f7f7f7")
        self.assertEqual(len(colours.stops("shadow", (0.0, 0.0), is_change=True)), 5)

    def test_yes_and_no_have_words(self):
        self.assertEqual([stop[2] for stop in colours.stops("shadow", (0.0, 1.0))], ["sun", "shadow"])
        self.assertTrue(colours.is_discrete("view", False) and not colours.is_discrete("view", True))
        self.assertEqual((colours.unit("hours"), colours.unit("share")), ("h", ""))


if __name__ == "__main__":
    unittest.main()
