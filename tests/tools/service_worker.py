#!/usr/bin/env python3
"""Tries the page's service worker in Chromium: service_worker.py SERVER-PROGRAM CITY [--tiles 50000] [--chromium PROGRAM]

Publishes a city and visits it with many kept tiles, with a full storage, behind a host that redirects to a login, and after an
upgrade of the site. Fails unless the page shows the city each time, the login is not kept, and the upgraded worker takes over within
one visit. `service_worker.mjs` tries single requests, in Node.
"""
import argparse, contextlib, http.server, json, os, pathlib, re, shutil, subprocess, tempfile, threading, time

# Counts the pictures of the city; the last of a view is final.
RECORDER = """addEventListener('frame', ({detail}) => {
    globalThis.pictures = (globalThis.pictures ?? 0) + 1; globalThis.isFinal = detail.final; }, true)"""
PATIENCE_S = 120


class Host(http.server.ThreadingHTTPServer):
    """A host of a folder that answers ranges, and may ask for a login."""
    daemon_threads = True
    asks_for_login = False

    def __init__(self, folder):
        super().__init__(("127.0.0.1", 0), Request)
        self.folder = folder
        self.url = f"http://127.0.0.1:{self.server_port}"
        threading.Thread(target=self.serve_forever, daemon=True).start()


class Request(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".json": "application/json",
             ".wasm": "application/wasm", ".jpg": "image/jpeg", ".svg": "image/svg+xml"}

    def log_message(self, *_):
        pass

    def answer(self, status, body, headers):
        self.send_response(status)
        for name, value in {"Content-Length": len(body), **headers}.items():
            self.send_header(name, str(value))
        self.end_headers()
        self.wfile.write(body)

    def do_GET(self):
        path = self.path.split("?")[0].lstrip("/")
        if path == "login":
            return self.answer(200, b"<!doctype html><p>Please log in", {"Content-Type": "text/html"})
        if self.server.asks_for_login:
            return self.answer(302, b"", {"Location": "/login"})
        file = self.server.folder / path
        file = file / "index.html" if file.is_dir() else file
        if not file.is_file():
            return self.answer(404, b"", {})
        body, kind = file.read_bytes(), {"Content-Type": self.TYPES.get(file.suffix, "application/octet-stream")}
        asked = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
        if not asked:
            return self.answer(200, body, kind)
        first, last = int(asked[1]), min(int(asked[2]), len(body) - 1)
        self.answer(206, body[first:last + 1], {**kind, "Content-Range": f"bytes {first}-{last}/{len(body)}"})


