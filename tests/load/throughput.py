#!/usr/bin/env python3
"""Compares the throughput of Insula and nginx on the same tiles with wrk. Prints Markdown, then a line of JSON.

    tests/load/throughput.py CITY [--rounds 5] [--seconds 8] [--tls] [--peer NAME=SERVER] [--report FILE.json]

Needs wrk, nginx, openssl, and `cargo build --release -p insula-measure -p insula-server --bin tile_files --bin insula-server`.
All servers run all the time, all but one of them idle. Each round measures each, in alternating order, so that other load on
the machine affects all equally. Peers are other builds of Insula.
"""

import argparse, json, os, pathlib, shutil, signal, statistics, subprocess, sys, tempfile, time, urllib.request, ssl

HERE = pathlib.Path(__file__).resolve().parent
TARGET = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", HERE.parent.parent / "target")) / "release"

NGINX = """
worker_processes auto;
daemon off;
pid {dir}/nginx.pid;
error_log {dir}/nginx.log warn;
events {{ worker_connections 4096; }}
http {{
  default_type application/octet-stream;
  access_log off;
  sendfile on; tcp_nopush on; tcp_nodelay on;
  keepalive_requests 100000000; keepalive_timeout 60s;
  open_file_cache max=200000 inactive=600s; open_file_cache_valid 600s;
  client_body_temp_path {dir}/b; proxy_temp_path {dir}/p; fastcgi_temp_path {dir}/f; uwsgi_temp_path {dir}/u; scgi_temp_path {dir}/s;
  server {{
    listen 127.0.0.1:{port}{tls};
    {certificate}
    root {dir}/files;
    location / {{ etag on; add_header Cache-Control "public, max-age=31536000, immutable"; add_header Access-Control-Allow-Origin "*"; add_header X-Content-Type-Options nosniff; }}
  }}
}}
"""


def free_port():
    import socket

    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def wait_until_open(port):
    import socket

    for _ in range(200):
        try:
            return socket.create_connection(("127.0.0.1", port), 1).close()
        except OSError:
            time.sleep(0.05)
    sys.exit("nginx does not listen")


def wrk(url, paths, seconds, connections, threads):
    command = ["wrk", f"-t{threads}", f"-c{connections}", f"-d{seconds}s", "--latency", "-s", str(HERE / "tiles.lua"), url]
    output = subprocess.run(command, env=dict(os.environ, PATHS=str(paths)), capture_output=True, text=True, check=True).stdout
    result = json.loads(next(line for line in output.splitlines() if line.startswith("JSON "))[5:])
    result["per_second"] = result["requests"] / result["seconds"]
    return result


def cpu_seconds(pid):
    """Processor time of a process and its children since their start."""
    pids = [pid] + [int(p) for p in pathlib.Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    ticks = [pathlib.Path(f"/proc/{p}/stat").read_text().rsplit(")", 1)[1].split() for p in pids]
    return sum(int(fields[11]) + int(fields[12]) for fields in ticks) / os.sysconf("SC_CLK_TCK")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("city")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=int, default=8)
    parser.add_argument("--connections", type=int, default=64)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--tls", action="store_true")
    parser.add_argument("--server", default=TARGET / "insula-server", help="for figures of a release, one that was built with --profile dist")
    parser.add_argument("--peer", action="append", default=[], help="NAME=SERVER: another build, measured in the same rounds")
    parser.add_argument("--report")
    args = parser.parse_args()
    folder = pathlib.Path(tempfile.mkdtemp(prefix="insula-load-"))
    os.chmod(folder, 0o755)
    started = []
    try:
        subprocess.run([TARGET / "tile_files", args.city, folder / "files"], check=True)
        paths = folder / "files/paths.txt"
        scheme, certificate, settings = "http", "", []
        if args.tls:
            scheme = "https"
            subprocess.run(
                ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2",
                 "-subj", "/CN=localhost", "-keyout", folder / "key.pem", "-out", folder / "cert.pem"],
                check=True, capture_output=True,
            )
            certificate = f"ssl_certificate {folder}/cert.pem; ssl_certificate_key {folder}/key.pem; ssl_session_cache shared:s:1m;"
            settings = ["--set", f"tls.certificate={folder}/cert.pem", "--set", f"tls.key={folder}/key.pem"]
        port = free_port()
        (folder / "nginx.conf").write_text(NGINX.format(dir=folder, port=port, tls=" ssl" if args.tls else "", certificate=certificate))
        started.append(subprocess.Popen(["nginx", "-c", folder / "nginx.conf", "-e", folder / "nginx.log"]))
        urls, pids = {"nginx": f"{scheme}://127.0.0.1:{port}"}, {"nginx": started[0].pid}
        for name, program in [("insula", args.server), *(peer.split("=", 1) for peer in args.peer)]:
            command = [program, "serve", args.city, "--listen", "127.0.0.1:0", *settings]
            server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, stderr=subprocess.DEVNULL)
            started.append(server)
            urls[name], pids[name] = server.stdout.readline().split()[-1], server.pid
        wait_until_open(port)
        # The comparison is valid only if both servers send the same bytes.
        path = paths.read_text().split()[-1]
        context = ssl._create_unverified_context()
        bodies = {name: urllib.request.urlopen(url + path, context=context).read() for name, url in urls.items()}
        assert all(body == bodies["nginx"] != b"" for body in bodies.values()), "the servers send different bytes"
        rounds = {name: [] for name in urls}
        for url in urls.values():
            wrk(url, paths, 2, args.connections, args.threads)
        for number in range(args.rounds):
            for name in sorted(urls, reverse=number % 2 == 1):
                before = cpu_seconds(pids[name])
                result = wrk(urls[name], paths, args.seconds, args.connections, args.threads)
                result["cpu_us"] = (cpu_seconds(pids[name]) - before) * 1e6 / result["requests"]
                assert result["errors"] == 0, (name, result)
                rounds[name].append(result)
                print(f"round {number + 1} {name}: {result['per_second']:.0f}/s p99 {result['p99_us'] / 1000:.2f} ms {result['cpu_us']:.2f} us", file=sys.stderr)
        median = lambda name, key: statistics.median(r[key] for r in rounds[name])
        summary = {name: {key: median(name, key) for key in ("per_second", "p50_us", "p99_us", "cpu_us")} for name in rounds}
        ratio = {key: summary["insula"][key] / summary["nginx"][key] for key in ("per_second", "p99_us", "cpu_us")}
        report = {"tls": args.tls, "connections": args.connections, "medians": summary, "ratio": ratio, "rounds": rounds}
        if args.report:
            pathlib.Path(args.report).write_text(json.dumps(report, indent=1) + "\n")
        print(f"| {scheme}, {args.connections} connections, medians of {args.rounds} | requests/s | p50 ms | p99 ms | CPU us per request |\n|---|---|---|---|---|")
        for name, medians in summary.items():
            print(f"| {name} | {medians['per_second']:.0f} | {medians['p50_us'] / 1000:.2f} | {medians['p99_us'] / 1000:.2f} | {medians['cpu_us']:.2f} |")
        print(f"| insula / nginx | {ratio['per_second']:.3f} | | {ratio['p99_us']:.3f} | {ratio['cpu_us']:.3f} |")
        print(json.dumps({"per_second_ratio": round(ratio["per_second"], 3), "p99_ratio": round(ratio["p99_us"], 3), "cpu_ratio": round(ratio["cpu_us"], 3)}))
    finally:
        for process in started:
            process.send_signal(signal.SIGTERM)
            process.wait()
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
