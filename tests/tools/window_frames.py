#!/usr/bin/env python3
"""Measures the frames of the window without a GPU: while the camera moves, and until the final frame after it stopped.

    tests/tools/window_frames.py --city FOLDER --path tests/paths/tokyo-circle.json PROGRAM...

Opens a window of 1280 x 720 on a virtual screen for each PROGRAM in turn, in several rounds: flies along the path, then holds keys in
the view over the whole city. Other load on the machine makes all of them slower: compare programs of one run. Needs Xvfb and xdotool.
"""
import argparse, collections, datetime, os, re, statistics, subprocess, sys, tempfile, threading, time

KEYS = ["w", "a", "d", "s"]
HELD_S = 1.2
# For the final frame, which takes long while another load is on the machine.
LIMIT_S = 30


def timestamp(line):
    match = re.search(r"(\d{4}-\d\d-\d\dT[\d:.]+)Z", line)
    return match and datetime.datetime.fromisoformat(match[1]).replace(tzinfo=datetime.timezone.utc).timestamp()


def fields(line):
    return {name: float(value) for name, value in re.findall(r"(\w+)=([\d.]+)", line)}


class Window:
    """The program with a window on a virtual screen of its own, and the lines that it logs."""

    def __init__(self, program, city, size, options):
        read, write = os.pipe()
        self.screen = subprocess.Popen(
            ["Xvfb", "-displayfd", str(write), "-screen", "0", "{}x{}x24".format(*size), "-nolisten", "tcp"],
            pass_fds=[write], stderr=subprocess.DEVNULL)
        os.close(write)
        with open(read) as number:
            # To its end: the server would die of a pipe that is closed before.
            display = ":" + number.read().strip()
        self.folder = tempfile.TemporaryDirectory()
        os.mkdir(os.path.join(self.folder.name, "insula"))
        with open(os.path.join(self.folder.name, "insula", "settings.json"), "w") as file:
            file.write('{"window":[%d,%d]}' % tuple(size))
        self.environment = {**os.environ, "DISPLAY": display, "XDG_CONFIG_HOME": self.folder.name, "NO_COLOR": "1",
                            "RUST_LOG": "error,insula_client::ui=trace"}
        self.environment.pop("WAYLAND_DISPLAY", None)
        self.process = subprocess.Popen([program, "view", city, "--adapter", "cpu", *options], env=self.environment,
                                        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        self.events = []
        self.reader = threading.Thread(target=self.collect, daemon=True)
        self.reader.start()

    def collect(self):
        for line in self.process.stderr:
            if (time_s := timestamp(line)):
                self.events.append((time_s, line))

    def wait_for(self, text, after, limit_s):
        begin = time.time()
        while time.time() - begin < limit_s:
            for time_s, line in list(self.events):
                if time_s >= after and text in line:
                    return time_s
            time.sleep(0.005)
        return None

    def close(self):
        for process in [self.process, self.screen]:
            process.kill()
            process.wait()
        self.reader.join(2)
        self.folder.cleanup()


def moving(program, args):
    """Frames of a flight: each with its fields, and seconds since the one before."""
    options = ["--path", args.path, "--seconds", str(args.seconds)]
    window = Window(program, args.city, args.size, options)
    try:
        window.process.wait(args.seconds + 60)
    finally:
        window.close()
    frames, surface = [], {}
    for time_s, line in window.events:
        if "surface presented" in line:
            surface = fields(line)
        elif "frame of a new view" in line:
            frames.append((time_s, {**fields(line), **surface}))
    # The first seconds load tiles and learn how fast frames are.
    frames = [frame for frame in frames if frame[0] > frames[0][0] + args.skip]
    return [dict(values, interval_ms=1e3 * (at - before)) for (before, _), (at, values) in zip(frames, frames[1:])]


def resting(program, args):
    """Seconds from the release of keys to the final frame; and by the program from the last change of the view."""
    window = Window(program, args.city, args.size, args.view)
    times, changes = [], []
    try:
        if not window.wait_for("frame settled", 0, 60):
            sys.exit(f"the window shows no city: {window.process.poll()} {window.events[-1:]}")
        ids = subprocess.check_output(["xdotool", "search", "--pid", str(window.process.pid)], env=window.environment, text=True)
        subprocess.run(["xdotool", "windowfocus", ids.split()[-1]], env=window.environment, check=True)
        for key in KEYS * args.keys:
            time.sleep(0.5)
            subprocess.run(["xdotool", "keydown", key], env=window.environment, check=True)
            time.sleep(HELD_S)
            subprocess.run(["xdotool", "keyup", key], env=window.environment, check=True)
            released = time.time()
            settled = window.wait_for("frame settled", released, LIMIT_S)
            times.append(settled - released if settled else float("inf"))
            time.sleep(0.2)
        changes = [fields(line)["since_change_ms"] / 1e3 for at, line in window.events if "since_change_ms" in line]
    finally:
        window.close()
    return times, changes[1:]


def report(program, frames, rests, changes):
    print(f"{program}:")
    if frames:
        shares = collections.Counter((int(frame["divisor"]), int(frame["samples"])) for frame in frames)
        interval_ms = statistics.median(frame["interval_ms"] for frame in frames)
        mean_ms = statistics.mean(frame["interval_ms"] for frame in frames)
        print(f"  moving: {1e3 / interval_ms:.1f} frames/s by the median interval, {1e3 / mean_ms:.1f} by the mean, {len(frames)} frames")
        print("  pixels along a side 1/n, rays along a pixel's side:",
              ", ".join(f"1/{d} {s}: {100 * n / len(frames):.0f}%" for (d, s), n in sorted(shares.items())))
        names = [name for name in frames[0] if name.endswith("_ms")]
        print("  medians, ms:", ", ".join(f"{name[:-3]} {statistics.median(f.get(name, 0) for f in frames):.1f}" for name in names))
    if rests:
        print(f"  final frame after the key: median {statistics.median(rests):.2f} s, worst {max(rests):.2f} s")
    if changes:
        print(f"  final frame after the last change: median {statistics.median(changes):.2f} s, worst {max(changes):.2f} s")


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("programs", nargs="+")
    ap.add_argument("--city", required=True)
    ap.add_argument("--path", required=True)
    ap.add_argument("--view", nargs="*", default=[], help="options of the view that keys move in, such as --camera=FILE")
    ap.add_argument("--size", type=int, nargs=2, default=[1280, 720])
    ap.add_argument("--seconds", type=float, default=12)
    ap.add_argument("--skip", type=float, default=3, help="seconds of the flight that are not counted")
    ap.add_argument("--keys", type=int, default=2, help="times that each key is held")
    ap.add_argument("--rounds", type=int, default=2)
    ap.add_argument("--only", choices=["moving", "resting"])
    args = ap.parse_args()
    results = {program: ([], [], []) for program in args.programs}
    for _ in range(args.rounds):
        for program, (frames, rests, changes) in results.items():
            if args.only != "resting":
                frames += moving(program, args)
            if args.only != "moving":
                for target, found in zip((rests, changes), resting(program, args)):
                    target += found
    for program, result in results.items():
        report(program, *result)


if __name__ == "__main__":
    main()
