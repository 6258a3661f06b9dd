#!/usr/bin/env python3
"""Measures cold starts of CesiumJS with a published 3D Tiles city, as `browser` measures those of Insula's page. Prints Markdown.

    tests/load/cesium.py --cesium BUILD --tiles FOLDER [--runs 3] [--browser PROGRAM] [OPTION...]

BUILD is CesiumJS's folder Build/Cesium (npm package cesium). FOLDER has .b3dm files whose glTF says where it is (CESIUM_RTC): all
become the tileset. Other options go to `browser` (--mbit, --rtt, --slow, --slow-what). Files are sent compressed by gzip.
"""
import argparse, functools, gzip, http.server, json, os, pathlib, struct, subprocess, tempfile, threading

HERE = pathlib.Path(__file__).resolve().parent
TARGET = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", HERE.parent.parent / "target")) / "release"
# Metres around a tile's centre, and around all.
TILE_RADIUS, CITY_RADIUS = 700, 1500
PAGE = """<!doctype html><meta charset="utf-8"><title>CesiumJS</title>
<style>html, body, #view { margin: 0; width: 100%; height: 100% }</style><div id="view"></div>
<script>CESIUM_BASE_URL = "cesium/"</script><link rel="stylesheet" href="cesium/Widgets/widgets.css">
<script src="cesium/Cesium.js"></script><script src="start.js"></script>
"""
# The first frame after all tiles of the first view are there.
START = """(async () => {
    const viewer = new Cesium.Viewer('view', {
        baseLayer: false, baseLayerPicker: false, geocoder: false, timeline: false, animation: false,
    });
    const tileset = viewer.scene.primitives.add(await Cesium.Cesium3DTileset.fromUrl('tileset.json'));
    tileset.initialTilesLoaded.addEventListener(() => {
        viewer.scene.postRender.addEventListener(() => { globalThis.firstPictureMs ??= performance.now(); });
    });
    viewer.zoomTo(tileset);
})();
"""


def centre(path):
    """The position of a tile's content on Earth, from its glTF."""
    data = path.read_bytes()
    gltf = data[28 + sum(struct.unpack("<4I", data[12:28])):]
    length = struct.unpack("<I", gltf[12:16])[0]
    return json.loads(gltf[20:20 + length])["extensions"]["CESIUM_RTC"]["center"]


def tileset(names, centres):
    """One level with all tiles."""
    middle = [sum(values) / len(values) for values in zip(*centres)]
    sphere = lambda at, radius: {"sphere": [*at, radius]}
    children = [{"boundingVolume": sphere(at, TILE_RADIUS), "geometricError": 0, "content": {"uri": f"tiles/{name}"}}
                for name, at in zip(names, centres)]
    root = {"boundingVolume": sphere(middle, CITY_RADIUS), "geometricError": 200, "refine": "ADD", "children": children}
    return {"asset": {"version": "1.0"}, "geometricError": 500, "root": root}


class Handler(http.server.SimpleHTTPRequestHandler):
    """Sends scripts and styles as gzip, made once."""

    made = {}

    def log_message(self, *_):
        pass

    def do_GET(self):
        path = self.translate_path(self.path)
        if not path.endswith((".js", ".css", ".json", ".html")) or not os.path.isfile(path):
            return super().do_GET()
        if path not in self.made:
            self.made[path] = gzip.compress(pathlib.Path(path).read_bytes(), 9)
        self.send_response(200)
        for name, value in [("content-type", self.guess_type(path)), ("content-encoding", "gzip"),
                            ("content-length", str(len(self.made[path])))]:
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(self.made[path])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cesium", type=pathlib.Path, required=True)
    parser.add_argument("--tiles", type=pathlib.Path, required=True)
    parser.add_argument("--browser", type=pathlib.Path, default=TARGET / "browser")
    arguments, options = parser.parse_known_args()
    names = sorted(path.name for path in arguments.tiles.glob("*.b3dm"))
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        (folder / "cesium").symlink_to(arguments.cesium.resolve())
        (folder / "tiles").symlink_to(arguments.tiles.resolve())
        (folder / "index.html").write_text(PAGE)
        (folder / "start.js").write_text(START)
        (folder / "tileset.json").write_text(json.dumps(tileset(names, [centre(arguments.tiles / n) for n in names])))
        handler = functools.partial(Handler, directory=folder)
        server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        page = f"http://127.0.0.1:{server.server_port}/"
        subprocess.run([arguments.browser, "--page", page, "--until", "globalThis.firstPictureMs", *options], check=True)


if __name__ == "__main__":
    main()
