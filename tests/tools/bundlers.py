#!/usr/bin/env python3
"""Builds pages with the packed npm package, one for each way of using it, and draws a city in each in headless Chromium.

bundlers.py CITY --server PROGRAM [--package FOLDER] [--out FOLDER] [--keep FOLDER] [WAY ...]

CITY is a baked city whose manifest has a location, PROGRAM `insula-server`, FOLDER of `--package` what `client/web/build` writes into
`client/web/dist/package`. A WAY is one of vite, vite-dev, webpack, esbuild, next, plain and types; without any, all are tried.

npm packs the package and installs it with the newest bundlers from the registry. Each page is `bundlers/main.js` as it is: it draws the
city, uses degrees, gives objects a colour, draws GeoJSON, adds a model and casts without an element. `types` has no page: it compiles `bundlers/types.tsx`. Prints a line for each
way, writes the pictures to the folder of `--out`, and exits with 1 if a build fails, a page has an error or a picture shows no city.
"""
import argparse, contextlib, functools, http.server, json, os, pathlib, re, shutil, signal, subprocess, sys, tempfile, threading, time
import urllib.parse, urllib.request

HERE = pathlib.Path(__file__).resolve().parent
# Longest time of a build and of a page, in seconds.
BUILD_S, PAGE_S = 300, 180
# Different colours of a picture that shows a city.
COLOURS = 60
FLAGS = ["--headless=new", "--no-sandbox", "--no-first-run", "--disable-background-networking", "--disable-component-update",
         "--disable-gpu", "--disable-dev-shm-usage", "--window-size=800,600"]

HTML = '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}</title><link rel="icon" href="data:,">' \
       '{head}</head><body>{body}</body></html>'
SCRIPT = '<script type="module" src="{src}"></script>'
# The package is imported where the page is made, too; the page's script runs in browsers only.
NEXT_PAGE = """'use client';
import '@insula/viewer';
import { useEffect } from 'react';

export default function Page() {
  useEffect(() => {
    import('./main.js');
  }, []);
  return <p>A city.</p>;
}
"""
NEXT_LAYOUT = "export default function Layout({ children }) {\n  return <html lang=\"en\"><body>{children}</body></html>;\n}\n"


class Way:
    """A way to use the package: what is installed, which files there are, how they are built, and what is served."""

    def __init__(self, install=(), files=None, build=None, serve=None, folder="."):
        self.install, self.files, self.build, self.serve, self.folder = install, files or {}, build, serve, folder


def page(src):
    return HTML.format(title="city", head="", body=SCRIPT.format(src=src))


IMPORTS = {"@insula/viewer": "city", **{f"@insula/viewer/{name}": name for name in ("caster", "maplibre", "three")}}
IMPORTS = {name: f"./node_modules/@insula/viewer/insula-{file}.js" for name, file in IMPORTS.items()}
IMPORT_MAP = f'<script type="importmap">{json.dumps({"imports": IMPORTS})}</script>'
# esbuild copies no files that scripts name: workers, module and shaders are entries of their own.
ESBUILD = ["npx", "esbuild", "main.js", "@insula/viewer/engine.js", "@insula/viewer/cast-engine.js", "@insula/viewer/helper.js",
           "@insula/viewer/insula_web_gpu.js", "@insula/viewer/insula_web_objects.js",
           *(f"@insula/viewer/insula_web{part}_bg.wasm" for part in ("", "_gpu", "_meshes", "_objects")), "@insula/viewer/shaders.txt",
           "--bundle", "--format=esm", "--loader:.wasm=copy", "--loader:.txt=copy", "--entry-names=[name]", "--outdir=dist"]
TSC = ["npx", "tsc", "--noEmit", "--strict", "--target", "es2022", "--module", "esnext", "--moduleResolution", "bundler", "--jsx",
       "react-jsx", "types.tsx"]
NEXT_FILES = {"app/page.jsx": NEXT_PAGE, "app/layout.jsx": NEXT_LAYOUT, "app/main.js": "main.js"}
WAYS = {
    "vite": Way(["vite@8"], {"index.html": page("/main.js")}, ["npx", "vite", "build"], folder="dist"),
    "vite-dev": Way(["vite@8"], {"index.html": page("/main.js")}, serve=["npx", "vite", "--port", "{port}", "--strictPort"]),
    "webpack": Way(["webpack@5", "webpack-cli"], {"dist/index.html": page("main.js")},
                   ["npx", "webpack", "--mode", "production", "--entry", "./main.js"], folder="dist"),
    "esbuild": Way(["esbuild"], {"dist/index.html": page("main.js")}, ESBUILD, folder="dist"),
    "next": Way(["next@16", "react@19", "react-dom@19"], NEXT_FILES, ["npx", "next", "build"],
                ["npx", "next", "start", "-p", "{port}"]),
    "types": Way(["typescript", "@types/react@19", "react@19"], {"types.tsx": "types.tsx"}, TSC, folder=None),
    "plain": Way([], {"index.html": HTML.format(title="city", head=IMPORT_MAP, body=SCRIPT.format(src="main.js"))}),
}


def run(command, folder):
    """Runs a command. Fails with the end of what it says."""
    environment = {**os.environ, "NEXT_TELEMETRY_DISABLED": "1", "CI": "1"}
    done = subprocess.run(command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=BUILD_S)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)}: {(done.stdout + done.stderr)[-2000:]}")
    return done.stdout


