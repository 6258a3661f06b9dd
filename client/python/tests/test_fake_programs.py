"""How programs are run, with others in their place."""

import os
import sys
import tempfile
import unittest
import warnings
from pathlib import Path
from unittest import mock

import insula

BAKES = """
import os, sys
out = next(word[6:] for word in sys.argv if word.startswith("--out="))
print("baking: read after 10 s", file=sys.stderr)
print("baking: sample 40% after 20 s, 11 min left", file=sys.stderr)
print("warning: heights look like centimetres", file=sys.stderr)
os.makedirs(out, exist_ok=True)
open(os.path.join(out, "city.json"), "w").write('{"name": "a", "title": "A"}')
print("{}")
"""
WAITS = """
import signal, sys
def leave(*_):
    print("interrupted in stage sample at 40%: continue with: insula-server bake --resume", file=sys.stderr, flush=True)
    sys.exit(1)
signal.signal(signal.SIGINT, leave)
print("baking: sample 40% after 20 s, 11 min left", file=sys.stderr, flush=True)
while True:
    signal.pause()
"""
FAILS = """
import sys
print("note: something\\nerror: a.gml: not a city", file=sys.stderr)
sys.exit(2)
"""


@unittest.skipUnless(os.name == "posix", "programs of one line are scripts")
class Runs(unittest.TestCase):
    def program(self, source: str) -> None:
        """Puts a script in the place of the server."""
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        path = self.folder / "insula-server"
        path.write_text(f"#!{sys.executable}\n{source}")
        path.chmod(0o755)
        patch = mock.patch.dict(os.environ, {"INSULA_PROGRAMS_DIR": str(self.folder)})
        patch.start()
        self.addCleanup(patch.stop)

    def test_a_bake_says_how_far_it_is(self):
        self.program(BAKES)
        seen = []
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            city = insula.bake("a.gml", self.folder / "city", progress=seen.append)
        self.assertEqual(
            seen,
            [
                insula.Progress("read", None, 10, None),
                insula.Progress("sample", 40, 20, "11 min"),
                insula.Progress("done", 100, 20, None),
            ],
        )
        self.assertEqual([str(warning.message) for warning in warned], ["heights look like centimetres"])
        self.assertEqual((city.title, city.folder), ("A", self.folder / "city"))

    def test_ctrl_c_lets_the_bake_end(self):
        self.program(WAITS)

        def interrupt(_):
            raise KeyboardInterrupt

        with self.assertRaises(KeyboardInterrupt) as caught:
            insula.bake("a.gml", self.folder / "city", progress=interrupt)
        if sys.version_info >= (3, 11):
            self.assertIn("--resume", caught.exception.__notes__[0])

    def test_a_failure_has_the_reason_of_the_program(self):
        self.program(FAILS)
        with self.assertRaises(insula.Error) as caught:
            insula.bake("a.gml", self.folder / "city")
        self.assertEqual((str(caught.exception), caught.exception.status), ("a.gml: not a city", 2))
        self.assertIn("note: something", caught.exception.stderr)
        with self.assertRaisesRegex(insula.Error, "a.gml: not a city"):
            insula.serve(self.folder)
        with self.assertRaisesRegex(insula.Error, "insula is not in"):
            insula.run("insula", "snapshot")


if __name__ == "__main__":
    unittest.main()
