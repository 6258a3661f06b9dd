#!/usr/bin/env python3
"""Copies a CityJSON file without its terrain."""
import argparse, json, pathlib

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("input", type=pathlib.Path)
parser.add_argument("output", type=pathlib.Path)
args = parser.parse_args()
city = json.loads(args.input.read_text())
city["CityObjects"] = {key: o for key, o in city["CityObjects"].items() if o["type"] != "TINRelief"}
args.output.write_text(json.dumps(city))
