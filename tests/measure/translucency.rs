//! Errors of the filters of translucency maps against all points that light enters: of shapes, and of meshes (ASCII PLY or OBJ) that
//! are scaled to 8 cm. Columns: mean difference over the mean of the exact light; mean of the differences over the exact light, where
//! that is at least 0.01; sum of the light over that of the exact light. Then the time of a point with either filter, on one thread.
//!
//! ```sh
//! cargo run --release -p insula-measure --bin translucency -- [MESH...]
//! ```

use glam::Vec3;
use insula_shaders::stone::Stone;
use insula_tests::translucent_shapes::{LitShape, Shape, filter_error};
use std::time::Instant;

const POINTS: usize = 150;
const SAMPLES: usize = 1_000_000;

fn main() {
    let stone = Stone::preset("carrara-marble").expect("a preset");
    let mut shapes = vec![
        ("sphere".to_owned(), Shape::ball(64, |_| 0.02)),
        ("slab".to_owned(), Shape::slab(Vec3::new(0.03, 0.03, 0.004))),
        ("thin slab".to_owned(), Shape::slab(Vec3::new(0.03, 0.03, 0.0015))),
        ("hand".to_owned(), Shape::hand()),
    ];
    for path in std::env::args().skip(1) {
        match std::fs::read_to_string(&path) {
            Ok(text) => shapes.push((path, read_mesh(&text))),
            Err(error) => eprintln!("{path}: {error}"),
        }
    }
    print_times(&stone);
    println!("{:<40} {:>10} {:>30} {:>30}", "shape", "sun", "21 taps: mean relative bias", "9 taps");
    for (name, shape) in shapes {
        for (from, sun) in [
            ("above", Vec3::new(0.1, 0.2, 0.97)),
            ("oblique", Vec3::new(0.6, 0.5, 0.62)),
            ("side", Vec3::new(0.3, 0.9, 0.25)),
        ] {
            let lit = LitShape::new(shape.clone(), sun.normalize_or(Vec3::Z), &stone, 512, SAMPLES);
            let text = [21, 9].map(|taps| {
                let e = filter_error(&lit, taps, POINTS);
                format!("{:>9.3} {:>9.3} {:>9.3}", e.of_mean, e.relative, e.bias)
            });
            println!("{:<40} {from:>10} {:>30} {:>30}", name.rsplit('/').next().unwrap_or(&name), text[0], text[1]);
        }
    }
}

/// Nanoseconds of a point on spheres of few and of many triangles, with either filter: medians of seven runs in turn.
fn print_times(stone: &Stone) {
    for steps in [71, 448] {
        let shape = Shape::ball(steps, |_| 0.02);
        let triangles = shape.triangles.len();
        let lit = LitShape::new(shape, Vec3::new(0.6, 0.5, 0.62).normalize_or(Vec3::Z), stone, 512, 1000);
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
}

fn read_mesh(text: &str) -> Shape {
    let numbers = |line: &str| {
        line.split_whitespace().filter_map(|w| w.split('/').next()?.parse::<f32>().ok()).collect::<Vec<f32>>()
    };
    let mut shape = Shape::default();
    if text.starts_with("ply") {
        let count =
            |what: &str| text.lines().find_map(|l| l.strip_prefix(what)?.trim().parse::<usize>().ok()).unwrap_or(0);
        let mut lines = text.lines().skip_while(|l| *l != "end_header").skip(1);
        let vertices = count("element vertex");
        shape.points.extend(lines.by_ref().take(vertices).map(|l| Vec3::from_slice(&numbers(l)[..3])));
        shape
            .triangles
            .extend(lines.map(numbers).filter(|v| v.len() > 3).map(|v| [v[1] as u32, v[2] as u32, v[3] as u32]));
    } else {
        shape.points.extend(text.lines().filter(|l| l.starts_with("v ")).map(|l| Vec3::from_slice(&numbers(l)[..3])));
        let faces = text.lines().filter(|l| l.starts_with("f ")).map(numbers);
        shape.triangles.extend(faces.map(|v| [v[0] as u32 - 1, v[1] as u32 - 1, v[2] as u32 - 1]));
    }
    let low = shape.points.iter().copied().fold(Vec3::MAX, Vec3::min);
    let high = shape.points.iter().copied().fold(Vec3::MIN, Vec3::max);
    let scale = 0.08 / (high - low).max_element();
    shape.points.iter_mut().for_each(|p| *p = (*p - (low + high) * 0.5) * scale);
    shape.with_normals()
}