class Browser:
    """Headless Chromium with one page."""

    def __init__(self, program, folder):
        (self.read_end, to_us), (from_us, self.write_end) = os.pipe(), os.pipe()
        flags = ["--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe", f"--user-data-dir={folder}",
                 "--no-first-run", "--window-size=640,400"]

        def keep_pipes():
            # The numbers that the browser expects, which the pipes may have already.
            inner = [os.dup(from_us), os.dup(to_us)]
            os.dup2(inner[0], 3)
            os.dup2(inner[1], 4)

        self.process = subprocess.Popen([program, *flags], preexec_fn=keep_pipes, close_fds=False, stderr=subprocess.DEVNULL)
        os.close(to_us), os.close(from_us)
        self.rest, self.number, self.session = b"", 0, None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime"):
            self.call(f"{domain}.enable")
        self.call("Page.addScriptToEvaluateOnNewDocument", source=RECORDER)

    def call(self, method, **params):
        self.number += 1
        message = {"id": self.number, "method": method, "params": params}
        message |= {"sessionId": self.session} if self.session else {}
        os.write(self.write_end, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self.rest:
                self.rest += os.read(self.read_end, 1 << 20)
            text, self.rest = self.rest.split(b"\0", 1)
            reply = json.loads(text)
            if reply.get("id") == self.number:
                if "error" in reply:
                    raise RuntimeError(f"{method}: {reply['error']}")
                return reply["result"]

    def value(self, expression):
        reply = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in reply:
            raise RuntimeError(f"{expression}: {reply['exceptionDetails']}")
        return reply["result"].get("value")

    def wait_for(self, expression):
        end = time.monotonic() + PATIENCE_S
        while not self.value(f"(async () => Boolean(await ({expression})))()"):
            if time.monotonic() > end:
                raise SystemExit(f"not within {PATIENCE_S} s: {expression}")
            time.sleep(0.1)

    def visit(self, url):
        self.call("Page.navigate", url="about:blank")
        self.call("Page.navigate", url=url)
        self.wait_for("document.readyState === 'complete' && location.href !== 'about:blank'")

    def close(self):
        self.process.terminate()
        self.process.wait()


def shows_city(browser, url, what):
    begin = time.monotonic()
    browser.visit(url)
    browser.wait_for("globalThis.pictures > 0 && globalThis.isFinal")
    print(f"{what}: the city after {time.monotonic() - begin:.1f} s", flush=True)


def fill(browser, host, count):
    """Keeps many tiles as the worker would, a thousand at a time."""
    browser.value("caches.keys().then(names => { globalThis.kept = names.filter(name => name.startsWith('insula-')).sort().at(-1) })")
    for first in range(0, count, 1000):
        browser.value(f"""caches.open(kept).then(cache => Promise.all(Array.from({{length: 1000}}, (_, k) =>
            cache.put('{host.url}/v1/cities/a/v1/blockmaps/20/' + ({first} + k) + '/0', new Response('tile')))))""")


def upgrade(site):
    """Another worker, with caches of its own, and other addresses of the page's files."""
    worker = site / "service-worker.js"
    text = worker.read_text()
    prefix = re.search(r"insula-(\d+)-", text)
    worker.write_text(text.replace(prefix[0], f"insula-{int(prefix[1]) + 1}-"))
    old = next(path.name for path in (site / "assets").iterdir() if re.fullmatch(r"[0-9a-f]{16}", path.name))
    new = old[::-1]
    (site / "assets" / old).rename(site / "assets" / new)
    for file in site.rglob("*"):
        if file.suffix in (".html", ".js", ".css", ".json") and old in file.read_text():
            file.write_text(file.read_text().replace(old, new))
    return prefix[0]


def main():
    ap = argparse.ArgumentParser(description=__doc__)
    ap.add_argument("server")
    ap.add_argument("city", type=pathlib.Path)
    ap.add_argument("--tiles", type=int, default=50_000)
    ap.add_argument("--chromium", default=shutil.which("chromium") or "chromium")
    args = ap.parse_args()
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        site = pathlib.Path(folder) / "site"
        subprocess.run([args.server, "publish", args.city, "--out", site], check=True, stdout=subprocess.DEVNULL)
        host = Host(site)
        browser = Browser(args.chromium, pathlib.Path(folder) / "profile")
        stack.callback(browser.close)
        url = next(f"{host.url}/cities/{path.name}/" for path in (site / "cities").iterdir())
        shows_city(browser, url, "first visit")
        browser.wait_for("navigator.serviceWorker.ready")
        shows_city(browser, url, "with the worker")
        browser.wait_for("navigator.serviceWorker.controller")
        fill(browser, host, args.tiles)
        shows_city(browser, url, f"{args.tiles} tiles kept")
        usage = browser.value("navigator.storage.estimate().then(({usage}) => usage)")
        browser.call("Storage.overrideQuotaForOrigin", origin=host.url, quotaSize=usage + 1000)
        shows_city(browser, f"{url}?more", "full storage")
        browser.call("Storage.overrideQuotaForOrigin", origin=host.url)
        host.asks_for_login = True
        browser.visit(f"{url}?private")
        browser.wait_for("document.body.innerText.includes('Please log in')")
        print("login: shown", flush=True)
        host.asks_for_login = False
        shows_city(browser, f"{url}?private", "after the login")
        kept = "caches.match(location.href).then(found => found?.text()).then(text => text?.includes('log in'))"
        if browser.value(kept):
            raise SystemExit("the login is kept")
        prefix = upgrade(site)
        shows_city(browser, url, "upgrade")
        browser.wait_for(f"caches.keys().then(names => names.length > 0 && !names.some(name => name.startsWith('{prefix}')))")
        shows_city(browser, url, "after the upgrade")
        print("the upgraded worker took over", flush=True)


if __name__ == "__main__":
    main()
