#!/usr/bin/env python3
"""Compares `insula-server analyse CITY sun|sky|solar` with rays on the triangles of its source.

usage: analysis_truth.py SOURCE.city.jsonl CITY --server PROGRAM [--rule NAME] [--points N] [--seed N]

The source is CityJSON or CityJSONSeq of buildings on ground that is nearly level. The sun is that of pvlib, the rays are Embree's
(packages embreex, trimesh, pvlib, numpy, mapbox_earcut, tifffile, imagecodecs, shapely). Prints a line each for roofs and ground, by the raster and at given points, for the sky and for the sun of a year:
quantiles of the difference, and the share of places for which a rule's answer is the same.
"""
import argparse, csv, datetime, json, pathlib, subprocess, sys, tempfile

import mapbox_earcut as earcut
import numpy as np
import pvlib
import tifffile
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector


def triangles(path):
    """Triangles of all surfaces of the best level of each object, in metres of the source's system."""
    lines = [json.loads(line) for line in open(path, encoding="utf-8")]
    head = lines[0]
    out = []
    for feature in lines if len(lines) == 1 else lines[1:]:
        transform = head.get("transform") or {"scale": [1, 1, 1], "translate": [0, 0, 0]}
        vertices = np.array(feature["vertices"], float) * transform["scale"] + transform["translate"]
        for thing in feature["CityObjects"].values():
            geometries = [g for g in thing.get("geometry", []) if g["type"] in ("Solid", "MultiSurface", "CompositeSurface")]
            if not geometries:
                continue
            best = max(geometries, key=lambda g: str(g.get("lod", 0)))
            shells = best["boundaries"] if best["type"] == "Solid" else [best["boundaries"]]
            for rings in (surface for shell in shells for surface in shell):
                points = vertices[np.concatenate(rings)]
                normal = newell(vertices[rings[0]])
                keep = [k for k in range(3) if k != int(np.argmax(np.abs(normal)))]
                flat = np.ascontiguousarray(points[:, keep] - points[0, keep])
                ends = np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
                index = earcut.triangulate_float64(flat, ends)
                out.append(points[index].reshape(-1, 3, 3))
    return np.concatenate(out)


def newell(ring):
    following = np.roll(ring, -1, axis=0)
    return np.array([np.sum((ring[:, a] - following[:, a]) * (ring[:, b] + following[:, b])) for a, b in ((1, 2), (2, 0), (0, 1))])


def read_raster(path):
    with tifffile.TiffFile(path) as file:
        page = file.pages[0]
        values = page.asarray()
        tie, scale = page.tags["ModelTiepointTag"].value, page.tags["ModelPixelScaleTag"].value
    return values, tie[3:5], scale[0]


def sun_directions(manifest, date, first, last, minutes):
    """Directions to the sun in the middle of each step, true solar time, as rows of east, north, up of the city's grid."""
    place = manifest["location"]
    lat, lon, north = place["latitude_deg"], place["longitude_deg"], place["north_deg"]
    steps = int(round((last - first) * 60 / minutes))
    day = np.datetime64(date)
    noon = pvlib.solarposition.get_solarposition([str(day) + "T12:00:00Z"], lat, lon)
    ahead = float(noon["equation_of_time"].iloc[0]) / 60
    hours = first + (np.arange(steps) + 0.5) * minutes / 60 - lon / 15 - ahead
    times = [datetime.datetime.fromisoformat(date).replace(tzinfo=datetime.timezone.utc) + datetime.timedelta(hours=h) for h in hours]
    sun = pvlib.solarposition.get_solarposition(times, lat, lon)
    azimuth, altitude = np.radians(sun["azimuth"].values + north), np.radians(sun["elevation"].values)
    return np.stack([np.sin(azimuth) * np.cos(altitude), np.cos(azimuth) * np.cos(altitude), np.sin(altitude)], axis=1)


