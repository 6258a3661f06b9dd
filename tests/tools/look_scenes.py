#!/usr/bin/env python3
"""Draws the scenes of a set of target pictures with `insula snapshot`, and measures the pictures.

look_scenes.py LOOK CITIES OUT [SCENE...] [--program insula] [--size 1280x720]

LOOK has `scenes.json`, `look.py` and `check.py`: cameras, how labels are made of buffers, and the measures. CITIES has a baked
city for each name in `scenes.json`; scenes without one are named and left out. The picture that is measured is the program's own.
Its labels (sky, ground, walls and roofs in sun and shade, water) come from buffers in the look `physical`. Prints a line of JSON a
scene, and writes the pictures, labels and buffers to OUT.

Needs: numpy, scipy, pillow
"""
import argparse, json, os, pathlib, subprocess, sys


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("look", type=pathlib.Path)
    parser.add_argument("cities", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("scenes", nargs="*")
    parser.add_argument("--program", default="insula")
    parser.add_argument("--size", default="1280x720")
    return parser.parse_args()


def draw(args, name, scene):
    """Draws the picture of a scene, and the buffers of its labels."""
    buffers = pathlib.Path("buf") / name
    buffers.mkdir(parents=True, exist_ok=True)
    camera = buffers / "camera.json"
    camera.write_text(json.dumps(scene["camera"]))
    sun = ",".join(f"{angle:g}" for angle in scene["sun"])
    common = [args.program, "--adapter", "cpu", "snapshot", "--server", scene["city"], "--camera", camera, "--sun", sun]

    def snapshot(*more):
        subprocess.run([*common, "--no-caption", "--size", args.size, *more], check=True, stderr=subprocess.DEVNULL)

    snapshot("--out", f"{name}.png")
    physical = ["--look", "physical", "--visibility", "1000"]
    objects = ["--objects", buffers / "o.png", "--objects-json", buffers / "o.json"]
    snapshot(*physical, "--radiance", buffers / "on.pfm", "--distance", buffers / "d.pfm", *objects, "--out", buffers / "lit.png")
    snapshot(*physical, "--shadows", "off", "--radiance", buffers / "off.pfm", "--out", buffers / "off.png")
    for shading in ("albedo", "ao", "normal"):
        snapshot("--look", "physical", "--shading", shading, "--out", buffers / f"{shading}.png")


def main():
    args = arguments()
    sys.path.insert(0, str(args.look.resolve()))
    import check, look
    from PIL import Image

    scenes = json.loads((args.look / "scenes.json").read_text())
    unknown = [name for name in args.scenes if name not in scenes]
    if unknown:
        sys.exit(f"no scene {', '.join(unknown)}; there are {', '.join(scenes)}")
    cities = args.cities.resolve()
    args.out.mkdir(parents=True, exist_ok=True)
    os.chdir(args.out)
    # Buffers have the size of the picture: `load` does not halve them.
    load = look.load
    look.load = lambda name, scene, fast: load(name, scene, 0)
    for name in args.scenes or scenes:
        # The sea is in the city, and not in a raster beside it.
        scene = {key: value for key, value in scenes[name].items() if key != "sea"}
        scene["city"] = str(cities / pathlib.Path(scene["city"]).name)
        if not pathlib.Path(scene["city"]).is_dir():
            print(f"{name}: no city {scene['city']}", file=sys.stderr)
            continue
        draw(args, name, scene)
        target, labels = look.make(name, scene, dict(look.P, fast=1))
        Image.fromarray(target).save(f"{name}.target.png")
        Image.fromarray(labels).save(f"{name}.labels.png")
        print(json.dumps({"scene": name, **check.measure(Image.open(f"{name}.png"), labels)}), flush=True)


if __name__ == "__main__":
    main()
