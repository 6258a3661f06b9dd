"""Colours of results: stops of a ramp from the lowest to the highest value. Needs no QGIS."""

from . import answers

# Perceptually even and readable without colours: cividis, dark to light.
EVEN = ["#00224e", "#35456c", "#666970", "#948e77", "#c8b866", "#fee838"]
# Below and above zero, for what a proposal changes.
BOTH_WAYS = ["#b2182b", "#ef8a62", "#f7f7f7", "#67a9cf", "#2166ac"]
# Units for people, by the unit of an answer.
UNITS = {"hours": "h", "percent": "%", "kwh_m2": "kWh/m2"}


def stops(what, values, is_change=False):
    """Values with their colours and labels. `what` is the analysis, `values` its least and greatest value.

    Yes and no have two colours; a change has white where nothing changes."""
    if what in ("shadow", "view") and not is_change:
        words = {"shadow": ("sun", "shadow"), "view": ("hidden", "visible")}[what]
        colours = {"shadow": ("#fff3c4", "#2b3350"), "view": ("#d9d9d9", "#e6550d")}[what]
        return [(0.0, colours[0], words[0]), (1.0, colours[1], words[1])]
    if is_change:
        reach = max(abs(values[0]), abs(values[1])) or 1.0
        return _spread(-reach, reach, BOTH_WAYS)
    low, high = values
    return _spread(low, high if high > low else low + 1.0, EVEN)


def _spread(low, high, colours):
    steps = len(colours) - 1
    places = [low + (high - low) * step / steps for step in range(steps + 1)]
    return [(place, colour, answers.number(place)) for place, colour in zip(places, colours)]


def is_discrete(what, is_change):
    """Whether a result has few values with a meaning each."""
    return what in ("shadow", "view") and not is_change


def unit(name):
    """The unit of values for people; empty for shares."""
    return UNITS.get(name, "")


# Kinds of objects, in the order of legends.
KINDS = {
    "building": "#c9b79c",
    "building-part": "#d8c9b2",
    "bridge": "#8c8c8c",
    "tunnel": "#6b6b6b",
    "road": "#b0b0b0",
    "rail": "#7d6b7d",
    "water": "#8ab6d6",
    "vegetation": "#8fb573",
    "land-use": "#d5e0b8",
    "furniture": "#c48f5c",
    "relief": "#bfa782",
    "generic": "#a9a9a9",
}
