"""Chapter 5 of Gasparello's thesis: simplification, compression, and a scene of levels of detail."""

import json, re, statistics, subprocess

from . import models
from .tools import Table, alternate, bake, digits, fly, middle, say, size_text, write_path

ROUNDS = 3
#: Larger than any scene: the finest level of detail everywhere.
EVERYWHERE = "100000"


def scans(setup):
    """The public scans, and one of them refined to the size of the paper's."""
    folder = setup.data / "meshes"
    return [folder / "nefertiti.obj", folder / "skull.obj", folder / "bun_zipper.ply", refined(setup, 2)]


def refined(setup, times):
    """Nefertiti, subdivided `times` times. Each subdivision makes four triangles of one."""
    path = setup.out / f"nefertiti-x{4**times}.obj"
    if not path.is_file():
        say(f"making {path.name}")
        vertices, triangles = models.read_mesh(setup.data / "meshes/nefertiti.obj")
        for _ in range(times):
            vertices, triangles = models.subdivide(vertices, triangles)
        models.write_obj(path, [("nefertiti", vertices, triangles, None)])
    return path


def compare(setup, a, b):
    """Mean, RMS and largest distance in parts of the diagonal of `a`: of each the larger of both directions."""
    text, _ = setup.run("insula-server", "compare", a, b)
    number = r"([\d.]+) \("
    sides = [list(map(float, found)) for found in re.findall(rf"mean {number}[^,]*, RMS {number}[^,]*, largest {number}", text)]
    diagonal = float(re.search(r" is ([\d.]+)$", text.strip())[1])
    return [max(side[k] for side in sides) / diagonal for k in range(3)]


def parts(value):
    """A share of the diagonal in millionths."""
    return f"{value * 1e6:,.0f}" if value >= 1e-5 else f"{value * 1e6:.1f}"


# Simplification.


def errors(setup):
    """Figures 5.5 to 5.7: errors by the number of polygons."""
    table = Table("mesh", "triangles kept", "share", "mean", "RMS", "Hausdorff", "command")
    table.row("paper: Ragazzo, Madonna, Carter", "of 1,070,426 to 1,999,210", "down to 15 to 20%", "a few millionths", "a few millionths", "graph only", "figures 5.5 to 5.7")
    for mesh in scans(setup):
        say(f"simplifying {mesh.stem}")
        for ratio in (0.5, 0.2, 0.15, 0.1, 0.05, 0.01, 0.001):
            out = setup.out / f"{mesh.stem}-{ratio}.ply"
            arguments = ("simplify", mesh, out, "--ratio", ratio)
            text, _ = setup.run("insula-server", *arguments)
            kept = int(re.search(r"(\d+) of \d+ triangles", text)[1])
            is_first = ratio == 0.5
            command = f"{setup.shown('insula-server', *arguments)}, {setup.shown('insula-server', 'compare', mesh, out)}" if is_first else ""
            table.row(mesh.stem if is_first else "", f"{kept:,}", f"{ratio * 100:g}%", *map(parts, compare(setup, mesh, out)), command)
    return table


def frame_times(setup):
    """Figures 5.5 to 5.7: the time of a frame by the number of polygons."""
    table = Table("triangles drawn", "paper", "frame, median ms", "of the finest", "command")
    mesh, up = setup.data / "meshes/nefertiti.obj", "z"
    still = ((-10, -50, 35), (32, 32, 22))
    path = write_path(setup.out / "statue.path.json", [(0.0, *still), (4.0, *still)])
    works = {}
    for ratio in (1, 0.5, 0.2, 0.1, 0.01):
        small = setup.out / f"statue-{ratio}.obj"
        setup.run("insula-server", "simplify", mesh, small, "--ratio", ratio)
        vertices, triangles = models.read_mesh(small)
        models.write_obj(small, [("statue", models.upright(vertices, up, 48.0, (32, 32)), triangles, None)])
        city = setup.out / f"statue-{ratio}"
        bake(setup, city.name, small, "--ground", "none")
        works[ratio] = lambda city=city: fly(setup, city, path, "--switch", EVERYWHERE)
    results = alternate(ROUNDS, works)
    finest = middle(results[1], "median_ms")
    for ratio, flights in results.items():
        ms = middle(flights, "median_ms")
        table.row(f"{flights[0]['triangles']:,}", "falls with the polygons" if ratio == 1 else "", f"{ms:.1f}", digits(ms / finest), flights[0]["command"] if ratio == 1 else "")
    return table


