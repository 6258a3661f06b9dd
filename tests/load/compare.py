#!/usr/bin/env python3
"""Compares two builds: same baked bytes, same images, and CPU time in turn. Prints Markdown; exits with 1 if a result differs.

    tests/load/compare.py OLD NEW [--bake INPUT]... [--view CITY CAMERA]... [--rounds 5]

OLD and NEW are folders with the programs `insula-server` and `insula`. CITY is a baked folder, CAMERA a camera file.
"""

import argparse, filecmp, pathlib, resource, statistics, subprocess, sys, tempfile


def cpu_seconds(command):
    """Runs a command to its end. Returns its processor time."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def same_files(old, new):
    names = sorted(path.name for path in old.iterdir())
    if names != sorted(path.name for path in new.iterdir()):
        return False
    return filecmp.cmpfiles(old, new, names, shallow=False)[0] == names


def compare(name, rounds, commands, outputs):
    """Runs both commands in turn. Returns whether their outputs are the same."""
    times = {build: [] for build in commands}
    for number in range(rounds):
        for build in sorted(commands, reverse=number % 2 == 1):
            times[build].append(cpu_seconds(commands[build]))
    is_same = same_files(outputs["old"], outputs["new"])
    old, new = (statistics.median(times[build]) for build in ("old", "new"))
    print(f"| {name} | {'same' if is_same else '**differ**'} | {old:.2f} | {new:.2f} | {new / old:.3f} |", flush=True)
    return is_same


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("old", type=pathlib.Path)
    parser.add_argument("new", type=pathlib.Path)
    parser.add_argument("--bake", action="append", default=[], metavar="INPUT")
    parser.add_argument("--view", action="append", default=[], nargs=2, metavar=("CITY", "CAMERA"))
    parser.add_argument("--rounds", type=int, default=5)
    args = parser.parse_args()
    programs = {"old": args.old, "new": args.new}
    print("| what | output | old CPU s | new CPU s | new / old |\n|---|---|---|---|---|")
    results = []
    with tempfile.TemporaryDirectory() as folder:
        for number, source in enumerate(args.bake):
            # The name of the folder becomes the name of the city.
            outputs = {build: pathlib.Path(folder) / f"bake-{number}" / build / "city" for build in programs}
            for output in outputs.values():
                output.parent.mkdir(parents=True)
            commands = {b: [programs[b] / "insula-server", "bake", source, "--out", outputs[b], "--threads", "2"] for b in programs}
            results.append(compare(f"bake {pathlib.Path(source).name}", args.rounds, commands, outputs))
        for number, (city, camera) in enumerate(args.view):
            for adapter in ("cpu", "gpu"):
                outputs = {build: pathlib.Path(folder) / f"view-{number}-{adapter}" / build for build in programs}
                for output in outputs.values():
                    output.mkdir(parents=True)
                commands = {
                    b: [programs[b] / "insula", "snapshot", "--no-caption", "--server", city, "--camera", camera, "--size", "1280x720", "--adapter", adapter,
                        "--out", outputs[b] / "image.png", "--distance", outputs[b] / "distance.pfm"]
                    for b in programs
                }
                name = f"{pathlib.Path(city).name} {pathlib.Path(camera).stem}, {adapter}"
                results.append(compare(name, args.rounds, commands, outputs))
    sys.exit(0 if all(results) else 1)


if __name__ == "__main__":
    main()
