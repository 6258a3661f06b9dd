#!/usr/bin/env python3
"""Measures what colours of objects cost: still frames with and without them, in turn.

colour_cost.py INSULA CITY CAMERA... [--color-by ATTRIBUTE] [--rounds N] [--size WxH] [--adapter cpu|gpu]

Prints the median time of a plain and of a coloured frame for each camera, and the median of the ratios of the pairs.
"""
import argparse, json, pathlib, statistics, subprocess, tempfile


def frame_ms(options, camera, colours):
    with tempfile.TemporaryDirectory() as folder:
        report = pathlib.Path(folder) / "report.json"
        command = [options.insula, "snapshot", "--server", options.city, "--camera", camera, "--size", options.size]
        command += ["--adapter", options.adapter, "--out", f"{folder}/frame.png", "--report", str(report)]
        subprocess.run(command + colours, check=True, capture_output=True)
        return json.loads(report.read_text())["frame_times"]["median_ms"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("insula")
    parser.add_argument("city")
    parser.add_argument("cameras", nargs="+")
    parser.add_argument("--color-by", default="height")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--size", default="1280x720")
    parser.add_argument("--adapter", default="cpu", choices=["cpu", "gpu"])
    options = parser.parse_args()
    for camera in options.cameras:
        pairs = []
        for _ in range(options.rounds):
            pairs.append([frame_ms(options, camera, colours) for colours in ([], ["--color-by", options.color_by])])
        plain, coloured = (statistics.median(times) for times in zip(*pairs))
        ratio = statistics.median(coloured / plain for plain, coloured in pairs)
        print(f"{pathlib.Path(camera).stem}: plain {plain:.0f} ms, coloured {coloured:.0f} ms, ratio {ratio:.3f}", flush=True)


if __name__ == "__main__":
    main()
