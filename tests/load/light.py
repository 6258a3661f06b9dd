#!/usr/bin/env python3
"""Compares the viewer's light with path-traced references: light.py REFERENCES CITIES [--program INSULA] [--out DIR]

REFERENCES has `cameras/CAMERA.json`, `pictures/CAMERA_HOUR.*` and `compare.py`; CITIES has a baked city CITY for each camera
CITY_VIEW, in the references' colours. Draws all views in the look `physical` on the CPU and prints stops and hue distances (mean
and worst) of `compare.py`, and the shares of dark and bright pixels. Views of cities that are not there are left out, and named.
Needs numpy and Pillow.
"""
import argparse, importlib.util, json, pathlib, subprocess, sys
import numpy as np
from PIL import Image

MEASURES = ["ground_sun_shade_stops", "wall_sun_shade_stops", "shade_wall_ground_stops", "city_rms_stops", "sky_city_stops",
            "shade_wall_hue_distance", "sky_hue_distance"]
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
# Linear colour of the plane and of generated ground: pictures of colours show a backdrop there.
PLANE = (0.515, 0.521, 0.491)


def snapshot(args, city, camera, *options):
    subprocess.run([args.program, "snapshot", "--no-caption", "--adapter", "cpu", "--server", args.cities / city, "--size", "640x360",
                    "--camera", args.references / "cameras" / f"{camera}.json", "--look", "physical", *options], check=True, stdout=subprocess.DEVNULL)


def luma(path):
    return np.asarray(Image.open(path).convert("RGB")) @ LUMINANCE


def main():
    ap = argparse.ArgumentParser(description=__doc__)
    ap.add_argument("references", type=pathlib.Path)
    ap.add_argument("cities", type=pathlib.Path)
    ap.add_argument("--program", default="target/release/insula")
    ap.add_argument("--out", type=pathlib.Path, default=pathlib.Path("target/light"))
    args = ap.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    spec = importlib.util.spec_from_file_location("compare", args.references / "compare.py")
    reference = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(reference)
    reference.PLANE = PLANE
    rows = {}
    for settings in sorted((args.references / "pictures").glob("*_*.json")):
        name = settings.stem
        camera, city = name.rsplit("_", 1)[0], name.split("_")[0]
        if not (args.cities / city).is_dir():
            print(f"{name}: no city {args.cities / city}", file=sys.stderr)
            continue
        sun = ",".join(str(v) for v in json.loads(settings.read_text())["sun"])
        lit, light, albedo = (args.out / f for f in (f"{name}.png", f"{name}.pfm", f"{camera}.albedo.png"))
        snapshot(args, city, camera, "--sun=" + sun, "--out", lit, "--radiance", light)
        if not albedo.exists():
            snapshot(args, city, camera, "--shading", "albedo", "--out", albedo)
        row = reference.compare(str(settings.with_suffix("")), str(light), str(albedo))
        shown = [luma(settings.with_suffix(".png")), luma(lit)]
        row["more_dark"], row["more_bright"] = (
            100 * (float(test(shown[1]).mean()) - float(test(shown[0]).mean()))
            for test in (lambda v: v < 20, lambda v: v > 250))
        rows[name] = row
        print(f"{name:22}", *(f"{row[m]:6.2f}" if m in row else "     -" for m in MEASURES))
    for measure in MEASURES + ["more_dark", "more_bright"]:
        values = [row[measure] if measure.startswith("more") else abs(row[measure]) for row in rows.values() if measure in row]
        print(f"{measure:26} mean {np.mean(values):.2f}, worst {max(values):.2f}, {len(values)} views")


if __name__ == "__main__":
    main()
