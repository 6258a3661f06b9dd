//! Simplification beside meshoptimizer's: triangles, time, distance to what it was.
//!
//! `cargo run --release -p insula-tests --bin mesh_simplify -- skull.obj nefertiti.obj`. Distances are those of points, spread
//! evenly over the surfaces, to the nearest point of the other surface, both ways, over the diagonal of the box around all.

#![allow(clippy::unwrap_used, reason = "a bench may fail loudly")]

use anyhow::{Context, Result};
use clap::Parser;
use insula_bake::{
    model::{ModelFormat, TriangleModel},
    simplify::{Goal, simplify},
};
use meshopt::{SimplifyOptions, VertexDataAdapter};
use rayon::prelude::*;
use std::{path::PathBuf, time::Instant};

/// Measures simplification beside meshoptimizer's.
#[derive(Debug, Parser)]
struct Args {
    /// PLY, OFF or OBJ files
    #[arg(required = true)]
    models: Vec<PathBuf>,
    /// How often times are taken
    #[arg(long, default_value_t = 7)]
    times: usize,
    /// Points on either surface
    #[arg(long, default_value_t = 200_000)]
    points: usize,
}

type Point = [f32; 3];

fn main() -> Result<()> {
    let args = Args::parse();
    println!("| mesh | kept | by | triangles | ms | mean | RMS | largest |");
    println!("|---|---|---|---|---|---|---|---|");
    for path in &args.models {
        let format = ModelFormat::of(path).context("a name that ends in .ply, .off or .obj is wanted")?;
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
        let [mean, rms, largest] = distance(&before, after, args.points).map(|d| d / diagonal);
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

/// Mean, root of the mean square and largest distance, of the larger of both directions.
fn distance(a: &[[Point; 3]], b: &[[Point; 3]], points: usize) -> [f64; 3] {
    let one_way = |from: &[[Point; 3]], to: &[[Point; 3]]| {
        let tree = Tree::new(to);
        let found: Vec<f64> = spread(from, points).par_iter().map(|p| tree.nearest(*p).sqrt()).collect();
        let mean = found.iter().sum::<f64>() / found.len() as f64;
        let square = found.iter().map(|d| d * d).sum::<f64>() / found.len() as f64;
        [mean, square.sqrt(), found.iter().copied().fold(0.0, f64::max)]
    };
    let (there, back) = (one_way(a, b), one_way(b, a));
    std::array::from_fn(|k| there[k].max(back[k]))
}

/// Points on triangles, as many on each as its area says; the same ones each time.
fn spread(triangles: &[[Point; 3]], count: usize) -> Vec<[f64; 3]> {
    let area = |t: &[Point; 3]| {
        let [a, b, c] = t.map(|p| p.map(f64::from));
        let (e, f) = (sub(b, a), sub(c, a));
        let cross = [e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]];
        dot(cross, cross).sqrt() * 0.5
    };
    let step = triangles.iter().map(area).sum::<f64>() / count as f64;
    let (mut due, mut seed, mut out) = (0.0, 0u64, Vec::with_capacity(count));
    for triangle in triangles {
        due += area(triangle) / step;
        let [a, b, c] = triangle.map(|p| p.map(f64::from));
        while due >= 1.0 {
            due -= 1.0;
            // A sequence of low discrepancy (Roberts 2018).
            seed += 1;
            let (mut s, mut t) =
                ((seed as f64 * 0.754_877_666_246_692_7).fract(), (seed as f64 * 0.569_840_290_998_053_2).fract());
            if s + t > 1.0 {
                (s, t) = (1.0 - s, 1.0 - t);
            }
            out.push(std::array::from_fn(|k| a[k] + (b[k] - a[k]) * s + (c[k] - a[k]) * t));
        }
    }
    out
}

fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| a[k] * b[k]).sum()
}

/// Boxes in boxes: four triangles in the innermost.
struct Tree {
    triangles: Vec<[[f64; 3]; 3]>,
    /// Of each node: its box.
    boxes: Vec<[[f64; 3]; 2]>,
}

