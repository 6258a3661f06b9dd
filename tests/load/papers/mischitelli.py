"""Chapters 3 and 5 of Mischitelli's report: time of ambient occlusion, cost of the filters of translucency."""

import re

from .gasparello import refined
from .tools import Table, digits, say

VIEWS, MAP = 256, 1024
#: The report's times in seconds without and with a graphics card, with vertices in a buffer of the card.
PAPER = [("David", 125_275, 16.8, 3.3), ("Dragon", 437_645, 45.8, 8.3)]


def occlusion(setup):
    """The table of section 3.6.1."""
    table = Table("mesh", "vertices", "time, s", "million vertices and views a second", "command")
    for name, vertices, cpu, gpu in PAPER:
        for machine, seconds in (("CPU", cpu), ("GPU", gpu)):
            table.row(f"paper: {name}, {machine}", f"{vertices:,}", seconds, digits(vertices * VIEWS / seconds / 1e6), "section 3.6.1")
    for mesh in (setup.data / "meshes/bun_zipper.ply", setup.data / "meshes/nefertiti.obj", refined(setup, 1), refined(setup, 2)):
        say(f"occlusion of {mesh.stem}")
        arguments = ("ao", mesh, "--out", setup.out / f"{mesh.stem}-ao.ply", "--views", VIEWS, "--map", MAP)
        text, _ = setup.run("insula-server", *arguments)
        vertices = int(re.search(r"(\d+) vertices", text)[1])
        # Without reading and writing the files.
        seconds = float(re.search(r"([\d.]+) s$", text.strip())[1])
        table.row(f"ours: {mesh.stem}, CPU", f"{vertices:,}", f"{seconds:.2f}", digits(vertices * VIEWS / seconds / 1e6), setup.shown("insula-server", *arguments))
    return table


def translucency(setup):
    """The table of section 5.4: frames a second with 21 taps over those with 9 taps."""
    table = Table("object", "vertices", "21 taps", "9 taps", "time of 9 taps, of 21", "command")
    for name, vertices, fast, fine in (("Teapot", 39_800, 59.0, 31.0), ("Hebe", 63_932, 58.9, 29.2), ("Bunny", 69_451, 58.9, 28.5), ("Elephant", 13_714, 59.9, 29.9)):
        table.row(f"paper: {name}", f"{vertices:,}", f"{fine} frames/s", f"{fast} frames/s (limited by the screen)", f"at most {fine / fast:.2f}", "section 5.4")
    arguments = ("--cost",)
    text, _ = setup.run("translucency", *arguments)
    for triangles, fine, fast in re.findall(r"(\d+) triangles: 21 taps (\d+) ns, 9 taps (\d+) ns", text):
        row = (f"{int(triangles) // 2 + 2:,}", f"{fine} ns a point", f"{fast} ns a point", f"{int(fast) / int(fine):.2f}")
        table.row("ours: sphere, one thread", *row, setup.shown("translucency", *arguments))
    return table


TABLES = {"mischitelli-occlusion": occlusion, "mischitelli-translucency": translucency}
