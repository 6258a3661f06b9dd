#!/usr/bin/env python3
"""Records the requests of the real client on flights, walks and jumps, for the scenarios of goose.

    tests/load/record.py CITY --out trace.json [--insula BIN] [--server BIN]

The server logs every request as JSON. `insula fly` replays camera paths around the centre of the city, each with an empty cache.
"""

import argparse, json, math, os, pathlib, subprocess, tempfile

HERE = pathlib.Path(__file__).resolve().parent
TARGET = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", HERE.parent.parent / "target")) / "release"


def camera_paths(manifest):
    """Key cameras of a flight, a walk and a series of jumps, by name."""
    (x0, y0), (x1, y1) = manifest["focus"]
    cx, cy, ground = (x0 + x1) / 2, (y0 + y1) / 2, manifest["ground_z_m"]
    reach = max(x1 - x0, y1 - y0) / 2
    on_ring = lambda angle, r, z: [cx + r * math.cos(angle), cy + r * math.sin(angle), ground + z]
    fly = [{"t": 2.0 * i, "position": on_ring(i * 0.7, reach * (1.2 - 0.1 * i), 400 - 30 * i), "target": [cx, cy, ground]} for i in range(8)]
    walk = [
        {"t": 2.0 * i, "position": [cx + 15.0 * i, cy + 5.0 * i, ground + 2.0], "target": [cx + 15.0 * i + 60, cy + 5.0 * i + 20, ground + 8.0]}
        for i in range(8)
    ]
    jump = []
    for i in range(6):
        position = [x0 + (x1 - x0) * ((i * 0.618) % 1), y0 + (y1 - y0) * ((i * 0.414) % 1), ground + 60]
        target = [position[0] + 100, position[1] + 100, ground]
        jump += [{"t": 2.0 * i, "position": position, "target": target}, {"t": 2.0 * i + 1.99, "position": position, "target": target}]
    return {"fly": fly, "walk": walk, "jump": jump}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("city", type=pathlib.Path)
    parser.add_argument("--out", required=True)
    parser.add_argument("--insula", default=TARGET / "insula")
    parser.add_argument("--server", default=TARGET / "insula-server")
    args = parser.parse_args()
    manifest = json.loads((args.city / "city.json").read_text())
    trace = {"manifest": [f"/v1/cities/{manifest['name']}"]}
    for name, keys in camera_paths(manifest).items():
        with tempfile.TemporaryDirectory() as folder:
            log = open(f"{folder}/log", "w+")
            command = [args.server, "serve", args.city, "--listen", "127.0.0.1:0", "--set", "log.requests=all", "--set", "log.format=json"]
            server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True)
            url = server.stdout.readline().split()[-1]
            path = pathlib.Path(folder, "path.json")
            path.write_text(json.dumps({"seconds": keys[-1]["t"], "keys": keys}))
            subprocess.run([args.insula, "fly", "--server", url, "--path", path, "--size", "320x180", "--tau", "0.5", "--adapter", "cpu", "--report", f"{folder}/r.json"], check=True, stdout=subprocess.DEVNULL)
            server.terminate()
            server.wait()
            log.seek(0)
            lines = (json.loads(line) for line in log if line.startswith("{"))
            trace[name] = [l["path"] for l in lines if l.get("message") == "request" and l["code"] == 200 and l["path"].count("/") > 3]
            print(f"{name}: {len(trace[name])} requests")
    pathlib.Path(args.out).write_text(json.dumps(trace, indent=0))


if __name__ == "__main__":
    main()
