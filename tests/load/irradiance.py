#!/usr/bin/env python3
"""Compares the clear sky's irradiances with pvlib's: irradiance.py [--turbidities T,T,T] [--from DEGREES] [--program FILE]

Prints direct normal, diffuse and global irradiance (W/m2) for 20 heights of the sun up to 90 degrees, and their ratios to
`pvlib.clearsky.ineichen`, the model whose input is Linke's turbidity. Exits with 1 if a ratio is off by more than 15%. Also
prints by how much pvlib's other models, with the same particles and water, differ from it. Needs pvlib (PyPI). Build first:
`cargo build --release -p insula-measure --bin irradiance`.
"""
import argparse, csv, pathlib, subprocess, sys
import numpy as np
from pvlib import atmosphere, clearsky

SUN = 1366.1
PARTS = {"dni": "direct_normal_w_m2", "dhi": "diffuse_w_m2", "ghi": "global_w_m2"}
LIMIT = 0.15


def others(depth, water, up, air_mass):
    """Particles as in irradiance.rs: 60% of the depth is grey, the rest has Angstrom's exponent 1.5."""
    at = lambda um: depth * (0.6 + 0.4 * (um / 0.55) ** -1.5)
    solis = clearsky.simplified_solis(up, aod700=at(0.7), precipitable_water=water, dni_extra=SUN)
    bird = clearsky.bird(90 - up, air_mass, at(0.38), at(0.5), water, dni_extra=SUN, albedo=0.25)
    return {"simplified_solis": solis, "bird": bird}


def main():
    ap = argparse.ArgumentParser(description=__doc__)
    ap.add_argument("--turbidities", default="3,4,5")
    ap.add_argument("--from", dest="lowest", type=float, default=10)
    ap.add_argument("--program", type=pathlib.Path, default="target/release/irradiance")
    args = ap.parse_args()
    up = np.linspace(args.lowest, 90, 20)
    printed = subprocess.run([args.program, args.turbidities, ",".join(f"{v:.6f}" for v in up)], check=True, text=True,
                             stdout=subprocess.PIPE).stdout
    rows = [{name: float(v) for name, v in row.items()} for row in csv.DictReader(printed.splitlines())]
    air_mass = atmosphere.get_relative_airmass(90 - up, "kastenyoung1989")
    worst = 0
    for turbidity in [float(v) for v in args.turbidities.split(",")]:
        mine = [row for row in rows if row["turbidity"] == turbidity]
        theirs = clearsky.ineichen(90 - up, air_mass, turbidity, altitude=0, dni_extra=SUN)
        ratio = {part: np.array([row[name] for row in mine]) / theirs[part] for part, name in PARTS.items()}
        print(f"turbidity {turbidity:g}\n  sun   direct      diffuse     global")
        for i, row in enumerate(mine):
            print(f"{up[i]:5.1f}", *(f"{row[name]:6.0f} {ratio[part][i]:4.2f}" for part, name in PARTS.items()))
        print("worst", *(f"{v[np.abs(v - 1).argmax()]:11.2f}" for v in ratio.values()))
        print("off by more than 15%:", *(f"{part} at {int((np.abs(v - 1) > LIMIT).sum())} of 20" for part, v in ratio.items()))
        for name, sky in others(mine[0]["depth"], mine[0]["water_cm"], up, air_mass).items():
            print(f"  {name}:", *(f"{part} {q.min():.2f} to {q.max():.2f}" for part in PARTS
                                  for q in [np.asarray(sky[part]) / theirs[part]]))
        worst = max(worst, *(np.abs(v - 1).max() for v in ratio.values()))
    sys.exit(int(worst > LIMIT))


if __name__ == "__main__":
    main()
