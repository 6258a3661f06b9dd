//! Reads city files and prints the report as JSON, the bounds and the duration.
//!
//! `cargo run --release -p insula-bake --example read_stats -- INPUT...`

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use insula_bake::read::{ReadOptions, read};

fn main() -> ExitCode {
    let inputs: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    if inputs.is_empty() {
        eprintln!("usage: read_stats INPUT...");
        return ExitCode::from(2);
    }
    let start = Instant::now();
    let (scene, report) = match read(&inputs, &ReadOptions::default(), &|_| {}) {
        Ok(read) => read,
        Err(error) => {
            eprintln!("{error}");
            return ExitCode::FAILURE;
        }
    };
    let secs = start.elapsed().as_secs_f64();
    match serde_json::to_string_pretty(&report) {
        Ok(text) => println!("{text}"),
        Err(error) => eprintln!("{error}"),
    }
    let mut bounds = [[f32::MAX; 3], [f32::MIN; 3]];
    for corner in scene.triangles.iter().flat_map(|triangle| triangle.corners) {
        for axis in 0..3 {
            bounds[0][axis] = bounds[0][axis].min(corner[axis]);
            bounds[1][axis] = bounds[1][axis].max(corner[axis]);
        }
    }
    println!("origin {:?}, bounds {bounds:?}, {} materials, {secs:.2} s", scene.origin, scene.materials.len());
    ExitCode::SUCCESS
}
