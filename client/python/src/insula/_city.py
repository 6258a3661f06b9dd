"""A baked city: its objects, pictures and analyses."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from . import _http, _picture
from ._analyses import Analyses
from ._picture import Picture
from ._programs import Error, arguments, is_address, local_path, run
from ._table import Form, table_of

Box = tuple[float, float, float, float]
"""West, south, east and north."""


def open(place: str | os.PathLike[str]) -> City:
    """Opens a baked city: its folder, or its address, such as `https://HOST/v1/cities/NAME`. Fails with `Error` if there is none."""
    return City(place)


class City(Analyses):
    """A baked city. `insula.open` and `insula.bake` make them.

    Pictures and maps are there for all cities; objects and analyses need the folder of the city on this machine.
    """

    def __init__(self, place: str | os.PathLike[str]) -> None:
        if is_address(place):
            self.place, self.manifest = _http.manifest_of(os.fspath(place))
        else:
            self.place = local_path(place)
            self.manifest = self._read_manifest()

    def _read_manifest(self) -> dict[str, Any]:
        path = Path(self.place) / "city.json"
        try:
            manifest = json.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise Error(f"{self.place}: there is no baked city here: {error.strerror}") from error
        except ValueError as error:
            raise Error(f"{path}: damaged: {error}") from error
        return manifest

    def __repr__(self) -> str:
        return f"<City {self.title!r} at {self._shown_place}>"

    @property
    def _shown_place(self) -> str:
        return _http.shown(self.place) if is_address(self.place) else self.place

    @property
    def name(self) -> str:
        """Name in addresses."""
        return self.manifest["name"]

    @property
    def title(self) -> str:
        """Title for people."""
        return self.manifest["title"]

    @property
    def crs(self) -> str | None:
        """Coordinate system, such as `EPSG:32632`."""
        return self.manifest.get("crs")

    @property
    def bounds(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Lowest and highest x, y and z in metres of the coordinate system."""
        low, high = self.manifest["bounds"]
        return tuple(low), tuple(high)

    @property
    def cell_m(self) -> float:
        """Width of the finest details in metres."""
        return self.manifest["cell_m"]

    @property
    def attribution(self) -> list[dict[str, Any]]:
        """Who must be named wherever the city is shown: `text`, `licence` and `url` of each source."""
        return self.manifest.get("attribution", [])

    @property
    def folder(self) -> Path:
        """Where the city is on this machine. Fails with `Error` if it is not."""
        if is_address(self.place):
            raise Error(f"{self._shown_place}: this needs the folder of the city, which is on another machine")
        return Path(self.place)

    def attributes(self) -> list[dict[str, Any]]:
        """The attributes that objects have: `name`, `type`, `count`, `min`, `max`, `top`."""
        return json.loads(run("insula-server", "objects", self.folder, "--json"))["attributes"]

    def describe(self, objects: int | Iterable[int]) -> list[dict[str, Any]]:
        """What is known of objects, by their numbers in pictures and tables."""
        numbers = [int(number) for number in np.atleast_1d(np.asarray(objects))]
        return json.loads(run("insula-server", "objects", self.folder, "--json", *arguments({"ids": _joined(numbers)})))

    def search(self, text: str, *, limit: int = 10) -> list[dict[str, Any]]:
        """Objects by starts of words of names, addresses and identifiers: `text`, `object`, `typos`."""
        return json.loads(run("insula-server", "search", "--json", f"--limit={limit}", "--", self.folder, text))

    def objects(
        self,
        as_: Form | None = None,
        *,
        bbox: Box | None = None,
        bbox_metres: Box | None = None,
        filter: str | None = None,
        parts: bool = False,
        polygon: str | os.PathLike[str] | None = None,
    ) -> Any:
        """A row for each object, with its footprint, heights and attributes.

        As a `geopandas.GeoDataFrame` in the city's coordinate system if GeoPandas is installed, else as a list of dicts with GeoJSON
        geometries in degrees; `as_` chooses. `filter` is as in "height > 20"; `parts` gives parts of buildings rows of their own.
        """
        limits = {"bbox": bbox, "bbox_metres": bbox_metres, "filter": filter, "parts": parts, "polygon": polygon}
        return table_of("export", self.folder, *arguments(limits), as_=as_, crs=self.crs)

    def render(
        self,
        camera: str | os.PathLike[str] | dict[str, Any] | None = None,
        *,
        size: tuple[int, int] = (1280, 720),
        distance: bool = False,
        objects: bool = False,
        **options: Any,
    ) -> Picture:
        """A picture of the city: an array of height x width x 3 bytes, which notebooks show.

        `camera` is a text `LON,LAT,HEIGHT,HEADING,PITCH[,FOV]` in degrees and metres, `view.camera` of a map, a copied link, a camera
        file or its content; without one the picture is the first view of the city. `at_street=(lon, lat, heading)` and
        `lookat=(lon, lat, height)` are cameras, too. `distance` and `objects` also fill `picture.distance` and `picture.objects` with `picture.seen`. Other keywords are the
        options of `insula snapshot`: `time`, `look`, `color_by`, `range`, `filter`, `others`, `legend`, `no_caption`, `tau`.
        """
        width, height = size
        with tempfile.TemporaryDirectory(prefix="insula-") as folder:
            paths = {name: Path(folder) / name for name in ("picture.png", "distance.pfm", "objects.bin", "objects.json")}
            if isinstance(camera, dict):
                paths["camera"] = Path(folder) / "camera.json"
                paths["camera"].write_text(json.dumps(camera), encoding="utf-8")
                camera = paths["camera"]
            files: dict[str, Any] = {"camera": camera, "size": f"{width}x{height}", "out": paths["picture.png"]}
            if distance:
                files["distance"] = paths["distance.pfm"]
            if objects:
                files.update(objects=paths["objects.bin"], objects_json=paths["objects.json"])
            run("insula", "snapshot", self.place, *arguments({**options, **files}))
            picture = Picture(paths["picture.png"].read_bytes())
            if distance:
                picture.distance = _picture.read_distance(paths["distance.pfm"])
            if objects:
                picture.objects = _picture.read_objects(paths["objects.bin"], (height, width))
                picture.seen = _picture.read_list(paths["objects.json"])
            return picture


def _joined(numbers: list[int]) -> str:
    return ",".join(str(number) for number in numbers)
