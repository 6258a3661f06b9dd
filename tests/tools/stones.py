#!/usr/bin/env python3
"""Draws a monument in each stone, lit from the front and from behind.

    tests/tools/stones.py CITY --insula target/release/insula --camera CAM.json --out stones.jpg
                          [--occlusion] [--translucency]

CITY has one landmark of stone; its manifest is copied with other stones, so that nothing is baked again. Needs Pillow.
"""
import argparse
import itertools
import json
import math
import pathlib
import shutil
import subprocess
import tempfile

from PIL import Image, ImageDraw

STONES = ["carrara-marble", "green-marble", "red-marble", "black-marble", "red-granite", "grey-granite", "bronze", "limestone", "wood"]
# Factors of the lengths that light goes in marble; 0 is opaque.
SCALES = [0, 8, 30]
# Azimuth from the camera, and height, in degrees.
SUNS = {"front": (-35, 40), "behind": (150, 30)}
SIZE = 360, 420


def snapshot(insula, city, camera, out, *options):
    command = [insula, "snapshot", "--server", city, "--camera", camera, "--size", f"{SIZE[0]}x{SIZE[1]}", "--out", out]
    subprocess.run([*map(str, command), "--adapter", "cpu", *options], check=True, stdout=subprocess.DEVNULL)
    return Image.open(out).convert("RGB")


def heading(camera):
    """Azimuth in degrees of the direction from the target to the camera."""
    view = json.loads(pathlib.Path(camera).read_text())
    east, north = (view["position"][k] - view["target"][k] for k in (0, 1))
    return math.degrees(math.atan2(east, north)) % 360


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("city", type=pathlib.Path)
    parser.add_argument("--insula", default="target/release/insula")
    parser.add_argument("--camera", required=True)
    parser.add_argument("--out", required=True)
    parser.add_argument("--occlusion", action="store_true", help="each also without ambient occlusion")
    parser.add_argument("--translucency", action="store_true", help="marble of several translucencies instead of all stones")
    args = parser.parse_args()
    stones = [(name, {"preset": name}) for name in STONES]
    if args.translucency:
        stones = [(f"marble x {scale}", {"preset": STONES[0], "scattering_scale": scale}) for scale in SCALES]
    towards = heading(args.camera)
    switches = ["on", "off"] if args.occlusion else ["on"]
    rows = list(itertools.product(SUNS.items(), switches))
    sheet = Image.new("RGB", (SIZE[0] * len(stones), SIZE[1] * len(rows)))
    draw = ImageDraw.Draw(sheet)
    with tempfile.TemporaryDirectory() as folder:
        city = shutil.copytree(args.city, pathlib.Path(folder) / "city")
        manifest = json.loads((city / "city.json").read_text())
        for column, (label, stone) in enumerate(stones):
            manifest["stones"] = [json.dumps(stone)]
            (city / "city.json").write_text(json.dumps(manifest, indent=2) + "\n")
            for row, ((name, (azimuth, altitude)), occlusion) in enumerate(rows):
                light = ["--sun", f"{(towards + azimuth) % 360:.0f},{altitude}", "--occlusion", occlusion]
                picture = snapshot(args.insula, city, args.camera, pathlib.Path(folder) / "a.png", *light)
                place = SIZE[0] * column, SIZE[1] * row
                sheet.paste(picture, place)
                text = f"{label}, sun: {name}" + (", no occlusion" if occlusion == "off" else "")
                draw.text((place[0] + 8, place[1] + 6), text, fill="white")
    sheet.save(args.out, quality=88)


if __name__ == "__main__":
    main()
