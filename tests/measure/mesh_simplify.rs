//! Compares simplification with meshoptimizer's: triangles, time, distance to the source.
//!
//! `cargo run --release -p insula-measure --bin mesh_simplify -- skull.obj nefertiti.obj`. Distances are those of evenly spread
//! points, and for the largest one of all vertices, to the other surface, in both directions, divided by the diagonal of the
//! bounding box.

#![allow(clippy::unwrap_used, reason = "a bench may fail loudly")]

use anyhow::{Context, Result};
use clap::Parser;
use insula_simplify::model::{ModelFormat, TriangleModel};
use insula_simplify::simplify::{Goal, simplify};
use insula_simplify::surface::Surface;
use meshopt::{SimplifyOptions, VertexDataAdapter};
use std::path::PathBuf;
use std::time::Instant;

/// Compares simplification with meshoptimizer's
#[derive(Debug, Parser)]
struct Args {
    /// PLY, OFF, OBJ or STL files
    #[arg(required = true)]
    models: Vec<PathBuf>,
    /// Number of measurements of each time
    #[arg(long, default_value_t = 7)]
    times: usize,
    /// Number of points on each surface
    #[arg(long, default_value_t = 200_000)]
    points: usize,
}

type Point = [f32; 3];

fn main() -> Result<()> {
    let args = Args::parse();
    println!("| mesh | kept | by | triangles | ms | mean | RMS | largest |");
    println!("|---|---|---|---|---|---|---|---|");
    for path in &args.models {
        let format = ModelFormat::of(path).context("the name must end in .ply, .off or .obj")?;
        let mut model = TriangleModel::read(&std::fs::read(path)?, format)?;
        model.weld();
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        for ratio in [0.5, 0.1, 0.01] {
            compare(&name, &model, ratio, &args)?;
        }
    }
    Ok(())
}

fn compare(name: &str, model: &TriangleModel, ratio: f64, args: &Args) -> Result<()> {
    let positions: Vec<Point> = model.positions.iter().map(|p| p.map(|v| v as f32)).collect();
    let goal = (model.triangles.len() as f64 * ratio) as usize;
    let indices = model.triangles.as_flattened();
    let mut times: [Vec<f64>; 3] = Default::default();
    let mut results: [Vec<[Point; 3]>; 3] = Default::default();
    for _ in 0..args.times {
        let begin = Instant::now();
        let out = simplify(model, Goal { triangles: goal, error: f64::INFINITY }, |_| false);
        times[0].push(begin.elapsed().as_secs_f64() * 1e3);
        let at = |vertex: u32| out.model.positions[vertex as usize].map(|v| v as f32);
        results[0] = out.model.triangles.iter().map(|corners| corners.map(at)).collect();

        let begin = Instant::now();
        let adapter = VertexDataAdapter::new(meshopt::utilities::typed_to_bytes(&positions), 12, 0)?;
        let kept = meshopt::simplify(indices, &adapter, goal * 3, 1.0, SimplifyOptions::None, None);
        times[1].push(begin.elapsed().as_secs_f64() * 1e3);
        results[1] = triangles(&kept, &positions);

        let begin = Instant::now();
        let (mut kept, mut moved) = (indices.to_vec(), positions.clone());
        with_update(&mut kept, &mut moved, goal * 3);
        times[2].push(begin.elapsed().as_secs_f64() * 1e3);
        results[2] = triangles(&kept, &moved);
    }
    let before = triangles(indices, &positions);
    let diagonal = model.diagonal();
    for ((by, times), after) in ["Insula", "simplify", "simplify_with_update"].iter().zip(times).zip(&results) {
        let [mean, rms, largest] = distance(&before, after, args.points)?.map(|d| d / diagonal);
        let ms = median(times);
        println!("| {name} | {ratio} | {by} | {} | {ms:.0} | {mean:.3e} | {rms:.3e} | {largest:.3e} |", after.len());
    }
    Ok(())
}

fn with_update(indices: &mut Vec<u32>, positions: &mut [Point], goal: usize) {
    let left = meshopt::simplify_with_update(
        indices,
        positions,
        &mut [],
        &[],
        0,
        None,
        goal,
        1.0,
        SimplifyOptions::None,
        None,
    );
    indices.truncate(left);
}

fn triangles(indices: &[u32], positions: &[Point]) -> Vec<[Point; 3]> {
    indices.as_chunks::<3>().0.iter().map(|corners| corners.map(|vertex| positions[vertex as usize])).collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Mean, root mean square and largest distance, each the larger of both directions.
fn distance(a: &[[Point; 3]], b: &[[Point; 3]], points: usize) -> Result<[f64; 3]> {
    let surface = |triangles: &[[Point; 3]]| {
        let corners = triangles.iter().map(|t| t.map(|p| p.map(f64::from)));
        Surface::new(corners.collect()).context("no triangles")
    };
    let (a, b) = (surface(a)?, surface(b)?);
    let (there, back) = (a.compare(&b, points), b.compare(&a, points));
    Ok([there.mean.max(back.mean), there.rms.max(back.rms), there.max.max(back.max)])
}
