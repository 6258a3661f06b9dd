#!/usr/bin/env python3
"""Draws a city at four hours from the air, a roof and a street: contact_sheet.py CITY STREET OUT [-- OPTIONS]

CITY is a baked folder, STREET a camera file, OUT an image (JPEG, PNG). Rows are dawn, noon, evening and night; OPTIONS are
those of `insula snapshot`. With `--old PROGRAM CITY`, the same view by another build of another bake is on the left of each.
Needs Pillow.
"""
import argparse, json, pathlib, subprocess, sys, tempfile
from PIL import Image

HOURS = ["2024-09-18T06:05", "2024-09-18T12:00", "2024-09-18T17:30", "2024-09-18T22:00"]
SIZE = (288, 162)


def cameras(city, street):
    """The camera in the air looks at the whole focus, the one on a roof at its middle."""
    manifest = json.loads((city / "city.json").read_text())
    (x0, y0), (x1, y1) = manifest["focus"]
    x, y, z, side = (x0 + x1) / 2, (y0 + y1) / 2, manifest["ground_z_m"], min(x1 - x0, y1 - y0)
    return [
        {"position": [x - 0.1 * side, y - 0.55 * side, z + 0.3 * side], "target": [x, y, z]},
        {"position": [x - 90, y - 90, z + 45], "target": [x + 100, y + 100, z + 15]},
        json.loads(street.read_text()),
    ]


def main():
    ap = argparse.ArgumentParser(description=__doc__)
    ap.add_argument("city", type=pathlib.Path)
    ap.add_argument("street", type=pathlib.Path)
    ap.add_argument("out", type=pathlib.Path)
    ap.add_argument("--program", default="target/release/insula")
    ap.add_argument("--old", nargs=2, metavar=("PROGRAM", "CITY"))
    own = sys.argv[1 : sys.argv.index("--")] if "--" in sys.argv else sys.argv[1:]
    options = sys.argv[len(own) + 2 :]
    args = ap.parse_args(own)
    builds = ([(*args.old, [])] if args.old else []) + [(args.program, args.city, options)]
    columns = [(view, *build) for view in cameras(args.city, args.street) for build in builds]
    sheet = Image.new("RGB", (SIZE[0] * len(columns), SIZE[1] * len(HOURS)))
    with tempfile.TemporaryDirectory() as folder:
        camera, picture = (pathlib.Path(folder) / name for name in ("camera.json", "picture.png"))
        for row, hour in enumerate(HOURS):
            for column, (view, program, city, options) in enumerate(columns):
                camera.write_text(json.dumps(view))
                subprocess.run([program, "snapshot", "--no-caption", "--adapter", "cpu", "--server", city, "--camera", camera, "--time",
                                hour, "--size", "{}x{}".format(*SIZE), "--out", picture, *options],
                               check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
                sheet.paste(Image.open(picture).convert("RGB"), (SIZE[0] * column, SIZE[1] * row))
    sheet.save(args.out, quality=80)


if __name__ == "__main__":
    main()
