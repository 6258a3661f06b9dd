"""Draws the surfaces of a city with a naive painter, and with pyvista's vector export, to compare them with `insula draw`.

    python3 tests/tools/drawing_peer.py CITY.glb OUT.svg AZIMUTH,ELEVATION [--pyvista]

CITY.glb comes from `insula-server export CITY --format glb`. The painter draws all faces that are turned to the eye, the farthest
first. Prints what it wrote, the share of its polygons that nothing of the picture shows, and the share of pixels that show another
face than the nearest one. Needs numpy and pillow, and pyvista for its export.
"""

import argparse
import json
import math
import pathlib
import struct
import time

import numpy
from PIL import Image, ImageDraw

COMPONENTS = {5121: numpy.uint8, 5123: numpy.uint16, 5125: numpy.uint32, 5126: numpy.float32}
WIDTH, HEIGHT = 4000, 2800
# Metres by which a face must be behind the nearest one to be wrong.
SLACK_M = 0.05


def triangles(path):
    """Corners of all triangles, east, north and up in metres."""
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    gltf, blob = json.loads(data[20:20 + length]), data[28 + length:]

    def values(index, width):
        accessor = gltf["accessors"][index]
        view = gltf["bufferViews"][accessor["bufferView"]]
        kind = numpy.dtype(COMPONENTS[accessor["componentType"]])
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        stride = view.get("byteStride", kind.itemsize * width)
        return numpy.ndarray((accessor["count"], width), kind, blob, start, (stride, kind.itemsize)).astype(float)

    found = []
    for node in gltf["nodes"]:
        if "mesh" not in node:
            continue
        matrix = numpy.array(node["matrix"]).reshape(4, 4).T
        for primitive in gltf["meshes"][node["mesh"]]["primitives"]:
            points = values(primitive["attributes"]["POSITION"], 3) @ matrix[:3, :3].T + matrix[:3, 3]
            found.append(points[values(primitive["indices"], 1).astype(int).ravel()].reshape(-1, 3, 3))
    return numpy.concatenate(found)


def axes(azimuth, elevation):
    forward = numpy.array([math.sin(azimuth) * math.cos(elevation), math.cos(azimuth) * math.cos(elevation), -math.sin(elevation)])
    right = numpy.array([math.cos(azimuth), -math.sin(azimuth), 0.0])
    return right, numpy.cross(right, forward), forward


def paint(corners, view, out):
    """Writes the SVG file. Returns pixels, depths and the order of the triangles."""
    right, up, forward = view
    normals = numpy.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    corners = corners[normals @ forward < 0]
    depth = corners @ forward
    order = numpy.argsort(-depth.mean(axis=1), kind="stable")
    corners, depth = corners[order], depth[order]
    page = numpy.stack([corners @ right, corners @ -up], axis=-1)
    low, high = page.min(axis=(0, 1)), page.max(axis=(0, 1))
    page = (page - low) * min(WIDTH / (high - low)[0], HEIGHT / (high - low)[1])
    lines = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" fill="#f3ede2" stroke="#000">']
    lines += ['<path d="M%.2f %.2fL%.2f %.2fL%.2f %.2fz"/>' % tuple(points.ravel()) for points in page]
    out.write_text("\n".join(lines + ["</svg>\n"]))
    return page, depth


def judge(page, depth):
    """Shares of polygons that are hidden and of pixels that are wrong."""
    picture = Image.new("I", (WIDTH, HEIGHT), 0)
    draw = ImageDraw.Draw(picture)
    nearest = numpy.full((HEIGHT, WIDTH), numpy.inf)
    planes = numpy.zeros((len(page) + 1, 3))
    for number, (points, depths) in enumerate(zip(page, depth), 1):
        draw.polygon([tuple(point) for point in points], fill=number)
        matrix = numpy.column_stack([points, numpy.ones(3)])
        if abs(numpy.linalg.det(matrix)) < 1e-6:
            continue
        planes[number] = numpy.linalg.solve(matrix, depths)
        x0, y0 = numpy.floor(points.min(axis=0)).astype(int).clip(0)
        x1, y1 = numpy.ceil(points.max(axis=0)).astype(int)
        x, y = numpy.meshgrid(numpy.arange(x0, min(x1, WIDTH)), numpy.arange(y0, min(y1, HEIGHT)))
        turn = [(points[k - 1], points[k]) for k in range(3)]
        sides = [(b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) for a, b in turn]
        # A pixel from the border, where the two rules of rasterisation differ.
        widths = [numpy.hypot(*(b - a)) for a, b in turn]
        is_in = numpy.all([side > width for side, width in zip(sides, widths)], axis=0)
        is_in |= numpy.all([side < -width for side, width in zip(sides, widths)], axis=0)
        part = nearest[y0:y0 + x.shape[0], x0:x0 + x.shape[1]]
        here = planes[number][0] * x + planes[number][1] * y + planes[number][2]
        part[is_in] = numpy.minimum(part, here)[is_in]
    shown = numpy.asarray(picture)
    y, x = numpy.nonzero(numpy.isfinite(nearest) & (shown > 0))
    plane = planes[shown[y, x]]
    is_wrong = plane[:, 0] * x + plane[:, 1] * y + plane[:, 2] > nearest[y, x] + SLACK_M
    hidden = len(page) - (numpy.unique(shown) > 0).sum()
    return hidden / len(page), is_wrong.mean()


def export(corners, view, out):
    """Shapes and pictures in the SVG file that pyvista writes."""
    import pyvista
    mesh = pyvista.PolyData.from_regular_faces(corners.reshape(-1, 3), numpy.arange(corners.size // 3).reshape(-1, 3))
    plotter = pyvista.Plotter(off_screen=True, window_size=(WIDTH // 2, HEIGHT // 2))
    plotter.add_mesh(mesh)
    plotter.enable_parallel_projection()
    middle = numpy.array(mesh.center)
    plotter.camera_position = [middle - view[2] * mesh.length * 2, middle, (0, 0, 1)]
    plotter.reset_camera()
    plotter.save_graphic(out, raster=False)
    text = out.read_text()
    return {"version": pyvista.__version__, "polygons": text.count("<polygon") + text.count("<path"), "pictures": text.count("<image")}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("city", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("angles")
    parser.add_argument("--pyvista", action="store_true")
    args = parser.parse_args()
    corners = triangles(args.city)
    view = axes(*(math.radians(float(v)) for v in args.angles.split(",")))
    started = time.time()
    page, depth = paint(corners, view, args.out)
    seconds = time.time() - started
    hidden, wrong = judge(page, depth)
    print(json.dumps({"triangles": len(corners), "seconds": round(seconds, 2), "polygons": len(page), "hidden": round(float(hidden), 4),
                      "wrong": round(float(wrong), 5), "bytes": args.out.stat().st_size}))
    if args.pyvista:
        print(json.dumps(export(corners, view, args.out.with_suffix(".pyvista.svg"))))


if __name__ == "__main__":
    main()
