"""What changed from one release of a city to the next. See docs/analyse.md."""

from __future__ import annotations

import os
from typing import Any

from ._city import Box, City
from ._programs import arguments
from ._table import Form, table_of


def changes(
    before: City | str | os.PathLike[str],
    after: City | str | os.PathLike[str],
    as_: Form | None = None,
    *,
    all: bool = False,
    attribute: str | list[str] | None = None,
    bbox: Box | None = None,
    bbox_metres: Box | None = None,
    height_step: float | None = None,
    same_footprint: float | None = None,
) -> Any:
    """A row for each building that was built, demolished or changed between two releases of a city; with `all`, for the others, too.

    The columns are those of `insula-server changes`: `change`, `what`, numbers, identifiers and heights before and after. Places decide
    which buildings are the same. As a `geopandas.GeoDataFrame` in the coordinate system of the later city, or as `City.objects` gives
    them; `as_` chooses.
    """
    cities = [city if isinstance(city, City) else City(city) for city in (before, after)]
    options = {
        "all": all,
        "attribute": attribute,
        "bbox": bbox,
        "bbox_metres": bbox_metres,
        "height_step": height_step,
        "same_footprint": same_footprint,
    }
    return table_of("changes", *(city.folder for city in cities), *arguments(options), as_=as_, crs=cities[1].crs)
