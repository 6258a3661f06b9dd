#!/usr/bin/env python3
"""Puts one-line faults into a copy of the workspace, one at a time, and checks that the tests that are named with them fail.

mutations.py [--check] [--only NAME]... [--fast] [--scratch DIR] [--target-dir DIR] [--cargo PROGRAM]

The faults are in mutations.toml, which says what its keys mean. The working tree's files (`git ls-files`) are copied to the scratch
folder and built there, by default in a target folder of its own. Before its first fault, each test must pass. A fault is caught if it
compiles and all of its tests fail, with the measure or the text that the list demands. Prints a Markdown table, and exits with 1 if a
fault is not caught.

--check only tells whether each old text occurs exactly once in its file, and each unit test in its crate, in a second.
"""
import argparse, functools, os, pathlib, re, shutil, subprocess, sys, time, tomllib

ROOT = pathlib.Path(__file__).resolve().parents[2]
LIST = pathlib.Path(__file__).with_name("mutations.toml")
REQUIRED = {"name", "file", "old", "new", "breaks", "run", "tests"}
OPTIONAL = {"measure", "says", "fast"}
MEASURES = ["iou", "near", "coloured"]
# The result stands on a line of its own where the program does not hold back what the test prints. The tier may precede the name.
RESULT = re.compile(r"^test +(?:\[[^]]*\] )?(\S+)(?: - should panic)?\s+\.\.\. (?:.*?^)??(ok|FAILED|ignored)$", re.MULTILINE | re.DOTALL)
SCORE = re.compile(
    r"ShapeScore \{ iou: (\S+), near: (\S+), coloured: (\S+) \}, at least (\S+), (\S+), (\S+) are required"
)


def read_faults():
    """Reads the list and checks its form. Exits if it is malformed."""
    faults = tomllib.loads(LIST.read_text(encoding="utf-8"))["fault"]
    names = [fault.get("name") for fault in faults]
    for fault in faults:
        keys = set(fault)
        wrong = (REQUIRED - keys) | (keys - REQUIRED - OPTIONAL)
        if wrong or names.count(fault["name"]) > 1 or fault.get("measure", "iou") not in MEASURES:
            sys.exit(f"{fault.get('name')}: missing, unknown or repeated keys: {sorted(wrong)}")
    return faults


def misplaced(faults, root):
    """What is wrong with the places of the faults."""
    texts = {}
    for fault in faults:
        file = fault["file"]
        if file not in texts:
            path = root / file
            texts[file] = path.read_text(encoding="utf-8") if path.is_file() else ""
        count = texts[file].count(fault["old"])
        if count != 1:
            yield f"{fault['name']}: the old text occurs {count} times in {file}"
        elif fault["old"] == fault["new"] or "\n" in fault["old"] + fault["new"]:
            yield f"{fault['name']}: the fault must change one line"
        yield from misplaced_tests(fault, root)


@functools.cache
def unit_test_names(root, crate):
    """Names of the functions in the sources of a crate."""
    folders = ("client", "protocol", "server", "shaders", "tests")
    for manifest in (path for folder in folders for path in (root / folder).rglob("Cargo.toml")):
        if f'name = "{crate}"' in manifest.read_text(encoding="utf-8"):
            sources = (manifest.parent / "src").rglob("*.rs")
            return set().union(*(re.findall(r"\bfn (\w+)", path.read_text(encoding="utf-8")) for path in sources))
    return set()


def misplaced_tests(fault, root):
    """Unit tests of a fault that its crate does not have: they would not run."""
    run = re.fullmatch(r"-p (\S+) --lib", fault["run"])
    for test in fault["tests"] if run else []:
        if test.split("::")[-1] not in unit_test_names(root, run[1]):
            yield f"{fault['name']}: {run[1]} has no test {test}"


