"""Command lines of insula-server. Needs no QGIS.

Values are written as --name=value, so that one that begins with a hyphen is not taken for an option.
"""

import os
import shlex

# Rules of hours of sun that the program has.
RULES = [
    "en-17037",
    "nl-tno-light",
    "nl-tno-strict",
    "nl-the-hague",
    "jp-winter-solstice",
    "cn-great-cold",
    "cn-winter-solstice",
    "au-21-june",
    "uk-br209-apsh",
    "uk-br209-apsh-winter",
    "uk-br209-gardens",
]


class UsageError(ValueError):
    """What a user must change before a command can run."""


def _number(value):
    """A number as the program reads it, without an exponent."""
    text = f"{value:.9f}".rstrip("0").rstrip(".")
    return "0" if text in ("", "-0") else text


def _area(bbox):
    """West, south, east and north in degrees, or nothing."""
    if bbox is None:
        return []
    west, south, east, north = bbox
    if not (west < east and south < north):
        raise UsageError("the area is empty: choose one with a width and a height")
    return ["--bbox=" + ",".join(map(_number, bbox))]


def _text(name, value):
    """An option with a text, unless it is empty."""
    value = (value or "").strip()
    return [f"--{name}={value}"] if value else []


def _flag(name, value):
    return [f"--{name}"] if value else []


def _city(folder):
    if not os.path.isfile(os.path.join(folder, "city.json")):
        raise UsageError(f"{folder} is no baked city: choose a folder that has city.json")
    return folder


def further(text):
    """The words of options that a user writes, with the quotes of a shell."""
    try:
        return shlex.split(text or "")
    except ValueError as error:
        raise UsageError(f"further options: {error}") from error


def bake(inputs, out, *, crs="", bbox=None, cell_m=1.0, title="", height_field="", mode="", more=""):
    """Bakes files into a city. `mode` is "" (a new city), "update" or "resume"."""
    if not inputs:
        raise UsageError("choose a file or a folder to bake")
    if mode not in ("", "update", "resume"):
        raise UsageError(f"unknown mode {mode!r}: choose a new city, update or resume")
    options = [f"--out={out}", f"--cell={_number(cell_m)}", *_text("crs", crs), *_area(bbox)]
    options += [*_text("title", title), *_text("height-field", height_field), *_flag(mode, mode)]
    return ["bake", "--json", *options, *further(more), "--", *inputs]


def _analyse(city, what, out, bbox, options, more):
    return ["analyse", _city(city), what, "--json", f"--out={out}", *_area(bbox), *options, *further(more)]


def sun(city, out, *, rule="en-17037", bbox=None, buildings="", proposal="", more=""):
    """Hours of sun by a rule: the name of one, or a file."""
    options = [f"--rule={rule}", *_text("buildings", buildings), *_text("proposal", proposal)]
    return _analyse(city, "sun", out, bbox, options, more)


def sky(city, out, *, bbox=None, buildings="", proposal="", more=""):
    """Sky view factors."""
    options = [*_text("buildings", buildings), *_text("proposal", proposal)]
    return _analyse(city, "sky", out, bbox, options, more)


def solar(city, out, *, turbidity=3.0, weather="", bbox=None, buildings="", proposal="", more=""):
    """Energy of a year without clouds, or with the weather of an EPW file."""
    sky = _text("weather", weather) or [f"--turbidity={_number(turbidity)}"]
    options = [*sky, *_text("buildings", buildings), *_text("proposal", proposal)]
    return _analyse(city, "solar", out, bbox, options, more)


def shadow(city, out, *, time, time_zone="", bbox=None, proposal="", more=""):
    """Shadows at a time, such as 2025-12-21T10:00."""
    if not time:
        raise UsageError("choose a time")
    options = [f"--time={time}", *_text("time-zone", time_zone), *_text("proposal", proposal)]
    return _analyse(city, "shadow", out, bbox, options, more)


def view(city, out, *, eye, eye_height_m=1.6, target_height_m=0.0, bbox=None, proposal="", more=""):
    """Places that are visible from an eye at a longitude and latitude."""
    if eye is None:
        raise UsageError("choose the place of the eye")
    options = ["--from=" + ",".join(map(_number, [*eye, eye_height_m]))]
    options += [f"--target-height={_number(target_height_m)}", *_text("proposal", proposal)]
    return _analyse(city, "view", out, bbox, options, more)


def export(city, out, form, *, bbox=None, where="", parts=False, plain=False, more=""):
    """A city, or a part of it, in another format: flatgeobuf, geotiff, glb and so on. `plain` is for 3dtiles that QGIS opens."""
    options = [f"--format={form}", f"--out={out}", *_area(bbox), *_text("filter", where), *_flag("parts", parts)]
    options += _flag("plain", plain)
    return ["export", _city(city), "--json", *options, *further(more)]
