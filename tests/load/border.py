#!/usr/bin/env python3
"""Looks at cities from 36 places on their border: border.py CITY... [--program INSULA] [--eye METRES]

Each place is on the rectangle around everything that a city contains, an eye's height above the surrounding plane, and looks
level at the middle. Prints the pixels below the horizon that show sky, which must be none, and the distance of the nearest
thing there, which tells whether a camera stands in the ground. Needs numpy and Pillow.
"""
import argparse, json, math, pathlib, subprocess, tempfile
import numpy as np
from PIL import Image


def read_pfm(path):
    with open(path, "rb") as file:
        assert file.readline().strip() == b"Pf"
        width, height = map(int, file.readline().split())
        scale = float(file.readline())
        rows = np.frombuffer(file.read(), "<f4" if scale < 0 else ">f4").reshape(height, width)
    return rows[::-1]


def main():
    ap = argparse.ArgumentParser(description=__doc__)
    ap.add_argument("cities", type=pathlib.Path, nargs="+")
    ap.add_argument("--program", default="target/release/insula")
    ap.add_argument("--eye", type=float, default=2.0)
    ap.add_argument("--places", type=int, default=36)
    args = ap.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        for city in args.cities:
            manifest = json.loads((city / "city.json").read_text())
            (x0, y0, _), (x1, y1, _) = manifest["bounds"]
            z = manifest["ground_z_m"] + args.eye
            middle = [(x0 + x1) / 2, (y0 + y1) / 2, z]
            sky, nearest = 0, math.inf
            for place in range(args.places):
                angle = 2 * math.pi * place / args.places
                dx, dy = math.cos(angle), math.sin(angle)
                reach = min((x1 - x0) / 2 / max(abs(dx), 1e-9), (y1 - y0) / 2 / max(abs(dy), 1e-9))
                camera = {"position": [middle[0] + dx * reach, middle[1] + dy * reach, z], "target": middle}
                (folder / "camera.json").write_text(json.dumps(camera))
                subprocess.run([args.program, "snapshot", "--no-caption", "--server", city, "--camera", folder / "camera.json", "--size",
                                "320x180", "--shading", "albedo", "--out", folder / "a.png", "--distance", folder / "a.pfm"],
                               check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
                below = slice(91, None)
                distances = read_pfm(folder / "a.pfm")[below]
                colours = np.asarray(Image.open(folder / "a.png").convert("RGB")).astype(int)[below]
                # Neither the plane nor the sky has a distance. The plane is grey.
                sky += int((np.isinf(distances) & (colours[..., 2] > colours[..., 0] + 10)).sum())
                nearest = min(nearest, float(distances.min()))
            print(f"{city}: {sky} pixels of sky below the horizon from {args.places} places, nearest thing {nearest:.1f} m")


if __name__ == "__main__":
    main()
