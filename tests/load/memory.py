#!/usr/bin/env python3
"""Shows that a server keeps to its limit of memory: memory.py CITY [--server PROGRAM] [--cities 300] [--open 100] [--secs 60]

Serves many copies of a city, whose search index should be large, with 16 MiB for tiles, room for a third of the indexes, and 32 MiB
for responses that wait. Searches all of them, so that two of three indexes are evicted, then keeps connections to some of them open,
and attacks for a minute: requests that compute, of all kinds, responses that nobody reads, damaged requests, and long headers.
Prints the resident memory after each stage. Fails if it grows by more than these limits and 32 MiB for the work itself, if the
caches have more than theirs, or if the indexes did not fill their room.
"""
import argparse, http.client, json, pathlib, random, re, socket, subprocess, tempfile, threading, time

import lockout

TILES_MIB, RESPONSES_MIB, WORK_MIB = 16, 32, 32
SETTINGS = (f"limits.tile_bytes={TILES_MIB << 20}", "cache.memory_bytes=0", f"limits.in_flight_bytes={RESPONSES_MIB << 20}",
            "drawings.at_once=1")


def copies(city, folder, count):
    """Copies of a city under names of their own. Archives are links to the same files."""
    manifest = json.loads((city / "city.json").read_text())
    for number in range(count):
        place = folder / f"city-{number}"
        place.mkdir()
        for file in city.iterdir():
            if file.name != "city.json":
                (place / file.name).symlink_to(file.resolve())
        (place / "city.json").write_text(json.dumps(manifest | {"name": place.name}))
    return manifest["version"]


def resident_mib(server, field="VmRSS"):
    status = pathlib.Path(f"/proc/{server.pid}/status").read_text()
    return int(re.search(rf"{field}:\s+(\d+)", status)[1]) / 1024


def get(port, path):
    client = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    client.request("GET", path)
    response = client.getresponse()
    body = response.read()
    client.close()
    return response.status, body


def cached_mib(port, kind="[a-z]*"):
    text = get(port, "/metrics")[1].decode()
    values = re.findall(rf'^insula_cached_bytes{{kind="{kind}"}} (\d+)', text, re.M)
    return sum(map(int, values)) / 2**20


def hostile(port, names, version, end):
    """Requests of all kinds from another address until a time."""
    chance = random.Random(threading.get_ident())
    while time.monotonic() < end:
        base = f"/v1/cities/{chance.choice(names)}"
        level = chance.randrange(7)
        x, y = (chance.randrange(1 << level) for _ in range(2))
        path = chance.choice((
            f"{base}/{version}/filter?{lockout.FILTER}" + f"+%7C%7C+{lockout.FILTER[5:]}" * chance.randrange(150),
            f"{base}/{version}/search?q={chance.choice('abcdefgh')}&limit=100",
            f"{base}/{version}/groups/meshes/{level}/{x // 8 * 8}/{y // 8 * 8}/64/0",
            f"{base}/3dtiles/{version}/content/{level}/{x}/{y}.glb", f"{base}/3dtiles/tileset.json",
            f"{base}/{version}/blockmaps/{level}/{x}/{y}", "/" + "%00" * chance.randrange(4000)))
        bytes_ = f"GET {path} HTTP/1.1\r\nHost: x\r\n\r\n".encode()
        kind = chance.randrange(6)
        if kind == 0:
            bytes_ = bytes(chance.randrange(256) for _ in range(chance.randrange(2000)))
        elif kind == 1:
            bytes_ = bytes_[:-2] + b"X-A: " + b"a" * chance.randrange(60000)
        elif kind == 2:
            bytes_ *= 50
        try:
            client = lockout.connect(port)
            client.settimeout(2)
            client.sendall(bytes_)
            if kind > 2:
                while client.recv(65536) and chance.random() < 0.98:
                    pass
            elif chance.random() < 0.5:
                time.sleep(0.05)
            client.close()
        except OSError:
            pass


def main():
    ap = argparse.ArgumentParser(description=__doc__)
    ap.add_argument("city", type=pathlib.Path)
    ap.add_argument("--server", default="target/release/insula-server")
    ap.add_argument("--cities", type=int, default=300)
    ap.add_argument("--open", type=int, default=100)
    ap.add_argument("--secs", type=float, default=60)
    args = ap.parse_args()
    with tempfile.TemporaryDirectory() as folder, socket.socket() as probe:
        version = copies(args.city, pathlib.Path(folder), args.cities)
        names = [f"city-{number}" for number in range(args.cities)]
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
        probe.close()
        index_mib = (args.city / "search.index").stat().st_size / 2**20
        room_mib = args.cities * index_mib / 3
        # An eighth is for directories of archives.
        cache_mib = TILES_MIB + room_mib * 8 / 7
        settings = (f"limits.cache_bytes={int(cache_mib * 2**20)}", *SETTINGS)
        words = [word for setting in settings for word in ("--set", setting)]
        server = subprocess.Popen([args.server, "serve", folder, "--listen", f"127.0.0.1:{port}", *words],
                                  stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            for _ in range(300):
                try:
                    if get(port, "/readyz")[0] == 200:
                        break
                except OSError:
                    time.sleep(0.1)
            start = resident_mib(server)
            show = lambda what: print(f"{what:36} resident {resident_mib(server):6.1f} MiB, at most "
                                      f"{resident_mib(server, 'VmHWM'):6.1f}, caches {cached_mib(port):5.1f} MiB", flush=True)
            show(f"{args.cities} cities")
            failed = sum(get(port, f"/v1/cities/{name}/{version}/search?q=a")[0] != 200 for name in names)
            show(f"all searched ({failed} failed)")
            # All but what one more would need.
            if not room_mib - 2 * index_mib < cached_mib(port, "computed") <= room_mib:
                raise SystemExit(f"indexes should fill their {room_mib:.1f} MiB")
            kept = []
            for name in names[:args.open]:
                client = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
                client.request("GET", f"/v1/cities/{name}/{version}/blockmaps/0/0/0")
                client.getresponse().read()
                kept.append(client)
            show(f"{len(kept)} open")
            end = time.monotonic() + args.secs
            threads = [threading.Thread(target=hostile, args=(port, names, version, end)) for _ in range(16)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            show(f"{args.secs:.0f} s of hostile requests")
            most, limit = resident_mib(server, "VmHWM"), start + cache_mib + RESPONSES_MIB + WORK_MIB
            print(f"at most {most:.1f} MiB of {limit:.1f} MiB")
            if failed or most > limit or cached_mib(port) > cache_mib or server.poll() is not None:
                raise SystemExit("over the limit")
        finally:
            server.terminate()
            server.wait()


if __name__ == "__main__":
    main()
