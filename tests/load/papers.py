#!/usr/bin/env python3
"""Measures what the papers measured, and writes the tables of docs/papers.md again.

    tests/load/papers.py --data DIR --out DIR [--only NAME]... [--markdown docs/papers.md] [--programs target/release]

DIR of the data has the folders `meshes` (nefertiti.obj, skull.obj, bun_zipper.ply), `delft-3dbag` (delft.city.jsonl) and
`chiba-textured` (chiba_68.obj with its textures); docs/papers.md says where they come from. Models that are not public are made
in the folder of --out, which takes about 1 GB. Build first: `cargo build --release --workspace --bins`.

Without --markdown all tables are printed. With it, each table of the file below a line `<!-- table: NAME -->` is replaced; a file
that does not exist is written with the tables alone. NAME is one of NAMES. All of them take about MINUTES minutes on two cores.
"""

import argparse, os, pathlib, re, sys, time

HERE = pathlib.Path(__file__).resolve().parent
TARGET = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", HERE.parent.parent / "target")) / "release"
sys.path.insert(0, str(HERE))

from papers import gasparello, mischitelli, vacca
from papers.tools import Setup, Table, say

TABLES = {**vacca.TABLES, **gasparello.TABLES, **mischitelli.TABLES}
MINUTES = 25


def load():
    """The mean number of busy processes of the last minute."""
    return os.getloadavg()[0]


def machine(seconds, loads):
    """What the tables were measured on."""
    model = "unknown processor"
    for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines() if pathlib.Path("/proc/cpuinfo").is_file() else []:
        if line.startswith("model name"):
            model = line.split(":")[1].strip()
    table = Table("processor", "cores", "measured", "minutes", "load average, lowest and highest at the end of a table")
    table.row(model, os.cpu_count(), time.strftime("%Y-%m-%d"), f"{seconds / 60:.1f}", f"{min(loads):.1f}, {max(loads):.1f}")
    return table.markdown()


def replaced(page, tables):
    """The page with its tables replaced. Fails if one has no place."""
    for name, text in tables.items():
        place = re.compile(rf"(<!-- table: {re.escape(name)} -->\n)(?:\|.*\n)*")
        if not place.search(page):
            sys.exit(f"the page has no line `<!-- table: {name} -->`")
        page = place.sub(lambda match: match[1] + text, page)
    return page


def main():
    description = __doc__.replace("NAMES", ", ".join(TABLES)).replace("MINUTES", str(MINUTES))
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=pathlib.Path, required=True, help="folder of the public data")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="folder for models, cities and reports")
    parser.add_argument("--only", action="append", choices=list(TABLES), metavar="NAME", help="one table; may be repeated")
    parser.add_argument("--markdown", type=pathlib.Path, help="page to update, or to write")
    parser.add_argument("--programs", type=pathlib.Path, default=TARGET, help="folder of the programs")
    args = parser.parse_args()
    setup = Setup(args.data.resolve(), args.out.resolve(), args.programs.resolve())
    tables, loads, begin = {}, [load()], time.monotonic()
    for name in args.only or TABLES:
        start = time.monotonic()
        tables[name] = TABLES[name](setup).markdown()
        loads.append(load())
        say(f"{name}: {time.monotonic() - start:.0f} s, load {loads[-1]:.1f}")
        (setup.out / f"{name}.md").write_text(tables[name])
    if not args.only:
        tables["machine"] = machine(time.monotonic() - begin, loads)
    texts = "\n".join(f"<!-- table: {name} -->\n{text}" for name, text in tables.items())
    if args.markdown is None:
        print(texts)
    elif args.markdown.is_file():
        args.markdown.write_text(replaced(args.markdown.read_text(), tables))
    else:
        args.markdown.write_text(texts)


if __name__ == "__main__":
    main()
