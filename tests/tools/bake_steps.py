#!/usr/bin/env python3
"""Bakes a city in steps, in random order and each step twice, and compares it with a plain bake, byte by byte.

    tests/tools/bake_steps.py --program target/release/insula-server INPUT... [--regions 8,16,32] [--chunks 1MiB,256MiB] [--work URL]
        [--mixed] -- [options of the bake]

Every size of regions is combined with every size of chunks. --work URL is a folder or s3://BUCKET/PATH in which each bake has a folder of
its own; the default is a temporary one. --mixed runs every second step as on a processor without fused operations (glibc on x86-64).
Inputs may lie in buckets; the plain bake reads the same. Downloading a city from a bucket needs `boto3`. Fails if a file differs.
"""

import argparse
import filecmp
import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

STAGES = ["scan", "plan", "shuffle", "region", "crown", "join-plan", "join-part", "join-finish"]
WITHOUT_FUSED = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-FMA4"}


class Program:
    """The server's program, which steps run."""

    def __init__(self, path, mixed, seed):
        self.path = path
        self.mixed = mixed
        self.random = random.Random(seed)
        self.runs = 0

    def run(self, *arguments):
        """Standard output of a command, which must succeed."""
        self.runs += 1
        environment = os.environ | (WITHOUT_FUSED if self.mixed and self.runs % 2 else {})
        command = [self.path, "bake", *map(str, arguments)]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        if done.returncode:
            sys.exit(f"{' '.join(command)}: exit code {done.returncode}\n{done.stderr}")
        return done.stdout

    def stage(self, stage, work):
        """Runs all tasks of a stage twice, in random order."""
        count = int(self.run("tasks", stage, "--work", work))
        has_numbers = stage in ("scan", "shuffle", "region", "join-part")
        tasks = 2 * list(range(count))
        self.random.shuffle(tasks)
        for task in tasks:
            self.run(stage, *([task] if has_numbers else []), "--work", work)
        return count


def downloaded(work, folder):
    """The folder of a finished city, fetched if it is in a bucket."""
    if not work.startswith("s3://"):
        return Path(work) / "city"
    import boto3  # needed for buckets only

    bucket, _, prefix = work.removeprefix("s3://").partition("/")
    store = boto3.client("s3", endpoint_url=os.environ.get("AWS_ENDPOINT"))
    for page in store.get_paginator("list_objects_v2").paginate(Bucket=bucket, Prefix=f"{prefix}/city/"):
        for entry in page.get("Contents", []):
            store.download_file(bucket, entry["Key"], str(folder / entry["Key"].rpartition("/")[2]))
    return folder


def compare(plain, other):
    """Names of the files in which two folders differ."""
    names = sorted({path.name for folder in (plain, other) for path in folder.iterdir()})
    return [name for name in names if not is_same(plain / name, other / name)]


def is_same(a, b):
    return a.exists() and b.exists() and filecmp.cmp(a, b, shallow=False)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("inputs", nargs="+", metavar="INPUT")
    parser.add_argument("--program", default="target/release/insula-server")
    parser.add_argument("--regions", default="8,16,32", help="leaves along a region's side")
    parser.add_argument("--chunks", default="1MiB,256MiB", help="inputs that one scan reads")
    parser.add_argument("--work", help="folder or s3://BUCKET/PATH")
    parser.add_argument("--mixed", action="store_true", help="steps on two kinds of processors")
    parser.add_argument("--seed", type=int, default=1)
    split = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    args, options = parser.parse_args(sys.argv[1:split]), sys.argv[split + 1 :]
    program = Program(str(Path(args.program).resolve()), args.mixed, args.seed)
    differing = 0
    with tempfile.TemporaryDirectory() as folder:
        # The folder's name is the city's name.
        plain = Path(folder) / "plain" / "city"
        plain.parent.mkdir()
        started = time.monotonic()
        program.run(*args.inputs, "--out", plain, *options)
        print(f"plain bake: {time.monotonic() - started:.1f} s", flush=True)
        for region in args.regions.split(","):
            for chunk in args.chunks.split(","):
                name = f"regions-{region}-chunks-{chunk}"
                work = f"{(args.work or folder).rstrip('/')}/{name}"
                started = time.monotonic()
                begun = program.run("plan", "--inputs", *args.inputs, "--work", work, "--region", region, "--chunk", chunk, *options)
                os.environ["INSULA_JOB"] = begun.split("\njob ")[1].strip()
                counts = {stage: program.stage(stage, work) for stage in STAGES}
                city = Path(folder) / f"fetched-{name}"
                city.mkdir()
                found = compare(plain, downloaded(work, city))
                differing += len(found)
                tasks = ", ".join(f"{counts[stage]} {stage}" for stage in STAGES if counts[stage] > 1)
                verdict = f"differ: {', '.join(found)}" if found else "all files equal"
                print(f"{name}: {verdict} ({tasks}; {time.monotonic() - started:.1f} s)", flush=True)
    sys.exit(1 if differing else 0)


if __name__ == "__main__":
    main()
