#!/usr/bin/env python3
"""Compares terrain's triangles with those of Martini at the same largest distance from all heights.

    roam.py --srtm N49E011.hgt.zip --tif DEM.tif [--program target/release/roam] [--errors 0.1,0.3,1,3,10]

Cuts squares of 513 and 1025 points out of two elevation models, and makes two fractal ones. Martini's error is nominal: its
meshes lie up to twice as far from the heights. So `roam` measures each mesh, and makes its own for what it measured.

Needs: numpy, tifffile, pymartini; cargo build --release -p insula-measure --bin roam
"""
import argparse, pathlib, subprocess, tempfile, zipfile

SRTM_SIDE = 1201


def crop(dem, corner, side):
    """A square with the median in place of missing heights; None if it does not fit."""
    import numpy as np

    part = dem[corner[1] : corner[1] + side, corner[0] : corner[0] + side].astype(np.float32)
    if part.shape != (side, side):
        return None
    missing = ~np.isfinite(part) | (part < -1000)
    part[missing] = np.median(part[~missing])
    return part


def fractal(side, roughness, amplitude_m, seed):
    """Heights whose power falls with the frequency to the power of `roughness`."""
    import numpy as np

    rng = np.random.default_rng(seed)
    size = 2 * (side - 1)
    fx, fy = np.meshgrid(np.fft.fftfreq(size), np.fft.fftfreq(size))
    frequency = np.hypot(fx, fy)
    frequency[0, 0] = 1
    spectrum = np.fft.fft2(rng.standard_normal((size, size))) / frequency**roughness
    spectrum[0, 0] = 0
    heights = np.fft.ifft2(spectrum).real[:side, :side]
    return ((heights - heights.min()) / (heights.max() - heights.min()) * amplitude_m).astype(np.float32)


def models(options):
    """Names and heights."""
    import numpy as np, tifffile

    archive = zipfile.ZipFile(options.srtm)
    srtm = np.frombuffer(archive.read(archive.namelist()[0]), ">i2").reshape(SRTM_SIDE, SRTM_SIDE)
    tif = tifffile.imread(options.tif)
    noise = np.random.default_rng(9)
    for side in [513, 1025]:
        middle = [(length - side) // 2 for length in (tif.shape[1], tif.shape[0])]
        yield f"srtm-{side}", crop(srtm, [0, 0], side)
        yield f"tif-{side}", crop(tif, middle, side) if min(middle) >= 0 else None
        yield f"rough-{side}", fractal(side, 1.6, 800, 1)
        # Lidar has noise of some centimetres over smooth ground.
        yield f"smooth-{side}", fractal(side, 2.2, 200, 2) + noise.normal(0, 0.03, (side, side)).astype(np.float32)


def write_meshes(name, heights, errors, folder):
    """Writes DEM.f32, and for each error DEM.f32.ERROR.mesh: numbers of vertices and triangles, and both, as u32."""
    import numpy as np
    from pymartini import Martini

    path = folder / f"{name}.f32"
    heights.tofile(path)
    tile = Martini(len(heights)).create_tile(heights)
    for error in errors:
        vertices, triangles = (np.asarray(part, np.uint32) for part in tile.get_mesh(max_error=float(error)))
        with open(f"{path}.{error}.mesh", "wb") as file:
            np.array([vertices.size // 2, triangles.size // 3], np.uint32).tofile(file)
            vertices.tofile(file)
            triangles.tofile(file)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--srtm", type=pathlib.Path, required=True)
    parser.add_argument("--tif", type=pathlib.Path, required=True)
    parser.add_argument("--program", type=pathlib.Path, default="target/release/roam")
    parser.add_argument("--errors", default="0.1,0.3,1,3,10")
    options = parser.parse_args()
    errors = options.errors.split(",")
    with tempfile.TemporaryDirectory() as folder:
        for name, heights in models(options):
            if heights is not None:
                write_meshes(name, heights, errors, pathlib.Path(folder))
        subprocess.run([options.program, "martini", folder, *errors], check=True)


if __name__ == "__main__":
    main()
