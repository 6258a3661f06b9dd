"""Runs insula-server, and stops it when asked to. Needs no QGIS."""

import os
import queue
import shutil
import subprocess
import threading

from . import answers

# Where the program is, if no setting says it.
VARIABLE = "INSULA_SERVER"
NAME = "insula-server"
# Between two looks at whether to stop, in seconds.
LOOK = 0.1
# A program that is asked to end gets this long, in seconds.
PATIENCE = 10


class ProgramError(RuntimeError):
    """The program is missing, or has failed: its own words."""


class Cancelled(Exception):
    """The user has stopped the program."""


def find(setting=""):
    """The path of the program: of a setting, else of INSULA_SERVER, else an installed one. Raises ProgramError if there is none."""
    for chosen in (setting, os.environ.get(VARIABLE, "")):
        if chosen:
            if os.path.isfile(chosen):
                return chosen
            raise ProgramError(f"{chosen} is no file: give the path of {NAME} in the options of Processing")
    found = shutil.which(NAME)
    if not found:
        raise ProgramError(f"{NAME} is not installed, or not found: give its path in the options of Processing")
    return found


def run(command, on_line=lambda line: None, is_cancelled=lambda: False):
    """Runs a command, a list of words, and returns its answers. `on_line` gets each line of standard error.

    Raises ProgramError if it fails, and Cancelled after it was stopped."""
    hidden = getattr(subprocess, "CREATE_NO_WINDOW", 0)
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            creationflags=hidden,
        )
    except OSError as error:
        raise ProgramError(f"{command[0]} cannot be started: {error}") from error
    lines, output, last_error = queue.Queue(), [], ""
    readers = [
        threading.Thread(target=lambda: output.append(process.stdout.read()), daemon=True),
        threading.Thread(target=_read_lines, args=(process.stderr, lines), daemon=True),
    ]
    for reader in readers:
        reader.start()
    try:
        while (line := _next(lines)) is not None:
            if is_cancelled():
                raise Cancelled
            if line:
                last_error = _text_of_error(line) or last_error
                on_line(line)
        while process.poll() is None:
            if is_cancelled():
                raise Cancelled
            _wait(process, LOOK)
    finally:
        _end(process)
        for reader in readers:
            reader.join()
        process.stdout.close()
        process.stderr.close()
    if process.returncode != 0:
        raise ProgramError(last_error or f"{NAME} ended with code {process.returncode}")
    try:
        return answers.parse("".join(output))
    except ValueError as error:
        raise ProgramError(f"the answer of {NAME} cannot be read: {error}; are plugin and program of one version?") from error


def _read_lines(stream, lines):
    for line in stream:
        lines.put(line.rstrip("\r\n"))
    lines.put(None)


def _next(lines):
    """The next line; "" if none has come, None at the end."""
    try:
        return lines.get(timeout=LOOK)
    except queue.Empty:
        return ""


def _text_of_error(line):
    kind, text = answers.level(line)
    return text if kind == "error" else ""


def _wait(process, seconds):
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        pass


def _end(process):
    """Asks a running program to end, and ends it if it does not."""
    if process.poll() is None:
        process.terminate()
        _wait(process, PATIENCE)
    if process.poll() is None:
        process.kill()
        process.wait()
