#!/usr/bin/env python3
"""Compares what cold views cost two clients: requests, bytes, and the time until a frame has no error above tau.

    tests/load/cold_views.py CITY OLD_INSULA [NEW_INSULA] [--server INSULA_SERVER] [--folder] [--runs 3]

Views over the middle of the city from 1,200 and 500 m, from 60 m and in a street, 1280 x 720, tau 1, an empty cache, a simulated link
of 20 Mbit/s and 50 ms. The city is served by a server of its own, or, with --folder, read as from a plain host. Both clients take
turns; prints medians as Markdown.
"""

import argparse, json, pathlib, statistics, subprocess, tempfile
from record import TARGET

SECONDS = 6


def views(manifest):
    """Positions and targets of the cameras, by name."""
    (west, south), (east, north) = manifest["focus"]
    x, y, ground = (west + east) / 2, (south + north) / 2, manifest["ground_z_m"]
    return {
        "1,200 m": ([x, y - 1200, ground + 1200], [x, y, ground]),
        "500 m": ([x, y - 700, ground + 500], [x, y, ground]),
        "60 m": ([x, y, ground + 60], [x + 300, y + 400, ground + 25]),
        "street": ([x, y, ground + 3], [x + 200, y + 300, ground + 5]),
    }


def fly(insula, city, position, target, folder):
    """Requests, bytes and seconds until the frame has converged."""
    path, report = folder / "path.json", folder / "report.json"
    path.write_text(json.dumps({"seconds": SECONDS, "keys": [{"t": 0, "position": position, "target": target}]}))
    command = [insula, "fly", "--server", city, "--path", path, "--adapter", "cpu", "--shadows", "off", "--size", "1280x720"]
    command += ["--paced", "--bandwidth", "20", "--rtt", "50", "--report", report]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    found = json.loads(report.read_text())
    seconds = found["time_to_converged_picture_secs"]
    return found["requests"], found["bytes_fetched"], SECONDS if seconds is None else seconds


def serve(program, city):
    """A server of the city, and its address."""
    server = subprocess.Popen([program, "serve", city, "--listen", "127.0.0.1:0"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    for line in server.stdout:
        if line.startswith("listening on "):
            return server, line.split()[-1]
    raise SystemExit(f"{program} does not serve {city}")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("city", type=pathlib.Path)
    parser.add_argument("old")
    parser.add_argument("new", nargs="?", default=TARGET / "insula")
    parser.add_argument("--server", default=TARGET / "insula-server")
    parser.add_argument("--folder", action="store_true")
    parser.add_argument("--runs", type=int, default=3)
    args = parser.parse_args()
    server, address = (None, args.city) if args.folder else serve(args.server, args.city)
    print("| view | requests | bytes | converged, s |\n|---|---|---|---|")
    try:
        with tempfile.TemporaryDirectory() as name:
            for view, (position, target) in views(json.loads((args.city / "city.json").read_text())).items():
                runs = [[fly(insula, address, position, target, pathlib.Path(name)) for insula in (args.old, args.new)] for _ in range(args.runs)]
                old, new = ([statistics.median(run[client][value] for run in runs) for value in range(3)] for client in (0, 1))
                print(f"| {view} | {old[0]:.0f} to {new[0]:.0f} | {new[1] / old[1]:.2f} of {old[1] / 1000:.0f} kB | {old[2]:.2f} to {new[2]:.2f} |")
    finally:
        if server:
            server.kill()


if __name__ == "__main__":
    main()
