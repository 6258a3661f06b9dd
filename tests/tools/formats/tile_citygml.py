#!/usr/bin/env python3
"""Repeats the members of a CityGML file over a grid until the file is as large as wanted.

    tile_citygml.py SRC.gml --bytes 1e9 --out big.gml

Coordinates are shifted; each copy has identifiers of its own, also in links and in the targets of textures. Everything else
stays as it is, byte for byte.

Needs only Python.
"""
import argparse, math, pathlib, re

MEMBER = re.compile(r"<((?:\w+:)?(?:cityObjectMember|appearanceMember|featureMember))\b[^>]*>.*?</\1>", re.S)
NUMBERS = re.compile(r"(<(?:\w+:)?(?:posList|pos|lowerCorner|upperCorner)\b[^>]*>)([^<]*)(</)")
IDS = re.compile(r"""((?:\w+:)?id=["'])([^"']+)(["'])""")
LINKS = re.compile(r"""(href=["']#|uri=["']#|ring=["']#)([^"']+)(["'])""")
TARGETS = re.compile(r"(<(?:\w+:)?target>#)([^<]+)(<)")


class Member:
    """A member's text in pieces: plain text, and lists of coordinates between them."""

    def __init__(self, text):
        for pattern in (IDS, LINKS, TARGETS):
            text = pattern.sub(r"\1\2@COPY@\3", text)
        self.pieces, end = [], 0
        for found in NUMBERS.finditer(text):
            self.pieces.append(text[end:found.start(2)])
            self.pieces.append([float(v) for v in found[2].split()])
            end = found.end(2)
        self.last = text[end:]

    def copy(self, number, shift, digits):
        out = []
        for piece in self.pieces:
            if isinstance(piece, str):
                out.append(piece.replace("@COPY@", f"_{number}"))
            else:
                axes = 3 if len(piece) % 3 == 0 else 2
                out.append(" ".join([f"{v + shift[i % axes]:.{digits}f}" for i, v in enumerate(piece)]))
        out.append(self.last.replace("@COPY@", f"_{number}"))
        return "".join(out)


def extent(members):
    """The lowest and highest first and second coordinate."""
    low, high = [math.inf] * 2, [-math.inf] * 2
    for member in members:
        for piece in member.pieces:
            if not isinstance(piece, str):
                axes = 3 if len(piece) % 3 == 0 else 2
                for axis in range(2):
                    values = piece[axis::axes]
                    low[axis], high[axis] = min(low[axis], *values), max(high[axis], *values)
    return low, high


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", metavar="SRC.gml")
    parser.add_argument("--bytes", type=float, required=True)
    parser.add_argument("--out", required=True)
    options = parser.parse_args()
    text = pathlib.Path(options.source).read_text(encoding="utf-8-sig")
    found = list(MEMBER.finditer(text))
    members = [Member(match[0]) for match in found]
    low, high = extent(members)
    # Degrees have small extents, and need more digits.
    in_degrees = max(map(abs, low + high)) <= 360
    step = [(high[axis] - low[axis]) * 1.02 for axis in range(2)]
    size = sum(len(match[0].encode()) for match in found)
    side = max(1, math.ceil(math.sqrt(options.bytes / size)))
    written, number = 0, 0
    with open(options.out, "w", encoding="utf-8") as out:
        written += out.write(text[:found[0].start()])
        while written < options.bytes:
            shift = (number % side * step[0], number // side * step[1], 0.0)
            for member in members:
                written += out.write(member.copy(number, shift, 10 if in_degrees else 4) + "\n")
            number += 1
        out.write(text[found[-1].end():])
    print(f"{number} copies of {len(members)} members")


if __name__ == "__main__":
    main()
