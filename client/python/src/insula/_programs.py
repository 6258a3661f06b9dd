"""Runs the programs `insula` and `insula-server`."""

from __future__ import annotations

import numbers
import os
import shutil
import signal
import subprocess
import sysconfig
import threading
import warnings
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

# A program that was interrupted says what it keeps. It may take so long.
_FAREWELL_SECS = 10.0


class Error(RuntimeError):
    """A program failed, or what was asked for is not possible. The message says why.

    `stderr` is all that the program said, `status` its exit status: 1 failed, 2 wrong usage.
    """

    def __init__(self, message: str, *, stderr: str = "", status: int | None = None) -> None:
        super().__init__(message)
        self.stderr = stderr
        self.status = status


def find(name: str) -> str:
    """The path of a program: in the folder of `INSULA_PROGRAMS_DIR` if that is set, else beside Python, else on the path."""
    folder = os.environ.get("INSULA_PROGRAMS_DIR")
    schemes = {sysconfig.get_default_scheme(), sysconfig.get_preferred_scheme("user")}
    folders = [folder] if folder else [sysconfig.get_path("scripts", scheme) for scheme in sorted(schemes)]
    for place in [*folders, None][: 1 if folder else None]:
        found = shutil.which(name, path=place)
        if found:
            return found
    where = f"in {folder} (INSULA_PROGRAMS_DIR)" if folder else "beside Python or on the path"
    raise Error(f"the program {name} is not {where}: install the wheel of insula, or set INSULA_PROGRAMS_DIR")


def arguments(options: Mapping[str, Any]) -> list[str]:
    """Keywords as options of a command: `cell=3` is `--cell 3`, `no_meshes=True` is `--no-meshes`.

    Numbers in a list are one value, as `bbox=(7.41, 43.72, 7.43, 43.74)`; other lists repeat the option. None and False leave it
    out.
    """
    words: list[str] = []
    for name, value in options.items():
        option = "--" + name.strip("_").replace("_", "-")
        if value is None or value is False:
            continue
        if value is True:
            words.append(option)
        elif isinstance(value, (str, os.PathLike)) or not isinstance(value, Iterable):
            words.append(f"{option}={_text(value)}")
        else:
            values = list(value)
            is_one = values and all(_is_number(part) for part in values)
            texts = [_text(part) for part in values]
            words += [f"{option}={text}" for text in ([",".join(texts)] if is_one else texts)]
    return words


def _is_number(value: object) -> bool:
    return not isinstance(value, (str, bytes, os.PathLike)) and hasattr(value, "__float__")


def _text(value: object) -> str:
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if not _is_number(value):
        return str(value)
    # Numbers of numpy have texts of their own.
    return str(int(value)) if isinstance(value, numbers.Integral) else repr(float(value))  # type: ignore[arg-type]


def run(program: str, *words: str | os.PathLike[str], on_line: Callable[[str], None] | None = None) -> str:
    """Runs a program to its end and returns what it printed. `on_line` gets each line of its standard error.

    Warnings of the program are warnings of Python. Ctrl-C, and an error in `on_line`, end the program first. Fails with `Error` if
    the program does.
    """
    command = [find(program), *(os.fspath(word) for word in words)]
    pipes: dict[str, Any] = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, text=True, encoding="utf-8", errors="replace", **pipes) as process:
        out: list[str] = []
        lines: list[str] = []
        reader = threading.Thread(target=lambda: out.append(process.stdout.read()), daemon=True)  # type: ignore[union-attr]
        reader.start()
        try:
            for line in process.stderr:  # type: ignore[union-attr]
                lines.append(line)
                if on_line:
                    on_line(line.rstrip("\n"))
            process.wait()
        except BaseException as error:
            end(process)
            farewell = process.stderr.read().strip()  # type: ignore[union-attr]
            if farewell and hasattr(error, "add_note"):
                error.add_note(farewell)
            raise
        reader.join()
    said = "".join(lines)
    if process.returncode != 0:
        raise Error(_message(program, said, process.returncode), stderr=said, status=process.returncode)
    for line in lines:
        if line.startswith("warning: "):
            warnings.warn(line.removeprefix("warning: ").rstrip(), stacklevel=3)
    return "".join(out)


def _message(program: str, said: str, status: int) -> str:
    """The line that says why: the last one that begins with "error:"."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    errors = [line.removeprefix("error:").strip() for line in lines if line.startswith("error:")]
    return (errors or lines or [f"{program} ended with status {status}"])[-1]


def end(process: subprocess.Popen[Any]) -> None:
    """Ends a program as Ctrl-C does, or at last by force."""
    try:
        if process.poll() is None:
            process.send_signal(signal.SIGINT if os.name == "posix" else signal.SIGTERM)
            process.wait(_FAREWELL_SECS)
    except subprocess.TimeoutExpired:
        pass
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()


def is_address(place: str | os.PathLike[str]) -> bool:
    """Whether a place is an address and not a folder."""
    return "://" in os.fspath(place)


def local_path(place: str | os.PathLike[str]) -> str:
    """A place as a program gets it: an address as it is, a path whole."""
    text = os.fspath(place)
    return text if is_address(text) else str(Path(text).expanduser().absolute())
