"""Requests to servers of cities, by the standard library."""

from __future__ import annotations

import http.client
import json
import re
import time
from typing import Any, NamedTuple
from urllib.parse import SplitResult, urlsplit, urlunsplit

from ._programs import Error

_TIMEOUT_SECS = 30
# An answer that comes drop by drop is given up.
_ANSWER_SECS = 300
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
    parts = _split(address)
    kinds = {"http": http.client.HTTPConnection, "https": http.client.HTTPSConnection}
    if parts.scheme not in kinds or not parts.hostname:
        raise Error(f"{shown(address)}: expected an address that begins with http:// or https://")
    try:
        connection = kinds[parts.scheme](parts.hostname, parts.port, timeout=_TIMEOUT_SECS)
        try:
            path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
            connection.request("GET", path, headers=headers or {})
            response = connection.getresponse()
            body = _read(response)
        finally:
            connection.close()
    except http.client.InvalidURL:
        # Its text has the query.
        raise Error(f"{shown(address)}: an address has no spaces and no control characters") from None
    except (OSError, ValueError, http.client.HTTPException) as error:
        raise Error(f"{shown(address)}: no answer: {error}") from error
    if len(body) > _MAX_BYTES:
        raise Error(f"{shown(address)}: the answer is longer than {_MAX_BYTES} bytes")
    return Answer(response.status, {name.lower(): value for name, value in response.getheaders()}, body)


def _read(response: http.client.HTTPResponse) -> bytes:
    """The body, or a byte more than is allowed of a longer one. Fails if it takes too long."""
    end = time.monotonic() + _ANSWER_SECS
    parts, left = [], _MAX_BYTES + 1
    while left > 0 and (part := response.read1(min(left, 1 << 16))):
        parts.append(part)
        left -= len(part)
        if time.monotonic() > end:
            raise OSError(f"it takes more than {_ANSWER_SECS} s")
    return b"".join(parts)


def _split(address: str) -> SplitResult:
    try:
        return urlsplit(address)
    except ValueError as error:
        raise Error(f"not an address: {error}") from error


def without_user(address: str) -> str:
    """An address without the user and the password that it may have."""
    parts = _split(address)
    return urlunsplit(parts._replace(netloc=parts.netloc.rpartition("@")[2]))


def shown(address: str) -> str:
    """An address as people may see it: notebooks keep messages, and are shared. A query may be a key."""
    return urlunsplit(_split(without_user(address))._replace(query="", fragment=""))


def get_json(address: str) -> Any:
    """Asks for JSON. Fails with `Error` if it is not there."""
    answer = get(address, {"Accept": "application/json"})
    if answer.status != 200:
        raise Error(f"{shown(address)}: status {answer.status}")
    try:
        return json.loads(answer.body)
    except ValueError as error:
        raise Error(f"{shown(address)}: not JSON: {error}") from error


def city_of(address: str) -> tuple[str, str] | None:
    """The root of a server and the name of a city, if an address names a city of a server."""
    parts = _split(address)
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
    if _split(root).path:
        return root, get_json(f"{root}/city.json")
    names = [entry["name"] for entry in get_json(f"{root}/v1/cities")]
    if len(names) != 1:
        root = shown(root)
        raise Error(f"{root} has {len(names)} cities: name one, as in {root}/v1/cities/{(names or ['NAME'])[0]}")
    whole = f"{root}/v1/cities/{names[0]}"
    return whole, get_json(whole)
