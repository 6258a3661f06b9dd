#!/usr/bin/env python3
"""Takes a picture of the map of each notebook in JupyterLab, with a headless Chromium.

The browser reaches Jupyter alone, as where the kernel is on another machine: all of the map comes over the kernel's channel. It needs
the packages jupyterlab and playwright beside insula[geo,widget], and a Chromium, which INSULA_CHROMIUM names or the path has.
"""

import argparse
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

from playwright.sync_api import Route, sync_playwright

HERE = Path(__file__).resolve().parent
TOKEN = "pictures"
# A CPU draws the city, beside the kernel.
PATIENCE_MS = 300_000
IS_IDLE = "() => window.jupyterapp?.shell.currentWidget?.sessionContext?.session?.kernel?.status === 'idle'"
ERROR = ".jp-OutputArea-output[data-mime-type='application/vnd.jupyter.error']"
IS_SHOWN = """() => {
  const city = document.querySelector('insula-city');
  return city?.last.ready !== undefined && city.last.progress?.final === true && city.view?.final === true;
}"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of the pictures")
    args = parser.parse_args()
    chromium = os.environ.get("INSULA_CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")
    if not chromium:
        sys.exit("there is no Chromium: INSULA_CHROMIUM names it")
    args.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="insula-") as root, sync_playwright() as playwright:
        # Notebooks find the bundled map from their folder.
        folder = Path(root) / "client" / "python" / "notebooks"
        folder.mkdir(parents=True)
        (Path(root) / "client" / "demo").symlink_to(HERE.parent / "demo")
        names = [path.name for path in sorted((HERE / "notebooks").glob("*.ipynb")) if copy(path, folder / path.name)]
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        words = ["--no-browser", f"--port={port}", f"--IdentityProvider.token={TOKEN}", "--expose-app-in-browser", "--allow-root"]
        command = [sys.executable, "-m", "jupyterlab", *words, "--LabApp.news_url=None"]
        jupyter = subprocess.Popen(command, cwd=root, stderr=subprocess.PIPE, text=True)
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        try:
            # Its log says when it listens. The rest of it is read, so that the pipe does not fill up.
            for line in jupyter.stderr or []:
                if f":{port}/" in line:
                    break
            threading.Thread(target=jupyter.stderr.read, daemon=True).start()
            for name in names:
                take(browser, f"http://127.0.0.1:{port}", name, args.out / f"{Path(name).stem}.png")
        finally:
            browser.close()
            jupyter.terminate()
            jupyter.wait()


def copy(path: Path, to: Path) -> bool:
    """Copies a notebook without the end of its map. Whether it has one."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    for cell in notebook["cells"]:
        cell["source"] = [line for line in cell["source"] if "view.close()" not in line]
    to.write_text(json.dumps(notebook), encoding="utf-8")
    return any("insula.Map" in line for cell in notebook["cells"] for line in cell["source"])


def take(browser, root: str, name: str, out: Path) -> None:
    """Runs a notebook and writes a picture of its map. Fails if the browser asked another host for anything but the trial."""
    page = browser.new_page(viewport={"width": 1000, "height": 900})
    others: list[str] = []

    def only_jupyter(route: Route) -> None:
        if route.request.url.startswith(root):
            route.continue_()
        else:
            others.append(route.request.url)
            route.abort()

    page.route("**/*", only_jupyter)
    page.goto(f"{root}/lab/tree/client/python/notebooks/{name}?token={TOKEN}&reset")
    page.wait_for_selector(".jp-Notebook .jp-Cell", timeout=PATIENCE_MS)
    page.wait_for_function(IS_IDLE, timeout=PATIENCE_MS)
    page.evaluate("() => { window.jupyterapp.commands.execute('notebook:run-all-cells'); }")
    page.wait_for_selector(f"insula-city, {ERROR}", timeout=PATIENCE_MS)
    if page.locator(ERROR).count() > 0:
        sys.exit(f"{name}: {page.locator(ERROR).first.inner_text()}")
    page.wait_for_function(IS_SHOWN, timeout=PATIENCE_MS)
    page.locator("insula-city").first.screenshot(path=out)
    trials = [url for url in others if re.fullmatch(r"http://127\.0\.0\.1:\d+/v1/cities/[a-z0-9_-]+", url)]
    if len(trials) < len(others):
        sys.exit(f"{name}: requests to other hosts: {sorted(set(others) - set(trials))}")
    print(f"{name}: {out}", flush=True)
    page.close()


if __name__ == "__main__":
    main()
