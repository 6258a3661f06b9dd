//! Small cities for tests: a generated one and a real one.

use crate::programs::program;
use crate::rng::Rng;
use anyhow::{Context, Result};
use insula_bake::{BakeOptions, Silent};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

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

/// Raises the first house of a file of [`write_city_json`] to 45 m, as a later delivery may have it.
pub fn raise_first_house(path: &Path) -> Result<()> {
    let mut town: Value = serde_json::from_slice(&fs::read(path)?)?;
    for corner in 4..8_usize {
        town["vertices"][corner][2] = 45_000.into();
    }
    fs::write(path, town.to_string()).with_context(|| path.display().to_string())
}

/// Two versions of a town in a folder: `first` of 2020-01-01, and `later` of 2024-01-31, which has a higher house and shares all other tiles.
pub fn bake_versions(folder: &Path) -> Result<[PathBuf; 2]> {
    let input = write_city_json(folder, 6)?;
    let [first, later] = ["first", "later"].map(|name| folder.join(name));
    let options = |date: &str, out: &Path| BakeOptions {
        inputs: vec![input.clone()],
        out: out.to_owned(),
        date: Some(date.to_owned()),
        ..BakeOptions::default()
    };
    insula_bake::bake(&options("2020-01-01", &first), &Silent).context("bake")?;
    raise_first_house(&input)?;
    let version_of = Some(first.clone());
    insula_bake::bake(&BakeOptions { version_of, ..options("2024-01-31", &later) }, &Silent).context("bake")?;
    Ok([first, later])
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

/// The bundled city, baked at 1 m as the program does it. Read only.
pub fn baked_chiba() -> Result<PathBuf> {
    baked("chiba", &BakeOptions { inputs: chiba()?, street_sets: true, ..BakeOptions::default() })
}

/// A city that each build bakes once and all tests share. Read only. `options` leaves the place to this function.
///
/// It is in the build's folder, under a hash of the server program, of the options, and of the contents of the inputs. Fails if
/// the bake fails.
pub fn baked(name: &str, options: &BakeOptions) -> Result<PathBuf> {
    let key = key(name, options)?;
    let folder = build_folder("test-cities")?.join(&key.to_hex()[..16]);
    fs::create_dir_all(&folder)?;
    // Other threads and programs may want the same city.
    let lock = fs::File::create(folder.join("lock"))?;
    lock.lock()?;
    let city = folder.join(name);
    if !city.join("city.json").is_file() {
        insula_bake::bake(&BakeOptions { out: city.clone(), ..options.clone() }, &Silent).context("bake")?;
    }
    Ok(city)
}

/// Inputs count by their names and contents, because their folders are often temporary.
fn key(name: &str, options: &BakeOptions) -> Result<blake3::Hash> {
    let mut key = blake3::Hasher::new();
    key.update(program_hash()?.as_bytes());
    for file in input_files(&options.inputs)? {
        let file_name = file.file_name().unwrap_or_default().to_string_lossy();
        key.update(file_name.as_bytes()).update(blake3::hash(&fs::read(&file)?).as_bytes());
    }
    let others = BakeOptions { inputs: Vec::new(), ..options.clone() };
    key.update(format!("{name} {others:?}").as_bytes());
    Ok(key.finalize())
}

/// The files that are inputs or lie in those, in a fixed order.
fn input_files(inputs: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for input in inputs {
        if input.is_dir() {
            let mut entries = fs::read_dir(input)?.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>>>()?;
            entries.sort();
            files.extend(input_files(&entries)?);
        } else {
            files.push(input.clone());
        }
    }
    Ok(files)
}

/// Hash of the server program, of which the code of a bake is a part; without it, of the running program.
fn program_hash() -> Result<blake3::Hash> {
    static HASH: OnceLock<blake3::Hash> = OnceLock::new();
    if let Some(hash) = HASH.get() {
        return Ok(*hash);
    }
    let program = program("insula-server").or_else(|_| std::env::current_exe().map_err(anyhow::Error::from))?;
    let hash = blake3::hash(&fs::read(&program).with_context(|| program.display().to_string())?);
    Ok(*HASH.get_or_init(|| hash))
}

/// A folder beside the programs of this build, for what tests keep: cities and pictures. Makes it if it is missing.
pub fn build_folder(name: &str) -> Result<PathBuf> {
    let program = std::env::current_exe()?;
    let mut build = program.parent().context("the program lies in no folder")?;
    // Test programs lie one folder deeper.
    if build.file_name().is_some_and(|folder| folder == "deps") {
        build = build.parent().context("the programs lie in no folder")?;
    }
    let folder = build.join(name);
    fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    Ok(folder)
}
