"""Chapter 3 of Mischitelli's report: the time of ambient occlusion."""

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


TABLES = {"mischitelli-occlusion": occlusion}
