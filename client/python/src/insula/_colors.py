"""Colours of values, for objects by their numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

# Stops of viridis, and the classes of Okabe and Ito (2008), which people tell apart who see fewer colours.
_RAMP = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37))
_CLASSES = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#f0e442", "#000000")


def colors(table: Any, column: str, *, id: str = "object", range: tuple[float, float] | None = None) -> dict[int, str]:
    """Colours of objects by a column: `map.colors = insula.colors(frame, "rent")`.

    `table` is a data frame or a list of dicts; its column `id` has the numbers of objects, as `City.objects` gives them. Numbers get
    a ramp from blue to yellow over `range`, by default from the least to the greatest; texts that are colours of CSS (`#rrggbb`) stay;
    other texts are classes, of which the first eight have colours. Rows without a value are left out.
    """
    rows = [(int(number), value) for number, value in _pairs(table, id, column) if not _is_missing(value)]
    values = [value for _, value in rows]
    if not all(_is_number(value) for value in values):
        return _of_classes(rows)
    low, high = range or (min(values, default=0), max(values, default=1))
    span = (high - low) or 1
    return {number: _of_share((value - low) / span) for number, value in rows}


def _pairs(table: Any, id: str, column: str) -> Any:
    if isinstance(table, list):
        return ((row[id], row.get(column)) for row in table)
    numbers = table.index if id not in table and getattr(table.index, "name", None) == id else table[id]
    return zip(numbers, table[column])


def _is_missing(value: Any) -> bool:
    return value is None or value != value or str(value) == "<NA>"


def _is_number(value: Any) -> bool:
    return hasattr(value, "__float__") and not isinstance(value, (str, bool))


def _of_share(share: float) -> str:
    at = min(max(float(share), 0.0), 1.0) * (len(_RAMP) - 1)
    first = min(math.floor(at), len(_RAMP) - 2)
    mixed = (round(a + (b - a) * (at - first)) for a, b in zip(_RAMP[first], _RAMP[first + 1]))
    return "#" + "".join(f"{channel:02x}" for channel in mixed)


def _of_classes(rows: list[tuple[int, Any]]) -> dict[int, str]:
    texts = [(number, str(value)) for number, value in rows]
    is_color = all(text.startswith("#") and len(text) in (4, 7) for _, text in texts)
    known: Mapping[str, str] = dict(zip(dict.fromkeys(text for _, text in texts), _CLASSES))
    return {number: text if is_color else known[text] for number, text in texts if is_color or text in known}
