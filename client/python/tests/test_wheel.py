"""The wheel, with files in the place of the programs."""

import base64
import hashlib
import os
import sys
import tempfile
import unittest
import zipfile
from pathlib import Path
from unittest import mock

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "build_backend"))
try:
    import insula_build
except ImportError:
    insula_build = None
finally:
    sys.path.pop(0)


@unittest.skipUnless(insula_build, "tomli is not installed")
class Wheel(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        for name in ("insula", "insula-server"):
            (self.folder / (name + insula_build.SUFFIX)).write_bytes(b"\x7fELF GLIBC_2.4\0GLIBC_2.34\0GLIBC_2.17")
        patch = mock.patch.dict(os.environ, {"INSULA_PROGRAMS_DIR": str(self.folder)})
        patch.start()
        self.addCleanup(patch.stop)

    def test_it_has_the_package_and_the_programs(self):
        name = insula_build.build_wheel(self.folder)
        content = (self.folder / name).read_bytes()
        with zipfile.ZipFile(self.folder / name) as wheel:
            files = {entry.filename: entry for entry in wheel.infolist()}
            texts = {name: wheel.read(name) for name in files}
        self.assertTrue({"insula/__init__.py", "insula/map.js", "insula/py.typed"} <= set(files))
        scripts = [entry for entry in files if ".data/scripts/insula" in entry]
        self.assertEqual([files[entry].external_attr >> 16 & 0o777 for entry in scripts], [0o755, 0o755])
        record = next(texts[entry].decode() for entry in files if entry.endswith("RECORD")).splitlines()
        self.assertEqual([line.split(",")[0] for line in record], list(files))
        for line in record[:-1]:
            path, digest, size = line.split(",")
            found = base64.urlsafe_b64encode(hashlib.sha256(texts[path]).digest()).rstrip(b"=").decode()
            self.assertEqual((digest, int(size)), (f"sha256={found}", len(texts[path])))
        metadata = next(texts[entry].decode() for entry in files if entry.endswith("METADATA"))
        self.assertIn("Requires-Dist: numpy", metadata)
        self.assertIn("Requires-Dist: anywidget>=0.9; extra == 'widget'", metadata)
        insula_build.build_wheel(self.folder)
        self.assertEqual((self.folder / name).read_bytes(), content, "the same files give another wheel")

    @unittest.skipUnless(sys.platform == "linux", "other systems have no glibc")
    def test_its_name_says_what_the_programs_need(self):
        self.assertRegex(insula_build.build_wheel(self.folder), r"-py3-none-manylinux_2_34_\w+\.whl$")

    def test_a_missing_program_is_named(self):
        (self.folder / ("insula" + insula_build.SUFFIX)).unlink()
        with self.assertRaisesRegex(FileNotFoundError, "insula"):
            insula_build.build_wheel(self.folder)


if __name__ == "__main__":
    unittest.main()
