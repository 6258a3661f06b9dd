"""Bakes cities."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from ._city import City
from ._programs import arguments, local_path, run

_LINE = re.compile(r"baking: (\S+)(?: (\d+)%)? after (\d+) s(?:, (.+) left)?")


class Progress(NamedTuple):
    """How far a bake is."""

    stage: str
    """Name of the stage, and "done" at the end."""
    percent: int | None
    """Of the stage, if its length is known."""
    seconds: int
    """Since the start."""
    left: str | None
    """Time that the stage still takes, as in "11 min", if it is known."""


def bake(
    sources: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    progress: Callable[[Progress], object] | None = None,
    **options: Any,
) -> City:
    """Bakes city files into the folder `out`, and opens the city.

    `progress` is called every ten seconds, and at the end. What it raises ends the bake, as Ctrl-C does: the note of the exception
    says how to go on, with `resume=True`. Other keywords are the options of `insula-server bake`: `bbox`, `cell`, `title`, `crs`,
    `attribution`, `update`. Guesses of the bake are warnings. Fails with `Error` if the bake does.
    """
    several = [sources] if isinstance(sources, (str, os.PathLike)) else list(sources)
    seconds = 0

    def on_line(line: str) -> None:
        nonlocal seconds
        found = _LINE.fullmatch(line)
        if found:
            seconds = int(found[3])
            if progress:
                progress(Progress(found[1], int(found[2]) if found[2] else None, seconds, found[4]))

    paths = [os.fspath(source) for source in several]
    words = [f"--out={local_path(out)}", "--json", *arguments(options)]
    run("insula-server", "bake", *words, "--", *paths, on_line=on_line)
    if progress:
        progress(Progress("done", 100, seconds, None))
    return City(out)
