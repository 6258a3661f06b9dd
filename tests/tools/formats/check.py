#!/usr/bin/env python3
"""Bakes real files of every format and compares the cities with triangles that the second reader makes of the same files.

    check.py --data DIR --program target/release/insula-server --fidelity target/release/fidelity [--out DIR] [--only NAME]

`cases.json` beside this script lists the files below DIR, their sources and licences, and the options of the bake. Prints a
table: the worst and the mean silhouette IoU, and the 95th percentile of the deviations in cells, at 0.1 pixels. Exits with 1
if a mean IoU is below 0.99 or a deviation above 0.1 cells. Files that are not in DIR are named and left out.

Needs: what truth.py needs
"""
import argparse, glob, json, pathlib, subprocess, sys, tempfile, time

HERE = pathlib.Path(__file__).parent
MIN_IOU, MAX_CELLS = 0.99, 0.1


class Failed(Exception):
    pass


def run(command):
    """Runs a program. Returns its seconds; fails with the end of its message."""
    started = time.monotonic()
    made = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if made.returncode:
        lines = (made.stderr.strip() or made.stdout.strip() or "no message").splitlines()
        raise Failed(f"{pathlib.Path(str(command[0])).name} {command[1]}: {lines[-1][:300]}")
    return time.monotonic() - started


def inputs_of(case, data):
    found = [path for pattern in case["inputs"] for path in sorted(glob.glob(str(data / pattern)))]
    if len(found) < len(case["inputs"]):
        raise FileNotFoundError(case["inputs"])
    return found


def truth_of(case, inputs, data, folder):
    report = folder / "truth.json"
    geoid = ["--geoid", data / case["geoid"]] if "geoid" in case else []
    place = ["--at", case["at"]] if "at" in case else []
    command = [sys.executable, "-B", HERE / "truth.py", *inputs, "--crs", case["crs"], "--out", folder / "truth.obj"]
    run([*command, "--report", report, *geoid, *place, *case.get("truth_args", [])])
    return json.loads(report.read_text())


def bake(case, inputs, data, folder, program):
    report = folder / "bake.json"
    grids = ["--grids", (data / case["geoid"]).parent] if "geoid" in case and case.get("grids", True) else []
    place = ["--at", case["at"]] if "at" in case else []
    command = [program, "bake", *inputs, "--out", folder / "city", "--crs", case["crs"], "--ground", "none"]
    secs = run([*command, "--cell", case.get("cell", 1.0), "--report", report, *grids, *place, *case.get("bake_args", [])])
    return json.loads(report.read_text()), secs


def check(case, options, folder):
    """The row of the table, and whether it is within the bounds."""
    inputs = inputs_of(case, options.data)
    baked, secs = bake(case, inputs, options.data, folder, options.program)
    truth = truth_of(case, inputs, options.data, folder)
    report = folder / "fidelity.json"
    run([options.fidelity, folder / "truth.obj", "--no-bake", "--out", folder, "--cell", case.get("cell", 1.0), "--tau", 0.1,
         "--report", report])
    of = json.loads(report.read_text())["summaries"][0]
    objects = sum(source["objects"] for source in baked["read"]["sources"])
    p95 = of["deviation_p95_cells"]
    fits = of["iou_mean"] >= MIN_IOU and p95 is not None and p95 <= MAX_CELLS
    size = sum(pathlib.Path(path).stat().st_size for path in inputs if pathlib.Path(path).is_file())
    row = [case["format"], case["name"], objects, truth["objects"], f"{of['iou_worst']:.4f}", f"{of['iou_mean']:.4f}",
           f"{p95:.3f}" if p95 is not None else "-", f"{size / 1e6:.2f}", f"{secs:.1f}", "yes" if fits else "NO"]
    return row, fits


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=pathlib.Path, required=True)
    parser.add_argument("--program", required=True, help="insula-server")
    parser.add_argument("--fidelity", required=True, help="the program `fidelity` of tests/measure")
    parser.add_argument("--cases", type=pathlib.Path, default=HERE / "cases.json")
    parser.add_argument("--only", help="only cases whose name or format contains this")
    parser.add_argument("--out", type=pathlib.Path, help="folder that keeps cities, truths and frames")
    options = parser.parse_args()
    cases = json.loads(options.cases.read_text())
    if options.only:
        cases = [case for case in cases if options.only in f"{case['format']} {case['name']}"]
    head = ["format", "file", "objects", "in truth", "worst IoU", "mean IoU", "p95 cells", "MB", "bake s", "within"]
    print(f"| {' | '.join(head)} |\n|{'---|' * len(head)}", flush=True)
    passed, missing = True, []
    with tempfile.TemporaryDirectory() as scratch:
        for case in cases:
            folder = (options.out or pathlib.Path(scratch)) / case["name"]
            folder.mkdir(parents=True, exist_ok=True)
            try:
                row, fits = check(case, options, folder)
            except FileNotFoundError as error:
                missing.append(f"{case['name']}: {error}")
                continue
            except Failed as error:
                row, fits = [case["format"], case["name"], *[""] * (len(head) - 3), str(error)], False
            passed &= fits
            print(f"| {' | '.join(map(str, row))} |", flush=True)
    for line in missing:
        print(f"not here: {line}")
    sys.exit(not passed)


if __name__ == "__main__":
    main()
