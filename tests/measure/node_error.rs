//! Measures how far each level of a baked city lies from its source, in both directions, against the stated errors.
//!
//! `cargo run --release -p insula-measure --bin node_error -- CITY SOURCE...`

use anyhow::{Result, ensure};
use clap::Parser;
use insula_tests::baked::Baked;
use insula_tests::fidelity;
use insula_tests::node_error::{self, Distances};
use insula_tests::truth::Truth;
use std::path::PathBuf;

/// Share of the points that must lie within the stated error.
const SHARE: f64 = 0.999;

/// Measures how far each level of a baked city lies from its source, in both directions
#[derive(Debug, Parser)]
struct Args {
    /// A city that was baked from the source without generated ground
    city: PathBuf,
    /// City files
    #[arg(required = true)]
    source: Vec<PathBuf>,
    /// Points in each direction
    #[arg(long, default_value_t = 100_000)]
    samples: usize,
    /// Larger distances count as this, in metres
    #[arg(long, default_value_t = 200.0)]
    most: f64,
    /// Fail if less than 99.9% of the points of a level lie within the stated error of their node
    #[arg(long)]
    check: bool,
}

fn main() -> Result<()> {
    let args = Args::parse();
    let (truth, baked) = (Truth::new(fidelity::read(&args.source)?), Baked::open(&args.city)?);
    println!(
        "level   cell nominal  stated:50% max | drawn to source: 99%  99.9%    max within | source to drawn: 99%  99.9%    max within"
    );
    let mut failed = Vec::new();
    for level in node_error::measure(&truth, &baked, args.samples, args.most)? {
        let figures = |of: &Distances| {
            let [a, b, c] = [0.99, SHARE, 1.0].map(|share| of.percentile(share));
            format!("{a:>6.2} {b:>6.2} {c:>6.1} {:>6.2}%", of.within * 100.0)
        };
        println!(
            "{:>5} {:>6} {:>7.2} {:>7.2} {:>7.2} |           {} |           {}",
            level.level,
            level.cell_m,
            level.nominal_m,
            level.stated_m[0],
            level.stated_m[1],
            figures(&level.drawn_to_source),
            figures(&level.source_to_drawn)
        );
        if level.drawn_to_source.within.min(level.source_to_drawn.within) < SHARE {
            failed.push(level.level);
        }
    }
    ensure!(
        !args.check || failed.is_empty(),
        "levels {failed:?}: more than 0.1% of the points exceed the stated error of their node"
    );
    Ok(())
}
