//! Terrain's triangles: how many beside Martini's, and the time and memory of a large elevation model.
//!
//! `cargo run --release -p insula-measure --bin roam -- large 10000 10000 1.0`: columns, rows and the largest error. Prints
//! processor time and peak memory.
//!
//! `tests/tools/roam.py` makes the input of `roam martini FOLDER ERROR...`.

use anyhow::{Context, Result, bail, ensure};
use insula_roam::{Borders, HeightField, TILE_STEPS, TerrainMesh, triangulate, triangulate_region};
use std::fs;
use std::path::Path;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.split_first().map(|(first, rest)| (first.as_str(), rest)) {
        Some(("martini", [folder, errors @ ..])) => compare(Path::new(folder), errors),
        Some(("large", [columns, rows, error])) => measure_large(columns.parse()?, rows.parse()?, error.parse()?),
        _ => bail!("expected: roam martini FOLDER ERROR... or roam large COLUMNS ROWS ERROR"),
    }
}

/// Compares with the meshes that `roam.py` made.
fn compare(folder: &Path, errors: &[String]) -> Result<()> {
    println!(
        "| heights | error m | Martini's triangles | their distance m | ours at that distance | their distance m | ratio |"
    );
    println!("|---|---|---|---|---|---|---|");
    let mut paths: Vec<_> = fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<Result<_>>()?;
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "f32"));
    paths.sort();
    for path in paths {
        let heights: Vec<f32> = words(&path)?.into_iter().map(f32::from_bits).collect();
        let side = heights.len().isqrt() as u32;
        let field = HeightField::new([side, side], heights.clone()).context("not a square of heights")?;
        for error in errors {
            let martini = read_mesh(Path::new(&format!("{}.{error}.mesh", path.display())))?;
            let distance_m = distance_m(&martini, &heights, side)?;
            let ours = triangulate(&field, distance_m);
            println!(
                "| {} | {error} | {} | {distance_m:.3} | {} | {:.3} | {:.3} |",
                path.file_stem().unwrap_or_default().display(),
                martini.triangles.len(),
                ours.triangles.len(),
                self::distance_m(&ours, &heights, side)?,
                ours.triangles.len() as f64 / martini.triangles.len() as f64
            );
        }
    }
    Ok(())
}

fn words(path: &Path) -> Result<Vec<u32>> {
    let bytes = fs::read(path).with_context(|| path.display().to_string())?;
    Ok(bytes.as_chunks::<4>().0.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect())
}

fn read_mesh(path: &Path) -> Result<TerrainMesh> {
    let words = words(path)?;
    ensure!(words.len() >= 2 && words.len() == 2 + 2 * words[0] as usize + 3 * words[1] as usize, "damaged");
    let (vertices, triangles) = words[2..].split_at(2 * words[0] as usize);
    Ok(TerrainMesh { vertices: vertices.as_chunks::<2>().0.to_vec(), triangles: triangles.as_chunks::<3>().0.to_vec() })
}

/// Largest vertical distance between a mesh and all heights, by another way than that of the module. Fails if the mesh does not
/// cover all of them.
fn distance_m(mesh: &TerrainMesh, heights: &[f32], side: u32) -> Result<f32> {
    let height = |[x, y]: [u32; 2]| f64::from(heights[(y * side + x) as usize]);
    let mut farthest = 0.0_f64;
    let mut is_covered = vec![false; heights.len()];
    for triangle in &mesh.triangles {
        let corners = triangle.map(|i| mesh.vertices[i as usize]);
        let [a, b, c] = corners.map(|corner| corner.map(f64::from));
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        let range = |axis: usize| {
            let along = corners.map(|corner| corner[axis]);
            along[0].min(along[1]).min(along[2])..=along[0].max(along[1]).max(along[2])
        };
        for y in range(1) {
            for x in range(0) {
                let d = [f64::from(x) - a[0], f64::from(y) - a[1]];
                let u = (d[0] * (c[1] - a[1]) - d[1] * (c[0] - a[0])) / area;
                let v = (d[1] * (b[0] - a[0]) - d[0] * (b[1] - a[1])) / area;
                if u >= 0.0 && v >= 0.0 && u + v <= 1.0 {
                    let z = corners.map(height);
                    let surface = z[0] + u * (z[1] - z[0]) + v * (z[2] - z[0]);
                    farthest = farthest.max((surface - height([x, y])).abs());
                    is_covered[(y * side + x) as usize] = true;
                }
            }
        }
    }
    ensure!(is_covered.iter().all(|is_covered| *is_covered), "the mesh has holes");
    Ok(farthest as f32)
}

/// Triangulates value noise tile by tile, as a bake does.
fn measure_large(columns: u32, rows: u32, error_m: f32) -> Result<()> {
    let field = HeightField::new([columns, rows], noise(columns, rows)).context("too large")?;
    println!("heights: {} MB", peak_mb()?);
    let start_s = cpu_s()?;
    let Ok(borders) = Borders::survey(&field, TILE_STEPS, error_m);
    let mut triangles = 0;
    for tile in borders.tiling().tiles() {
        let Ok(mesh) = triangulate_region(&field, &borders, tile);
        triangles += mesh.triangles.len();
    }
    println!("{triangles} triangles in {:.1} s of processor time, {} MB", cpu_s()? - start_s, peak_mb()?);
    Ok(())
}

/// Value noise of eleven octaves.
fn noise(columns: u32, rows: u32) -> Vec<f32> {
    let random = |x: u32, y: u32, octave: u32| {
        let mut h = x.wrapping_mul(0x9E37_79B1) ^ y.wrapping_mul(0x85EB_CA77) ^ octave.wrapping_mul(0xC2B2_AE3D);
        h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
        h = (h ^ (h >> 12)).wrapping_mul(0x297A_2D39);
        (h ^ (h >> 15)) as f32 / u32::MAX as f32
    };
    let mut heights = Vec::with_capacity(columns as usize * rows as usize);
    for y in 0..rows {
        let row = heights.len();
        heights.resize(row + columns as usize, 0.0);
        for octave in 0..11 {
            let amplitude = 0.2 * (1 << octave) as f32;
            let (cell, within) = (y >> octave, (y & ((1 << octave) - 1)) as f32 / (1 << octave) as f32);
            for block in 0..=(columns >> octave) {
                let corner = |dx: u32, dy: u32| random(block + dx, cell + dy, octave);
                let west = corner(0, 0) + within * (corner(0, 1) - corner(0, 0));
                let east = corner(1, 0) + within * (corner(1, 1) - corner(1, 0));
                let first = block << octave;
                for x in first..(first + (1 << octave)).min(columns) {
                    let share = (x - first) as f32 / (1 << octave) as f32;
                    heights[row + x as usize] += amplitude * (west + share * (east - west));
                }
            }
        }
    }
    heights
}

/// Peak memory of this process, on Linux.
fn peak_mb() -> Result<u64> {
    let status = fs::read_to_string("/proc/self/status")?;
    let line = status.lines().find(|line| line.starts_with("VmHWM")).context("no VmHWM")?;
    Ok(line.split_whitespace().nth(1).context("no number")?.parse::<u64>()? / 1024)
}

/// Processor time of this process, in user mode and in the kernel: other work on the machine does not count.
fn cpu_s() -> Result<f64> {
    let stat = fs::read_to_string("/proc/self/stat")?;
    let fields: Vec<&str> = stat.rsplit(')').next().context("no fields")?.split_whitespace().collect();
    let ticks = |index: usize| fields.get(index).context("too few fields")?.parse::<f64>().context("no number");
    Ok((ticks(11)? + ticks(12)?) / 100.0)
}
