"""Compares a drawing with the ray-caster's object picture.

Draws a camera's view with the number of each object as its colour, rasterises it with Chromium, and compares each pixel with
`insula snapshot --objects`, except for those within a pixel of an edge in either picture. Needs numpy and pillow.

    python3 tests/tools/drawing_objects.py INSULA CITY CAM.json [--size 4000x2400] [--keep FOLDER]
"""

import argparse
import json
import pathlib
import shutil
import subprocess
import tempfile

import numpy
from PIL import Image

Image.MAX_IMAGE_PIXELS = None
NONE = 0xFFFFFF
STYLE = """fill = "object"
[lines]
silhouette = 0
crease = 0
border = 0
intersection = 0
"""


def rasterise(svg, png, width, height):
    """Writes a picture of an SVG file. Shapes have hard edges there."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    page = png.with_suffix(".html")
    style = f"width:{width}px;height:{height}px;display:block"
    page.write_text(f'<body style="margin:0"><img src="{svg.resolve().as_uri()}" style="{style}"></body>')
    subprocess.run(
        [browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--force-device-scale-factor=1",
         "--force-color-profile=srgb", f"--window-size={width},{height}", f"--screenshot={png}", page.resolve().as_uri()],
        check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    pixels = numpy.asarray(Image.open(png).convert("RGB")).astype(numpy.uint32)[:height, :width]
    return pixels[..., 0] << 16 | pixels[..., 1] << 8 | pixels[..., 2]


def near_edges(objects):
    """Pixels of which a neighbour shows another object."""
    near = numpy.zeros(objects.shape, bool)
    padded = numpy.pad(objects, 1, mode="edge")
    height, width = objects.shape
    for dy in range(3):
        for dx in range(3):
            near |= padded[dy:dy + height, dx:dx + width] != objects
    return near


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("insula")
    parser.add_argument("city")
    parser.add_argument("camera", nargs="+")
    parser.add_argument("--size", default="4000x2400")
    parser.add_argument("--keep")
    args = parser.parse_args()
    width, height = map(int, args.size.split("x"))
    worst = 1.0
    with tempfile.TemporaryDirectory() as temporary:
        folder = pathlib.Path(args.keep or temporary)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "style.toml").write_text(STYLE)
        for camera in args.camera:
            name = pathlib.Path(camera).stem
            svg, raw = folder / f"{name}.svg", folder / f"{name}.u32"
            paper = f"{width / 10}x{height / 10}"
            subprocess.run([args.insula, "draw", args.city, "--camera", camera, "--paper", paper, "--bare", "--style",
                            folder / "style.toml", "--out", svg], check=True, stderr=subprocess.DEVNULL)
            if not raw.exists():
                subprocess.run([args.insula, "snapshot", "--server", args.city, "--camera", camera, "--size", args.size,
                                "--tau", "0.1", "--cache-mib", "1024", "--adapter", "cpu", "--out", folder / f"{name}.png",
                                "--objects", raw], check=True, stderr=subprocess.DEVNULL)
            drawn = rasterise(svg, folder / f"{name}-drawing.png", width, height)
            cast = numpy.fromfile(raw, dtype="<u4").reshape(height, width) & NONE
            judged = ~(near_edges(drawn) | near_edges(cast))
            is_same = (drawn == cast)[judged]
            share = is_same.mean() if is_same.size else 0.0
            worst = min(worst, share)
            print(json.dumps({"camera": name, "same": round(float(share), 6), "judged": round(float(judged.mean()), 4),
                              "objects": int(numpy.unique(cast).size)}), flush=True)
            if args.keep:
                Image.fromarray(numpy.where(judged & (drawn != cast), 255, 0).astype(numpy.uint8)).save(folder / f"{name}-difference.png")
    print(f"worst: {100 * worst:.3f}% of the pixels outside of edges show the same object")


if __name__ == "__main__":
    main()
