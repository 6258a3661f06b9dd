"""What insula-server says: answers on standard output, progress and notes on standard error. Needs no QGIS."""

import json
import re

PROGRESS = re.compile(r"^(?:baking|analysing):(?: ([a-z][a-z -]*?))?(?: (\d+)%)? after (\d+) s(.*)$")


class Progress:
    """How far a stage of the work is: `percent` is None if that is unknown."""

    def __init__(self, stage, percent, text):
        self.stage, self.percent, self.text = stage, percent, text


def progress(line):
    """The progress that a line of standard error tells; None if it tells none."""
    found = PROGRESS.match(line)
    if not found:
        return None
    stage, percent, seconds, left = found.groups()
    text = f"{stage or 'computing'}, {seconds} s{left}"
    return Progress(stage or "", None if percent is None else min(100, int(percent)), text)


def level(line):
    """What kind of line of standard error this is, and its text: "error", "warning", "note" or ""."""
    for kind in ("error", "warning", "note"):
        if line.startswith(kind + ": "):
            return kind, line[len(kind) + 2 :]
    return "", line


def parse(text):
    """The answers of standard output with --json: one object in each line. Raises ValueError if it is anything else."""
    answers = []
    for line in text.splitlines():
        if line.strip():
            answer = json.loads(line)
            if not isinstance(answer, dict):
                raise ValueError(f"no answer of insula-server: {line[:80]}")
            answers.append(answer)
    return answers


def value_range(answer):
    """The least and the greatest value of a raster's cells: of roofs and ground, as those of walls are not in it. None without any."""
    parts = [answer.get(name) or {} for name in ("roofs", "ground")]
    least = [part["least"] for part in parts if part.get("least") is not None]
    most = [part["most"] for part in parts if part.get("most") is not None]
    return (min(least), max(most)) if least and most else None


def number(value):
    """A number with three digits, or whole."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def sentences(answer):
    """What an answer says, for a log."""
    lines = []
    for name in ("roofs", "walls", "ground"):
        part = answer.get(name) or {}
        if part.get("mean") is not None:
            mean, least, most = (number(part[key]) for key in ("mean", "least", "most"))
            lines.append(f"{name}: {mean} on average, {least} to {most}")
            if part.get("share_reaching") is not None:
                lines.append(f"{name}: {100 * part['share_reaching']:.1f}% reach what the rule asks for")
    lines += [str(note) for note in answer.get("notes") or []]
    if answer.get("attribution"):
        lines.append(f"name the source wherever this is shown: {answer['attribution']}")
    return lines
