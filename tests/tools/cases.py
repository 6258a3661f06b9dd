#!/usr/bin/env python3
"""Bakes small files with known faults, and compares the cities with what is right.

cases.py FOLDER [--program PATH] [--list FILE] [--only TEXT]

Each case is a file or folder in FOLDER, with the right values in a list: `cases.json` in FOLDER, else the one beside this
script. Prints a line for each case, and exits with 1 if one is wrong. Files of the list that FOLDER lacks are left out, and
said so. Needs only Python 3.9.

The list is a JSON array of objects; all members but the first are optional:

    file      path in FOLDER
    options   options of `bake`
    place     longitude and latitude of a corner in degrees: one of a footprint must be within 1 m
    heights   lowest and highest height of each object in metres, in any order: within 0.05 m
    range     lowest and highest height of all objects in metres: within 0.5 m, for terrain
    areas     area of each object on the map in square metres, in any order: within 0.1%
    count     number of objects
    warning   texts that the warnings must have
    report    texts that the report must have
    error     texts that the error must have: the file must be refused
    why       what goes wrong in other programs
"""
import argparse, json, math, pathlib, subprocess, sys, tempfile

PLACE_M = 1.0
HEIGHT_M = 0.05
RANGE_M = 0.5
AREA_SHARE = 1e-3
EARTH_M = 6_371_000.0
TIMEOUT_S = 120


def main():
    here = pathlib.Path(__file__).resolve().parent
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--program", default="target/release/insula-server", help="insula-server")
    parser.add_argument("--list", type=pathlib.Path, help="the cases [default: FOLDER/cases.json, else that of this script]")
    parser.add_argument("--only", default="", help="only cases whose file has this text")
    args = parser.parse_args()
    own = args.folder / "cases.json"
    path = args.list or (own if own.is_file() else here / "cases.json")
    cases = [case for case in json.loads(path.read_text(encoding="utf-8")) if args.only in case["file"]]
    wrong = 0
    for case in cases:
        source = args.folder / case["file"]
        name = " ".join([case["file"], *case.get("options", [])])
        if not source.exists():
            print(f"absent  {name}")
            continue
        faults, values = check(args.program, source, case)
        wrong += bool(faults)
        print(f"{'WRONG' if faults else 'right':7} {name}: {'; '.join(faults) or values}", flush=True)
    print(f"{wrong} of {len(cases)} wrong")
    sys.exit(1 if wrong else 0)


def run(arguments):
    result = subprocess.run([str(a) for a in arguments], capture_output=True, text=True, errors="replace", timeout=TIMEOUT_S)
    return result.returncode, result.stdout + result.stderr


def check(program, source, case):
    """What is wrong with a case, and its values in words."""
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        city, report = folder / "city", folder / "report.json"
        bake = [program, "bake", source, "--out", city, "--cell", "0.25", "--ground", "none", "--no-street-sets"]
        try:
            status, output = run([*bake, "--report", report, *case.get("options", [])])
        except subprocess.TimeoutExpired:
            return [f"not baked within {TIMEOUT_S} s"], ""
        if "error" in case:
            missing = [text for text in case["error"] if text not in output]
            if status == 0:
                return ["baked, although it has to be refused"], ""
            return [f"the error lacks \"{text}\": {last_line(output)}" for text in missing], "refused"
        if status != 0:
            return [f"refused: {last_line(output)}"], ""
        faults = [f"no warning has \"{text}\"" for text in case.get("warning", []) if text not in output]
        text = report.read_text(encoding="utf-8")
        faults += [f"the report lacks \"{part}\"" for part in case.get("report", []) if part not in text]
        if "range" in case:
            faults += check_range(program, source, case)
        objects, failures = read_objects(program, city, folder)
        return faults + failures + compare(case, objects), describe(objects)


def check_range(program, source, case):
    status, output = run([program, "inspect", source, "--json", *case.get("options", [])])
    if status != 0:
        return [f"not inspected: {last_line(output)}"]
    low, high = (corner[2] for corner in json.loads(output[output.index("{"):])["bounds"])
    if max(abs(low - case["range"][0]), abs(high - case["range"][1])) > RANGE_M:
        return [f"from {low:.2f} to {high:.2f} m, not from {case['range'][0]} to {case['range'][1]} m"]
    return []


def last_line(text):
    lines = [line for line in text.splitlines() if line.strip()]
    return lines[-1][:300] if lines else "no message"


