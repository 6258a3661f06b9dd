#!/usr/bin/env python3
"""Bakes a city on a Dask cluster whose workers are killed, and compares it with a plain bake, byte by byte.

    tests/tools/bake_dask.py --program target/release/insula-server INPUT... [--kills 10] [--workers 4] [--s3] [--schedulers 1] [--late 20]
        [--slow] -- [options of the bake]

--schedulers N kills the scheduler N times, and starts it and the driver again. --late S starts one more worker after S seconds. --slow
stops the steps of one worker for nine tenths of the time. Needs `pip install distributed`, and `moto[server]` for --s3 (with boto3). Prints
the times of both bakes and what was killed, and what `bake abort` has ended.
"""

import argparse
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

DRIVER = Path(__file__).resolve().parents[2] / "docker" / "dask" / "bake.py"


def free_port():
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


def wait_for(port):
    for _ in range(600):
        with socket.socket() as client:
            if client.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.1)
    sys.exit(f"nothing listens at port {port}")


def crawl(command):
    """Runs a command that is stopped for nine tenths of the time."""
    child = subprocess.Popen(command)
    while child.poll() is None:
        time.sleep(0.02)
        child.send_signal(signal.SIGSTOP)
        time.sleep(0.18)
        child.send_signal(signal.SIGCONT)
    return child.returncode


class Cluster:
    """A scheduler and workers, one of which dies now and then and is replaced later."""

    def __init__(self, count, seed, slow):
        self.random = random.Random(seed)
        self.slow = slow
        self.port = free_port()
        # The module, because Python's folder of programs need not be on the path.
        self.command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", str(self.port), "--no-dashboard"]
        self.start_scheduler()
        self.workers = [self.start_worker(i) for i in range(count)]
        self.killed = 0
        self.schedulers_killed = 0

    def start_scheduler(self):
        self.scheduler = subprocess.Popen(self.command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        wait_for(self.port)

    def restart_scheduler(self):
        """Kills the scheduler, and starts it again. Workers that have ended with it are replaced."""
        self.scheduler.kill()
        self.scheduler.wait()
        self.schedulers_killed += 1
        time.sleep(self.random.uniform(0.5, 3.0))
        self.start_scheduler()
        for i, worker in enumerate(self.workers):
            if worker.poll() is not None:
                self.workers[i] = self.start_worker(i)

    def start_worker(self, number):
        environment = dict(os.environ, BAKE_SLOW="1" if self.slow and number == 0 else "")
        command = [sys.executable, "-m", "distributed.cli.dask_worker", f"tcp://127.0.0.1:{self.port}", "--nthreads", "1",
                   "--memory-limit", "0", "--death-timeout", "60", "--no-dashboard", "--no-nanny"]
        # A session of its own, so that a kill takes the step with it.
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True, env=environment)

    def kill_one(self):
        victim = self.random.randrange(len(self.workers))
        group = self.workers[victim].pid
        if self.workers[victim].poll() is None:
            os.killpg(group, signal.SIGKILL)
        self.workers[victim].wait()
        self.killed += 1
        time.sleep(self.random.uniform(0.0, 1.0))
        self.workers[victim] = self.start_worker(victim)

    def stop(self):
        for worker in self.workers:
            try:
                os.killpg(worker.pid, signal.SIGKILL)
            except ProcessLookupError:
                pass
            worker.wait()
        self.scheduler.terminate()
        self.scheduler.wait()