def year(manifest, turbidity):
    """Suns of a year under the clear sky of pvlib: directions, direct normal and diffuse irradiation of each in kWh/m2."""
    place = manifest["location"]
    lat, lon, north = place["latitude_deg"], place["longitude_deg"], place["north_deg"]
    days, minutes = 5, 30
    steps = [datetime.datetime(2025, 1, 3, tzinfo=datetime.timezone.utc) + datetime.timedelta(days=d, minutes=minutes * (i + 0.5))
             for d in range(0, 365, days) for i in range(24 * 60 // minutes)]
    sun = pvlib.solarposition.get_solarposition(steps, lat, lon)
    sun = sun[sun["elevation"] > 0.1]
    mass = pvlib.atmosphere.get_absolute_airmass(pvlib.atmosphere.get_relative_airmass(sun["apparent_zenith"]))
    sky = pvlib.clearsky.ineichen(sun["apparent_zenith"], mass, turbidity, dni_extra=pvlib.irradiance.get_extra_radiation(sun.index))
    azimuth, altitude = np.radians(sun["azimuth"].values + north), np.radians(sun["elevation"].values)
    directions = np.stack([np.sin(azimuth) * np.cos(altitude), np.cos(azimuth) * np.cos(altitude), np.sin(altitude)], axis=1)
    hours = days * minutes / 60 / 1000
    return directions, np.nan_to_num(sky["dni"].values) * hours, np.nan_to_num(sky["dhi"].values) * hours


def quantiles(name, difference, unit):
    text = ", ".join(f"p{q} {np.percentile(np.abs(difference), q):.3f}" for q in (50, 90, 95, 99))
    print(f"{name}: {len(difference)} points, {text} {unit}, mean {np.mean(difference):+.4f}, RMS {np.sqrt(np.mean(difference**2)):.4f}")


def compare(name, hours, truth):
    quantiles(name, (hours - truth) * 60, "min")
    same, near = np.mean((hours >= 2) == (truth >= 2)), np.mean(np.abs(hours - truth) <= 5.01 / 60)
    print(f"  the same answer to 2 hours: {same:.2%}; within 5 min: {near:.1%}")


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("source", type=pathlib.Path)
    args.add_argument("city", type=pathlib.Path)
    args.add_argument("--server", required=True)
    args.add_argument("--points", type=int, default=5000)
    args.add_argument("--seed", type=int, default=1)
    args = args.parse_args()
    random = np.random.default_rng(args.seed)
    manifest = json.load(open(args.city / "city.json"))
    folder = pathlib.Path(tempfile.mkdtemp())
    rule = folder / "rule.toml"
    rule.write_text('title = "21 March"\nsource = "a test"\ndays = ["03-21"]\nlowest_sun_deg = 5\nasked_hours = 2\n')
    run = lambda *more: subprocess.run([args.server, "analyse", args.city, *more], check=True, stdout=sys.stderr)
    run("sun", "--rule", rule, "--out", folder / "sun.tif")
    run("sky", "--out", folder / "sky.tif")
    run("solar", "--turbidity", "3", "--out", folder / "solar.tif")
    subprocess.run([args.server, "export", args.city, "--format", "geotiff", "--out", folder / "top.tif"], check=True, stdout=sys.stderr)
    hours, corner, cell = read_raster(folder / "sun.tif")
    sky, tops = read_raster(folder / "sky.tif")[0], read_raster(folder / "top.tif")[0]

    shape = triangles(args.source)
    centre = shape.reshape(-1, 3).mean(axis=0)
    low, high = shape.reshape(-1, 3).min(axis=0), shape.reshape(-1, 3).max(axis=0)
    mesh = trimesh.Trimesh(vertices=(shape - centre).reshape(-1, 3), faces=np.arange(len(shape) * 3).reshape(-1, 3), process=False)
    rays = RayMeshIntersector(mesh)

    # Middles of cells inside of the source, with the height of what is there in the source, or else of the city's ground.
    rows, columns = np.nonzero(tops > -9000)
    place = np.stack([corner[0] + (columns + 0.5) * cell, corner[1] - (rows + 0.5) * cell], axis=1)
    inside = np.all((place > low[:2] + 30) & (place < high[:2] - 30), axis=1)
    chosen = random.choice(np.nonzero(inside)[0], size=min(args.points * 2, int(inside.sum())), replace=False)
    rows, columns, place = rows[chosen], columns[chosen], place[chosen]
    start = np.column_stack([place, np.full(len(place), high[2] + 10)]) - centre
    hits, ray, hit_triangles = rays.intersects_location(start, np.tile([0, 0, -1.0], (len(start), 1)), multiple_hits=False)
    top = tops[rows, columns].astype(float)
    is_roof = np.zeros(len(place), bool)
    is_roof[ray] = True
    normals = np.tile([0.0, 0.0, 1.0], (len(place), 1))
    upward = mesh.face_normals[hit_triangles]
    normals[ray] = upward * np.sign(upward[:, 2:])
    height = top.copy()
    height[ray] = hits[:, 2] + centre[2]
    # Where the middle of a cell is a roof on one side and ground on the other, the place is not the same.
    same = np.abs(height - top) < 0.5
    origin = np.column_stack([place, height + 0.05]) - centre
    suns = sun_directions(manifest, "2025-03-21", 0, 24, 5)
    suns = suns[suns[:, 2] > np.sin(np.radians(5))]
    truth = np.zeros(len(origin))
    for sun in suns:
        truth += ~rays.intersects_any(origin, np.tile(sun, (len(origin), 1)))
    truth *= 5 / 60
    found = hours[rows, columns]
    print(f"{len(suns)} moments, {np.mean(~same):.1%} of the places left out: another surface within the cell")
    for name, which in (("roofs", is_roof), ("ground", ~is_roof)):
        which = which & same
        compare(f"sun on {name}", found[which], truth[which])
    # The same places as points, which are answered by rays on the city's triangles.
    table = folder / "points.csv"
    with open(table, "w") as file:
        file.write("x,y,z\n")
        for (x, y), z in zip(place, height):
            file.write(f"{x},{y},{z}\n")
    run("sun", "--rule", rule, "--points", table, "--out", folder / "sun.csv")
    with open(folder / "sun.csv") as file:
        at_points = np.array([float(row["hours"]) for row in csv.DictReader(file)])
    for name, which in (("roofs", is_roof), ("ground", ~is_roof)):
        compare(f"sun at points on {name}", at_points[which], truth[which])
    # The sky: 1,024 directions by the cosine.
    count = 1024
    i = np.arange(count) + 0.5
    radius, turn = np.sqrt(i / count), np.pi * (1 + 5**0.5) * i
    directions = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1 - radius**2)], axis=1)
    truth = np.zeros(len(origin))
    for direction in directions:
        truth += ~rays.intersects_any(origin, np.tile(direction, (len(origin), 1)))
    truth /= count
    for name, which in (("roofs", is_roof), ("ground", ~is_roof)):
        which = which & same
        quantiles(f"sky on {name}", (sky[rows, columns] - truth)[which], "")
    # The year: each sun on the surface as it is inclined, and an even sky above it.
    visible_sky = truth
    suns, direct, diffuse = year(manifest, 3)
    truth = diffuse.sum() * visible_sky
    for sun, energy in zip(suns, direct):
        facing = np.maximum(normals @ sun, 0)
        truth += energy * facing * ~rays.intersects_any(origin, np.tile(sun, (len(origin), 1)))
    solar = read_raster(folder / "solar.tif")[0]
    for name, which in (("roofs", is_roof), ("ground", ~is_roof)):
        which = which & same
        ratio = solar[rows, columns][which].sum() / truth[which].sum()
        quantiles(f"year on {name}", (solar[rows, columns] - truth)[which], "kWh/m2")
        print(f"  {truth[which].mean():.0f} kWh/m2 on average, {ratio:.3f} of it by the raster")


if __name__ == "__main__":
    main()
