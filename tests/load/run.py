#!/usr/bin/env python3
"""Measures a server under load. Writes a report in Markdown and JSON.

    tests/load/run.py CITY --out DIR [--minutes 10] [--skip throughput,tls,overload]

Records the requests of the real client (record.py) and repeats them with goose (scenarios): with empty caches, as a ramp, a
spike and a soak. Then compares with nginx (throughput.py, without and with TLS) and overloads the server (overload). Build
first: `cargo build --release --workspace --bins`, `cargo build --release -p insula-measure --bin tile_files`, and in tests/load
`cargo build --release`. The comparison needs wrk, nginx and openssl. Exits with 1 if a target is missed.
"""

import argparse, json, os, pathlib, platform, subprocess, sys, threading, time

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
TARGET = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release"
LOAD = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", HERE / "target")) / "release"

# Without caches: every tile is read again.
COLD = ["limits.tile_bytes=0", "cache.memory_bytes=0"]


class Server:
    """A running server. Its resident memory is recorded every second."""

    def __init__(self, program, city, settings):
        flags = [word for setting in settings for word in ("--set", setting)]
        command = [program, "serve", city, "--listen", "127.0.0.1:0", *flags]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.url = self.process.stdout.readline().split()[-1]
        self.resident = []
        self.done = threading.Event()
        threading.Thread(target=self.watch, daemon=True).start()

    def watch(self):
        start = time.monotonic()
        while not self.done.wait(1):
            try:
                status = pathlib.Path(f"/proc/{self.process.pid}/status").read_text()
                kib = next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS:"))
            except (OSError, StopIteration):
                return
            self.resident.append((time.monotonic() - start, kib / 1024))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.done.set()
        self.process.terminate()
        self.process.wait()


def goose(server, trace, out, name, users, seconds, rate=0):
    """Runs one phase, as fast as possible or at a rate in requests per second. Returns a row of the table."""
    report = out / f"goose-{name}.json"
    first = len(server.resident)
    command = [LOAD / "scenarios", "--host", server.url, "--users", str(users), "--increase-rate", str(max(users, 1)),
               "--run-time", f"{seconds}s", "--report-file", report, "--no-print-metrics", "-q", "--no-reset-metrics"]
    command += ["--throttle-requests", str(rate)] if rate else []
    code = subprocess.run(command, env=dict(os.environ, TRACE=str(trace)), stdout=subprocess.DEVNULL).returncode
    data = json.loads(report.read_text())
    whole = lambda rows: next(row for row in rows if row["name"] == "Aggregated")
    requests, times = whole(data["raw_request_metrics"]), whole(data["raw_response_metrics"])
    resident = [mib for _, mib in server.resident[first:]]
    row = {
        "phase": name, "users": users, "seconds": seconds, "requests": requests["number_of_requests"],
        "failed": requests["number_of_failures"], "per_second": requests["number_of_requests"] / seconds,
        "p50_ms": times["percentile_50"], "p95_ms": times["percentile_95"], "p99_ms": times["percentile_99"],
        "resident_mib": max(resident, default=0.0), "ok": code == 0,
    }
    print(f"{name}: {row['requests']} requests, {row['failed']} failed, {row['per_second']:.0f}/s, p99 {row['p99_ms']} ms", file=sys.stderr)
    return row


