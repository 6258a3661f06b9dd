#!/usr/bin/env python3
"""Times the readers on large files, each beside another tool that reads the same file.

    speed.py FILE... --program target/release/insula-server [--runs 3]

Ours is `insula-server inspect FILE --json`, which reads all objects with their geometry and attributes. The other tool is
chosen by the file's name: `citygmltest` (libcitygml) for CityGML, `osmium export` to a null device for OpenStreetMap,
`pyogrio.read_dataframe` for vectors, and `pyarrow` with `shapely.from_wkb` for GeoParquet. Prints the medians of the runs, which alternate:
megabytes a second of wall time and of processor time, and the peak memory of the process.

Needs: pip install pyogrio pyarrow shapely geopandas; apt install libcitygml-bin osmium-tool (those that are missing are left out)
"""
import argparse, os, pathlib, shutil, statistics, subprocess, sys, time

PARQUET = "import sys, pyarrow.parquet, shapely; t = pyarrow.parquet.read_table(sys.argv[1]); shapely.from_wkb(t['geometry'].to_numpy()); t.to_pandas()"
VECTOR = "import sys, pyogrio; print(len(pyogrio.read_dataframe(sys.argv[1])))"


def peer(path):
    """Name and command of the tool that reads a file; None if there is none."""
    name = path.name.lower()
    if name.endswith((".gml", ".citygml", ".xml")):
        return ("libcitygml", ["citygmltest", str(path)]) if shutil.which("citygmltest") else None
    if name.endswith((".osm.pbf", ".osm", ".osm.gz")):
        command = ["osmium", "export", str(path), "-f", "geojsonseq", "-o", "/dev/null", "--overwrite", "--no-progress"]
        return ("osmium export", command) if shutil.which("osmium") else None
    if name.endswith(".parquet"):
        return "pyarrow, shapely", [sys.executable, "-c", PARQUET, str(path)]
    if name.endswith((".fgb", ".gpkg", ".shp", ".geojson")):
        return "pyogrio", [sys.executable, "-c", VECTOR, str(path)]
    return None


def size(path):
    """Bytes of a file, of a Shapefile with its attributes."""
    parts = [path, path.with_suffix(".dbf")] if path.suffix.lower() == ".shp" else [path]
    return sum(part.stat().st_size for part in parts)


def run(command):
    """Seconds of wall time and of processor time, and peak memory in bytes."""
    start = time.monotonic()
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    message = child.stderr.read()
    _, status, usage = os.wait4(child.pid, 0)
    wall = time.monotonic() - start
    if status:
        raise RuntimeError(f"{command[0]}: {message.decode(errors='replace').strip()[-300:]}")
    return wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", type=pathlib.Path, metavar="FILE")
    parser.add_argument("--program", required=True)
    parser.add_argument("--runs", type=int, default=3)
    options = parser.parse_args()
    print("| file | MB | reader | s | s of processor | MB/s | MB/s of processor | peak memory, MB |")
    print("|---|---|---|---|---|---|---|---|")
    for path in options.files:
        tools = [("insula", [options.program, "inspect", str(path), "--json"])]
        tools += [tool for tool in [peer(path)] if tool]
        runs = {name: [] for name, _ in tools}
        for _ in range(options.runs):
            for name, command in tools:
                if runs[name] is None:
                    continue
                try:
                    runs[name].append(run(command))
                except RuntimeError as error:
                    print(f"{path.name}: {error}", file=sys.stderr)
                    runs[name] = None
        megabytes = size(path) / 1e6
        for name, found in runs.items():
            if not found:
                print(f"| {path.name} | {megabytes:.0f} | {name} | failed | | | | |")
                continue
            wall, cpu, memory = (statistics.median(run[i] for run in found) for i in range(3))
            print(f"| {path.name} | {megabytes:.0f} | {name} | {wall:.1f} | {cpu:.1f} | {megabytes / wall:.0f} | "
                  f"{megabytes / cpu:.0f} | {memory / 1e6:.0f} |", flush=True)


if __name__ == "__main__":
    main()
