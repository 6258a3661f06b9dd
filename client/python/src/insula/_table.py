"""Tables that the programs write, as frames, Arrow tables or records."""

from __future__ import annotations

import json
import os
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

from ._programs import Error, run

Form = Literal["geopandas", "arrow", "records"]


def table_of(*words: str | os.PathLike[str], as_: Form | None, crs: str | None) -> Any:
    """Runs a command of the server that writes a table, and reads that. `as_` is as in `City.objects`."""
    if as_ is None:
        as_ = "geopandas" if find_spec("geopandas") and find_spec("pyarrow") else "records"
    # GeoParquet has types and metres; GeoJSON needs nothing to be read.
    suffix = "geojson" if as_ == "records" else "parquet"
    with tempfile.TemporaryDirectory(prefix="insula-") as folder:
        path = Path(folder) / f"table.{suffix}"
        run("insula-server", *words, f"--out={path}")
        return _read(path, as_, crs)


def _read(path: Path, as_: Form, crs: str | None) -> Any:
    if as_ == "records":
        features = json.loads(path.read_text(encoding="utf-8"))["features"]
        return [{**feature["properties"], "geometry": feature["geometry"]} for feature in features]
    try:
        if as_ == "arrow":
            import pyarrow.parquet

            return pyarrow.parquet.read_table(path)
        import geopandas

        frame = geopandas.read_parquet(path).drop(columns="bbox", errors="ignore")
        # The file has the parameters of the system; its code has also a name and an area.
        return frame.set_crs(crs, allow_override=True) if crs else frame
    except ImportError as error:
        raise Error(f"{error.name} is not installed: pip install 'insula[geo]', or ask for as_=\"records\"") from error
