//! Baked cities look like their sources: twelve views of each real city against its ray-traced triangles, within bounds.

use anyhow::{Context, Result, ensure};
use insula_tests::baked::Baked;
use insula_tests::cameras::StationKind;
use insula_tests::fidelity::{self, MeasureOptions, REAL_CITIES, Summary};
use insula_tests::trials::{Test, Trials, WHOLE_CITY};
use insula_tests::truth::Truth;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(REAL_CITIES.map(|name| {
        let test = Test::new(name.replace('-', "_"), move || check(name))
            .ignored_if(fidelity::real_city(name).is_none())
            .in_turn(&WHOLE_CITY);
        if name == "chiba-textured" { test } else { test.full_tier() }
    }));
}

fn check(name: &str) -> Result<()> {
    let inputs = fidelity::real_city(name).context("it is not on this machine")?;
    let city = fidelity::baked(name)?;
    let (truth, baked) = (Truth::new(fidelity::read(&inputs)?), Baked::open(&city)?);
    let is_aerial = |kind: StationKind| kind == StationKind::Aerial;
    let options = MeasureOptions::plain(&[0.1, 1.0]);
    let summaries = fidelity::measure_coloured(&truth, &baked, &options, is_aerial, None, |_, _| Ok(()))?;
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
