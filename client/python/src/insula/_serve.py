"""Serves cities."""

from __future__ import annotations

import atexit
import os
import subprocess
import threading
from collections import deque
from collections.abc import Iterable
from types import TracebackType
from typing import Any

from ._city import City
from ._programs import Error, arguments, end, find, local_path

_SAYS = "listening on "
# Lines of the server's log that are kept.
_KEPT_LINES = 200


class Server:
    """A running server. It ends with `close`, at the end of a `with` block, and with Python."""

    url: str
    """Its address, without a slash at the end."""

    def __init__(self, cities: list[str], words: list[str]) -> None:
        command = [find("insula-server"), "serve", *cities, *words]
        pipes: dict[str, Any] = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        self._process = subprocess.Popen(command, text=True, encoding="utf-8", errors="replace", **pipes)
        self._log: deque[str] = deque(maxlen=_KEPT_LINES)
        self._reader = threading.Thread(target=self._read_log, daemon=True)
        self._reader.start()
        atexit.register(self.close)
        line = self._process.stdout.readline().strip()  # type: ignore[union-attr]
        if not line.startswith(_SAYS):
            self.close()
            last = self.log.strip().splitlines()
            raise Error((last or ["the server did not start"])[-1].removeprefix("error: "), stderr=self.log)
        self.url = line.removeprefix(_SAYS)

    def _read_log(self) -> None:
        for line in self._process.stderr:  # type: ignore[union-attr]
            self._log.append(line)

    @property
    def log(self) -> str:
        """The last lines that the server has said."""
        return "".join(self._log)

    def close(self) -> None:
        """Ends the server."""
        atexit.unregister(self.close)
        end(self._process)
        self._reader.join()
        for pipe in (self._process.stdout, self._process.stderr):
            pipe.close()  # type: ignore[union-attr]

    def __enter__(self) -> Server:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<Server at {self.url}>"


def serve(
    cities: City | str | os.PathLike[str] | Iterable[City | str | os.PathLike[str]], port: int = 0, **options: Any
) -> Server:
    """Serves cities on this machine, to itself alone: `with insula.serve(city) as server: print(server.url)`.

    Port 0 picks a free one. Other keywords are the options of `insula-server serve`; `listen="0.0.0.0:7700"` serves to others. Fails
    with `Error` if the server does not start.
    """
    several = [cities] if isinstance(cities, (City, str, os.PathLike)) else list(cities)
    places = [local_path(city.place if isinstance(city, City) else city) for city in several]
    return Server(places, arguments({"listen": f"127.0.0.1:{port}", **options}))
