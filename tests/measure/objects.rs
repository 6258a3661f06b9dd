//! Compares the objects of random pixels of a baked city with those of its ray-traced source.
//!
//! `cargo run --release -p insula-measure --bin objects -- CITY_INPUTS... --city CITY`. For each of the twelve cameras of `fidelity` and
//! each tolerated error: random pixels at which a ray hits the source, how many of them show the same object, and how many of the others
//! are within one pixel of an edge between two objects of the source. Objects are compared by identifier. Where surfaces of several
//! objects coincide, each is right.

use anyhow::{Context, Result, ensure};
use clap::Parser;
use glam::DVec3;
use insula_client::commands::headless::settle;
use insula_client::objects::ObjectLookup;
use insula_shaders::layout::Shading;
use insula_test_support::rng::Rng;
use insula_tests::cameras::{self, Station};
use insula_tests::fidelity;
use insula_tests::truth::Truth;
use insula_tests::view::FrameSpec;
use insula_tests::viewer::open;
use insula_viewer::frame::RenderSettings;
use insula_viewer::streamer::FrameRequest;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Compares the objects of random pixels with those of the source
#[derive(Debug, Parser)]
struct Args {
    /// City files
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    /// The same city, baked with `--ground none`
    #[arg(long)]
    city: PathBuf,
    /// Tolerated errors in pixels
    #[arg(long, value_delimiter = ',', default_value = "0.1,1")]
    tau: Vec<f64>,
    /// Random pixels of all cameras together
    #[arg(long, default_value_t = 10_000)]
    samples: usize,
    /// Print this many wrong pixels away from edges
    #[arg(long, default_value_t = 0)]
    wrong: usize,
}

const TIMEOUT: Duration = Duration::from_secs(300);
const CACHE_MIB: u32 = 4096;
const SPEC: FrameSpec = fidelity::FRAME;
/// Surfaces closer to each other than this coincide.
const COINCIDENT_M: f64 = 0.01;
/// Draws per wanted pixel until one hits the source.
const MAX_TRIES: usize = 20;

/// Sampled pixels.
#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    all: usize,
    /// Those that show another object than the source's.
    wrong: usize,
    /// Wrong ones within one pixel of an edge.
    at_edges: usize,
}

fn main() -> Result<()> {
    let args = Args::parse();
    // As the bake reads: objects that two inputs have are kept once.
    let truth = Truth::new(insula_bake::read::read(&args.inputs, &Default::default(), &|_| ())?.0);
    let stations = cameras::stations(&truth);
    ensure!(!stations.is_empty(), "the source has no view");
    let each = args.samples.div_ceil(stations.len());
    println!("| tau px | camera | pixels | same object | of the others within 1 px of an edge |");
    println!("|---|---|---|---|---|");
    for tau_px in &args.tau {
        let mut sum = Counts::default();
        for (number, station) in stations.iter().enumerate() {
            let counts = measure(&args, &truth, (number, station), *tau_px, each)?;
            print_row(*tau_px, &format!("{number} {:?}", station.kind), counts);
            sum = Counts {
                all: sum.all + counts.all,
                wrong: sum.wrong + counts.wrong,
                at_edges: sum.at_edges + counts.at_edges,
            };
        }
        print_row(*tau_px, "all", sum);
    }
    Ok(())
}

fn print_row(tau_px: f64, camera: &str, Counts { all, wrong, at_edges }: Counts) {
    let same = 100.0 * (all - wrong) as f64 / all.max(1) as f64;
    println!("| {tau_px} | {camera} | {all} | {same:.2}% | {at_edges} of {wrong} |");
}

fn measure(
    args: &Args,
    truth: &Truth,
    (number, station): (usize, &Station),
    tau_px: f64,
    each: usize,
) -> Result<Counts> {
    let reference = truth.render(&station.camera, &SPEC);
    let objects: Vec<Option<u32>> = reference
        .hit
        .iter()
        .map(|triangle| truth.scene.triangles.get(*triangle as usize).map(|triangle| triangle.object))
        .collect();
    let drawn = draw(&args.city, station, tau_px)?;
    let mut rng = Rng::new(number as u64 + 1);
    let mut counts = Counts::default();
    for _ in 0..each * MAX_TRIES {
        let pixel = rng.below(objects.len());
        let Some(expected) = objects[pixel] else { continue };
        let expected = &truth.scene.objects[expected as usize].id;
        counts.all += 1;
        let is_right = |name: &String| name == expected || coincides(truth, station, pixel as u32, name);
        if !drawn[pixel].as_ref().is_some_and(is_right) {
            let at_edge = is_at_edge(&objects, pixel);
            counts.wrong += 1;
            counts.at_edges += usize::from(at_edge);
            if !at_edge && counts.wrong - counts.at_edges <= args.wrong {
                let [x, y] = [pixel as u32 % SPEC.width_px, pixel as u32 / SPEC.width_px];
                eprintln!("camera {number}, pixel {x},{y}: {expected} in the source, {:?} drawn", drawn[pixel]);
            }
        }
        if counts.all == each {
            break;
        }
    }
    Ok(counts)
}

/// Whether an object's surface is where the pixel's ray hits the source.
fn coincides(truth: &Truth, station: &Station, pixel: u32, name: &str) -> bool {
    let o = DVec3::from(station.camera.position) - DVec3::from(truth.scene.origin);
    let d = station.camera.axes(&SPEC).ray(&SPEC, pixel % SPEC.width_px, pixel / SPEC.width_px);
    truth.cast(o, d).is_some_and(|hit| truth.shows(name, o, d, &hit, COINCIDENT_M))
}

/// The identifier of the object at each pixel of the settled frame.
fn draw(city: &Path, station: &Station, tau_px: f64) -> Result<Vec<Option<String>>> {
    let mut session = open(city, CACHE_MIB)?;
    let camera = station.camera.to_viewer()?;
    let request =
        FrameRequest { camera, heading: None, size_px: [SPEC.width_px, SPEC.height_px], tau_px, switching: None };
    settle(&mut session, &request, TIMEOUT)?;
    let settings = RenderSettings { shading: Shading::Objects, ..RenderSettings::default() };
    let pixels = session.draw(&request, &settings)?;
    let ids = session.objects_of(&pixels);
    let reader = session.open_objects()?;
    let mut names = HashMap::new();
    ids.iter().map(|id| name(&reader, &mut names, *id)).collect()
}

/// The identifier of an object; `None` for ground that is no object.
fn name(reader: &ObjectLookup, names: &mut HashMap<u32, Option<String>>, id: u32) -> Result<Option<String>> {
    if let Some(name) = names.get(&id) {
        return Ok(name.clone());
    }
    let name = reader.describe(id).with_context(|| format!("object {id}"))?.map(|record| record.identifier);
    Ok(names.entry(id).or_insert(name).clone())
}

/// Whether a pixel or one of its eight neighbours shows another object than another.
fn is_at_edge(objects: &[Option<u32>], pixel: usize) -> bool {
    let (width, height) = (SPEC.width_px as usize, SPEC.height_px as usize);
    let (x, y) = (pixel % width, pixel / width);
    let near = |at: usize, size: usize| at.saturating_sub(1)..=(at + 1).min(size - 1);
    near(y, height).any(|y| near(x, width).any(|x| objects[y * width + x] != objects[pixel]))
}
