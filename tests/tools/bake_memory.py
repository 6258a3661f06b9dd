#!/usr/bin/env python3
"""Measures peak memory and processor time of a bake, or of the steps of a bake, by the size of the city.

    tests/tools/bake_memory.py --program target/release/insula-server SOURCE.geojson --counts 100000,1000000 --folder FOLDER \\
        [--plain] [--shuffles 8] [--regions 2] [-- options of the bake]

SOURCE may be `houses`: triangular houses 20 m apart, whose bake is quicker. Otherwise the footprints of SOURCE (in degrees) are put side by side with other heights, one copy a file, until there are COUNT of them. All scans and
the plan run, then some of the shuffles, and some of the regions if all shuffles ran (`--shuffles 0`). Prints one line for each count and
stage: the highest peak of resident memory of its tasks, and the sum of their processor time. FOLDER needs 2.5 kB a footprint, and
4 kB with all shuffles; it is emptied before and after each count. `--plain` runs `inspect` and a bake without steps instead, which
needs 5 kB a footprint.
"""

import argparse
import json
import math
import os
import random
import shutil
import subprocess
import sys
from pathlib import Path

# Degrees from one copy to the next.
STEP = (0.045, 0.036)


def moved(coordinates, dx, dy):
    if isinstance(coordinates[0], (int, float)):
        return [round(coordinates[0] + dx, 7), round(coordinates[1] + dy, 7)]
    return [moved(some, dx, dy) for some in coordinates]


def make(source, count, folder):
    """Writes COUNT footprints, one copy of the source a file."""
    features = [f for f in json.loads(Path(source).read_text())["features"] if f["geometry"]["type"] in ("Polygon", "MultiPolygon")]
    copies = math.ceil(count / len(features))
    columns = math.ceil(math.sqrt(copies))
    for copy in range(copies):
        rng = random.Random(copy)
        dx, dy = copy % columns * STEP[0], copy // columns * STEP[1]
        with open(folder / f"copy-{copy:05}.geojson", "w") as file:
            file.write('{"type":"FeatureCollection","features":[')
            for i, feature in enumerate(features[: count - copy * len(features)]):
                properties = dict(feature.get("properties") or {}, height=round(3 + rng.random() * 40, 1), id=f"{copy}-{i}")
                geometry = {"type": feature["geometry"]["type"], "coordinates": moved(feature["geometry"]["coordinates"], dx, dy)}
                text = json.dumps({"type": "Feature", "id": f"{copy}-{i}", "properties": properties, "geometry": geometry})
                file.write(("," if i else "") + "\n" + text)
            file.write("]}")


def make_houses(count, folder):
    """Writes COUNT triangular houses, each with a name, in files of squares of 25,000."""
    rng = random.Random(1)
    for first in range(0, count, 25_000):
        square, features = first // 25_000, []
        for k in range(min(25_000, count - first)):
            lon = round(139.7 + (square % 7 * 158 + k % 158) * 0.00022, 7)
            lat = round(35.6 + (square // 7 * 159 + k // 158) * 0.00018, 7)
            ring = [[lon, lat], [round(lon + 1e-4, 7), lat], [lon, round(lat + 1e-4, 7)], [lon, lat]]
            number = first + k
            properties = {"height": round(3 + rng.random() * 30, 1), "id": f"h-{number}", "name": f"House {number % 977} {number}"}
            geometry = {"type": "Polygon", "coordinates": [ring]}
            features.append(json.dumps({"type": "Feature", "id": str(number), "properties": properties, "geometry": geometry}))
        text = '{"type":"FeatureCollection","features":[' + ",\n".join(features) + "]}"
        (folder / f"square-{square:03}.geojson").write_text(text)


def run(words, folder):
    """Runs a command; returns its peak of resident memory in MiB and its processor time in seconds."""
    environment = dict(os.environ, TMPDIR=str(folder))
    with open(folder / "errors", "w") as errors:
        child = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=errors, env=environment)
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        sys.exit(f"{' '.join(map(str, words))}: {child.returncode}\n{(folder / 'errors').read_text()[-2000:]}")
    return usage.ru_maxrss / 1024, usage.ru_utime + usage.ru_stime


def measure(arguments, options, count):
    folder = Path(arguments.folder)
    shutil.rmtree(folder, ignore_errors=True)
    inputs, work, temporary = folder / "inputs", folder / "work", folder / "temporary"
    for path in (inputs, temporary):
        path.mkdir(parents=True)
    # A process of its own, whose memory is not that of the children.
    subprocess.run([sys.executable, __file__, "--make", str(count), arguments.source, "--folder", str(inputs)], check=True)
    bake = [arguments.program, "bake"]
    if arguments.plain:
        inspect = [arguments.program, "inspect", inputs, "--json"]
        whole = [*bake, inputs, "--out", folder / "city", "--threads", "1", *options]
        for name, words in (("inspect", inspect), ("bake", whole)):
            peak, time = run(words, temporary)
            print(f"{count} {name}: {peak:.0f} MiB, {time:.1f} s", flush=True)
        return shutil.rmtree(folder)
    begin = [*bake, "plan", "--inputs", inputs, "--work", work, "--chunk", "1", "--name", "city", *options]

    def stage(name, tasks, words):
        found = [run([*bake, *words(task), "--work", work, "--threads", "1"], temporary) for task in tasks]
        if found:
            peak, time = max(found)[0], sum(t for _, t in found)
            print(f"{count} {name}: {len(found)} tasks, at most {peak:.0f} MiB, {time:.1f} s together", flush=True)

    def tasks(name):
        command = [*bake, "tasks", name, "--work", work]
        return int(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)

    def some(name, wanted):
        count = tasks(name)
        wanted = min(wanted, count) if wanted else count
        return [count * i // wanted for i in range(wanted)]

    peak, time = run(begin, temporary)
    print(f"{count} begin: {peak:.0f} MiB, {time:.1f} s", flush=True)
    stage("scan", range(tasks("scan")), lambda task: ["scan", str(task)])
    shutil.rmtree(inputs)
    stage("plan", [0], lambda _: ["plan"])
    stage("shuffle", some("shuffle", arguments.shuffles), lambda task: ["shuffle", str(task)])
    if not arguments.shuffles and arguments.regions:
        regions = some("region", arguments.regions + 2)[1:-1]
        stage("region", regions, lambda task: ["region", str(task)])
    shutil.rmtree(folder)


def main():
    split = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source")
    parser.add_argument("--program")
    parser.add_argument("--counts", default="100000,1000000")
    parser.add_argument("--folder", required=True)
    parser.add_argument("--plain", action="store_true")
    parser.add_argument("--shuffles", type=int, default=8)
    parser.add_argument("--regions", type=int, default=0)
    parser.add_argument("--make", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args(sys.argv[1:split])
    if arguments.make:
        return make_houses(arguments.make, Path(arguments.folder)) if arguments.source == "houses" else make(arguments.source, arguments.make, Path(arguments.folder))
    if not arguments.program:
        parser.error("--program is missing")
    for count in map(int, arguments.counts.split(",")):
        measure(arguments, sys.argv[split + 1:], count)


if __name__ == "__main__":
    main()
