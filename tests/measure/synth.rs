//! Generates a city that can be served.
//!
//! `cargo run --release -p insula-measure --bin synth -- --buildings 100000 --out DIR`

use anyhow::Result;
use clap::Parser;
use insula_bake::Progress;
use insula_tests::synth::City;
use std::path::PathBuf;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Generates a city with a number of buildings, the same in every run
#[derive(Debug, Parser)]
struct Args {
    /// Number of buildings
    #[arg(long)]
    buildings: u64,
    /// The city's folder
    #[arg(long)]
    out: PathBuf,
    /// Side of a leaf's column in metres
    #[arg(long, default_value_t = 1.0)]
    cell: f64,
    /// Worker threads (default: one per core). The result does not depend on it
    #[arg(long)]
    threads: Option<usize>,
}

/// Prints progress to standard error.
struct Lines(Mutex<(String, u64, u64, Instant)>);

impl Progress for Lines {
    fn stage(&self, name: &str, total: u64) {
        if let Ok(mut state) = self.0.lock() {
            eprintln!("{name}: {total} steps");
            *state = (name.to_owned(), 0, total, Instant::now());
        }
    }

    fn advance(&self, n: u64) {
        if let Ok(mut state) = self.0.lock() {
            state.1 += n;
            if state.3.elapsed() > Duration::from_secs(10) {
                eprintln!("{}: {} of {}", state.0, state.1, state.2);
                state.3 = Instant::now();
            }
        }
    }
}

fn main() -> Result<()> {
    let args = Args::parse();
    let begin = Instant::now();
    let city = City::new(args.buildings, args.cell)?;
    let progress = Lines(Mutex::new((String::new(), 0, 0, begin)));
    let manifest = city.write(&args.out, args.threads, &progress)?;
    let nodes: u64 = manifest.counts.nodes_per_level.iter().sum();
    let bytes: u64 = manifest.counts.bytes_per_level.iter().sum();
    println!(
        "{} buildings, {} triangles, {nodes} nodes, {} MiB, version {}, {:.1} s",
        manifest.counts.objects,
        manifest.counts.triangles,
        bytes >> 20,
        manifest.version,
        begin.elapsed().as_secs_f64(),
    );
    Ok(())
}