def read_objects(program, city, folder):
    """Corners in degrees, heights and areas of all objects from two exports, and what failed."""
    corners, objects = [], []
    places, seq = folder / "city.geojson", folder / "city.jsonl"
    # A city without a coordinate system has no places.
    if run([program, "export", city, "--format", "geojson", "--out", places])[0] == 0:
        for feature in json.loads(places.read_text(encoding="utf-8"))["features"]:
            corners += list(positions((feature.get("geometry") or {}).get("coordinates", [])))
    status, output = run([program, "export", city, "--format", "cityjsonseq", "--out", seq])
    if status != 0:
        return {"corners": corners, "objects": []}, [f"not exported: {last_line(output)}"]
    lines = seq.read_text(encoding="utf-8").splitlines()
    transform = json.loads(lines[0])["transform"]
    for line in lines[1:]:
        objects += read_feature(json.loads(line), transform)
    return {"corners": corners, "objects": objects}, []


def positions(coordinates):
    if coordinates and isinstance(coordinates[0], (int, float)):
        yield coordinates[:2]
        return
    for part in coordinates:
        yield from positions(part)


def read_feature(feature, transform):
    """Lowest and highest height, and the area of the faces that look up, of each object of a feature with a shape."""
    vertices = [[v * s + t for v, s, t in zip(vertex, transform["scale"], transform["translate"])]
                for vertex in feature["vertices"]]
    found = []
    for city_object in feature["CityObjects"].values():
        faces = [face for geometry in city_object.get("geometry", []) for face in faces_of(geometry["boundaries"])]
        heights = [vertices[index][2] for face in faces for ring in face for index in ring]
        if heights:
            # Holes turn the other way and count as negative.
            areas = [sum(area_on_map([vertices[index] for index in ring]) for ring in face) for face in faces]
            area = sum(max(area, 0.0) for area in areas)
            found.append((min(heights), max(heights), area))
    return found


def faces_of(boundaries):
    """Faces of any nesting, each a list of rings of indices, the outer one first."""
    if boundaries and boundaries[0] and isinstance(boundaries[0][0], int):
        yield boundaries
        return
    for part in boundaries:
        yield from faces_of(part)


def area_on_map(ring):
    origin = ring[0]
    points = [(x - origin[0], y - origin[1]) for x, y, _ in ring]
    pairs = zip(points, points[1:] + points[:1])
    return sum(ax * by - ay * bx for (ax, ay), (bx, by) in pairs) / 2


def distance_m(a, b):
    east = math.radians(a[0] - b[0]) * math.cos(math.radians(b[1]))
    return math.hypot(east, math.radians(a[1] - b[1])) * EARTH_M


def compare(case, found):
    objects, faults = found["objects"], []
    if "count" in case and len(objects) != case["count"]:
        faults.append(f"{len(objects)} objects, not {case['count']}")
    if "place" in case:
        nearest = min(found["corners"], key=lambda corner: distance_m(corner, case["place"]), default=None)
        if nearest is None or distance_m(nearest, case["place"]) > PLACE_M:
            faults.append(f"at {nearest}, not {case['place']}")
    if "heights" in case:
        actual = sorted((low, high) for low, high, _ in objects)
        wanted = sorted(map(tuple, case["heights"]))
        if len(actual) != len(wanted) or any(
                abs(a - w) > HEIGHT_M for pair, right in zip(actual, wanted) for a, w in zip(pair, right)):
            faults.append(f"heights {rounded(actual)}, not {case['heights']}")
    if "areas" in case:
        actual, wanted = sorted(area for *_, area in objects), sorted(case["areas"])
        if len(actual) != len(wanted) or any(abs(a - w) > AREA_SHARE * w for a, w in zip(actual, wanted)):
            faults.append(f"areas {rounded(actual)}, not {case['areas']}")
    return faults


def rounded(values):
    return [rounded(value) if isinstance(value, tuple) else round(value, 3) for value in values]


def describe(found):
    corner = min(found["corners"], default=None)
    place = f"{corner[0]:.5f}, {corner[1]:.5f}, " if corner else ""
    heights = ", ".join(f"{low:.2f} to {high:.2f} m" for low, high, _ in found["objects"][:3])
    return f"{place}{len(found['objects'])} objects, {heights}"


if __name__ == "__main__":
    main()
