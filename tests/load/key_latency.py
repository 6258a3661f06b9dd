#!/usr/bin/env python3
"""Measures the time from a key press to the picture that shows it, in the window on a virtual screen.

    tests/load/key_latency.py PROGRAM PLACE [--keys 40] [--hogs 0] [--adapter cpu]

Presses W and S in turn at random times, at rest and while the final frame is drawn. `--hogs` busy processes load the machine.
Prints the median, the 90th percentile, and the time of a frame with all pixels. Needs Xvfb and xdotool.
"""
import argparse, datetime, os, random, re, statistics, subprocess, sys, tempfile, threading, time


def timestamp(line):
    match = re.search(r"(\d{4}-\d\d-\d\dT[\d:.]+)Z", line)
    return match and datetime.datetime.fromisoformat(match[1]).replace(tzinfo=datetime.timezone.utc).timestamp()


def collect(stream, events):
    for line in stream:
        time_s = timestamp(line)
        if time_s:
            events.append((time_s, line))


def wait_for(events, text, after, limit_s):
    begin = time.time()
    while time.time() - begin < limit_s:
        for time_s, line in list(events):
            if time_s >= after and text in line:
                return time_s
        time.sleep(0.002)
    return None


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("program")
    ap.add_argument("place")
    ap.add_argument("--keys", type=int, default=40)
    ap.add_argument("--hogs", type=int, default=0)
    ap.add_argument("--adapter", default="cpu")
    args = ap.parse_args()
    read, write = os.pipe()
    xvfb = subprocess.Popen(["Xvfb", "-displayfd", str(write), "-screen", "0", "1400x900x24", "-nolisten", "tcp"],
                            pass_fds=[write], stderr=subprocess.DEVNULL)
    display = ":" + os.read(read, 16).decode().strip()
    hogs = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(args.hogs)]
    random.seed(1)
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "DISPLAY": display, "XDG_CONFIG_HOME": folder, "NO_COLOR": "1",
                       "RUST_LOG": "error,insula_client::ui=trace"}
        environment.pop("WAYLAND_DISPLAY", None)
        viewer = subprocess.Popen([args.program, "view", args.place, "--adapter", args.adapter], env=environment,
                                  stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        events = []
        threading.Thread(target=collect, args=[viewer.stderr, events], daemon=True).start()
        try:
            if not wait_for(events, "frame settled", 0, 120):
                sys.exit("the window shows no city")
            window = subprocess.check_output(["xdotool", "search", "--pid", str(viewer.pid)], env=environment, text=True)
            subprocess.run(["xdotool", "windowfocus", window.split()[-1]], env=environment, check=True)
            latencies = []
            for number in range(args.keys):
                time.sleep(random.uniform(0.2, 2.0))
                pressed = time.time()
                subprocess.run(["xdotool", "key", "ws"[number % 2]], env=environment, check=True)
                shown = wait_for(events, "frame of a new view", pressed, 20)
                latencies.append(1000 * (shown - pressed) if shown else float("inf"))
            frames = [float(m[1]) for _, line in events if (m := re.search(r"full_frame_ms=([\d.]+)", line))]
        finally:
            viewer.kill()
            for process in [*hogs, xvfb]:
                process.kill()
    latencies.sort()
    frame = f"{statistics.median(frames):.0f} ms" if frames else "unknown"
    print(f"keys {len(latencies)}, hogs {args.hogs}: median {statistics.median(latencies):.0f} ms, "
          f"90th percentile {latencies[int(0.9 * len(latencies))]:.0f} ms; a frame with all pixels {frame}")


if __name__ == "__main__":
    main()