impl Tree {
    fn new(triangles: &[[Point; 3]]) -> Self {
        let mut triangles: Vec<_> = triangles.iter().map(|t| t.map(|p| p.map(f64::from))).collect();
        let mut boxes = vec![[[0.0; 3]; 2]; 4 * triangles.len().next_power_of_two()];
        Self::split(&mut triangles, &mut boxes, 1);
        Self { triangles, boxes }
    }

    fn split(triangles: &mut [[[f64; 3]; 3]], boxes: &mut [[[f64; 3]; 2]], node: usize) {
        let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for p in triangles.iter().flatten() {
            for k in 0..3 {
                (min[k], max[k]) = (min[k].min(p[k]), max[k].max(p[k]));
            }
        }
        boxes[node] = [min, max];
        if triangles.len() > 4 {
            let axis = (0..3).max_by(|a, b| (max[*a] - min[*a]).total_cmp(&(max[*b] - min[*b]))).unwrap_or(0);
            let middle = triangles.len() / 2;
            let at = |t: &[[f64; 3]; 3]| t[0][axis] + t[1][axis] + t[2][axis];
            triangles.select_nth_unstable_by(middle, |a, b| at(a).total_cmp(&at(b)));
            let (low, high) = triangles.split_at_mut(middle);
            Self::split(low, boxes, 2 * node);
            Self::split(high, boxes, 2 * node + 1);
        }
    }

    /// Squared distance to the nearest point of all triangles.
    fn nearest(&self, p: [f64; 3]) -> f64 {
        let mut best = f64::INFINITY;
        self.search(p, 1, 0..self.triangles.len(), &mut best);
        best
    }

    fn search(&self, p: [f64; 3], node: usize, range: std::ops::Range<usize>, best: &mut f64) {
        if self.to_box(p, node) >= *best {
            return;
        }
        if range.len() <= 4 {
            for triangle in &self.triangles[range] {
                *best = best.min(to_triangle(p, triangle));
            }
            return;
        }
        let middle = range.start + range.len() / 2;
        let mut halves = [(2 * node, range.start..middle), (2 * node + 1, middle..range.end)];
        if self.to_box(p, 2 * node + 1) < self.to_box(p, 2 * node) {
            halves.reverse();
        }
        halves.into_iter().for_each(|(node, range)| self.search(p, node, range, best));
    }

    fn to_box(&self, p: [f64; 3], node: usize) -> f64 {
        let [min, max] = &self.boxes[node];
        (0..3).map(|k| (min[k] - p[k]).max(p[k] - max[k]).max(0.0).powi(2)).sum()
    }
}

/// Squared distance from a point to a triangle (Ericson, Real-Time Collision Detection, 5.1.5).
fn to_triangle(p: [f64; 3], [a, b, c]: &[[f64; 3]; 3]) -> f64 {
    let (ab, ac, ap) = (sub(*b, *a), sub(*c, *a), sub(p, *a));
    let (d1, d2) = (dot(ab, ap), dot(ac, ap));
    let bp = sub(p, *b);
    let (d3, d4) = (dot(ab, bp), dot(ac, bp));
    let cp = sub(p, *c);
    let (d5, d6) = (dot(ab, cp), dot(ac, cp));
    let (va, vb, vc) = (d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2);
    let (s, t) = if d1 <= 0.0 && d2 <= 0.0 {
        (0.0, 0.0)
    } else if d3 >= 0.0 && d4 <= d3 {
        (1.0, 0.0)
    } else if d6 >= 0.0 && d5 <= d6 {
        (0.0, 1.0)
    } else if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        (d1 / (d1 - d3), 0.0)
    } else if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        (0.0, d2 / (d2 - d6))
    } else if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        (1.0 - w, w)
    } else {
        let all = va + vb + vc;
        if all == 0.0 { (0.0, 0.0) } else { (vb / all, vc / all) }
    };
    let off: [f64; 3] = std::array::from_fn(|k| ap[k] - ab[k] * s - ac[k] * t);
    dot(off, off)
}
