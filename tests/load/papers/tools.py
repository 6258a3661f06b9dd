"""Running the programs, and tables."""

import json, os, pathlib, shlex, statistics, subprocess, sys, time

HERE = pathlib.Path(__file__).resolve().parents[1]


class Setup:
    """Where programs, data and results are."""

    def __init__(self, data, out, programs):
        self.data, self.out, self.programs = data, out, programs
        self.out.mkdir(parents=True, exist_ok=True)

    def command(self, program, *arguments):
        return [self.programs / program, *map(str, arguments)]

    def shown(self, program, *arguments):
        """A command as the page shows it: without the folders of this machine."""
        words = []
        for word in map(str, arguments):
            word = word.replace(str(self.data), "DATA").replace(str(self.out) + os.sep, "")
            words.append(shlex.quote(word))
        return f"`{program} {' '.join(words)}`"

    def run(self, program, *arguments):
        """Runs a program. Returns its standard output, and the seconds that it took."""
        begin = time.monotonic()
        done = subprocess.run(self.command(program, *arguments), capture_output=True, text=True)
        seconds = time.monotonic() - begin
        if done.returncode != 0:
            words = " ".join(map(str, arguments))
            sys.exit(f"{program} {words} failed:\n{done.stderr[-2000:]}")
        return done.stdout, seconds

    def has_program(self, program):
        return (self.programs / program).is_file()


class Table:
    """Rows of a table of the page. `missing` is the reason why there are none."""

    def __init__(self, *header):
        self.header, self.rows = list(header), []

    def row(self, *cells):
        self.rows.append([str(cell) for cell in cells])

    def markdown(self):
        lines = [self.header, ["---"] * len(self.header), *self.rows]
        return "".join("|" + "|".join(f" {cell} " if cell else " " for cell in cells) + "|\n" for cells in lines)


def say(text):
    print(text, file=sys.stderr, flush=True)


def bake(setup, name, source, *options):
    """Bakes a city. Returns its report, with the shown command."""
    city, report = setup.out / name, setup.out / f"{name}.json"
    sources = source if isinstance(source, list) else [source]
    arguments = ["bake", *sources, "--out", city, *options]
    setup.run("insula-server", *arguments, "--report", report)
    return dict(json.loads(report.read_text()), command=setup.shown("insula-server", *arguments))


def alternate(rounds, works):
    """Runs each work once per round, in turn. Returns the results of each."""
    results = {name: [] for name in works}
    for _ in range(rounds):
        for name, work in works.items():
            results[name].append(work())
    return results


def middle(results, key=None):
    """The median of numbers, or of a value of dictionaries."""
    return statistics.median(result[key] if key else result for result in results)


def fly(setup, city, path, *options, size="640x360"):
    """Replays a camera path. Returns the report, with the mean frames per second and the shown command."""
    report = setup.out / "fly.json"
    arguments = ["fly", "--server", city, "--path", path, "--size", size, "--adapter", "cpu", "--shadows", "off", "--no-fades",
                 "--cache-mib", "2048", *options]
    setup.run("insula", *arguments, "--report", report)
    flight = json.loads(report.read_text())
    seconds = json.loads(path.read_text())["seconds"]
    frames = flight["frame_times"]
    return {
        "fps": frames["count"] / seconds,
        "frames": frames["count"],
        "median_ms": frames["median_ms"],
        "triangles": flight["triangles_drawn"],
        "cache_bytes": flight["peak_cache_bytes"],
        "bytes": flight["bytes_fetched"],
        "unconverged": flight["unconverged_share"],
        "command": setup.shown("insula", *arguments),
    }


def write_path(file, keys):
    """A camera path of (seconds, position, target)."""
    keys = [{"t": t, "position": list(position), "target": list(target)} for t, position, target in keys]
    file.write_text(json.dumps({"seconds": max(keys[-1]["t"], 1), "keys": keys}))
    return file


def size_text(number):
    """Bytes in the units of the papers, with two or three digits."""
    for unit in ("bytes", "kB"):
        if number < 1000:
            return f"{number:.0f} {unit}" if unit == "bytes" or number >= 99.5 else f"{number:.1f} {unit}"
        number /= 1000
    return f"{number:.2f} MB" if number < 10 else f"{number:.1f} MB"


def digits(number, count=3):
    """A number with so many significant digits, without an exponent where it is not tiny."""
    return f"{number:#.{count}g}".rstrip(".") if 1e-3 <= abs(number) < 1e4 else f"{number:,.0f}" if abs(number) >= 1e4 else f"{number:.1e}"
