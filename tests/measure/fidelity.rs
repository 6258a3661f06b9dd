//! Bakes a city and compares twelve views of it with its ray-traced source.
//!
//! `cargo run --release -p insula-measure --bin fidelity -- CITY_INPUTS... --cell 1.0 --out DIR --report DIR/report.json`

use anyhow::Result;
use clap::Parser;
use insula_tests::baked::Baked;
use insula_tests::cameras::StationKind;
use insula_tests::compare::{self, Colour, Score};
use insula_tests::fidelity::{self, MeasureOptions, Size, Summary, View};
use insula_tests::gpu::Gpu;
use insula_tests::truth::Truth;
use insula_tests::view::FrameSpec;
use serde::Serialize;
use std::fs;
use std::path::PathBuf;
use std::time::Instant;

/// Bakes a city and compares twelve views of it with its ray-traced source.
#[derive(Debug, Parser)]
struct Args {
    /// City files
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    /// Side of a leaf's column in metres
    #[arg(long, default_value_t = 1.0)]
    cell: f64,
    /// Folder for the frames (source, baked, differences) and the baked city
    #[arg(long)]
    out: PathBuf,
    /// Tolerated errors in pixels
    #[arg(long, value_delimiter = ',', default_value = "0.1,1")]
    tau: Vec<f64>,
    /// Do not bake: use the city that is already in the folder
    #[arg(long)]
    no_bake: bool,
    /// Draw with the GPU
    #[arg(long)]
    gpu: bool,
    /// Draw leaves as meshes where the client does
    #[arg(long)]
    meshes: bool,
    /// Only the cameras in streets
    #[arg(long)]
    street: bool,
    /// Width and height of the frames
    #[arg(long, num_args = 2, default_values_t = [fidelity::FRAME.width_px, fidelity::FRAME.height_px])]
    size: Vec<u32>,
    /// Write all measures as JSON
    #[arg(long)]
    report: Option<PathBuf>,
}

#[derive(Debug, Serialize)]
struct Report {
    inputs: Vec<PathBuf>,
    cell_m: f64,
    bake_secs: Option<f64>,
    size: Size,
    cameras: Vec<CameraReport>,
    summaries: Vec<SummaryReport>,
}

#[derive(Debug, Serialize)]
struct CameraReport {
    number: usize,
    kind: StationKind,
    tau_px: f64,
    nodes: usize,
    score: Score,
    image: String,
}

#[derive(Debug, Serialize)]
struct SummaryReport {
    tau_px: f64,
    iou_worst: f64,
    iou_mean: f64,
    aerial_iou_worst: f64,
    deviation_median_cells: f64,
    deviation_p95_cells: f64,
    colour: Option<Colour>,
    textured: Option<Colour>,
    aerial_textured: Option<Colour>,
}

impl SummaryReport {
    fn new(summary: &Summary) -> Self {
        let ([iou_worst, iou_mean], [median, p95]) = (summary.iou(None), summary.deviation_cells());
        Self {
            tau_px: summary.tau_px,
            iou_worst,
            iou_mean,
            aerial_iou_worst: summary.iou(Some(StationKind::Aerial))[0],
            deviation_median_cells: median,
            deviation_p95_cells: p95,
            colour: summary.colour(None, false),
            textured: summary.colour(None, true),
            aerial_textured: summary.colour(Some(StationKind::Aerial), true),
        }
    }
}

fn main() -> Result<()> {
    let args = Args::parse();
    fs::create_dir_all(&args.out)?;
    let folder = args.out.join("city");
    let started = Instant::now();
    if !args.no_bake {
        fidelity::bake(&args.inputs, &folder, args.cell)?;
    }
    let bake_secs = (!args.no_bake).then(|| started.elapsed().as_secs_f64());
    let baked = Baked::open(&folder)?;
    let truth = Truth::new(fidelity::read(&args.inputs)?);
    let size = Size::new(&baked, &truth.scene);
    print_size(&size, &baked, bake_secs);
    let gpu = args.gpu.then(Gpu::open).transpose()?;
    let mut cameras = Vec::new();
    println!(
        "camera       tau  nodes    IoU  median    p95 | all: PSNR  SSIM gradient | textured:   px  PSNR  SSIM gradient"
    );
    let started = Instant::now();
    let spec = FrameSpec { width_px: args.size[0], height_px: args.size[1], ..fidelity::FRAME };
    let kind = args.street.then_some(StationKind::Street);
    let options = MeasureOptions { taus_px: &args.tau, meshes: args.meshes, kind, spec };
    let summaries = fidelity::measure(&truth, &baked, &options, gpu.as_ref(), |number, view| {
        print_view(number, view);
        let (kind, tau_px, nodes, score) = (view.station.kind, view.tau_px, view.nodes, view.score);
        let image = format!("{number:02}-{kind:?}-tau{tau_px}.png").to_lowercase();
        compare::side_by_side(&view.reference, &view.drawn, args.cell).save(args.out.join(&image))?;
        let camera = serde_json::to_string(&view.station.camera)?;
        cameras.push(CameraReport { number, kind, tau_px, nodes, score, image });
        Ok(fs::write(args.out.join(format!("{number:02}-camera.json")), camera)?)
    })?;
    println!("drawn and compared in {:.1} s", started.elapsed().as_secs_f64());
    let summaries: Vec<SummaryReport> = summaries.iter().map(SummaryReport::new).collect();
    summaries.iter().for_each(print_summary);
    if let Some(path) = &args.report {
        let report = Report { inputs: args.inputs, cell_m: args.cell, bake_secs, size, cameras, summaries };
        fs::write(path, serde_json::to_vec_pretty(&report)?)?;
    }
    Ok(())
}

fn print_size(size: &Size, baked: &Baked, bake_secs: Option<f64>) {
    if let Some(secs) = bake_secs {
        println!("baked in {secs:.1} s");
    }
    for (level, (nodes, bytes)) in baked.levels() {
        println!("  level {level}: {nodes} nodes, {bytes} bytes, {} a node", bytes / nodes.max(1));
    }
    println!(
        "V-BlockMaps: {:.0} bytes a leaf, {:.0} a node, {:.0} a building, {:.0} a square kilometre covered",
        size.bytes_per_leaf, size.bytes_per_node, size.bytes_per_building, size.bytes_per_km2
    );
}

fn colour(colour: Option<Colour>) -> String {
    colour.map_or_else(
        || "    -      -     -".to_owned(),
        |c| format!("{:>5.2} {:>6.4} {:>5.3}", c.psnr_db, c.ssim, c.gradient),
    )
}

fn print_view(number: usize, view: &View) {
    let (kind, score) = (format!("{:?}", view.station.kind), view.score);
    println!(
        "{number:>2} {kind:<8} {:>5}  {:>5}  {:.4}  {:>6.3} {:>6.3} |    {}  |      {:>6} {}",
        view.tau_px,
        view.nodes,
        score.iou,
        score.median_cells,
        score.p95_cells,
        colour(score.colour),
        score.textured.map_or(0, |c| c.pixels),
        colour(score.textured)
    );
}

fn print_summary(of: &SummaryReport) {
    println!(
        "tau {}: IoU worst {:.4}, mean {:.4}, aerial worst {:.4}; deviation median {:.3}, p95 {:.3} cells (all views)",
        of.tau_px, of.iou_worst, of.iou_mean, of.aerial_iou_worst, of.deviation_median_cells, of.deviation_p95_cells
    );
    println!(
        "       PSNR, SSIM and gradient, means: city {}; textured {}; textured from the air {}",
        colour(of.colour),
        colour(of.textured),
        colour(of.aerial_textured)
    );
}
