//! Small cities for tests: a generated one and a real one.

use crate::{programs::program, rng::Rng};
use anyhow::{Context, Result};
use insula_bake::{BakeOptions, Silent, sample::SampleSettings};
use serde_json::{Value, json};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// A cuboid at `x`, `y` as a CityJSON solid, whose vertices are numbered from `first`.
fn block(x: f64, y: f64, side_m: f64, height_m: f64, first: usize) -> (Vec<[i64; 3]>, Value) {
    let corner = |dx: f64, dy: f64, z: f64| [(x + dx) * 1000.0, (y + dy) * 1000.0, z * 1000.0].map(|v| v as i64);
    let square = [(0.0, 0.0), (side_m, 0.0), (side_m, side_m), (0.0, side_m)];
    let vertices = [0.0, height_m].iter().flat_map(|z| square.map(|(dx, dy)| corner(dx, dy, *z))).collect();
    let face = |corners: [usize; 4]| json!([corners.map(|c| c + first)]);
    let faces = [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]].map(face);
    (vertices, json!({ "type": "Solid", "lod": "2.2", "boundaries": [faces] }))
}

/// CityJSON 2.0 with `per_side` x `per_side` cuboids, 40 m apart.
pub fn city_json(per_side: usize) -> Value {
    let mut rng = Rng::new(11);
    let (mut vertices, mut objects) = (Vec::new(), serde_json::Map::new());
    for i in 0..per_side * per_side {
        let (x, y) = ((i % per_side) as f64 * 40.0, (i / per_side) as f64 * 40.0);
        let (corners, geometry) = block(x, y, rng.range(12.0, 26.0), rng.range(6.0, 40.0), vertices.len());
        vertices.extend(corners);
        objects.insert(format!("house-{i}"), json!({ "type": "Building", "geometry": [geometry] }));
    }
    json!({
        "type": "CityJSON",
        "version": "2.0",
        "metadata": { "referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/7415" },
        "transform": { "scale": [0.001, 0.001, 0.001], "translate": [84000.0, 447000.0, 0.0] },
        "CityObjects": objects,
        "vertices": vertices,
    })
}

pub fn write_city_json(folder: &Path, per_side: usize) -> Result<PathBuf> {
    let path = folder.join("town.city.json");
    fs::write(&path, city_json(per_side).to_string()).context("town.city.json")?;
    Ok(path)
}

/// One of the three textured parts of the bundled city (Chiba).
pub fn chiba_quarter() -> Result<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../client/demo/chiba/chiba_70.obj.gz");
    anyhow::ensure!(path.is_file(), "{} is missing", path.display());
    Ok(path)
}

/// All of the bundled city.
pub fn chiba() -> Result<Vec<PathBuf>> {
    let folder = chiba_quarter()?.parent().context("no folder")?.to_owned();
    Ok(["chiba_64", "chiba_68", "chiba_70"].map(|name| folder.join(format!("{name}.obj.gz"))).into())
}

/// The bundled city baked at 1 m as the program does it, but with few occlusion directions, for tests that do not depend on the bake. Read
/// only.
pub fn baked_chiba() -> Result<PathBuf> {
    let sample = SampleSettings { sky_directions: 16, low_directions: 16, ..SampleSettings::default() };
    baked("chiba", &BakeOptions { inputs: chiba()?, sample, street_sets: true, ..BakeOptions::default() })
}

/// A city that each build bakes once and all tests share. Read only.
///
/// It is in the build's folder, under a hash of the server program and the options. Fails if the bake fails.
pub fn baked(name: &str, options: &BakeOptions) -> Result<PathBuf> {
    let program = program("insula-server").or_else(|_| std::env::current_exe().map_err(anyhow::Error::from))?;
    let build = program.parent().context("the program lies in no folder")?;
    let mut key = blake3::Hasher::new();
    key.update(&fs::read(&program)?).update(format!("{name} {options:?}").as_bytes());
    let folder = build.join("test-cities").join(&key.finalize().to_hex()[..16]);
    fs::create_dir_all(&folder)?;
    // Other test programs may run at the same time.
    let lock = fs::File::create(folder.join("lock"))?;
    lock.lock()?;
    let city = folder.join(name);
    if !city.join("city.json").is_file() {
        insula_bake::bake(&BakeOptions { out: city.clone(), ..options.clone() }, &Silent).context("bake")?;
    }
    Ok(city)
}
