#!/usr/bin/env python3
"""Measures what slow clients of one address do to others: lockout.py CITY [--server PROGRAM] [--secs S]

Starts a server and requests its manifest from 127.0.0.1, first alone, then while another process attacks from 127.0.0.2 at
full rate. Then the same for filters, while 120 connections of the other address ask for long ones. Prints the p99 of the latency, its ratio to that without an attack, and failed requests. The attacker has a processor
of its own if there are several, so that it takes from others what the server spends on it and not what it spends itself.
"""
import argparse, http.client, json, multiprocessing, os, pathlib, socket, statistics, subprocess, tempfile, threading, time

ATTACKER = "127.0.0.2"
FILTER = "expr=kind+%3D%3D+'building'"
FILTER_CONNECTIONS = 120
H2_PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"


def connect(port):
    client = socket.socket()
    client.settimeout(5)
    client.bind((ATTACKER, 0))
    client.connect(("127.0.0.1", port))
    return client


def keep(sockets, client, limit=2000):
    """Holds a connection, and closes the oldest one beyond `limit`."""
    sockets.append(client)
    if len(sockets) > limit:
        sockets.pop(0).close()


def slow_headers(port, _city):
    sockets = []
    while True:
        try:
            client = connect(port)
            client.send(b"GET / HTTP/1.1\r\nHost: x\r\nX-A: ")
            keep(sockets, client)
        except OSError:
            pass


def idle(port, _city):
    sockets = []
    while True:
        try:
            keep(sockets, connect(port))
        except OSError:
            pass


def deaf(port, city):
    """Requests tiles and reads nothing."""
    sockets = []
    request = f"GET /v1/cities/{city} HTTP/1.1\r\nHost: x\r\n\r\n".encode() * 50
    while True:
        try:
            client = connect(port)
            client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            client.send(request)
            keep(sockets, client)
        except OSError:
            pass


def zero_window(port, _city):
    """HTTP/2 connections whose streams may send nothing."""
    def frame(kind, flags, stream, payload=b""):
        return len(payload).to_bytes(3, "big") + bytes([kind, flags]) + stream.to_bytes(4, "big") + payload
    settings = frame(4, 0, 0, (4).to_bytes(2, "big") + (0).to_bytes(4, "big"))
    # :method GET, :scheme http, :path /, :authority x (HPACK, RFC 7541).
    headers = bytes([0x82, 0x86, 0x84, 0x41, 1]) + b"x"
    requests = b"".join(frame(1, 5, 2 * k + 1, headers) for k in range(100))
    sockets = []
    while True:
        try:
            client = connect(port)
            client.send(H2_PREFACE + settings + requests)
            keep(sockets, client, 200)
        except OSError:
            pass


def long_filters(port, city):
    """Asks for long filters on many connections."""
    def ask():
        while True:
            try:
                client = http.client.HTTPConnection("127.0.0.1", port, timeout=60, source_address=(ATTACKER, 0))
                client.request("GET", f"{city}/filter?{FILTER}" + f"+%7C%7C+{FILTER[5:]}" * 150)
                client.getresponse().read()
                client.close()
            except OSError:
                time.sleep(0.01)
    threads = [threading.Thread(target=ask, daemon=True) for _ in range(FILTER_CONNECTIONS)]
    for thread in threads:
        thread.start()
    threads[0].join()


def address_of_version(port, city):
    client = http.client.HTTPConnection("127.0.0.1", port, timeout=5)
    client.request("GET", f"/v1/cities/{city}")
    version = json.loads(client.getresponse().read())["version"]
    client.close()
    return f"/v1/cities/{city}/{version}"


def pin(cores):
    os.sched_setaffinity(0, cores)


def attack(kind, port, city, cores):
    pin(cores)
    kind(port, city)


def latencies(port, path, secs):
    """Requests `path` for `secs`. Every other request opens a connection. Returns their seconds and the number of failures."""
    times, failures, kept = [], 0, None
    end = time.monotonic() + secs
    while time.monotonic() < end:
        fresh = len(times) % 2 == 0
        client = http.client.HTTPConnection("127.0.0.1", port, timeout=5) if fresh or kept is None else kept
        begin = time.perf_counter()
        try:
            client.request("GET", path)
            response = client.getresponse()
            response.read()
            failures += response.status != 200
            kept = client if not fresh else kept
        except OSError:
            failures, kept = failures + 1, None
        times.append(time.perf_counter() - begin)
        if fresh:
            client.close()
        time.sleep(0.002)
    return times, failures


def main():
    ap = argparse.ArgumentParser(description=__doc__)
    ap.add_argument("city", type=pathlib.Path)
    ap.add_argument("--server", default="target/release/insula-server")
    ap.add_argument("--secs", type=float, default=10)
    args = ap.parse_args()
    every = sorted(os.sched_getaffinity(0))
    attackers, others = ({every[-1]}, set(every[:-1])) if len(every) > 1 else (set(every), set(every))
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    pin(others)
    with tempfile.TemporaryFile() as log, subprocess.Popen(
            [args.server, "serve", args.city, "--listen", f"127.0.0.1:{port}"], stdout=log, stderr=log) as server:
        try:
            city = args.city.resolve().name
            manifest = f"/v1/cities/{city}"
            for _ in range(100):
                try:
                    if latencies(port, manifest, 0.05)[1] == 0:
                        break
                except OSError:
                    pass
                time.sleep(0.1)
            else:
                raise SystemExit("the server does not respond")
            p99 = lambda times: statistics.quantiles(times, n=100)[98] * 1000
            version = address_of_version(port, city)
            for path, target, kinds in ((manifest, city, (idle, slow_headers, deaf, zero_window)),
                                        (f"{version}/filter?{FILTER}", version, (long_filters,))):
                alone = p99(latencies(port, path, args.secs)[0])
                print(f"{'alone':14} p99 {alone:6.2f} ms")
                for kind in kinds:
                    process = multiprocessing.Process(target=attack, args=(kind, port, target, attackers), daemon=True)
                    process.start()
                    time.sleep(1)
                    times, failures = latencies(port, path, args.secs)
                    process.kill()
                    process.join()
                    time.sleep(2)
                    print(f"{kind.__name__:14} p99 {p99(times):6.2f} ms, {p99(times) / alone:5.2f} times, "
                          f"{failures} of {len(times)} requests failed")
        finally:
            server.terminate()


if __name__ == "__main__":
    main()
