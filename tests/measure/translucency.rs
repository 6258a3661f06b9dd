//! Errors of the filters of translucency maps against all points that light enters: of shapes, and of meshes (PLY, OFF, OBJ) that are
//! scaled to 8 cm. Columns: mean difference over the mean of the exact light; mean of the differences over the exact light, where
//! that is at least 0.01; sum of the light over that of the exact light. Then the time of a point with either filter, on one thread.
//!
//! ```sh
//! cargo run --release -p insula-measure --bin translucency -- [MESH...]
//! ```

use anyhow::{Context, Result};
use glam::Vec3;
use insula_shaders::stone::Stone;
use insula_simplify::model::{ModelFormat, TriangleModel};
use insula_tests::translucent_shapes::{LitShape, Shape, filter_error};
use std::path::Path;
use std::time::Instant;

const POINTS: usize = 150;
const SAMPLES: usize = 1_000_000;
/// Longest side of meshes from files.
const MESH_SIDE_M: f32 = 0.08;

fn main() -> Result<()> {
    let stone = Stone::preset("carrara-marble").context("no such preset")?;
    let mut shapes = vec![
        ("sphere".to_owned(), Shape::ball(64, |_| 0.02)),
        ("slab".to_owned(), Shape::slab(Vec3::new(0.03, 0.03, 0.004))),
        ("thin slab".to_owned(), Shape::slab(Vec3::new(0.03, 0.03, 0.0015))),
        ("hand".to_owned(), Shape::hand()),
    ];
    for path in std::env::args().skip(1) {
        let shape = read_mesh(Path::new(&path)).with_context(|| path.clone())?;
        shapes.push((path, shape));
    }
    print_times(&stone)?;
    println!("{:<40} {:>10} {:>30} {:>30}", "shape", "sun", "21 taps: mean relative bias", "9 taps");
    for (name, shape) in shapes {
        for (from, sun) in [
            ("above", Vec3::new(0.1, 0.2, 0.97)),
            ("oblique", Vec3::new(0.6, 0.5, 0.62)),
            ("side", Vec3::new(0.3, 0.9, 0.25)),
        ] {
            let lit = LitShape::new(shape.clone(), sun.normalize_or(Vec3::Z), &stone, 512, SAMPLES)?;
            let text = [21, 9].map(|taps| {
                let e = filter_error(&lit, taps, POINTS);
                format!("{:>9.3} {:>9.3} {:>9.3}", e.of_mean, e.relative, e.bias)
            });
            println!("{:<40} {from:>10} {:>30} {:>30}", name.rsplit('/').next().unwrap_or(&name), text[0], text[1]);
        }
    }
    Ok(())
}

/// Nanoseconds of a point on spheres of few and of many triangles, with either filter: medians of seven runs in turn.
fn print_times(stone: &Stone) -> Result<()> {
    for steps in [71, 448] {
        let shape = Shape::ball(steps, |_| 0.02);
        let triangles = shape.triangles.len();
        let lit = LitShape::new(shape, Vec3::new(0.6, 0.5, 0.62).normalize_or(Vec3::Z), stone, 512, 1000)?;
        let (points, _) = lit.shape.samples(20_000, 3);
        let mut runs = [Vec::new(), Vec::new()];
        for _ in 0..7 {
            for (taps, times) in [21, 9].into_iter().zip(&mut runs) {
                let start = Instant::now();
                let sum: Vec3 = points.iter().map(|point| lit.by_taps(point.at, taps)).sum();
                std::hint::black_box(sum);
                times.push(start.elapsed().as_secs_f64() * 1e9 / points.len() as f64);
            }
        }
        let [fine, fast] = runs.map(|mut times| {
            times.sort_by(f64::total_cmp);
            times[times.len() / 2]
        });
        println!("{triangles} triangles: 21 taps {fine:.0} ns, 9 taps {fast:.0} ns, {:.2} of it", fast / fine);
    }
    Ok(())
}

/// A mesh, scaled to 8 cm around the origin. Fails if the file is not one.
fn read_mesh(path: &Path) -> Result<Shape> {
    let format = ModelFormat::of(path).context("the name must end in .ply, .off or .obj")?;
    let TriangleModel { positions, triangles, .. } = TriangleModel::read(&std::fs::read(path)?, format)?;
    let mut points: Vec<Vec3> = positions.iter().map(|p| Vec3::from_array(p.map(|v| v as f32))).collect();
    let low = points.iter().copied().fold(Vec3::MAX, Vec3::min);
    let high = points.iter().copied().fold(Vec3::MIN, Vec3::max);
    let scale = MESH_SIDE_M / (high - low).max_element();
    points.iter_mut().for_each(|p| *p = (*p - (low + high) * 0.5) * scale);
    Ok(Shape { points, triangles, ..Shape::default() }.with_normals())
}
