//! The load generator runs, for seconds. What it measures is only worth something in longer runs.

use anyhow::{Context, Result, ensure};
use insula_protocol::manifest::Manifest;
use insula_tests::load::overload;
use insula_tests::programs::program;
use insula_tests::trials::Trials;
use insula_tests::{fixtures, tests};

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![an_overloaded_server_refuses_and_recovers]);
}

fn an_overloaded_server_refuses_and_recovers() -> Result<()> {
    let city = fixtures::baked_chiba()?;
    let manifest: Manifest = serde_json::from_slice(&std::fs::read(city.join("city.json"))?)?;
    let folder = tempfile::tempdir()?;
    let paths = folder.path().join("paths.txt");
    std::fs::write(&paths, format!("/v1/cities/{}/{}/blockmaps/0/0/0\n", manifest.name, manifest.version))?;
    let report = overload::run(&program("insula-server")?, &city, &paths, 1)?;
    let number = |key: &str| report[key].as_f64().with_context(|| format!("no {key} in {report}"));
    ensure!(number("capacity_per_second")? > 0.0 && number("failed")? == 0.0, "{report}");
    ensure!(number("accepted_per_second_overloaded")? > 0.0 && number("p99_ratio_after")? > 0.0, "{report}");
    Ok(())
}
