"""Whole cities in 3D: bake, render, analyse and show them.

>>> import insula
>>> city = insula.bake("monaco.osm.pbf", "monaco", cell=3)
>>> city.render(size=(640, 360))  # an array, which notebooks show
>>> city.objects()                # a GeoDataFrame
>>> insula.Map(city)              # a widget

The programs `insula` and `insula-server` do the work. They are part of the wheel; INSULA_PROGRAMS_DIR names the folder of others.
"""

from __future__ import annotations

from importlib import metadata
from typing import TYPE_CHECKING, Any

from ._bake import Progress, bake
from ._changes import changes
from ._city import City, open
from ._colors import colors
from ._picture import NO_OBJECT, Picture
from ._programs import Error, run
from ._raster import Raster
from ._serve import Server, serve

if TYPE_CHECKING:
    from ._map import Map

__all__ = [
    "NO_OBJECT",
    "City",
    "Error",
    "Map",
    "Picture",
    "Progress",
    "Raster",
    "Server",
    "bake",
    "changes",
    "colors",
    "open",
    "run",
    "serve",
]

try:
    __version__ = metadata.version("insula")
except metadata.PackageNotFoundError:  # From the sources.
    __version__ = "0"


def __getattr__(name: str) -> Any:
    """The widget needs what the rest does not."""
    if name == "Map":
        try:
            from ._map import Map
        except ImportError as error:
            raise Error("anywidget is not installed: pip install 'insula[widget]'") from error
        return Map
    raise AttributeError(f"module 'insula' has no attribute {name!r}")