def simplify_times(setup):
    """Figure 5.8: the time to simplify to nothing, by the number of polygons."""
    table = Table("mesh", "triangles", "to 1%, s", "million triangles a second", "command")
    table.row("paper: Ragazzo, Madonna, Carter, to none", "1,070,426 to 1,999,210", "a few tens, linear", "", "figure 5.8")
    meshes = [*scans(setup)[:3], refined(setup, 1), refined(setup, 2)]
    say("timing simplification")
    arguments = ["--times", "3", "--points", "1000", *meshes]
    text, _ = setup.run("mesh_simplify", *arguments)
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines()]
    times = {row[0]: float(row[4]) / 1e3 for row in rows if row[1:3] == ["0.01", "Insula"]}
    for i, mesh in enumerate(meshes):
        count = len(models.read_mesh(mesh)[1])
        seconds = times[mesh.stem]
        table.row(mesh.stem, f"{count:,}", f"{seconds:.2f}", digits(count / seconds / 1e6), setup.shown("mesh_simplify", *arguments) if i == 0 else "")
    return table


# Compression.


def one_point(setup, mesh):
    """The mesh with all vertices but one so near to each other that they take no bits. Returns it, with its counts."""
    vertices, triangles = models.read_mesh(mesh)
    welded = {}
    number = [welded.setdefault(place, len(welded)) for place in vertices]
    used = {number[v] for corners in triangles for v in corners}
    path = setup.out / f"{mesh.stem}-flat.obj"
    with open(path, "w") as file:
        file.write("v 1 0 0\n" + "".join(f"v {i * 1e-12:e} 0 0\n" for i in range(1, len(welded))))
        file.write("".join(f"f {number[a] + 1} {number[b] + 1} {number[c] + 1}\n" for a, b, c in triangles))
    return path, len(used), len(triangles)


def connectivity(setup, mesh):
    """Bytes of connectivity alone, vertices and triangles."""
    path, vertices, triangles = one_point(setup, mesh)
    coded = setup.out / f"{mesh.stem}-flat.insm"
    setup.run("insula-server", "compress", path, coded, "--bits", 8)
    return coded.stat().st_size, vertices, triangles


def compressed(setup):
    """Tables 5.2 and 5.3: shares and bits."""
    table = Table("mesh", "triangles", "binary file", "compressed", "saved", "connectivity, bits a vertex", "saved", "geometry, bits a vertex", "saved", "command")
    for row in (("Ragazzo", "2,000,000", "35,143 kB", "2,052 kB", "94.34%", "2.28", "98.81%", "14.2", "85.2%"),
                ("Madonna", "1,200,000", "21,104 kB", "1,364 kB", "93.65%", "2.31", "98.80%", "15.7", "83.7%"),
                ("Carter", "1,000,000", "19,267 kB", "1,273 kB", "94.40%", "2.64", "98.63%", "16.3", "83.0%")):
        table.row(f"paper: {row[0]}", *row[1:], "tables 5.2, 5.3")
    for mesh in scans(setup):
        say(f"compressing {mesh.stem}")
        coded = setup.out / f"{mesh.stem}.insm"
        arguments = ("compress", mesh, coded, "--bits", "12")
        setup.run("insula-server", *arguments)
        share, vertices, triangles = connectivity(setup, mesh)
        size, original = coded.stat().st_size, 12 * (vertices + triangles)
        saved = lambda bytes_now, before: f"{100 * (1 - bytes_now / before):.2f}%"
        bits = lambda number: f"{8 * number / vertices:.2f}"
        table.row(mesh.stem, f"{triangles:,}", f"{original / 1024:,.0f} kB", f"{size / 1024:,.0f} kB", saved(size, original), bits(share),
                  saved(share, 12 * triangles), bits(size - share), saved(size - share, 12 * vertices), setup.shown("insula-server", *arguments))
    return table


