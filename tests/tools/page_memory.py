#!/usr/bin/env python3
"""Memory of pages with cities: page_memory.py CITY --server PROGRAM [--package FOLDER] [--elements 1 6] [--cores 2 8]

FOLDER is what `client/web/build` writes into `client/web/dist/package`. Serves a city, opens a page with so many elements `<insula-city>` in headless Chromium that is told so many cores, waits until each
element has its final picture, and sums what the browser's processes hold: memory that several share is counted in shares (Pss). The
same browser with an empty page is subtracted, so the difference is what the cities cost. Prints a row for each page, in MiB. Linux.
"""
import argparse, functools, http.server, pathlib, re, shutil, subprocess, tempfile, threading

from service_worker import Browser

HERE = pathlib.Path(__file__).resolve().parent
# Which elements have their final picture.
STATE = """addEventListener('frame', ({target, detail}) => {
    const final = (globalThis.finalOf ??= new Map()); final.set(target, detail.final); }, true)"""


def children(pid):
    """A process and its descendants."""
    found = [pid]
    for parent in found:
        for task in pathlib.Path(f"/proc/{parent}/task").iterdir():
            found += [int(child) for child in (task / "children").read_text().split()]
    return found


def shares_mib(pid):
    """Memory of a process and its descendants."""
    kib = 0
    for process in children(pid):
        rollup = pathlib.Path(f"/proc/{process}/smaps_rollup").read_text()
        kib += int(re.search(r"^Pss:\s+(\d+)", rollup, re.MULTILINE)[1])
    return kib / 1024


def page_of(city, script, count):
    elements = f'<insula-city src="{city}" style="display:block;height:380px"></insula-city>' * count
    return f'<!doctype html><meta charset="utf-8"><title>Cities</title><script type="module" src="{script}"></script>{elements}'


class Pages(http.server.SimpleHTTPRequestHandler):
    """The files of the package, and the page."""
    extensions_map = {".wasm": "application/wasm", ".js": "text/javascript"}

    def log_message(self, *_):
        pass

    def do_GET(self):
        if self.path != "/":
            return super().do_GET()
        body = self.server.page.encode()
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)


def measure(program, url, count, cores):
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        browser = Browser(program, profile)
        try:
            empty = shares_mib(browser.process.pid)
            browser.call("Emulation.setHardwareConcurrencyOverride", hardwareConcurrency=cores)
            browser.call("Page.addScriptToEvaluateOnNewDocument", source=STATE)
            browser.visit(url)
            for number in range(count):
                browser.value(f"document.querySelectorAll('insula-city')[{number}].scrollIntoView()")
                browser.wait_for(f"globalThis.finalOf?.get(document.querySelectorAll('insula-city')[{number}])")
            assert browser.value("navigator.hardwareConcurrency") == cores
            return empty, shares_mib(browser.process.pid)
        finally:
            browser.close()


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("city", type=pathlib.Path)
    ap.add_argument("--server", required=True)
    ap.add_argument("--package", type=pathlib.Path, default=HERE / "../../client/web/dist/package", metavar="FOLDER")
    ap.add_argument("--elements", type=int, nargs="+", default=[1, 6])
    ap.add_argument("--cores", type=int, nargs="+", default=[2, 8])
    ap.add_argument("--chromium", default=shutil.which("chromium") or "chromium")
    args = ap.parse_args()
    serve = [args.server, "serve", args.city, "--listen", "127.0.0.1:0"]
    with subprocess.Popen(serve, stdout=subprocess.PIPE, text=True) as server:
        try:
            address = next(found[1] for line in server.stdout if (found := re.search(r"listening on (\S+)", line)))
            threading.Thread(target=server.stdout.read, daemon=True).start()
            pages = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Pages, directory=args.package))
            threading.Thread(target=pages.serve_forever, daemon=True).start()
            print("| elements | cores | empty page | with cities | difference |\n|---|---|---|---|---|")
            for count in args.elements:
                pages.page = page_of(f"{address}/v1/cities/{args.city.name}", "/insula-city.js", count)
                for cores in args.cores:
                    empty, full = measure(args.chromium, f"http://127.0.0.1:{pages.server_port}/", count, cores)
                    print(f"| {count} | {cores} | {empty:.0f} | {full:.0f} | {full - empty:.0f} |", flush=True)
        finally:
            server.terminate()


if __name__ == "__main__":
    main()
