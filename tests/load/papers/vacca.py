"""Tables 4.1 and 4.2 of Vacca's thesis, its frame rates and its number of views."""

import json, math, subprocess

from . import models
from .tools import Table, alternate, bake, digits, fly, middle, say, size_text, write_path

#: The paper's views. Without meshes and generated ground, as there.
LIKE_THE_PAPER = ["--no-meshes", "--ground", "none", "--views", "256"]
ROUNDS = 3


def across(extent, columns):
    """The cell at which so many columns cover an extent, in whole centimetres."""
    return math.ceil(extent / columns * 100) / 100


def build_rows(table, case, paper, report, source_bytes):
    """The rows of one model of table 4.1. `paper` has views, seconds, source and BlockMap."""
    leaves = report["levels"][-1]
    rows = [
        ("views", paper[0], "256", report["command"]),
        ("time of the bake", paper[1], f"{report['seconds']:.2f} s", "`seconds` of `--report`"),
        ("geometry with textures", paper[2], f"{size_text(source_bytes)}, {report['triangles']:,} triangles", "the input"),
        ("finest BlockMap", paper[3], f"{size_text(leaves['bytes'])} in {leaves['nodes']} node{'s' * (leaves['nodes'] > 1)}", "last of `levels`"),
        ("all levels; city folder", "", f"{size_text(report['blockmap_bytes'])}; {size_text(report['city_bytes'])}", "`blockmap_bytes`, `city_bytes`"),
    ]
    for i, row in enumerate(rows):
        table.row(case if i == 0 else "", *row)


def single(setup):
    """Table 4.1."""
    table = Table("model", "what", "paper", "ours", "command")
    source = models.cubes(setup.out / "cubes.obj")
    report = bake(setup, "cubes", source, "--cell", "0.5", *LIKE_THE_PAPER)
    build_rows(table, "6 cubes, 64 columns across", ("256", "30 + 10 s", "2 KB", "5 KB"), report, source.stat().st_size)
    source = setup.out / "building.city.jsonl"
    _, extent = models.delft_building(setup.data / "delft-3dbag/delft.city.jsonl", source)
    report = bake(setup, "building", source, "--cell", across(max(extent), 128), *LIKE_THE_PAPER)
    build_rows(table, "one building, 128 columns across", ("256", "30 to 40 + 10 s", "6 MB, 6,300 triangles", "95 KB"), report, source.stat().st_size)
    source, _, source_bytes = models.chiba_buildings(setup.data / "chiba-textured/chiba_68.obj", setup.out / "chiba20", 20)
    places = [list(map(float, line.split()[1:3])) for line in open(source) if line.startswith("v ")]
    extent = max(max(c) - min(c) for c in zip(*places))
    report = bake(setup, "chiba20-city", source, "--cell", across(extent, 128), *LIKE_THE_PAPER)
    build_rows(table, "20 buildings, 128 columns across", ("256", "60 + 10 s", "30 MB", "97 KB"), report, source_bytes)
    return table


def towns(setup):
    """The two towns of 50 buildings: name, source, its bytes, cells of 64 and of 32 columns where the paper has a node."""
    town = setup.out / "town.obj"
    if not town.is_file():
        models.town(town)
    chiba = setup.data / "chiba-textured/chiba_68.obj"
    textured, _, textured_bytes = models.chiba_buildings(chiba, setup.out / "chiba50", 50)
    return [("generated", town, town.stat().st_size, "0.5", "1"), ("Chiba", textured, textured_bytes, "1", "2")]


def town(setup):
    """Table 4.2: sizes and times at two resolutions."""
    table = Table("what", "paper: 64, 32 columns a node", *(f"ours, {name}: cell {a} m, {b} m" for name, _, _, a, b in towns(setup)))
    fine, coarse, sources = [], [], []
    for name, source, source_bytes, cell, twice in towns(setup):
        say(f"baking the town {name}")
        works = {c: (lambda c=c: bake(setup, f"town-{name}-{c}", source, "--cell", c, *LIKE_THE_PAPER)) for c in (cell, twice)}
        results = alternate(ROUNDS, works)
        for side, c in ((fine, cell), (coarse, twice)):
            side.append(dict(results[c][0], seconds=middle(results[c], "seconds")))
        sources.append(source_bytes)
    pairs = list(zip(fine, coarse))
    both = lambda value: [", ".join(value(report) for report in pair) for pair in pairs]
    ratio = lambda key: [digits(a[key] / b[key]) for a, b in pairs]
    table.row("triangles", "about 230,000", *(f"{a['triangles']:,}" for a in fine))
    table.row("geometry with textures", "70 MB (30 + 40)", *(size_text(n) for n in sources))
    table.row("nodes", "34, 33", *both(lambda r: str(r["nodes"])))
    table.row("levels below the root", "3, 3", *both(lambda r: str(len(r["levels"]) - 1)))
    table.row("bytes of the BlockMaps", "1.3 MB, under 400 KB", *both(lambda r: size_text(r["blockmap_bytes"])))
    table.row("of these, fine / coarse", "over 3.2", *ratio("blockmap_bytes"))
    table.row("bytes a node", "38 KB, under 12 KB", *both(lambda r: size_text(r["blockmap_bytes"] / r["nodes"])))
    table.row("city folder", "", *both(lambda r: size_text(r["city_bytes"])))
    table.row("geometry / BlockMaps", "54, over 175", *(", ".join(digits(n / r["blockmap_bytes"]) for r in pair) for n, pair in zip(sources, pairs)))
    table.row("time of the bake", "66 min, 58 min", *both(lambda r: f"{r['seconds']:.1f} s"))
    table.row("of these, fine / coarse", "1.14", *ratio("seconds"))
    table.row("command", "", *(a["command"] for a in fine))
    return table