def coders(setup):
    """The paper's kind of coder on the same models, and Draco."""
    meshes = scans(setup)[:3]
    table = Table("mesh", "Insula, bits a vertex", "static Huffman codes of valences and parallelograms", "Draco, level 10", "encode, decode in memory, ms", "Draco, ms", "command")
    arguments = [word for mesh in meshes for word in ("--scan", mesh)] + ["--times", "5"]
    done = subprocess.run(setup.command("mesh_codec", *arguments), capture_output=True, text=True)
    if done.returncode != 0:
        table.row("not measured", "", "", "", "", "", "needs the Debian package `draco`")
        return table
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in done.stdout.splitlines()[2:]]
    for i, mesh in enumerate(meshes):
        own = {row[1]: row for row in rows if row[0] == mesh.stem}
        insula, draco, huffman = own["Insula"], own["Draco, cl 10"], own["static Huffman"]
        vertices = 8 * int(insula[2]) / (float(insula[4]) + float(insula[5]))
        bits = lambda row: f"{8 * int(row[2]) / vertices:.2f}"
        table.row(mesh.stem, bits(insula), bits(huffman), bits(draco), f"{insula[6]}, {insula[7]}", f"{draco[6]}, {draco[7]}",
                  setup.shown("mesh_codec", *arguments) if i == 0 else "")
    return table


def loading(setup):
    """Figure 5.11: time to compress, to decompress and to load."""
    table = Table("mesh", "triangles", "compress, s", "load compressed, s", "load binary, s", "compressed / binary", "command")
    table.row("paper: Ragazzo, Madonna, Carter", "1,070,426 to 1,999,210", "a few", "a few", "less", "over 1", "figure 5.11")
    for mesh in scans(setup):
        coded, binary, again = (setup.out / f"{mesh.stem}-load{end}" for end in (".insm", ".ply", "-again.insm"))
        setup.run("insula-server", "compress", mesh, coded, "--bits", "16")
        setup.run("insula-server", "decompress", coded, binary)

        def compress():
            text, seconds = setup.run("insula-server", "compress", binary, again)
            own = float(re.search(r"([\d.]+) s\b", text.split("per vertex")[1])[1])
            return own, seconds - own

        works = {"compress": compress, "decompress": lambda: setup.run("insula-server", "decompress", again, setup.out / "load-again.ply")[1]}
        works["compress"]()
        results = alternate(5, works)
        encode, load = (statistics.median(times) for times in zip(*results["compress"]))
        decode = middle(results["decompress"])
        count = len(models.read_mesh(mesh)[1])
        command = f"{setup.shown('insula-server', 'compress', binary, again)}, {setup.shown('insula-server', 'decompress', again, 'load-again.ply')}"
        table.row(mesh.stem, f"{count:,}", f"{encode:.2f}", f"{decode:.2f}", f"{load:.2f}", digits(decode / load), command)
    return table


def quantised(setup):
    """Figures 5.12 to 5.14: 10, 12 and 14 bits a coordinate."""
    table = Table("mesh", "bits", "connectivity", "geometry", "mean error", "RMS", "Hausdorff", "command")
    table.row("paper", "10", "the same", "least", "that of some thousand polygons", "", "", "figures 5.12 to 5.14")
    table.row("", "12 and more", "the same", "more", "a few millionths", "", "", "")
    for mesh in scans(setup):
        say(f"quantising {mesh.stem}")
        share, _, _ = connectivity(setup, mesh)
        for bits in (10, 12, 14):
            coded, back = setup.out / f"{mesh.stem}-{bits}.insm", setup.out / f"{mesh.stem}-{bits}.ply"
            arguments = ("compress", mesh, coded, "--bits", bits)
            setup.run("insula-server", *arguments)
            setup.run("insula-server", "decompress", coded, back)
            size = coded.stat().st_size
            row = [mesh.stem if bits == 10 else "", bits, size_text(share), size_text(size - share), *map(parts, compare(setup, mesh, back))]
            table.row(*row, setup.shown("insula-server", *arguments) if bits == 10 else "")
    return table


# The scene of 5 x 5 objects.

#: Distance of neighbouring statues, which is the switching distance of the base configuration.
SPACING_M = 64


#: The configurations that are also measured from a point that sees all statues.
STILL = ("levels off", "5 levels, d", "by screen-space error")


