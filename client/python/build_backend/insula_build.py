"""Build backend (PEP 517): a wheel of the package and of the programs `insula` and `insula-server`.

The programs are built by Cargo, in the profile INSULA_PROFILE (release), or taken from the folder that INSULA_PROGRAMS_DIR names. README.md
says why this is not maturin.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
import platform
import re
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

HERE = Path(__file__).resolve().parent.parent
WORKSPACE = HERE.parent.parent
PROGRAMS = ("insula", "insula-server")
SUFFIX = ".exe" if os.name == "nt" else ""
# Zip files have no earlier time; the same sources give the same bytes.
TIME = (1980, 1, 1, 0, 0, 0)


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    """Writes the wheel and returns its name."""
    programs = _programs()
    version, metadata = _metadata()
    tag = f"py3-none-{_platform(programs)}"
    info = f"insula-{version}.dist-info"
    sources = HERE / "src"
    modules = [path for path in sorted(sources.rglob("*")) if path.suffix in (".py", ".js", ".typed")]
    files = [(path.relative_to(sources).as_posix(), path.read_bytes(), 0o644) for path in modules]
    files += [(f"insula-{version}.data/scripts/{path.name}", path.read_bytes(), 0o755) for path in programs]
    for name in ("LICENSE-MIT", "LICENSE-APACHE"):
        files.append((f"{info}/licenses/{name}", (WORKSPACE / name).read_bytes(), 0o644))
    wheel = f"Wheel-Version: 1.0\nGenerator: insula_build\nRoot-Is-Purelib: false\nTag: {tag}\n"
    files += [(f"{info}/METADATA", metadata.encode(), 0o644), (f"{info}/WHEEL", wheel.encode(), 0o644)]
    name = f"insula-{version}-{tag}.whl"
    _write(Path(wheel_directory) / name, files, f"{info}/RECORD")
    return name


def build_sdist(sdist_directory, config_settings=None):
    """There is none: the programs are built from the whole repository."""
    raise NotImplementedError("insula has no source distribution: run pip in client/python of a clone of the repository")


def _write(path, files, record):
    """Writes the archive, and in it the list of all hashes."""
    lines = []
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, content, mode in files:
            digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
            lines.append(f"{name},sha256={digest},{len(content)}\n")
            _add(archive, name, content, mode)
        _add(archive, record, "".join([*lines, f"{record},,\n"]).encode(), 0o644)


def _add(archive, name, content, mode):
    entry = zipfile.ZipInfo(name, TIME)
    entry.external_attr = (0o100000 | mode) << 16
    archive.writestr(entry, content, zipfile.ZIP_DEFLATED, 9)


def _programs():
    """The paths of both programs."""
    folder = os.environ.get("INSULA_PROGRAMS_DIR")
    found = [Path(folder) / (name + SUFFIX) for name in PROGRAMS] if folder else _built()
    for path in found:
        if not path.is_file():
            raise FileNotFoundError(f"{path} is missing")
    return found


def _built():
    """Builds the programs. Cargo says where they are."""
    profile = os.environ.get("INSULA_PROFILE", "release")
    command = ["cargo", "build", "--profile", profile, "--locked", "-p", "insula-server", "-p", "insula-client"]
    command += ["--message-format", "json-render-diagnostics"]
    output = subprocess.run(command, cwd=WORKSPACE, stdout=subprocess.PIPE, check=True).stdout
    messages = [json.loads(line) for line in output.splitlines() if line.startswith(b"{")]
    paths = [Path(message["executable"]) for message in messages if message.get("executable")]
    return [path for name in PROGRAMS for path in paths if path.name == name + SUFFIX]


def _platform(programs):
    """The platform of the wheel. On Linux with glibc, the oldest one whose symbols the programs ask for."""
    name = re.sub(r"[-.]", "_", sysconfig.get_platform())
    if name.startswith("linux_"):
        asked = [int(n) for path in programs for n in re.findall(rb"GLIBC_2\.(\d+)", path.read_bytes())]
        return name.replace("linux_", f"manylinux_2_{max(asked)}_") if asked else name
    if name.startswith("macosx_"):
        return f"macosx_11_0_{platform.machine()}"
    return name


def _metadata():
    """Version and core metadata."""
    project = tomllib.loads((HERE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    version = tomllib.loads((WORKSPACE / "Cargo.toml").read_text(encoding="utf-8"))["workspace"]["package"]["version"]
    lines = [
        "Metadata-Version: 2.4",
        f"Name: {project['name']}",
        f"Version: {version}",
        f"Summary: {project['description']}",
        f"Keywords: {','.join(project['keywords'])}",
        f"Requires-Python: {project['requires-python']}",
        f"License-Expression: {project['license']}",
        "License-File: LICENSE-MIT",
        "License-File: LICENSE-APACHE",
        *(f"Requires-Dist: {needed}" for needed in project["dependencies"]),
    ]
    for extra, needs in project["optional-dependencies"].items():
        lines.append(f"Provides-Extra: {extra}")
        lines += [f"Requires-Dist: {needed}; extra == '{extra}'" for needed in needs]
    readme = (HERE / project["readme"]).read_text(encoding="utf-8")
    return version, "\n".join([*lines, "Description-Content-Type: text/markdown", "", readme])
