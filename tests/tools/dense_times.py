#!/usr/bin/env python3
"""Times and memory of the mesh tools and of the bake, of a scan of 1.6 million triangles with noise.

    tests/tools/dense_times.py nefertiti.obj --insula target/release/insula-server --out OUT

The scan is made by dense_scan.py, which needs numpy. OUT keeps all files. Prints a Markdown table.
"""
import argparse
import os
import pathlib
import subprocess
import time

import dense_scan


def measured(command):
    """Seconds, seconds of the processor, and the peak of the memory in MiB."""
    start = time.monotonic()
    process = subprocess.Popen([str(word) for word in command], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{command}: status {status}")
    return time.monotonic() - start, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def size_of(path):
    files = [file for file in path.rglob("*") if file.is_file()] if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files) / 1e6


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mesh")
    parser.add_argument("--insula", default="target/release/insula-server")
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--parts", type=int, default=4)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    scan = args.out / "scan.ply"
    dense_scan.make(args.mesh, scan, args.parts, 0.12)
    small, coded, back, city = (args.out / name for name in ("small.ply", "scan.insm", "back.ply", "city"))
    commands = [
        (["simplify", scan, small, "--ratio", "0.1"], small),
        (["simplify", scan, args.out / "within.ply", "--error", "1"], args.out / "within.ply"),
        (["compress", scan, coded], coded),
        (["decompress", coded, back], back),
        (["compare", scan, small], None),
        (["bake", scan, "--out", city, "--cell", "4", "--stone", "carrara-marble", "--memory", "3GiB"], city),
    ]
    print("| command | s | s of the processor | peak memory, MiB | output, MB |\n| --- | --- | --- | --- | --- |")
    for command, output in commands:
        seconds, processor, memory = measured([args.insula, *command])
        text = " ".join(str(word).replace(f"{args.out}/", "") for word in command)
        size = f"{size_of(output):.1f}" if output else ""
        print(f"| `{text}` | {seconds:.1f} | {processor:.1f} | {memory:,.0f} | {size} |", flush=True)


if __name__ == "__main__":
    main()
