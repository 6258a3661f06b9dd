#!/usr/bin/env python3
"""Measures what clients of one address do to others: lockout.py CITY [--server PROGRAM] [--secs S] [--only NAME,...]

Starts a server and requests its manifest from 127.0.0.1, first alone, then while another process attacks from 127.0.0.2 at
full rate. Then the same on each route that computes, while 120 connections of the other address ask for the most expensive
answers: `filter`, `search`, `group`, `tileset`, `list`, `draw`, `analyse`. Prints the p99 of the latency, its ratio to that without an attack,
and failed requests. The attacker has a processor of its own if there are several, so that it takes from others what the server
spends on it and not what it spends itself. Fails if a route that computes takes more than 3 times as long as alone.
"""
import argparse, contextlib, http.client, itertools, json, multiprocessing, os, pathlib, random, socket, statistics, subprocess, tempfile
import threading, time

ATTACKER = "127.0.0.2"
CONNECTIONS = 120
MOST_TIMES = 3
FILTER = "expr=kind+%3D%3D+'building'"
# Nothing that a request made is kept for the next one.
NO_CACHE = ("limits.tile_bytes=0", "cache.memory_bytes=0", "limits.cache_bytes=0")
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


def request(client, what):
    """Sends a request, a path or a path with the JSON of a body, and reads the response. Returns its status."""
    path, body = what if isinstance(what, tuple) else (what, None)
    text = None if body is None else json.dumps(body)
    client.request("GET" if body is None else "POST", path, text, {} if body is None else {"Content-Type": "application/json"})
    response = client.getresponse()
    response.read()
    return response.status


def ask_much(port, requests):
    """Sends requests on many connections, which stay open, each as soon as the one before is answered."""
    def ask(number):
        client = None
        for what in itertools.islice(itertools.cycle(requests), number, None):
            try:
                client = client or http.client.HTTPConnection("127.0.0.1", port, timeout=60, source_address=(ATTACKER, 0))
                request(client, what)
            except (OSError, http.client.HTTPException):
                client = None
                time.sleep(0.01)
    threads = [threading.Thread(target=ask, args=(number,), daemon=True) for number in range(CONNECTIONS)]
    for thread in threads:
        thread.start()
    threads[0].join()


class Routes:
    """What a client asks of each route that computes, what an attacker does, and the settings of the server."""

    def __init__(self, manifest, port):
        self.port = port
        self.city, self.version = f"/v1/cities/{manifest['name']}", f"/v1/cities/{manifest['name']}/{manifest['version']}"
        self.depth, self.focus = manifest["depth"], manifest["focus"]
        side = 1 << self.depth
        self.leaves = [(x, y) for x in range(side) for y in range(side)]
        random.Random(1).shuffle(self.leaves)

    NAMES = ("filter", "search", "group", "tileset", "list", "draw", "analyse")

    def is_served(self, path):
        client = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        status = request(client, path)
        client.close()
        return status == 200

    def filter(self):
        return f"{self.version}/filter?{FILTER}", [f"{self.version}/filter?{FILTER}" + f"+%7C%7C+{FILTER[5:]}" * 150], NO_CACHE

    def search(self):
        letters = random.Random(2)
        word = lambda length: "".join(letters.choice("aeinrstlo") for _ in range(length))
        texts = ["%20".join(word(7) for _ in range(8)) for _ in range(500)]
        return f"{self.version}/search?q=ro", [f"{self.version}/search?q={text}&limit=100" for text in texts], ()

    def group(self):
        path = lambda x, y, count, side: f"{self.version}/groups/meshes/{self.depth}/{x // side * side}/{y // side * side}/{count}/0"
        # Parts of a city may be without meshes.
        served = next(path(x, y, 4, 2) for x, y in self.leaves if self.is_served(path(x, y, 4, 2)))
        return served, [path(x, y, 64, 8) for x, y in self.leaves], NO_CACHE

    def tileset(self):
        path = lambda level, x, y: f"{self.city}/3dtiles/{self.version.rsplit('/')[-1]}/content/{level}/{x}/{y}.glb"
        return path(0, 0, 0), [path(0, 0, 0)] + [path(self.depth, x, y) for x, y in self.leaves], NO_CACHE

    def list(self):
        # The usual page is in memory.
        return "/v1/cities?limit=5", [f"/v1/cities?limit={limit}" for limit in range(2, 1000)], ()

    def around(self, metres):
        """A square, in metres of the city's system."""
        [west, south], [east, north] = self.focus
        x, y = (west + east) / 2, (south + north) / 2
        return [x - metres, y - metres, x + metres, y + metres]

    def draw(self):
        drawing = lambda metres: (f"{self.city}/draw", {"format": "svg", "bbox_metres": self.around(metres)})
        return drawing(50), [drawing(150)], ("drawings.at_once=2",)

    def analyse(self):
        analysis = lambda metres: (f"{self.city}/analyse", {"kind": "sky", "bbox_metres": self.around(metres)})
        return analysis(20), [analysis(150)], ("analyses.at_once=2",)


