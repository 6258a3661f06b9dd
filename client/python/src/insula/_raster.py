"""Rasters: heights, hours of sun, and the other results of `insula-server analyse`."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from . import _tiff
from ._programs import Error


@dataclass
class Raster:
    """Values of square cells, row by row from the north."""

    array: np.ndarray
    """Height x width, float32. Cells without a value have `nodata`."""
    transform: tuple[float, float, float, float, float, float]
    """From columns and rows to metres, as `affine.Affine` has it: x = a * column + b * row + c, y = d * column + e * row + f."""
    crs: str | None
    """Such as `EPSG:32632`; None if the city's coordinate system is not known."""
    nodata: float | None
    title: str = ""
    """What the values are."""
    attribution: str = ""
    """Who must be named where the values are shown."""
    buildings: list[dict[str, Any]] = field(default_factory=list)
    """The table of buildings, if it was asked for: `pandas.DataFrame(raster.buildings)`."""

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Raster:
        """Reads a GeoTIFF file that Insula wrote."""
        content = _tiff.read(Path(path))
        west, north = content.north_west
        transform = (content.cell_m, 0.0, west, 0.0, -content.cell_m, north)
        crs = f"EPSG:{content.epsg}" if content.epsg else None
        return cls(content.values, transform, crs, content.nodata, content.title, content.attribution)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        height, width = self.array.shape
        return height, width

    @property
    def cell_m(self) -> float:
        """Side of a cell in metres."""
        return self.transform[0]

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east and north in metres."""
        cell, _, west, _, _, north = self.transform
        height, width = self.shape
        return west, north - height * cell, west + width * cell, north

    @property
    def values(self) -> np.ndarray:
        """A copy of the array with NaN in cells without a value."""
        out = self.array.copy()
        if self.nodata is not None:
            out[out == np.float32(self.nodata)] = np.nan
        return out

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """As `values`: without the mark of missing ones."""
        return self.values if dtype is None else self.values.astype(dtype, copy=False)

    def to_xarray(self) -> Any:
        """An `xarray.DataArray` with coordinates of the middles of cells, NaN for missing values, and the names that rioxarray reads."""
        try:
            import xarray
        except ImportError as error:
            raise Error("xarray is not installed: pip install 'insula[geo]'") from error
        west, _, _, north = self.bounds
        rows, columns = self.shape
        coordinates: dict[str, Any] = {
            "y": north - (np.arange(rows) + 0.5) * self.cell_m,
            "x": west + (np.arange(columns) + 0.5) * self.cell_m,
        }
        a, b, c, d, e, f = self.transform
        # GDAL has another order.
        place = {"GeoTransform": " ".join(repr(float(v)) for v in (c, a, b, f, d, e))}
        coordinates["spatial_ref"] = xarray.Variable((), 0, {**place, **({"crs_wkt": self.crs} if self.crs else {})})
        facts = {"long_name": self.title, "attribution": self.attribution, "grid_mapping": "spatial_ref"}
        return xarray.DataArray(self.values, coords=coordinates, dims=("y", "x"), name="values", attrs=facts)

    def to_rasterio_profile(self) -> dict[str, Any]:
        """Keywords of `rasterio.open(path, "w", **profile)`; `write(raster.array, 1)` then writes the values."""
        rows, columns = self.shape
        try:
            from affine import Affine

            transform: Any = Affine(*self.transform)
        except ImportError:
            transform = self.transform
        facts = {"driver": "GTiff", "dtype": "float32", "count": 1, "width": columns, "height": rows}
        return {**facts, "crs": self.crs, "transform": transform, "nodata": self.nodata}
