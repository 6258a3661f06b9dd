#!/usr/bin/env python3
"""Draws 3D Tiles with CesiumJS in headless Chromium.

cesium.py TILES --cesium FOLDER [--views FILE] [--out FOLDER]

TILES is what `insula-server export CITY --format 3dtiles --out TILES` writes, or the address of a tileset.json that a server offers.
FOLDER has `Cesium.js`, as `Build/Cesium` of a release
of CesiumJS. FILE is JSON, a list of `[name, eye, target]` in metres from the origin of the tileset's root; without it, four views from
far away to the street.

Prints for each view the bytes and files that are fetched in addition, the number of features, and what a click in the middle finds.
Writes the pictures to the folder of `--out`. Exits with 1 if a tile fails, a file is missing or the page has an error, and if no click
finds an object.
"""
import argparse, base64, http.server, json, pathlib, shutil, subprocess, sys, tempfile, threading, urllib.error, urllib.parse, urllib.request

VIEWS = [
    ["far", [0, -2500, 1500], [0, 0, 0]],
    ["mid", [-500, -600, 250], [100, 100, 20]],
    ["near", [-150, -250, 60], [100, 100, 10]],
    ["street", [-60, -100, 8], [200, 200, 20]],
]
# Longest time of all views, in seconds.
TIMEOUT = 300

PAGE = """<!doctype html><meta charset="utf-8">
<style>html, body, #view { margin: 0; width: 100%; height: 100% }</style><div id="view"></div>
<link rel="stylesheet" href="cesium/Widgets/widgets.css">
<script>CESIUM_BASE_URL = "cesium/"</script><script src="cesium/Cesium.js"></script><script src="start.js"></script>"""

START = """
const post = (path, body) => fetch(path, { method: 'POST', body });
const fail = (error) => post('error', String(error && error.stack || error));
window.onerror = fail;
window.onunhandledrejection = (event) => fail(event.reason);

function look(viewer, frame, eye, target) {
    const { Cartesian3, Matrix4 } = Cesium;
    const place = (v) => Matrix4.multiplyByPoint(frame, new Cartesian3(...v), new Cartesian3());
    const destination = place(eye);
    const up = Matrix4.multiplyByPointAsVector(frame, Cartesian3.UNIT_Z, new Cartesian3());
    const between = Cartesian3.subtract(place(target), destination, new Cartesian3());
    const direction = Cartesian3.normalize(between, new Cartesian3());
    const right = Cartesian3.normalize(Cartesian3.cross(direction, up, new Cartesian3()), new Cartesian3());
    viewer.camera.setView({ destination, orientation: { direction, up: Cartesian3.cross(right, direction, new Cartesian3()) } });
}

async function main() {
    const options = { baseLayer: false, baseLayerPicker: false, geocoder: false, timeline: false, animation: false,
        contextOptions: { webgl: { preserveDrawingBuffer: true } } };
    const viewer = new Cesium.Viewer('view', options);
    Object.assign(viewer.scene, { skyBox: undefined, skyAtmosphere: undefined, backgroundColor: Cesium.Color.LIGHTSKYBLUE });
    viewer.scene.globe.show = false;
    const loaded = Cesium.Cesium3DTileset.fromUrl('tiles/tileset.json', { dynamicScreenSpaceError: false });
    const tileset = viewer.scene.primitives.add(await loaded);
    tileset.tileFailed.addEventListener((event) => fail(`${event.url}: ${event.message}`));
    for (const [name, eye, target] of await (await fetch('views.json')).json()) {
        look(viewer, tileset.root.computedTransform, eye, target);
        // Tiles come level by level, so the view must stay complete for a while.
        for (let calm = 0; calm < 5; calm = tileset.tilesLoaded ? calm + 1 : 0) {
            viewer.scene.render();
            await new Promise((done) => setTimeout(done, 60));
        }
        viewer.scene.render();
        await post('picture?' + name, viewer.canvas.toDataURL('image/png'));
        const middle = new Cesium.Cartesian2(viewer.canvas.width / 2, viewer.canvas.height / 2);
        const picked = viewer.scene.pick(middle);
        const ids = picked && picked.getPropertyIds ? picked.getPropertyIds() : [];
        const object = Object.fromEntries(ids.map((id) => [id, String(picked.getProperty(id))]));
        const features = tileset.statistics.numberOfFeaturesSelected;
        await post('view', JSON.stringify({ name, features, object }));
    }
}
main().catch(fail).finally(() => post('done', ''));
"""