def manifest_of(port, city):
    client = http.client.HTTPConnection("127.0.0.1", port, timeout=5)
    client.request("GET", f"/v1/cities/{city}")
    manifest = json.loads(client.getresponse().read())
    client.close()
    return manifest


def pin(cores):
    os.sched_setaffinity(0, cores)


def attack(kind, port, city, cores):
    pin(cores)
    kind(port, city)


def latencies(port, path, secs):
    """Requests `path` for `secs` as [`request`] does. Every other request opens a connection. Returns their seconds and the number of failures."""
    times, failures, kept = [], 0, None
    end = time.monotonic() + secs
    while time.monotonic() < end:
        fresh = len(times) % 2 == 0
        client = http.client.HTTPConnection("127.0.0.1", port, timeout=30) if fresh or kept is None else kept
        begin = time.perf_counter()
        try:
            failures += request(client, path) != 200
            kept = client if not fresh else kept
        except (OSError, http.client.HTTPException):
            failures, kept = failures + 1, None
        times.append(time.perf_counter() - begin)
        if fresh:
            client.close()
        time.sleep(0.002)
    return times, failures


@contextlib.contextmanager
def served(program, city, settings=()):
    """The port of a server of a city."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    words = [word for setting in settings for word in ("--set", setting)]
    command = [program, "serve", city, "--listen", f"127.0.0.1:{port}", *words]
    with tempfile.TemporaryFile() as log, subprocess.Popen(command, stdout=log, stderr=log) as server:
        try:
            for _ in range(100):
                if latencies(port, f"/v1/cities/{city.resolve().name}", 0.05)[1] == 0:
                    break
                time.sleep(0.1)
            else:
                log.seek(0)
                raise SystemExit(f"the server does not respond: {log.read().decode()}")
            yield port
        finally:
            server.terminate()


def measure(name, port, path, secs, attackers, attacks):
    """Prints what each attack, a function with its last argument, does to a request. Returns the largest ratio."""
    p99 = lambda times: statistics.quantiles(times, n=100)[98] * 1000
    times, failures = latencies(port, path, secs)
    alone, worst = p99(times), 0
    if failures:
        raise SystemExit(f"{name}: {failures} of {len(times)} requests fail without an attack: {path}")
    print(f"{name:14} alone p99 {alone:8.2f} ms, {failures} of {len(times)} requests failed", flush=True)
    for kind, target in attacks:
        process = multiprocessing.Process(target=attack, args=(kind, port, target, attackers), daemon=True)
        process.start()
        time.sleep(1)
        times, failures = latencies(port, path, secs)
        process.kill()
        process.join()
        time.sleep(2)
        worst = max(worst, p99(times) / alone)
        print(f"{name:14} {kind.__name__:12} p99 {p99(times):8.2f} ms, {p99(times) / alone:5.2f} times, "
              f"{failures} of {len(times)} requests failed", flush=True)
    return worst


def main():
    ap = argparse.ArgumentParser(description=__doc__)
    ap.add_argument("city", type=pathlib.Path)
    ap.add_argument("--server", default="target/release/insula-server")
    ap.add_argument("--secs", type=float, default=10)
    ap.add_argument("--only", default=",".join(("manifest", *Routes.NAMES)))
    args = ap.parse_args()
    every = sorted(os.sched_getaffinity(0))
    attackers, others = ({every[-1]}, set(every[:-1])) if len(every) > 1 else (set(every), set(every))
    pin(others)
    city, slow = args.city.resolve().name, []
    for name in args.only.split(","):
        if name == "manifest":
            with served(args.server, args.city) as port:
                attacks = [(kind, city) for kind in (idle, slow_headers, deaf, zero_window)]
                measure(name, port, f"/v1/cities/{city}", args.secs, attackers, attacks)
            continue
        with served(args.server, args.city) as port:
            path, requests, settings = getattr(Routes(manifest_of(port, city), port), name)()
        with served(args.server, args.city, settings) as port:
            if measure(name, port, path, args.secs, attackers, [(ask_much, requests)]) > MOST_TIMES:
                slow.append(name)
    if slow:
        raise SystemExit(f"more than {MOST_TIMES} times as long as alone: {', '.join(slow)}")


if __name__ == "__main__":
    main()