@contextlib.contextmanager
def started(command, folder):
    """A process with all that it starts."""
    process = subprocess.Popen(command, cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                               text=True, start_new_session=True)
    try:
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGTERM)
        process.wait()


@contextlib.contextmanager
def serving(handler):
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()


class Files(http.server.SimpleHTTPRequestHandler):
    extensions_map = {**http.server.SimpleHTTPRequestHandler.extensions_map, ".wasm": "application/wasm", ".js": "text/javascript"}

    def log_message(self, *_):
        pass


class Report:
    """What the page has said."""

    def __init__(self):
        self.said = threading.Event()
        self.error, self.picture, self.result = None, b"", None

    def handler(self):
        report = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def log_message(self, *_):
                pass

            def do_POST(self):
                body = self.rfile.read(int(self.headers["content-length"]))
                kind = self.path.strip("/")
                if kind == "picture":
                    report.picture = body
                elif kind == "error":
                    report.error = report.error or body.decode()[:1000]
                    report.said.set()
                elif kind == "done":
                    report.result = json.loads(body)
                    report.said.set()
                self.send_response(204)
                self.end_headers()

        return Handler


def answers(url):
    for _ in range(BUILD_S):
        with contextlib.suppress(OSError):
            return urllib.request.urlopen(url).status == 200
        time.sleep(1)
    raise RuntimeError(f"{url} does not answer")


def free_port():
    with http.server.HTTPServer(("127.0.0.1", 0), None) as server:
        return server.server_port


def show(browser, url, city):
    """Opens a page and waits for its report."""
    report = Report()
    with serving(report.handler()) as to, tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        query = urllib.parse.urlencode({"src": city, "report": to})
        with started([browser, *FLAGS, f"--user-data-dir={profile}", f"{url}/?{query}"], profile):
            if not report.said.wait(PAGE_S):
                report.error = f"the page reported nothing within {PAGE_S} s"
    if report.error:
        raise RuntimeError(report.error)
    if report.result["colours"] < COLOURS or report.result["ready"] != 1:
        raise RuntimeError(f"no city: {report.result}")
    return report


def attempt(name, project, archive, browser, city):
    way = WAYS[name]
    project.mkdir(parents=True)
    (project / "package.json").write_text(json.dumps({"name": "page", "private": True, "type": "module"}))
    run(["npm", "install", "--no-audit", "--no-fund", str(archive), *way.install], project)
    for path, text in {"main.js": "main.js", **way.files}.items():
        (project / path).parent.mkdir(parents=True, exist_ok=True)
        (project / path).write_text((HERE / "bundlers" / text).read_text() if text in ("main.js", "types.tsx") else text)
    if way.build:
        run(way.build, project)
    if way.folder is None:
        return None
    if not way.serve:
        with serving(functools.partial(Files, directory=project / way.folder)) as url:
            return show(browser, url, city)
    url = f"http://127.0.0.1:{(port := free_port())}"
    with started([part.format(port=port) for part in way.serve], project):
        answers(url)
        return show(browser, url, city)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("city", type=pathlib.Path, metavar="CITY")
    parser.add_argument("ways", nargs="*", metavar="WAY")
    parser.add_argument("--server", type=pathlib.Path, required=True, metavar="PROGRAM")
    parser.add_argument("--package", type=pathlib.Path, default=HERE / "../../client/web/dist/package", metavar="FOLDER")
    parser.add_argument("--out", type=pathlib.Path, metavar="FOLDER")
    parser.add_argument("--keep", type=pathlib.Path, metavar="FOLDER", help="where the projects are made, and stay")
    options = parser.parse_intermixed_args()
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if not browser or not shutil.which("npm"):
        sys.exit("no Chromium or no npm: install both")
    if unknown := [way for way in options.ways if way not in WAYS]:
        sys.exit(f"{unknown[0]}: one of {', '.join(WAYS)}")
    if not (options.package / "insula_web_bg.wasm").is_file():
        sys.exit(f"{options.package} is not the package: run client/web/build")
    failed = []
    with tempfile.TemporaryDirectory() as temporary, started(
        [str(options.server.resolve()), "serve", str(options.city.resolve()), "--listen", "127.0.0.1:0"], temporary
    ) as server:
        folder = (options.keep or pathlib.Path(temporary)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        address = next((found[0] for line in server.stdout if (found := re.findall(r"listening on (\S+)", line))), None)
        if not address:
            sys.exit(f"{options.server} does not serve {options.city}")
        threading.Thread(target=server.stdout.read, daemon=True).start()
        with urllib.request.urlopen(f"{address}/v1/cities") as response:
            city = f"{address}/v1/cities/{json.load(response)[0]['name']}"
        packed = run(["npm", "pack", "--json", "--pack-destination", str(folder)], options.package.resolve())
        archive = folder / json.loads(packed)[0]["filename"]
        print(f"{archive.name}: {archive.stat().st_size} bytes", flush=True)
        for name in options.ways or WAYS:
            try:
                report = attempt(name, folder / name, archive, browser, city)
                print(f"{name}: {report.result['colours']} colours" if report else f"{name}: compiled", flush=True)
                if options.out and report:
                    options.out.mkdir(parents=True, exist_ok=True)
                    (options.out / f"{name}.png").write_bytes(report.picture)
            except (RuntimeError, subprocess.TimeoutExpired) as error:
                failed.append(name)
                print(f"FAILED {name}: {error}", flush=True)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
