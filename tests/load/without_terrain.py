#!/usr/bin/env python3
"""Copies a CityJSON file without its terrain: without_terrain.py INPUT OUTPUT"""
import json, sys

city = json.load(open(sys.argv[1]))
city["CityObjects"] = {key: o for key, o in city["CityObjects"].items() if o["type"] != "TINRelief"}
json.dump(city, open(sys.argv[2], "w"))