def copy_tree(scratch):
    """Copies the working tree's files. Files that are the same already keep their time, so that nothing is built again."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, stdout=subprocess.PIPE, check=True).stdout.decode()
    names = [name for name in listed.split("\0") if name and (ROOT / name).is_file()]
    for name in names:
        content, copy = (ROOT / name).read_bytes(), scratch / name
        if not copy.is_file() or copy.read_bytes() != content:
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(content)
            shutil.copymode(ROOT / name, copy)
    listed = set(names)
    for folder, subfolders, files in os.walk(scratch):
        here = pathlib.Path(folder)
        subfolders[:] = [name for name in subfolders if here != scratch or name not in ("target", ".git")]
        for name in files:
            path = here / name
            if path.relative_to(scratch).as_posix() not in listed:
                path.unlink()


class Workspace:
    """The scratch copy and the cargo that builds it."""

    def __init__(self, args):
        self.root, self.cargo, self.timeout_secs = args.scratch / "tree", args.cargo, args.timeout
        self.env = dict(os.environ, CARGO_TARGET_DIR=str(args.target_dir or args.scratch / "target"))
        # Most of a crate stays as it is from one fault to the next.
        self.env.setdefault("CARGO_INCREMENTAL", "1")

    def test(self, program, options):
        """Runs `cargo test`. Returns its exit status, None if it did not end, and its output."""
        # `insula-measure` has no tests. It gives all crates the features that they have in the whole workspace.
        command = [self.cargo, "test", "--profile", "ci", "--locked", "-p", "insula-measure", *program, *options]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "errors": "replace"}
        process = subprocess.Popen(command, cwd=self.root, env=self.env, start_new_session=True, **pipes)
        try:
            output, _ = process.communicate(timeout=self.timeout_secs)
            return process.returncode, output
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, 9)
            return None, process.communicate()[0]

    def build(self, run):
        program, _ = split_run(run)
        return self.test(program, ["--no-run"])

    def run_tests(self, run, tests):
        # Cities that the tests share are baked again only if `insula-server` changes, which is not built here.
        shutil.rmtree(pathlib.Path(self.env["CARGO_TARGET_DIR"]) / "ci/test-cities", ignore_errors=True)
        program, module = split_run(run)
        # The program of insula-tests takes one filter at most.
        filters = tests if "insula-tests" not in program or len(tests) == 1 else module
        return self.test(program, ["--", *filters])


def split_run(run):
    """The arguments that select the test program, and its module, if it has several."""
    words = run.split()
    return (words[:-1], words[-1:]) if words[-1].endswith("::") else (words, [])


def results(output):
    """The result of each test by its full name."""
    return dict(RESULT.findall(output))


def result_of(found, test):
    """The result of a test that is named by the end of its path; None if it did not run, or did not end."""
    of_name = [result for name, result in found.items() if name == test or name.endswith("::" + test)]
    return of_name[0] if of_name else None


def section_of(output, test):
    """What a failed test said."""
    parts = re.split(r"^---- (\S+)(?: stdout)? ----$", output, flags=re.MULTILINE)
    said = [text for name, text in zip(parts[1::2], parts[2::2]) if name == test or name.endswith("::" + test)]
    return said[0] if said else output


def what_survives(fault, status, output):
    """Why a fault is not caught; None if it is."""
    if status is None:
        return "the test does not end"
    found = results(output)
    for test in fault["tests"]:
        result = result_of(found, test)
        # Without a result the program ended early: a crash.
        if result in ("ok", "ignored") or status == 0:
            return f"{test}: {result or 'did not run'}"
        section = section_of(output, test)
        if "measure" in fault:
            scores = [[float(number) for number in score] for score in SCORE.findall(section)]
            at = MEASURES.index(fault["measure"])
            if not any(score[at] < score[at + 3] for score in scores):
                return f"{test}: {fault['measure']} is within its bound"
        for text in fault.get("says", []):
            if not re.search(text, section):
                return f"{test}: does not say {text!r}"
    return None


def run_fault(workspace, fault):
    """Applies a fault, runs its tests, and takes it back. Returns why it is not caught; None if it is."""
    path = workspace.root / fault["file"]
    before = path.read_text(encoding="utf-8")
    try:
        path.write_text(before.replace(fault["old"], fault["new"]), encoding="utf-8")
        status, output = workspace.build(fault["run"])
        if status != 0:
            return "does not compile: " + first_error(output)
        status, output = workspace.run_tests(fault["run"], fault["tests"])
        workspace.last_output = output
        return what_survives(fault, status, output)
    finally:
        path.write_text(before, encoding="utf-8")


def first_error(output):
    errors = [line for line in output.splitlines() if line.startswith("error")]
    return errors[0] if errors else "no error message"


def check_baseline(workspace, run, tests):
    """The tests that do not pass without a fault, with their results."""
    status, output = workspace.build(run)
    if status != 0:
        sys.exit(f"{output}\n{run} cannot be built")
    status, output = workspace.run_tests(run, tests)
    found = results(output)
    return {test: result_of(found, test) for test in tests if result_of(found, test) != "ok"}


def main():
    parser = argparse.ArgumentParser(prog="mutations.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="only check that each old text occurs exactly once")
    parser.add_argument("--list", action="store_true", help="print the names of the faults")
    parser.add_argument("--only", action="append", default=[], metavar="NAME", help="only this fault; may be repeated")
    parser.add_argument("--fast", action="store_true", help="only faults whose tests take seconds to build and run")
    parser.add_argument("--scratch", type=pathlib.Path, default=ROOT / "target/mutations", metavar="DIR")
    parser.add_argument("--target-dir", type=pathlib.Path, metavar="DIR", help="folder of the builds, if not in the scratch folder")
    parser.add_argument("--cargo", default="cargo", metavar="PROGRAM")
    parser.add_argument("--timeout", type=float, default=1800, metavar="SECS", help="most seconds of a build, and of a run")
    parser.add_argument("--logs", type=pathlib.Path, metavar="DIR", help="write what the tests say to NAME.log in this folder")
    args = parser.parse_args()
    for folder in ("scratch", "target_dir", "logs"):
        if getattr(args, folder):
            setattr(args, folder, getattr(args, folder).resolve())
    faults = read_faults()
    wrong = list(misplaced(faults, ROOT))
    if wrong:
        sys.exit("\n".join(wrong))
    unknown = set(args.only) - {fault["name"] for fault in faults}
    if unknown:
        sys.exit(f"no fault is named {', '.join(sorted(unknown))}")
    chosen = [fault for fault in faults if not args.only or fault["name"] in args.only]
    chosen = [fault for fault in chosen if fault.get("fast") or not args.fast]
    if args.list:
        print("\n".join(fault["name"] for fault in chosen))
    if args.check or args.list:
        return
    workspace = Workspace(args)
    workspace.root.mkdir(parents=True, exist_ok=True)
    copy_tree(workspace.root)
    # Faults of one crate follow each other, so that the crates above it are built again as seldom as possible.
    runs = list(dict.fromkeys(fault["run"] for fault in chosen))
    print("| fault | result | seconds |\n|---|---|---|", flush=True)
    survivors = 0
    for run in runs:
        of_run = sorted((fault for fault in chosen if fault["run"] == run), key=lambda fault: fault["file"])
        tests = list(dict.fromkeys(test for fault in of_run for test in fault["tests"]))
        failing = check_baseline(workspace, run, tests)
        for fault in of_run:
            begin = time.monotonic()
            early = [f"{test}: {failing[test] or 'did not run'} without the fault" for test in fault["tests"] if test in failing]
            workspace.last_output = ""
            reason = early[0] if early else run_fault(workspace, fault)
            survivors += reason is not None
            result = "caught" if reason is None else f"**NOT CAUGHT**: {reason}"
            print(f"| {fault['name']} | {result} | {time.monotonic() - begin:.0f} |", flush=True)
            if args.logs:
                args.logs.mkdir(parents=True, exist_ok=True)
                (args.logs / f"{fault['name']}.log").write_text(workspace.last_output, encoding="utf-8")
    print(f"\n{len(chosen) - survivors} of {len(chosen)} faults are caught.")
    sys.exit(1 if survivors else 0)


if __name__ == "__main__":
    main()
