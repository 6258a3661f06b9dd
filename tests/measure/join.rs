//! Measures the join of a bake in steps: generated tiles are joined by several processes, and copied by as many.
//!
//! `cargo run --release -p insula-measure --bin join -- --work DIR` needs three times the size of the tiles on disk. Each process prints its
//! peak of resident memory.

use anyhow::{Context, Result, bail, ensure};
use clap::Parser;
use insula_bake::{BakeOptions, BakeStage, BakeSteps, Job, JobRequest, Silent, WorkFolder, WorkStore};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};
use std::{fs, io};

/// Measures the join of a bake in steps
#[derive(Debug, Parser)]
struct Args {
    /// An empty folder
    #[arg(long)]
    work: PathBuf,
    /// Level of the leaves
    #[arg(long, default_value_t = 10)]
    depth: u8,
    /// Mean size of a tile
    #[arg(long, default_value_t = 2000)]
    tile_bytes: u32,
    /// Processes that join, and that copy
    #[arg(long, default_value_t = 4)]
    workers: usize,
    /// What a process that this program has started does: plan, part, finish or copy, and its number
    #[arg(long, num_args = 2, hide = true)]
    role: Vec<String>,
}

/// Some houses, so that there is a plan.
const TOWN: &str = r#"{"type": "FeatureCollection", "crs": {"type": "name", "properties": {"name": "EPSG:25832"}}, "features": [
    {"type": "Feature", "id": "a", "properties": {"height": 9}, "geometry": {"type": "Polygon", "coordinates":
    [[[500000, 5400000], [500020, 5400000], [500020, 5400020], [500000, 5400020], [500000, 5400000]]]}}]}"#;

fn main() -> Result<()> {
    let args = Args::parse();
    let store = WorkFolder::new(&args.work);
    let options =
        BakeOptions { inputs: vec![args.work.with_extension("geojson")], out: "city".into(), ..BakeOptions::default() };
    if let [role, number] = args.role.as_slice() {
        return work(&args, role, number.parse()?, &store, &options);
    }
    fs::create_dir_all(&args.work)?;
    fs::write(args.work.with_extension("geojson"), TOWN)?;
    let request = JobRequest { arguments: Vec::new(), chunk_bytes: 1, region_leaves: 32, is_update: false };
    let job = BakeSteps::begin(&store, &options, &request, &Silent)?;
    let steps = BakeSteps::open(&store, job, &options, &Silent)?;
    steps.run(BakeStage::Scan, 0)?;
    steps.run(BakeStage::Plan, 0)?;
    let bytes = steps.generate_tiles(args.depth, args.tile_bytes)?;
    println!("{:.2} GB of tiles", bytes as f64 / 1e9);
    let copy = || {
        let time = run(&args, "copy", args.workers)?;
        fs::remove_dir_all(args.work.join("copies"))?;
        Ok::<_, anyhow::Error>(time)
    };
    let before = copy()?;
    let planned = run(&args, "plan", 1)?;
    let joined = run(&args, "part", args.workers)?;
    let finished = run(&args, "finish", 1)?;
    // Once more: the parts may find less of the tiles in the system's memory than the first copies did.
    let after = copy()?;
    let seconds = |time: Duration| time.as_secs_f64();
    println!(
        "copy {:.1} s before and {:.1} s after; join: plan {:.1} s, parts {:.1} s, finish {:.1} s",
        seconds(before),
        seconds(after),
        seconds(planned),
        seconds(joined),
        seconds(finished)
    );
    println!("parts take {:.2} times as long as a copy", 2.0 * seconds(joined) / seconds(before + after));
    Ok(())
}

/// Starts processes of a role, and waits for them.
fn run(args: &Args, role: &str, count: usize) -> Result<Duration> {
    let program = std::env::current_exe()?;
    let begin = Instant::now();
    let start = |number: usize| {
        let (work, workers) = (args.work.as_os_str(), args.workers.to_string());
        Command::new(&program)
            .arg("--work")
            .arg(work)
            .args(["--workers", &workers, "--role", role, &number.to_string()])
            .spawn()
    };
    let children = (0..count).map(start).collect::<io::Result<Vec<_>>>()?;
    for mut child in children {
        ensure!(child.wait()?.success(), "{role} failed");
    }
    Ok(begin.elapsed())
}

/// Does what a role says.
fn work(args: &Args, role: &str, number: usize, store: &WorkFolder, options: &BakeOptions) -> Result<()> {
    let steps = || BakeSteps::open(store, Job::read(store)?, options, &Silent);
    match role {
        "copy" => copy(&args.work, store, number, args.workers)?,
        "plan" => steps()?.run(BakeStage::JoinPlan, 0)?,
        "part" => {
            let parts = steps()?.tasks(BakeStage::JoinPart)?;
            (number..parts).step_by(args.workers).try_for_each(|part| steps()?.run(BakeStage::JoinPart, part))?;
        }
        "finish" => steps()?.run(BakeStage::JoinFinish, 0)?,
        _ => bail!("{role}: no role"),
    }
    println!("{role} {number}: {}", peak_memory()?);
    Ok(())
}

/// Copies a share of the tiles, as a bucket would get them.
fn copy(work: &Path, store: &WorkFolder, number: usize, workers: usize) -> Result<()> {
    let names: Vec<String> = [store.list("region")?, store.list("crown")?].concat();
    let tiles = names.into_iter().filter(|name| name.ends_with("/bytes"));
    fs::create_dir_all(work.join("copies"))?;
    for (i, name) in tiles.enumerate().filter(|(i, _)| i % workers == number) {
        let mut to = fs::File::create(work.join("copies").join(i.to_string()))?;
        io::Write::write_all(&mut to, &fs::read(work.join(name))?)?;
        to.sync_all()?;
    }
    Ok(())
}

/// The highest resident memory of this process so far, as Linux tells it.
fn peak_memory() -> Result<String> {
    let status = fs::read_to_string("/proc/self/status")?;
    let line = status.lines().find(|line| line.starts_with("VmHWM"));
    Ok(line.context("the system does not tell it")?.split_whitespace().skip(1).collect::<Vec<_>>().join(" "))
}
