#!/usr/bin/env python3
"""Compares what two bakes of one city cost a client and what they show: requests, bytes and frame times of flights, and pictures
along them.

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


def psnr_db(errors):
    return 10 * math.log10(255**2 / max(sum(errors) / len(errors), 1e-9))


def measure(insula, folder, city, paths, tau):
    """Requests, bytes, median frame time, PSNR and pictures of each flight."""
    results = {}
    for name, keys in paths.items():
        path = folder / "path.json"
        path.write_text(json.dumps({"seconds": keys[-1]["t"], "keys": keys}))
        report = run(insula, folder, "fly", "--server", city, "--path", path, "--tau", str(tau))
        pictures, errors = [], []
        for key in keys[:: max(1, len(keys) // 3)][:3]:
            camera = {"position": key["position"], "target": key["target"]}
            pictures.append(picture(insula, folder, city, camera, tau))
            errors.append(squared_error(pictures[-1], picture(insula, folder, city, camera, 0.25)))
        frame_ms = report["frame_times"]["median_ms"]
        results[name] = (report["requests"], report["bytes_fetched"], frame_ms, psnr_db(errors), pictures)
    return results


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("old", type=pathlib.Path)
    parser.add_argument("new", type=pathlib.Path)
    parser.add_argument("--tau", type=float, action="append")
    parser.add_argument("--insula", default=TARGET / "insula")
    args = parser.parse_args()
    print("| flight | tau | requests | bytes | frame time | PSNR before | PSNR | between them |")
    print("|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        paths = camera_paths(json.loads((args.old / "city.json").read_text()))
        old = measure(args.insula, folder, args.old, paths, 1.0)
        for tau in args.tau or [1.0]:
            new = measure(args.insula, folder, args.new, paths, tau)
            for flight, after in new.items():
                before = old[flight]
                ratios = " | ".join(f"{after[i] / before[i]:.3f}" for i in range(3))
                between = psnr_db([squared_error(*pair) for pair in zip(before[4], after[4])])
                print(f"| {flight} | {tau} | {ratios} | {before[3]:.2f} | {after[3]:.2f} | {between:.2f} |", flush=True)
            sums = [sum(result[i] for result in new.values()) / sum(result[i] for result in old.values()) for i in range(3)]
            print(f"| all | {tau} | {' | '.join(f'{ratio:.3f}' for ratio in sums)} | | | |", flush=True)


if __name__ == "__main__":
    main()
