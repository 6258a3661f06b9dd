"""Requests to servers of cities, by the standard library."""

from __future__ import annotations

import http.client
import json
import re
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from ._programs import Error

_TIMEOUT_SECS = 30
# Larger answers than any tile are refused.
_MAX_BYTES = 64 << 20
# The address of a city on a server, or of its page.
_CITY = re.compile(r"(.*?)(?:/v1)?/cities/([a-z0-9_-]{1,64})/*")


class Answer(NamedTuple):
    """An answer with its body as it was sent."""

    status: int
    headers: dict[str, str]
    body: bytes


def get(address: str, headers: dict[str, str] | None = None) -> Answer:
    """Asks for an address. Redirects are not followed. Fails with `Error` if there is no answer, or it is too long."""
    parts = urlsplit(address)
    kinds = {"http": http.client.HTTPConnection, "https": http.client.HTTPSConnection}
    if parts.scheme not in kinds or not parts.hostname:
        raise Error(f"{address}: expected an address that begins with http:// or https://")
    try:
        connection = kinds[parts.scheme](parts.hostname, parts.port, timeout=_TIMEOUT_SECS)
        try:
            path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
            connection.request("GET", path, headers=headers or {})
            response = connection.getresponse()
            body = response.read(_MAX_BYTES + 1)
        finally:
            connection.close()
    except (OSError, ValueError, http.client.HTTPException) as error:
        raise Error(f"{address}: no answer: {error}") from error
    if len(body) > _MAX_BYTES:
        raise Error(f"{address}: the answer is longer than {_MAX_BYTES} bytes")
    return Answer(response.status, {name.lower(): value for name, value in response.getheaders()}, body)


def get_json(address: str) -> Any:
    """Asks for JSON. Fails with `Error` if it is not there."""
    answer = get(address, {"Accept": "application/json"})
    if answer.status != 200:
        raise Error(f"{address}: status {answer.status}")
    try:
        return json.loads(answer.body)
    except ValueError as error:
        raise Error(f"{address}: not JSON: {error}") from error


def city_of(address: str) -> tuple[str, str] | None:
    """The root of a server and the name of a city, if an address names a city of a server."""
    parts = urlsplit(address)
    found = _CITY.fullmatch(parts.path)
    return (f"{parts.scheme}://{parts.netloc}{found[1]}", found[2]) if found else None


def manifest_of(address: str) -> tuple[str, Any]:
    """The address of a city, and its manifest. Of a server with one city, the address of the server is enough."""
    city = city_of(address)
    if city:
        root, name = city
        whole = f"{root}/v1/cities/{name}"
        return whole, get_json(whole)
    root = address.rstrip("/")
    if urlsplit(root).path:
        return root, get_json(f"{root}/city.json")
    names = [entry["name"] for entry in get_json(f"{root}/v1/cities")]
    if len(names) != 1:
        raise Error(f"{root} has {len(names)} cities: name one, as in {root}/v1/cities/{(names or ['NAME'])[0]}")
    whole = f"{root}/v1/cities/{names[0]}"
    return whole, get_json(whole)
