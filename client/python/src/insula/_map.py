"""The widget: a city in a notebook.

The viewer of the programs runs in the front end. Its modules and the tiles come from a server that the kernel starts, by one of two ways
that the front end chooses: straight from that server if it is the same machine, else through the kernel's channel. The server wants a token,
which only the front end and the kernel have: any page of the browser reaches the machine that it runs on.
"""

from __future__ import annotations

import re
import secrets
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import anywidget
import traitlets

from . import _http
from ._city import City
from ._city import open as open_city
from ._colors import colors as colors_of
from ._programs import Error, is_address
from ._serve import Server, serve

_ASSETS = re.compile(r"assets/[0-9a-f]{8,64}/")
# What the front end may ask for: files of the viewer, and the city.
_PATHS = re.compile(r"/(assets|v1)/[A-Za-z0-9_./?=&%+*~,:-]*")
_KEPT_HEADERS = ("content-type", "content-range", "content-encoding", "retry-after", "etag")
# Requests that the kernel has at once.
_WORKERS = 8


class Map(anywidget.AnyWidget):
    """A city that one can fly through: `insula.Map(city)` at the end of a cell.

    All traits may be set and observed. Needs the viewer for browsers in the programs, as wheels have it.
    """

    _esm = Path(__file__).parent / "map.js"

    height = traitlets.Int(480, help="Height in CSS pixels.").tag(sync=True)
    camera = traitlets.Unicode(
        "", help="`camera=X,Y,Z,AZIMUTH,PITCH,FOV` as links have it; `LON,LAT,HEIGHT,HEADING,PITCH[,FOV]` may be set, too."
    ).tag(sync=True)
    time = traitlets.Unicode("", help="Time of the light, as in `2024-06-21T17:00`.").tag(sync=True)
    picked = traitlets.Dict(help="What was clicked last: position, lon, lat, height, object.").tag(sync=True)
    selection = traitlets.List(traitlets.Int(), help="Numbers of the selected objects.").tag(sync=True)
    colors = traitlets.Dict(help="Colours of CSS by the number of the object.").tag(sync=True)
    rules = traitlets.Dict(
        help="Colours and filters by attributes: attribute, palette, range, filter, others, as in `setColors` of the viewer."
    ).tag(sync=True)
    status = traitlets.Unicode("loading", help="`loading`, `ready`, or what is wrong.").tag(sync=True)
    transport = traitlets.Enum(
        ("auto", "kernel"), "auto", help="`kernel` never asks the server of the kernel's machine directly."
    ).tag(sync=True)
    _address = traitlets.Unicode().tag(sync=True)
    _name = traitlets.Unicode().tag(sync=True)
    _version = traitlets.Unicode().tag(sync=True)
    _assets = traitlets.Unicode().tag(sync=True)
    _token = traitlets.Unicode().tag(sync=True)

    def __init__(self, city: City | str, **traits: Any) -> None:
        """Shows a city. Fails with `Error` if the server does not start or has no viewer."""
        city = city if isinstance(city, City) else open_city(city)
        of_server = _http.city_of(city.place) if is_address(city.place) else None
        self._server: Server | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._headers: dict[str, str] = {}
        token = "" if of_server else self._serve(city)
        root, name = of_server or (self._server.url, city.name)  # type: ignore[union-attr]
        self._pool = ThreadPoolExecutor(_WORKERS, thread_name_prefix="insula")
        try:
            assets = _assets_of(root, name, self._headers)
        except Error:
            self._end()
            raise
        # Notebooks keep what the front end gets.
        place = {"_address": _http.without_user(root), "_name": name, "_version": str(city.manifest.get("version", ""))}
        super().__init__(**place, _assets=assets, _token=token, **traits)
        self.on_msg(self._receive)

    def _serve(self, city: City) -> str:
        """Starts a server of a city, and returns the token that it wants."""
        token = secrets.token_urlsafe(24)
        # The server looks at the file now and then.
        self._folder = tempfile.TemporaryDirectory(prefix="insula-")
        path = Path(self._folder.name) / "tokens"
        path.write_text(f"{token}\n", encoding="utf-8")
        try:
            self._server = serve(city, set=f"access.tokens={path}")
        except BaseException:
            self._folder.cleanup()
            raise
        self._headers = {"Authorization": f"Bearer {token}"}
        return token

    def color(self, table: Any, column: str, **options: Any) -> None:
        """Colours objects by a column of a table: `map.color(frame, "rent")`. Options are those of `insula.colors`."""
        self.colors = {str(number): color for number, color in colors_of(table, column, **options).items()}

    def close(self) -> None:
        """Ends the widget and its server."""
        super().close()
        self._end()

    def _end(self) -> None:
        self._pool.shutdown(wait=False)
        if self._server:
            self._server.close()
            self._server = None
        if self._folder:
            self._folder.cleanup()
            self._folder = None

    def _receive(self, _: Any, content: Any, __: Any) -> None:
        """A message of the front end. Answers come from threads: requests of tiles do not wait for each other."""
        if isinstance(content, dict) and content.get("kind") == "fetch":
            self._pool.submit(self._answer, content)

    def _answer(self, content: dict[str, Any]) -> None:
        facts, body = self._fetch(str(content.get("path")), content.get("range"))
        self.send({"kind": "answer", "id": content.get("id"), **facts}, [body])

    def _fetch(self, path: str, range_: Any) -> tuple[dict[str, Any], bytes]:
        if not _PATHS.fullmatch(path) or ".." in path:
            return {"error": f"{path} is not of this city"}, b""
        # Files of the viewer are compressed, tiles are so by themselves.
        headers = {"Range": str(range_)} if range_ else {"Accept-Encoding": "gzip"}
        try:
            answer = _http.get(self._address + path, {**headers, **self._headers})
        except Error as error:
            return {"error": str(error)}, b""
        kept = {name: answer.headers[name] for name in _KEPT_HEADERS if name in answer.headers}
        return {"status": answer.status, "headers": kept}, answer.body


def _assets_of(root: str, name: str, headers: dict[str, str]) -> str:
    """The path of the viewer's files on a server. Fails with `Error` if it has none."""
    page = _http.get(f"{root}/cities/{name}", headers)
    found = _ASSETS.search(page.body.decode("utf-8", "replace"))
    if not found:
        raise Error(f"{_http.shown(root)}: this server has no viewer for browsers: build it with client/web/build before the programs")
    return f"/{found[0]}"
