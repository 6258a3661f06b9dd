//! Baked cities look like their sources: twelve views of each real city against its ray-traced triangles, within bounds.

use anyhow::{Result, ensure};
use insula_tests::{
    baked::Baked,
    cameras::StationKind,
    fidelity::{self, MeasureOptions, Summary},
    truth::Truth,
};
use libtest_mimic::{Arguments, Failed, Trial};
use std::path::PathBuf;

fn main() {
    // One after another: a bake uses all cores, and only one should be in memory.
    let arguments = Arguments { test_threads: Some(1), ..Arguments::from_args() };
    let found = fidelity::real_cities();
    let tests = ["chiba-textured", "delft-3dbag", "denhaag-cityjson"].map(|name| {
        let inputs = found.iter().find(|city| city.0 == name).map(|city| city.1.clone());
        let ignored = inputs.is_none();
        let run = move || check(name, &inputs.clone().unwrap_or_default()).map_err(|e| Failed::from(format!("{e:#}")));
        Trial::test(name.replace('-', "_"), run).with_ignored_flag(ignored)
    });
    libtest_mimic::run(&arguments, tests.into()).exit();
}

fn check(name: &str, inputs: &[PathBuf]) -> Result<()> {
    ensure!(!inputs.is_empty(), "{name} is not on this machine");
    // Meshes are not drawn here, but other tests share Chiba with them.
    let city = fidelity::baked(name, inputs, name == "chiba-textured")?;
    let (truth, baked) = (Truth::new(fidelity::read(inputs)?), Baked::open(&city)?);
    let summaries = fidelity::measure(&truth, &baked, &MeasureOptions::plain(&[0.1, 1.0]), None, |_, _| Ok(()))?;
    let [finest, one] = &summaries[..] else { anyhow::bail!("two tolerances are expected") };
    ensure!(finest.views.len() == 12, "{} cameras found a place to stand", finest.views.len());
    let figures = format!("{}; {}", figures(finest), figures(one));
    println!("{name}: {figures}");
    let [worst, mean] = finest.iou(None);
    ensure!(worst >= 0.98 && mean >= 0.99, "silhouettes at the finest level: {figures}");
    let [median, p95] = finest.deviation_cells();
    ensure!(median <= 0.02 && p95 <= 0.1, "deviations at the finest level: {figures}");
    let [aerial, _] = one.iou(Some(StationKind::Aerial));
    ensure!(aerial >= 0.975, "silhouettes from the air: {figures}");
    ensure!(one.deviation_cells()[1] <= 0.1, "deviations at one pixel: {figures}");
    match finest.colour(Some(StationKind::Aerial), true) {
        Some(colour) => ensure!(colour.psnr_db >= 29.5 && colour.ssim >= 0.93, "textures from the air: {figures}"),
        None => ensure!(name != "chiba-textured", "no textured pixel in any view"),
    }
    Ok(())
}

fn figures(of: &Summary) -> String {
    let ([worst, mean], [aerial, _]) = (of.iou(None), of.iou(Some(StationKind::Aerial)));
    let [median, p95] = of.deviation_cells();
    let colour =
        of.colour(Some(StationKind::Aerial), true).map(|c| format!(", {:.2} dB, SSIM {:.4}", c.psnr_db, c.ssim));
    format!(
        "tau {}: IoU worst {worst:.4}, mean {mean:.4}, aerial worst {aerial:.4}, median {median:.3}, p95 {p95:.3} cells{}",
        of.tau_px,
        colour.unwrap_or_default()
    )
}