def start_moto():
    import urllib.request

    port = free_port()
    moto = subprocess.Popen(["moto_server", "-p", str(port)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wait_for(port)
    os.environ.update(AWS_ENDPOINT=f"http://127.0.0.1:{port}", AWS_ACCESS_KEY_ID="test", AWS_SECRET_ACCESS_KEY="test",
                      AWS_REGION="us-east-1", AWS_EC2_METADATA_DISABLED="true")
    urllib.request.urlopen(urllib.request.Request(f"http://127.0.0.1:{port}/bakes", method="PUT")).read()
    return moto, port


def read_object(port, name):
    """An object of the bucket. Without a signature, moto refuses what was put with one."""
    import boto3

    store = boto3.client("s3", endpoint_url=f"http://127.0.0.1:{port}", region_name="us-east-1")
    return store.get_object(Bucket="bakes", Key=name)["Body"].read()


def count_uploads(port):
    """Number of uploads in parts that were begun and not completed."""
    import boto3

    store = boto3.client("s3", endpoint_url=f"http://127.0.0.1:{port}", region_name="us-east-1")
    return len(store.list_multipart_uploads(Bucket="bakes").get("Uploads", []))


def drive(arguments, cluster, driver):
    """Runs the driver until the city is complete, while workers and schedulers die. Returns its exit code."""
    start = time.monotonic()
    running = subprocess.Popen(driver)
    late = arguments.late
    while True:
        time.sleep(cluster.random.uniform(0.2, 2.0))
        if running.poll() is not None:
            return running.returncode
        if late is not None and time.monotonic() - start > late:
            cluster.workers.append(cluster.start_worker(len(cluster.workers)))
            late = None
        if cluster.killed < arguments.kills:
            cluster.kill_one()
        # Between the kills of workers.
        due = cluster.killed * arguments.schedulers >= arguments.kills * (cluster.schedulers_killed + 1) - 1
        if cluster.schedulers_killed < arguments.schedulers and due:
            cluster.restart_scheduler()
            # The driver ends when its scheduler has; it goes on where it stopped when it is started again.
            try:
                running.wait(timeout=30)
            except subprocess.TimeoutExpired:
                running.kill()
                running.wait()
            running = subprocess.Popen(driver)


def main():
    if sys.argv[1:2] == ["--crawl"]:
        sys.exit(crawl(sys.argv[2:]))
    split = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("inputs", nargs="+")
    parser.add_argument("--program", required=True)
    parser.add_argument("--workers", type=int, default=4)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--region", type=int, default=8)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--s3", action="store_true")
    parser.add_argument("--schedulers", type=int, default=0)
    parser.add_argument("--late", type=float)
    parser.add_argument("--slow", action="store_true")
    arguments = parser.parse_args(sys.argv[1:split])
    options = sys.argv[split + 1:]
    folder = Path(tempfile.mkdtemp(prefix="bake-dask-"))
    moto = None
    try:
        start = time.monotonic()
        plain = [arguments.program, "bake", *arguments.inputs, "--out", str(folder / "city"), "--threads", "2", *options]
        subprocess.run(plain, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        plain_s = time.monotonic() - start
        if arguments.s3:
            moto, port = start_moto()
        work = "s3://bakes/work" if arguments.s3 else str(folder / "work")
        begin = [arguments.program, "bake", "plan", "--inputs", *arguments.inputs, "--work", work, "--chunk", "1",
                 "--region", str(arguments.region), "--name", "city", *options]
        start = time.monotonic()
        begun = subprocess.run(begin, check=True, stdout=subprocess.PIPE, text=True).stdout
        print(begun, end="")
        job = begun.split("\njob ")[1].strip()
        wrapper = folder / "insula-server"
        program = str(Path(arguments.program).resolve())
        crawl_command = f'"{sys.executable}" "{Path(__file__).resolve()}" --crawl "{program}" "$@"'
        wrapper.write_text(f'#!/bin/sh\n[ -n "$BAKE_SLOW" ] || exec "{program}" "$@"\nexec {crawl_command}\n')
        wrapper.chmod(0o755)
        cluster = Cluster(arguments.workers, arguments.seed, arguments.slow)
        driver = [sys.executable, str(DRIVER), "--scheduler", f"tcp://127.0.0.1:{cluster.port}", "--work", work, "--program",
                  str(wrapper), "--attempts", "30", "--job", job]
        code = drive(arguments, cluster, driver)
        dask_s = time.monotonic() - start
        cluster.stop()
        if code:
            sys.exit("the driver failed")
        differing = 0
        for path in sorted((folder / "city").iterdir()):
            made = read_object(port, f"work/city/{path.name}") if arguments.s3 else (folder / "work/city" / path.name).read_bytes()
            same = made == path.read_bytes()
            differing += not same
            print(f"{path.name}: {path.stat().st_size} bytes, {'equal' if same else 'DIFFERENT'}")
        print(f"plain bake {plain_s:.1f} s; {arguments.workers} workers {dask_s:.1f} s, {cluster.killed} of them and "
              f"{cluster.schedulers_killed} schedulers killed")
        if arguments.s3:
            print(f"{count_uploads(port)} uploads were not completed")
            abort = [arguments.program, "bake", "abort", "--work", work]
            print(subprocess.run(abort, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines()[-1])
            left = count_uploads(port)
            print(f"{left} uploads are left after `bake abort`")
            differing += left
        sys.exit(1 if differing else 0)
    finally:
        if moto:
            moto.terminate()
            moto.wait()
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
