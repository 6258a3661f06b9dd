#!/usr/bin/env python3
"""Bakes a city in steps on a Dask cluster: bake.py --scheduler ADDRESS --work URL [--program PATH].

The job is in the work URL already (`insula-server bake plan --inputs ... --work URL`). The result of each task is in the work URL too, so
this program keeps nothing: started again, it goes on where it stopped.
"""

import argparse
import os
import subprocess
import sys
import time
from collections import Counter

from distributed import Client, as_completed

STAGES = ["scan", "plan", "shuffle", "region", "crown", "join-plan", "join-part", "join-finish"]
# Stages of one task, which has no number.
SINGLE = ("plan", "crown", "join-plan", "join-finish")
# Exit codes of errors that no retry mends: a wrong command line, and a task that fails on any machine.
FINAL = (2, 3)


def run_step(program, work, job, words, threads):
    """Runs a step on a worker, and returns its exit code and what it says. A worker that dies takes its step with it."""
    command = [program, "bake", *words, "--work", work, "--job", job, "--threads", str(threads)]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    return done.returncode, done.stderr.strip()[-2000:]


def threads_of_a_host(client):
    """Threads of all workers of the host that has the fewest: the other workers wait while a stage has one task."""
    of_hosts = Counter()
    for worker in client.scheduler_info(n_workers=-1)["workers"].values():
        of_hosts[worker["host"]] += worker["nthreads"]
    return min(of_hosts.values(), default=1)


def run_stage(client, arguments, stage, tasks):
    """Runs the tasks of a stage until all are done. Ends the program at an error that no retry mends, or after too many rounds."""
    waiting = list(range(tasks))
    threads = max(arguments.threads, threads_of_a_host(client)) if stage in SINGLE else arguments.threads
    for attempt in range(arguments.attempts):
        futures = {}
        for task in waiting:
            words = [stage] if stage in SINGLE else [stage, str(task)]
            # `pure=False`: a task that failed before is run again.
            future = client.submit(run_step, arguments.program, arguments.work, arguments.job, words, threads, pure=False)
            futures[future] = task
        waiting = []
        for future in as_completed(futures, raise_errors=False):
            task = futures[future]
            # A task has no result when its workers died more often than the scheduler allows.
            code, text = future.result() if future.status == "finished" else (1, "its workers died")
            if code in FINAL:
                sys.exit(f"{stage} {task}: {text}")
            if code:
                print(f"{stage} {task}: {text}; it is tried again", file=sys.stderr, flush=True)
                waiting.append(task)
        if not waiting:
            return
        time.sleep(min(2**attempt, 60))
    sys.exit(f"{stage}: {len(waiting)} of {tasks} tasks failed {arguments.attempts} times")


def main():
    parser = argparse.ArgumentParser(description="Bakes a city in steps on a Dask cluster.")
    parser.add_argument("--scheduler", required=True, help="address of the scheduler, such as tcp://10.0.0.1:8786")
    parser.add_argument("--work", required=True, help="folder or s3://BUCKET/PATH that all workers reach")
    parser.add_argument("--job", default=os.environ.get("INSULA_JOB", ""), help="hash of the job, as `bake plan --inputs` printed it")
    parser.add_argument("--program", default="insula-server", help="path of insula-server on the workers")
    parser.add_argument("--threads", type=int, default=1, help="threads of a step: the number that a worker has")
    parser.add_argument("--attempts", type=int, default=8, help="rounds in which tasks that failed are tried again")
    arguments = parser.parse_args()
    with Client(arguments.scheduler) as client:
        for stage in STAGES:
            count = [arguments.program, "bake", "tasks", stage, "--work", arguments.work, "--job", arguments.job]
            tasks = int(subprocess.run(count, check=True, stdout=subprocess.PIPE, text=True).stdout)
            start = time.monotonic()
            run_stage(client, arguments, stage, tasks)
            print(f"{stage}: {tasks} tasks in {time.monotonic() - start:.1f} s", flush=True)


if __name__ == "__main__":
    main()