def flight_path(setup, name, city):
    """Half round a town, then down into it."""
    (x0, y0, z0), (x1, y1, z1) = json.loads((city / "city.json").read_text())["bounds"]
    x, y, reach = (x0 + x1) / 2, (y0 + y1) / 2, max(x1 - x0, y1 - y0)
    ring = lambda turn, r, z: (x + r * math.cos(turn), y + r * math.sin(turn), z0 + z)
    keys = [(1.5 * i, ring(-2.4 + 0.6 * i, reach * (0.9 - 0.1 * i), reach * (0.5 - 0.09 * i)), (x, y, z0 + 5)) for i in range(5)]
    keys.append((8.0, (x, y, z0 + reach * 0.1), (x - reach / 2, y + reach / 3, z0 + 2)))
    return write_path(setup.out / f"{name}.path.json", keys)


def frames(setup):
    """The frame rate of columns against that of the geometry, both by rays; and by rays against rasterised triangles."""
    table = Table("scene", "triangles", "columns, frames/s", "geometry, frames/s", "columns / geometry", "command")
    table.row("paper: Pompei, 50 buildings, both resolutions", "230,000", "32 (rays on a GPU)", "14 (rasterised on a GPU)", "2.3", "table 4.2")
    for name, source, _, cell, twice in towns(setup):
        say(f"flying over the town {name}")
        city, coarse = setup.out / f"town-{name}-meshes", setup.out / f"town-{name}-{twice}"
        report = bake(setup, city.name, source, "--cell", cell, "--ground", "none")
        if not coarse.is_dir():
            bake(setup, coarse.name, source, "--cell", twice, *LIKE_THE_PAPER)
        path = flight_path(setup, name, city)
        results = alternate(ROUNDS, {
            "columns": lambda: fly(setup, city, path, "--no-meshes"),
            "coarse": lambda: fly(setup, coarse, path, "--no-meshes"),
            "geometry": lambda: fly(setup, city, path, "--switch", "100000"),
            "both": lambda: fly(setup, city, path),
        })
        fps = {key: middle(flights, "fps") for key, flights in results.items()}
        rows = [(f"{name}, cell {cell} m", "columns"), (f"{name}, cell {twice} m", "coarse"), (f"{name}, both, chosen by error", "both")]
        for scene, key in rows:
            command = results[key][0]["command"] + ("; for the geometry `--switch 100000`" if key == "columns" else "")
            geometry = digits(fps["geometry"]) if key == "columns" else ""
            table.row(scene, f"{report['triangles']:,}", digits(fps[key]), geometry, digits(fps[key] / fps["geometry"]), command)
    flat(setup, table)
    return table


def flat(setup, table):
    """Rows of the program `flat`: rays through columns against rasterised triangles, on the same device."""
    report = setup.out / "flat.json"
    arguments = ["--cities", setup.out / "flat", "--sizes", "1000,10000,100000", "--frames", "640x360", "--no-cpu", "--rounds", str(ROUNDS)]
    say("rays against rasterised triangles")
    done = subprocess.run(setup.command("flat", *arguments, "--report", report), capture_output=True, text=True)
    if done.returncode != 0:
        table.row("synthetic city, triangles rasterised", "", "", "", "not measured: no Vulkan driver", setup.shown("flat", *arguments))
        return
    for i, row in enumerate(json.loads(report.read_text())):
        columns, geometry = 1e3 / row["gpu_ms"], 1e3 / row["triangles_ms"]
        scene = f"synthetic city of {row['buildings']:,}, {row['viewpoint']}, triangles rasterised"
        table.row(scene, f"{row['triangles']:,} drawn", digits(columns), digits(geometry), digits(columns / geometry), setup.shown("flat", *arguments) if i == 0 else "")


def views(setup):
    """The number of views: time and occlusion, against a bake with the most."""
    # Reads the tiles with the second decoder.
    from views import leaves

    source = setup.out / "building.city.jsonl"
    if not source.is_file():
        models.delft_building(setup.data / "delft-3dbag/delft.city.jsonl", source)
    table = Table("views", "paper", "bake, s", "of 256 views", "columns, of those of 1,024", "occlusion of roofs, RMS of 0 to 63", "command")
    options = ["--cell", "1", "--quality", "lossless", "--no-meshes", "--ground", "none"]
    numbers = [32, 64, 128, 256, 512, 1024]
    works = {n: (lambda n=n: bake(setup, f"views-{n}", source, *options, "--views", n)) for n in numbers}
    results = alternate(ROUNDS, works)
    found = {n: leaves(setup.out / f"views-{n}") for n in numbers}
    seconds = {n: middle(results[n], "seconds") for n in numbers}
    best = found[numbers[-1]]
    for n in numbers:
        shared = found[n].keys() & best.keys()
        rms = math.sqrt(sum((found[n][place] - best[place]) ** 2 for place in shared) / max(len(shared), 1))
        share = len(shared) / max(len(found[n].keys() | best.keys()), 1)
        paper = "30 to 40 s for the volume" if n == 256 else "faster, less exact" if n < 256 else ""
        command = results[n][0]["command"] if n == 32 else "same, other `--views`" if n == 64 else ""
        is_best = n == numbers[-1]
        table.row(f"{n:,}", paper, f"{seconds[n]:.2f}", digits(seconds[n] / seconds[256]), "" if is_best else f"{share:.5f}", "" if is_best else f"{rms:.2f}", command)
    return table


TABLES = {"vacca-models": single, "vacca-town": town, "vacca-frames": frames, "vacca-views": views}
