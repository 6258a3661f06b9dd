#!/usr/bin/env python3
"""Where the time of a frame goes on the CPU, of columns beside geometry: by parts of the ray-caster.

frame_profile.py RAYS CITY [CAMERA...] [--way TEXT] [--rounds N]

RAYS is the program of the profile `profiling`: cargo build --profile profiling -p insula-measure --bin rays

Draws frames of one ray a pixel on one thread, once of columns only and once of the finest meshes, under `perf record`. A sample
counts for the part to whose file the innermost of its inlined functions belongs that has one; arithmetic counts for its caller.
Without cameras, the default views of `rays` count together. Prints a table in Markdown. Needs perf and llvm-symbolizer.
"""
import argparse, collections, json, os, pathlib, re, statistics, subprocess, tempfile

#: Files of shaders/src/cpu and of packet/ in it.
PARTS = {
    "steps over the grid": ["walk.rs", "grid_walk.rs"],
    "nodes: entering, blocks, cells": ["node.rs", "node_rays.rs", "node_walk.rs"],
    "columns": ["column.rs", "solid.rs"],
    "triangles": ["mesh.rs", "mesh_surface.rs", "landmark.rs"],
    "light, haze, sky": ["shade.rs", "sky.rs", "sea.rs", "night.rs", "ward.rs", "stone.rs", "noise.rs", "translucency.rs"],
    "directions, segments, hits": ["raycast.rs", "ray.rs", "ray_packet.rs", "trace.rs", "hits.rs", "surface.rs", "objects.rs"],
    "radiance words, tone curve, frame": ["tone.rs", "frame.rs", "render.rs", "hit_counts.rs"],
}
REST = "the rest"
WAYS = ["columns", "geometry"]
LINE = re.compile(r"\bprimary\s+.+?\s+([\d.]+)\s+[\d.]+\s+([\d.]+)\s+([\d.]+)\s+([\d.]+)\s+([\d.]+)(?:\s|$)")
MAPPED = re.compile(r"\[0x([0-9a-f]+)\(0x([0-9a-f]+)\) @ (0x[0-9a-f]+|0) .*\]: r-xp (.+)$")


def part_of(files):
    """The part of the innermost of the files that has one."""
    for file in files:
        place = pathlib.PurePath(file)
        if "shaders" in place.parts:
            for part, names in PARTS.items():
                if place.name in names:
                    return part
    return REST


def address_of_offset(program):
    """Turns places in the file into addresses of the program's own numbering."""
    headers = subprocess.run(["readelf", "--program-headers", "--wide", program], check=True, capture_output=True, text=True).stdout
    rows = [line.split() for line in headers.splitlines() if line.split()[:1] == ["LOAD"]]
    loaded = [tuple(int(word, 16) for word in (row[1], row[2], row[4])) for row in rows]

    def address(offset):
        inside = [(start, to) for start, to, size in loaded if start <= offset < start + size]
        return offset - inside[0][0] + inside[0][1] if inside else None

    return address


def sampled(data, program):
    """How many samples each address of the program has; None for all that are elsewhere."""
    command = ["perf", "script", "-i", data, "--show-mmap-events", "-F", "ip"]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    address, maps, counts = address_of_offset(program), [], collections.Counter()
    for line in text.splitlines():
        mapped = MAPPED.search(line)
        if mapped:
            if os.path.basename(mapped[4]) == os.path.basename(program):
                start, size, offset = int(mapped[1], 16), int(mapped[2], 16), int(mapped[3], 16)
                maps.append((start, start + size, offset))
        elif re.fullmatch(r"\s*[0-9a-f]+\s*", line):
            ip = int(line, 16)
            places = [ip - start + offset for start, end, offset in maps if start <= ip < end]
            counts[address(places[0]) if places else None] += 1
    return counts


def parts_of(addresses, program):
    """The part of each address."""
    command = ["llvm-symbolizer", f"--obj={program}", "--inlines", "--output-style=JSON"]
    text = "".join(f"0x{address:x}\n" for address in addresses)
    lines = subprocess.run(command, input=text, check=True, capture_output=True, text=True).stdout.splitlines()
    found = [json.loads(line) for line in lines if line.strip()]
    return {int(one["Address"], 16): part_of([frame.get("FileName", "") for frame in one.get("Symbol", [])]) for one in found}


def profile(options, cameras, way):
    """Milliseconds of a frame by part, and what a ray reads."""
    with tempfile.TemporaryDirectory() as folder:
        data = f"{folder}/perf.data"
        command = ["perf", "record", "-e", "cpu-clock:u", "-F", "997", "-o", data, "--", options.rays, "--city", options.city]
        command += ["--draw", way, "--frames", "primary", "--only", options.way, "--rounds", str(options.rounds)]
        command += ["--camera", *cameras] if cameras else []
        one_thread = dict(os.environ, RAYON_NUM_THREADS="1")
        done = subprocess.run(command, check=True, capture_output=True, text=True, env=one_thread)
        counts = sampled(data, options.rays)
    views = [[float(number) for number in line.groups()] for line in LINE.finditer(done.stdout)]
    if not views:
        raise SystemExit(f"no view of a way with {options.way!r} in its name:\n{done.stdout}")
    ms, *reads = (statistics.mean(numbers) for numbers in zip(*views))
    parts = parts_of([address for address in counts if address is not None], options.rays)
    times = collections.Counter()
    for address, count in counts.items():
        times[parts.get(address, REST)] += count
    # Opening the city and fetching its tiles are no parts of a frame; they end up in the rest, which is therefore not given.
    cast = sum(count for part, count in times.items() if part != REST)
    return ms, {part: ms * times[part] / max(cast, 1) for part in PARTS}, reads


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rays")
    parser.add_argument("city")
    parser.add_argument("cameras", nargs="*")
    parser.add_argument("--way", default="AVX2", help="text in the name of a way of `rays`")
    parser.add_argument("--rounds", type=int, default=60)
    options = parser.parse_args()
    for camera in options.cameras or [None]:
        results = [profile(options, [camera] if camera else [], way) for way in WAYS]
        print(f"\n| {pathlib.Path(camera).stem if camera else 'default views'}, {options.way} | {' | '.join(WAYS)} | geometry / columns |")
        print("|---|---|---|---|")
        rows = [(f"{part}, ms", *(parts[part] for _, parts, _ in results)) for part in PARTS]
        rows.append(("a frame, ms", *(ms for ms, _, _ in results)))
        for name, k in (("nodes", 0), ("entries of the grid", 1), ("words of the atlas", 2), ("cells and triangles", 3)):
            rows.append((f"{name} a ray", *(reads[k] for _, _, reads in results)))
        for name, columns, geometry in rows:
            ratio = f"{geometry / columns:.2f}" if columns > 0 else ""
            print(f"| {name} | {columns:.2f} | {geometry:.2f} | {ratio} |", flush=True)


if __name__ == "__main__":
    main()
