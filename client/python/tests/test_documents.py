"""The fences of Python in docs/python.md run, one after the other. Those that need what is absent are left out."""

import os
import re
import tempfile
import unittest
import warnings
from contextlib import redirect_stdout
from importlib.util import find_spec
from io import StringIO
from pathlib import Path

from test_programs import has_programs

ROOT = Path(__file__).resolve().parents[3]


@unittest.skipUnless(has_programs(), "the programs are absent")
class Documents(unittest.TestCase):
    def test_the_guide_runs(self):
        text = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
        fences = re.findall(r"^```python(?: needs ([^\n]+))?\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
        self.assertGreater(len(fences), 5)
        names: dict = {}
        before = Path.cwd()
        self.addCleanup(os.chdir, before)
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(), redirect_stdout(StringIO()):
            warnings.simplefilter("ignore")
            os.symlink(ROOT / "client", Path(folder) / "client")
            os.chdir(folder)
            for needs, code in fences:
                if needs and (needs == "a notebook" or find_spec(needs) is None):
                    continue
                with self.subTest(code):
                    exec(compile(code, "docs/python.md", "exec"), names)
            os.chdir(before)


if __name__ == "__main__":
    unittest.main()