def minutes_of(resident):
    """Mean resident memory of each full minute, in MiB."""
    last = int(resident[-1][0] // 60) if resident else 0
    means = []
    for minute in range(last):
        part = [mib for at, mib in resident if minute * 60 <= at < minute * 60 + 60]
        means.append(sum(part) / len(part))
    return means


def run_tool(command):
    """Runs another program. Returns its result (the JSON in its last line) and its table (the lines before)."""
    print(" ".join(str(word) for word in command), file=sys.stderr)
    done = subprocess.run([str(word) for word in command], stdout=subprocess.PIPE, text=True)
    lines = done.stdout.strip().splitlines()
    if done.returncode != 0 or not lines:
        return {"missing": f"{pathlib.Path(command[0]).name} ended with {done.returncode}"}, ""
    return json.loads(lines[-1]), "\n".join(line for line in lines[:-1])


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("city", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--minutes", type=int, default=10, help="duration of the soak")
    parser.add_argument("--rate", type=int, default=1000, help="requests per second of the soak; 0: as fast as possible")
    parser.add_argument("--skip", default="", help="comma-separated list of throughput, tls, overload")
    parser.add_argument("--server", type=pathlib.Path, default=TARGET / "insula-server")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    skip = args.skip.split(",")
    trace = args.out / "trace.json"
    subprocess.run([HERE / "record.py", args.city, "--out", trace, "--server", args.server], check=True)
    report = {"city": str(args.city.name), "machine": f"{os.cpu_count()} cores, {platform.machine()}", "phases": []}
    rows = report["phases"]
    with Server(args.server, args.city, COLD) as server:
        rows.append(goose(server, trace, args.out, "cold", 10, 20))
    with Server(args.server, args.city, []) as server:
        for users in (5, 10, 20, 40):
            rows.append(goose(server, trace, args.out, f"ramp-{users}", users, 20))
        for name, users in (("before-the-spike", 5), ("spike", 200), ("after-the-spike", 5)):
            rows.append(goose(server, trace, args.out, name, users, 20))
    with Server(args.server, args.city, []) as server:
        rows.append(goose(server, trace, args.out, "soak", 20, args.minutes * 60, args.rate))
        minutes = minutes_of(server.resident)
    report["soak_resident_mib"] = minutes
    report["soak_last_over_second_minute"] = minutes[-1] / minutes[1] if len(minutes) > 2 else None
    text = ["# Load", "", f"{report['city']}, {report['machine']}, clients and server on the same machine.", "", "## Simulated viewers (goose)", ""]
    text += ["| phase | users | s | requests | failed | requests/s | p50 ms | p95 ms | p99 ms | resident MiB |", "|---|---|---|---|---|---|---|---|---|---|"]
    text += [f"| {r['phase']} | {r['users']} | {r['seconds']} | {r['requests']} | {r['failed']} | {r['per_second']:.0f} | {r['p50_ms']} | {r['p95_ms']} | {r['p99_ms']} | {r['resident_mib']:.1f} |" for r in rows]
    text += ["", "Resident memory per minute of the soak, MiB: " + ", ".join(f"{mib:.1f}" for mib in minutes) + "."]
    if report["soak_last_over_second_minute"]:
        text += [f"The last minute has {report['soak_last_over_second_minute']:.3f} times the memory of the second."]
    others = {
        "throughput": ("Comparison with nginx", [HERE / "throughput.py", args.city, "--server", args.server]),
        "tls": ("Comparison with nginx over TLS", [HERE / "throughput.py", args.city, "--server", args.server, "--tls"]),
        "overload": ("Overload: 20 times the capacity", [TARGET / "overload", args.server, args.city, args.out / "paths.txt"]),
    }
    recorded = json.loads(trace.read_text())
    (args.out / "paths.txt").write_text("\n".join(path for paths in recorded.values() for path in paths) + "\n")
    for name, (title, command) in others.items():
        if name not in skip:
            report[name], table = run_tool(command)
            text += ["", f"## {title}", "", table or report[name]["missing"]]
    missed = [row["phase"] for row in rows if row["failed"] or not row["ok"]]
    if (report["soak_last_over_second_minute"] or 1.0) > 1.05:
        missed.append("memory of the soak")
    report["missed"] = missed
    text += ["", "Missed: " + ", ".join(missed) + "." if missed else "No request failed, and memory did not grow."]
    (args.out / "report.json").write_text(json.dumps(report, indent=1) + "\n")
    (args.out / "report.md").write_text("\n".join(text) + "\n")
    print("\n".join(text))
    sys.exit(1 if missed else 0)


if __name__ == "__main__":
    main()
