#!/usr/bin/env python3
"""Runs the tests that changed files concern.

affected.py [--profile NAME] [--list] [FILE | CRATE]...

Without files, those that differ from HEAD. A source concerns the unit tests of its folder's module, and the integration tests of its
crate that have its name; a shader or its CPU twin also concerns the comparisons of both. A crate's name stands for all of its tests.
All features are those of the whole workspace, so that nothing is compiled twice. --list only prints the commands.
"""
import argparse, collections, json, pathlib, subprocess, sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
# It has no tests, and depends on everything: with it, a crate has the features that it has in the whole workspace.
FEATURES = "insula-measure"
WHOLE = "insula-tests"
# Tests of the whole system, by the beginning of a changed file's name.
CONCERNS = {
    "shaders/wgsl/": ["twin_", "packets::"],
    "shaders/src/cpu/": ["twin_", "packets::"],
    "shaders/src/gpu/": ["twin_"],
    "client/web/": ["browser::"],
    "client/qgis/": ["qgis::"],
    "client/python/": ["python::", "tidy::"],
    "client/src/ui/": ["window::a_user"],
    "tests/tools/": ["scripts::"],
    "tests/load/": ["scripts::"],
    "docs/": ["tidy::", "command_line::", "documents::"],
    "docs/python.md": ["python::"],
    "README.md": ["tidy::", "documents::"],
    "SECURITY.md": ["tidy::"],
}


def crates():
    """Name, folder and test targets of each member of the workspace, the innermost folder first."""
    arguments = ["cargo", "metadata", "--no-deps", "--format-version", "1", "--offline"]
    packages = json.loads(subprocess.run(arguments, cwd=ROOT, stdout=subprocess.PIPE, check=True).stdout)["packages"]
    found = []
    for package in packages:
        folder = pathlib.Path(package["manifest_path"]).parent.relative_to(ROOT).as_posix()
        targets = {target["name"] for target in package["targets"] if target["kind"] == ["test"]}
        found.append((package["name"], folder, targets))
    return sorted(found, key=lambda crate: -len(crate[1]))


def changed_files():
    arguments = ["git", "status", "--porcelain", "--untracked-files=all", "-z", "--no-renames"]
    status = subprocess.run(arguments, cwd=ROOT, stdout=subprocess.PIPE, check=True, text=True).stdout
    return [entry[3:] for entry in status.split("\0") if entry]


def module_of(path):
    """The module path of a source's tests: of its folder, or of the one above for deep ones, whose tests lie there; of the source itself
    where it lies at the root of the crate."""
    parts = list(path.with_suffix("").parts)
    parts = parts[: max(1, min(len(parts) - 1, 2))]
    return "" if parts in (["lib"], ["main"]) else "::".join(parts) + "::"


def plan(names, members):
    """The test targets to run, each with its filters; "" is all tests."""
    wanted = collections.defaultdict(set)
    for name in names:
        crate = next((crate for crate in members if crate[0] == name or crate[0] == f"insula-{name}"), None)
        if crate:
            wanted[crate[0], "--lib"].add("")
            for target in crate[2]:
                wanted[crate[0], target].add("")
            continue
        path = pathlib.PurePosixPath(name)
        for beginning, filters in CONCERNS.items():
            if name.startswith(beginning):
                wanted[WHOLE, "whole"].update(filters)
        crate = next((crate for crate in members if name.startswith(crate[1] + "/")), None)
        if not crate or path.suffix != ".rs":
            continue
        package, folder, targets = crate
        inner = path.relative_to(folder)
        if inner.parts[0] == "src":
            wanted[package, "--lib"].add(module_of(inner.relative_to("src")))
            has_integration = "integration" in targets and inner.stem not in ("main", "mod")
            if has_integration and (ROOT / folder / "tests/integration" / inner.name).is_file():
                wanted[package, "integration"].add(inner.stem + "::")
        elif package == WHOLE and inner.parts[0] == "integration":
            wanted[WHOLE, "whole"].add("" if inner.stem == "main" else pathlib.PurePosixPath(inner.parts[1]).stem + "::")
        elif package == WHOLE:
            wanted[WHOLE, "--lib"].add("")
        elif inner.parts[0] == "tests":
            is_shared = inner.stem in ("main", "support", "test_server")
            for target in targets:
                wanted[package, target].add("" if is_shared or target != "integration" else inner.parts[2].removesuffix(".rs") + "::")
    return wanted


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--profile", default="ci", help="profile of cargo")
    parser.add_argument("--list", action="store_true", help="only print the commands")
    parser.add_argument("names", nargs="*", metavar="FILE | CRATE")
    args = parser.parse_args()
    wanted = plan(args.names or changed_files(), crates())
    if not wanted:
        print("no test concerns these files")
    status = 0
    for (package, target), filters in sorted(wanted.items()):
        command = ["cargo", "test", "--profile", args.profile, "-p", FEATURES, "-p", package]
        command += [target] if target == "--lib" else ["--test", target]
        if package == WHOLE and target != "--lib":
            # Their programs are not those of the package.
            programs = ["cargo", "build", "--profile", args.profile, "-p", FEATURES, "-p", "insula-client", "-p", "insula-server"]
            status |= run([*programs, "--bin", "insula", "--bin", "insula-server"], args.list)
        # libtest-mimic takes one filter.
        for filters in [[]] if "" in filters else [[one] for one in sorted(filters)] if package == WHOLE else [sorted(filters)]:
            status |= run([*command, *(["--", *filters] if filters else [])], args.list)
    sys.exit(1 if status else 0)


def run(command, is_dry):
    print("$", " ".join(command), flush=True)
    return 0 if is_dry else subprocess.run(command, cwd=ROOT).returncode


if __name__ == "__main__":
    main()