class Session:
    """What the page has fetched and said."""

    def __init__(self, options):
        self.options = options
        self.fetched, self.counted, self.errors, self.views = {}, set(), [], []
        self.done = threading.Event()

    def view(self, view):
        new = {path: size for path, size in self.fetched.items() if path not in self.counted}
        self.counted.update(new)
        self.views.append(view)
        identity = {key: value for key, value in view["object"].items() if key in ("identifier", "kind", "parent")}
        print(f"{view['name']}: {sum(new.values())} bytes in {len(new)} files, {view['features']} features, click: {identity or 'nothing'}")


def read(folder, name):
    """The bytes of a file in a folder or at a server; None if there is none."""
    if isinstance(folder, pathlib.Path):
        return (folder / name).read_bytes() if (folder / name).is_file() else None
    try:
        with urllib.request.urlopen(folder + name) as response:
            return response.read()
    except urllib.error.HTTPError:
        return None


def tiles_of(text):
    """The folder of tiles, or the address before `tileset.json`."""
    return text.removesuffix("tileset.json") if text.startswith("http://") else pathlib.Path(text)


def handler_of(session):
    options = session.options
    folders = {"tiles": options.tiles, "cesium": options.cesium}
    texts = {
        "/": ("text/html", PAGE),
        "/start.js": ("text/javascript", START),
        "/views.json": ("application/json", json.dumps(options.views)),
    }

    class Handler(http.server.BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, *_):
            pass

        def reply(self, status, body, kind="application/octet-stream"):
            self.send_response(status)
            self.send_header("content-type", kind)
            self.send_header("content-length", str(len(body)))
            try:
                self.end_headers()
                self.wfile.write(body)
            except ConnectionError:
                # The page has cancelled the request.
                self.close_connection = True

        def do_GET(self):
            path = urllib.parse.urlparse(self.path).path
            if path in texts:
                kind, text = texts[path]
                return self.reply(200, text.encode(), kind)
            folder, _, name = path.lstrip("/").partition("/")
            body = read(folders[folder], name) if folder in folders else None
            if body is None:
                if folder == "tiles":
                    session.errors.append(f"{path} is missing")
                return self.reply(404, b"")
            if folder == "tiles":
                session.fetched[path] = len(body)
            kinds = {".js": "text/javascript", ".css": "text/css", ".json": "application/json", ".wasm": "application/wasm"}
            self.reply(200, body, kinds.get(pathlib.PurePath(name).suffix, "application/octet-stream"))

        def do_POST(self):
            body = self.rfile.read(int(self.headers["content-length"]))
            path, _, name = self.path.lstrip("/").partition("?")
            if path == "error":
                session.errors.append(body.decode()[:500])
            elif path == "view":
                session.view(json.loads(body))
            elif path == "picture" and options.out:
                (options.out / f"{pathlib.Path(name).name}.png").write_bytes(base64.b64decode(body.partition(b",")[2]))
            elif path == "done":
                session.done.set()
            self.reply(200, b"")

    return Handler


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tiles", type=tiles_of, metavar="TILES")
    parser.add_argument("--cesium", type=pathlib.Path, required=True, metavar="FOLDER")
    parser.add_argument("--views", type=lambda path: json.loads(pathlib.Path(path).read_text()), default=VIEWS, metavar="FILE")
    parser.add_argument("--out", type=pathlib.Path, metavar="FOLDER")
    options = parser.parse_args()
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if not browser:
        sys.exit("no Chromium: install it")
    if not (options.cesium / "Cesium.js").is_file():
        sys.exit(f"{options.cesium} has no Cesium.js: give Build/Cesium of a release of CesiumJS")
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
    session = Session(options)
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler_of(session))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    flags = ["--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
    flags += ["--no-first-run", "--disable-background-networking", "--disable-component-update", "--window-size=1280,720"]
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        address = f"http://127.0.0.1:{server.server_port}/"
        process = subprocess.Popen([browser, *flags, f"--user-data-dir={profile}", address], stderr=subprocess.DEVNULL)
        if not session.done.wait(TIMEOUT):
            session.errors.append(f"not finished after {TIMEOUT} s")
        process.terminate()
        process.wait()
    size = sum(session.fetched.values())
    print(f"{len(session.fetched)} files, {size} bytes in all")
    if not any(view["object"] for view in session.views):
        session.errors.append("no click found an object")
    print("\n".join(f"FAILED {error}" for error in session.errors))
    sys.exit(1 if session.errors else 0)


if __name__ == "__main__":
    main()
