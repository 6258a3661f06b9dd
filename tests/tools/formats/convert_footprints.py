#!/usr/bin/env python3
"""Writes GeoJSON footprints in other vector formats, for bakes that must give equal columns.

    convert_footprints.py IN.geojson --out DIR

Writes NAME.fgb, NAME.gpkg, NAME.shp (with .dbf, .prj, .cpg), NAME.parquet (GeoParquet 1.1 with a bbox column), NAME.csv
(well-known text in the column `wkt`) and NAME.geojson, all with the same features in the same order.

Needs: pip install geopandas pyogrio pyarrow shapely
"""
import argparse, pathlib, sys


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("input")
    parser.add_argument("--out", required=True)
    options = parser.parse_args()
    import geopandas
    folder, stem = pathlib.Path(options.out), pathlib.Path(options.input).stem
    folder.mkdir(parents=True, exist_ok=True)
    frame = geopandas.read_file(options.input)
    frame = frame[[name for name in frame.columns if len(name) <= 10]]
    if frame.geometry.isna().any():
        sys.exit("a feature has no geometry")
    path = lambda end: str(folder / (stem + end))
    # Without an index, readers get the features in the order of the source.
    frame.to_file(path(".fgb"), driver="FlatGeobuf", SPATIAL_INDEX="NO")
    frame.to_file(path(".gpkg"), driver="GPKG")
    frame.to_file(path(".shp"), encoding="UTF-8")
    frame.to_file(path(".geojson"), driver="GeoJSON", COORDINATE_PRECISION=15)
    frame.to_parquet(path(".parquet"), write_covering_bbox=True, schema_version="1.1.0")
    table = frame.drop(columns="geometry")
    table.insert(0, "wkt", frame.geometry.to_wkt(rounding_precision=17))
    table.to_csv(path(".csv"), index=False)
    for file in sorted(folder.glob(stem + ".*")):
        print(f"{file.stat().st_size:>12} {file.name}")


if __name__ == "__main__":
    main()
