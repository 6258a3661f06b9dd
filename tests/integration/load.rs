//! The load generators run, for seconds. What they measure is only worth something in longer runs.

use anyhow::{Context, Result, ensure};
use insula_protocol::manifest::Manifest;
use insula_tests::{
    fixtures,
    programs::{program, run},
};
use serde_json::Value;
use std::{path::PathBuf, process::Command};

/// The last line of a generator's output, which is JSON. It serves the city of the fixtures, and asks for its root tile.
fn report_of(generator: &str, numbers: &[&str]) -> Result<Value> {
    let city: PathBuf = fixtures::baked_chiba()?;
    let manifest: Manifest = serde_json::from_slice(&std::fs::read(city.join("city.json"))?)?;
    let folder = tempfile::tempdir()?;
    let paths = folder.path().join("paths.txt");
    std::fs::write(&paths, format!("/v1/cities/{}/{}/blockmaps/0/0/0\n", manifest.name, manifest.version))?;
    let output =
        run(Command::new(program(generator)?).arg(program("insula-server")?).arg(&city).arg(&paths).args(numbers))?;
    let text = String::from_utf8_lossy(&output.stdout);
    ensure!(output.status.success(), "{text}{}", String::from_utf8_lossy(&output.stderr));
    Ok(serde_json::from_str(text.lines().last().context("no output")?)?)
}

#[test]
fn an_overloaded_server_refuses_and_recovers() -> Result<()> {
    let report = report_of("overload", &["1"])?;
    let number = |key: &str| report[key].as_f64().with_context(|| format!("no {key} in {report}"));
    ensure!(number("capacity_per_second")? > 0.0 && number("failed")? == 0.0, "{report}");
    ensure!(number("accepted_per_second_overloaded")? > 0.0 && number("p99_ratio_after")? > 0.0, "{report}");
    Ok(())
}

#[test]
fn a_soak_ends_without_failed_requests() -> Result<()> {
    let report = report_of("soak", &["3", "100"])?;
    ensure!(report["failed"] == 0 && report["requests"].as_u64().is_some_and(|n| n > 200), "{report}");
    Ok(())
}
