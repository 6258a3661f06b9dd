#!/usr/bin/env python3
"""Compares what two bakes of one city cost a client and what they show: requests and bytes of flights, and pictures along them.

    tests/load/flights.py OLD_CITY NEW_CITY [--tau T]... [--insula BIN]

The flights are those of record.py, each with an empty cache, on the CPU. Pictures are compared with the same city's at a quarter
of the tau; the PSNR is that of all pixels of three cameras a flight. OLD_CITY is drawn with tau 1, NEW_CITY with each T. Prints
Markdown.
"""

import argparse, json, math, pathlib, subprocess, tempfile
from PIL import Image, ImageChops, ImageStat
from record import TARGET, camera_paths

SIZE = "640x360"


def run(insula, folder, *arguments):
    """Runs a command of the viewer. Returns its report."""
    report = folder / "report.json"
    common = ["--size", SIZE, "--adapter", "cpu", "--shadows", "off", "--report", report]
    subprocess.run([insula, *arguments, *common], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return json.loads(report.read_text())


def picture(insula, folder, city, camera, tau):
    place, out = folder / "camera.json", folder / "picture.png"
    place.write_text(json.dumps(camera))
    run(insula, folder, "snapshot", "--server", city, "--camera", place, "--tau", str(tau), "--no-caption", "--out", out)
    return Image.open(out).convert("RGB")


def squared_error(a, b):
    return sum(ImageStat.Stat(ImageChops.difference(a, b)).sum2) / 3 / (a.width * a.height)


def measure(insula, folder, city, tau):
    """Requests, bytes and PSNR of each flight."""
    manifest = json.loads((city / "city.json").read_text())
    results = {}
    for name, keys in camera_paths(manifest).items():
        path = folder / "path.json"
        path.write_text(json.dumps({"seconds": keys[-1]["t"], "keys": keys}))
        report = run(insula, folder, "fly", "--server", city, "--path", path, "--tau", str(tau))
        errors = []
        for key in keys[:: max(1, len(keys) // 3)][:3]:
            camera = {"position": key["position"], "target": key["target"]}
            errors.append(squared_error(*(picture(insula, folder, city, camera, t) for t in (tau, 0.25))))
        psnr = 10 * math.log10(255**2 / max(sum(errors) / len(errors), 1e-9))
        results[name] = (report["requests"], report["bytes_fetched"], psnr)
    return results


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("old", type=pathlib.Path)
    parser.add_argument("new", type=pathlib.Path)
    parser.add_argument("--tau", type=float, action="append")
    parser.add_argument("--insula", default=TARGET / "insula")
    args = parser.parse_args()
    print("| flight | tau | requests | bytes | PSNR before | PSNR |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        old = measure(args.insula, folder, args.old, 1.0)
        for tau in args.tau or [1.0]:
            new = measure(args.insula, folder, args.new, tau)
            for flight, (requests, size, psnr) in new.items():
                before = old[flight]
                ratios = f"{requests / before[0]:.3f} | {size / before[1]:.3f}"
                print(f"| {flight} | {tau} | {ratios} | {before[2]:.2f} | {psnr:.2f} |", flush=True)
            total = [sum(result[i] for result in new.values()) / sum(result[i] for result in old.values()) for i in (0, 1)]
            print(f"| all | {tau} | {total[0]:.3f} | {total[1]:.3f} | | |", flush=True)


if __name__ == "__main__":
    main()
