//! Bakes a city and shows how true it is to its source, camera by camera.
//!
//! `cargo run --release -p insula-tests --bin fidelity -- CITY_INPUTS... --cell 1.0 --out DIR`

use anyhow::Result;
use clap::Parser;
use insula_tests::{
    baked::Baked,
    compare,
    fidelity::{self, View},
    gpu::Gpu,
    truth::Truth,
};
use std::{fs, path::PathBuf, time::Instant};

/// Bakes a city and compares twelve views of it with its ray-traced source.
#[derive(Debug, Parser)]
struct Args {
    /// City files.
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    /// Side of a leaf's column in metres.
    #[arg(long, default_value_t = 1.0)]
    cell: f64,
    /// Folder for the pictures (truth, baked, difference) and the baked city.
    #[arg(long)]
    out: PathBuf,
    /// Tolerated errors in pixels.
    #[arg(long, value_delimiter = ',', default_value = "0.1,1")]
    tau: Vec<f64>,
    /// Do not bake: take the city that is in the folder already.
    #[arg(long)]
    no_bake: bool,
    /// Draw with the GPU.
    #[arg(long)]
    gpu: bool,
}

fn main() -> Result<()> {
    let args = Args::parse();
    fs::create_dir_all(&args.out)?;
    let started = Instant::now();
    let folder = args.out.join("city");
    if !args.no_bake {
        fidelity::bake(&args.inputs, &folder, args.cell)?;
    }
    let baked = Baked::open(&folder)?;
    println!("baked in {:.1} s", started.elapsed().as_secs_f64());
    for (level, (nodes, bytes)) in baked.levels() {
        println!("  level {level}: {nodes} nodes, {bytes} bytes, {} a node", bytes / nodes.max(1));
    }
    let truth = Truth::new(fidelity::read(&args.inputs)?);
    let gpu = args.gpu.then(Gpu::open).transpose()?;
    println!("camera       tau  nodes    IoU  median    p95   PSNR   (deviations in leaf cells)");
    let started = Instant::now();
    let summaries = fidelity::measure(&truth, &baked, &args.tau, gpu.as_ref(), |number, view| {
        print_view(number, view);
        let name = format!("{number:02}-{:?}-tau{}.png", view.station.stand, view.tau_px).to_lowercase();
        compare::side_by_side(&view.meant, &view.drawn, args.cell).save(args.out.join(name))?;
        let camera = serde_json::to_string(&view.station.camera)?;
        Ok(fs::write(args.out.join(format!("{number:02}-camera.json")), camera)?)
    })?;
    println!("drawn and compared in {:.1} s", started.elapsed().as_secs_f64());
    for summary in summaries {
        let ([worst, mean], [median, p95]) = (summary.iou(None), summary.deviation_cells());
        let [aerial, _] = summary.iou(Some(insula_tests::cameras::Stand::Aerial));
        println!(
            "tau {}: IoU worst {worst:.4}, mean {mean:.4}, aerial worst {aerial:.4}; deviation median {median:.3}, \
             p95 {p95:.3} (all views); PSNR mean {:.2} dB",
            summary.tau_px,
            summary.psnr_db()
        );
    }
    Ok(())
}

fn print_view(number: usize, view: &View) {
    let (stand, score) = (format!("{:?}", view.station.stand), view.score);
    println!(
        "{number:>2} {stand:<8} {:>5}  {:>5}  {:.4}  {:>6.3} {:>6.3} {:>6.2}",
        view.tau_px, view.nodes, score.iou, score.median_cells, score.p95_cells, score.psnr_db
    );
}
