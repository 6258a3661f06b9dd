"""Questions that a city answers by rays, as rasters. See docs/analyse.md."""

from __future__ import annotations

import csv
import os
import tempfile
from pathlib import Path
from typing import Any

from ._programs import arguments, run
from ._raster import Raster

_TEXTS = ("identifier", "parent", "kind")


class Analyses:
    """The analyses of a city. All take an area as `bbox` in degrees or `bbox_metres`, and `out`, a path for the GeoTIFF file.

    Those of `insula-server analyse` also take its options, such as `proposal`, a file of what a plan would change, and `reach`.
    With `buildings=True`, the result has the table of buildings.
    """

    @property
    def folder(self) -> Path:
        """Where the city is on this machine."""
        raise NotImplementedError

    def heights(self, **options: Any) -> Raster:
        """Heights of ground and roofs in metres of the city's system."""
        return self._raster(["export", self.folder, "--format=geotiff"], False, options)

    def sun_hours(self, rule: str | os.PathLike[str] = "en-17037", *, buildings: bool = False, **options: Any) -> Raster:
        """Hours of sun by a rule: a name such as `en-17037`, or a TOML file."""
        return self._analyse("sun", buildings, {"rule": rule, **options})

    def sky_view(self, *, buildings: bool = False, **options: Any) -> Raster:
        """Sky view factors: the share of the light of an even sky that a level surface gets, 0 to 1."""
        return self._analyse("sky", buildings, options)

    def solar(self, *, buildings: bool = False, **options: Any) -> Raster:
        """Energy of sun and sky in a year without clouds, in kWh/m2 of each surface; with that of `weather`, an EPW file."""
        return self._analyse("solar", buildings, options)

    def shadow(self, time: str, **options: Any) -> Raster:
        """1 where shadow lies at a time, such as `2025-12-21T10:00+01:00`. Without an offset, `time_zone` counts."""
        return self._analyse("shadow", False, {"time": time, **options})

    def view(self, from_: tuple[float, float, float] | None = None, *, buildings: bool = False, **options: Any) -> Raster:
        """1 where the top of a cell is visible from an eye at (lon, lat, metres above the ground or roof).

        Instead of an eye: `of`, the outline of a planned building, with its `height`; or `vista`, a file of protected vistas.
        """
        return self._analyse("view", buildings, {"from": from_, **options})

    def _analyse(self, what: str, buildings: bool, options: dict[str, Any]) -> Raster:
        return self._raster(["analyse", self.folder, what], buildings, options)

    def _raster(self, command: list[Any], buildings: bool, options: dict[str, Any]) -> Raster:
        with tempfile.TemporaryDirectory(prefix="insula-") as folder:
            table = Path(folder) / "buildings.csv"
            files: dict[str, Any] = {"out": options.pop("out", None) or Path(folder) / "raster.tif"}
            if buildings:
                files["buildings"] = table
            run("insula-server", *command, *arguments({**options, **files}))
            raster = Raster.read(files["out"])
            if buildings:
                raster.buildings = _read_buildings(table)
            return raster


def _read_buildings(path: Path) -> list[dict[str, Any]]:
    """The rows of a table: texts of identifiers, else numbers where they are ones, and None where nothing is."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        rows = list(csv.DictReader(file))
    return [{name: _value(name, text) for name, text in row.items()} for row in rows]


def _value(name: str, text: str | None) -> Any:
    if not text or name in _TEXTS:
        return text or None
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
