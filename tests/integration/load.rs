//! The load generators run, for seconds. What they measure is only worth something in longer runs.

use anyhow::{Context, Result, ensure};
use insula_protocol::manifest::Manifest;
use insula_tests::{
    fixtures,
    load::{overload, soak},
    programs::program,
    tests,
    trials::Trials,
};
use serde_json::Value;
use std::path::Path;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![an_overloaded_server_refuses_and_recovers, a_soak_ends_without_failed_requests]);
}

/// The report of a generator, which serves the city of the fixtures, and asks for its root tile.
fn report_of(generator: impl FnOnce(&Path, &Path, &Path) -> Result<Value>) -> Result<Value> {
    let city = fixtures::baked_chiba()?;
    let manifest: Manifest = serde_json::from_slice(&std::fs::read(city.join("city.json"))?)?;
    let folder = tempfile::tempdir()?;
    let paths = folder.path().join("paths.txt");
    std::fs::write(&paths, format!("/v1/cities/{}/{}/blockmaps/0/0/0\n", manifest.name, manifest.version))?;
    generator(&program("insula-server")?, &city, &paths)
}

fn an_overloaded_server_refuses_and_recovers() -> Result<()> {
    let report = report_of(|server, city, paths| overload::run(server, city, paths, 1))?;
    let number = |key: &str| report[key].as_f64().with_context(|| format!("no {key} in {report}"));
    ensure!(number("capacity_per_second")? > 0.0 && number("failed")? == 0.0, "{report}");
    ensure!(number("accepted_per_second_overloaded")? > 0.0 && number("p99_ratio_after")? > 0.0, "{report}");
    Ok(())
}

fn a_soak_ends_without_failed_requests() -> Result<()> {
    let report = report_of(|server, city, paths| soak::run(server, city, paths, 3, 100.0))?;
    ensure!(report["failed"] == 0 && report["requests"].as_u64().is_some_and(|n| n > 200), "{report}");
    Ok(())
}