def scene_configurations():
    """Name, the paper's configuration and its result, and options of `fly`. A level that is left out has a centimetre."""
    by = lambda *distances: ["--switch", ",".join(f"{d:g}" for d in distances)]
    d = SPACING_M
    return [
        ("levels off", "table 5.5", "1 (at most 3 frames/s with all in view)", ["--switch", EVERYWHERE]),
        ("5 levels, d", "table 5.4, d = 4", "over 3", by(d, 2 * d, 3 * d, 4 * d)),
        ("5 levels, d / 2", "d = 2", "faster by about 800%", by(d / 2, d, 1.5 * d, 2 * d)),
        ("5 levels, 2 d", "d = 8", "slowest of the three", by(2 * d, 4 * d, 6 * d, 8 * d)),
        ("3 levels, 2 d", "table 5.6, d = 8", "slower than 5 levels", by(2 * d - 0.01, 2 * d, 4 * d - 0.01, 4 * d)),
        ("by screen-space error", "none", "none", ["--tau", "1"]),
    ]


def scene_city(setup):
    """Bakes the scene, unless that was done before. Returns the bake's report."""
    folder, source, city = setup.data / "meshes", setup.out / "statues.obj", setup.out / "statues"
    if not source.is_file():
        say("making the scene of 5 x 5 statues")
        models.statues(source, [(*models.read_mesh(folder / name), up) for name, up in (("nefertiti.obj", "z"), ("skull.obj", "y"), ("bun_zipper.ply", "y"))])
    if not (city / "city.json").is_file():
        say("baking the scene of 5 x 5 statues")
        return bake(setup, city.name, source, "--ground", "none", "--memory", "2GiB")
    return json.loads((setup.out / "statues.json").read_text())


def levels(setup):
    """Table 5.4: the levels of detail of a statue."""
    report = scene_city(setup)
    table = Table("level of a statue's leaf", "paper: triangles", "ours: triangles, mean of a leaf", "leaves that have it", "largest error, m")
    paper = ["200,000", "100,000", "50,000", "20,000", "10,000"]
    for lod in report["meshes"]:
        table.row(lod["lod"], paper[lod["lod"]], f"{lod['triangles'] / lod['leaves']:,.0f}", lod["leaves"], digits(lod["error_m"]))
    table.row("columns", paper[len(report["meshes"])], "64 x 64 columns", report["levels"][-1]["nodes"], "")
    return table


def scene(setup):
    """Figures 5.19 to 5.24."""
    scene_city(setup)
    city = setup.out / "statues"
    all_in_view = ((-230, -120, 130), (150, 150, 20))
    # The camera stands still at first, because most tiles are fetched there.
    keys = [(0.0, *all_in_view), (5.0, *all_in_view), (8.0, (0, 30, 40), (150, 150, 20)), (10.0, (128, 64, 20), (160, 224, 20)),
            (12.0, (192, 192, 20), (96, 256, 20)), (14.0, (320, 128, 40), (160, 160, 20))]
    path = write_path(setup.out / "statues.path.json", keys)
    still = write_path(setup.out / "statues-still.path.json", [(0.0, *all_in_view), (12.0, *all_in_view)])
    configurations = scene_configurations()
    flight = lambda path, options: lambda: fly(setup, city, path, *options)
    say("flying through the scene")
    flights = alternate(2, {name: flight(path, options) for name, _, _, options in configurations})
    stills = alternate(2, {name: flight(still, options) for name, _, _, options in configurations if name in STILL})
    table = Table("levels of detail", "paper", "paper: frames, of levels off", "ours: frames/s", "of levels off", "lacked tiles", "all in view: frame, ms", "triangles there", "bytes fetched", "command")
    off = middle(flights["levels off"], "fps")
    for name, paper, speed, _ in configurations:
        flown, view = flights[name], stills.get(name)
        fps = middle(flown, "fps")
        seen = (f"{middle(view, 'median_ms'):.0f}", f"{view[-1]['triangles']:,}") if view else ("", "")
        table.row(name, paper, speed, digits(fps), digits(fps / off), f"{100 * middle(flown, 'unconverged'):.0f}%", *seen,
                  size_text(middle(flown, "bytes")), flown[0]["command"])
    table.row("9 levels", "table 5.7, d = 2", "fastest", "not possible", "", "", "", "", "", "a leaf has at most 6 meshes and its columns")
    return table


TABLES = {
    "gasparello-errors": errors, "gasparello-frames": frame_times, "gasparello-simplify": simplify_times, "gasparello-compressed": compressed,
    "gasparello-coders": coders, "gasparello-loading": loading, "gasparello-bits": quantised, "gasparello-levels": levels, "gasparello-scene": scene,
}
