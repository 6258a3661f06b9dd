//! The Python package: its own tests, with the programs. Without Python or `numpy`, they are reported as ignored.

use anyhow::{Context, Result, ensure};
use insula_tests::programs::{find_installed, program, run};
use insula_tests::trials::{Test, Trials};
use std::path::Path;
use std::process::Command;

pub(crate) fn add(trials: &mut Trials) {
    let has_numpy = find_installed("python3").is_some()
        && run(Command::new("python3").args(["-c", "import numpy"])).is_ok_and(|output| output.status.success());
    trials.add([Test::new("the_package_passes_its_tests", the_package_passes_its_tests).ignored_if(!has_numpy)]);
}

fn the_package_passes_its_tests() -> Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../client/python");
    // Without one of them, tests are skipped.
    program("insula")?;
    let server = program("insula-server")?;
    let mut command = Command::new("python3");
    command.args(["-B", "-m", "unittest", "discover", "-s", "tests"]).current_dir(root);
    command.env("INSULA_PROGRAMS_DIR", server.parent().context("a program without a folder")?);
    command.env("PYTHONPATH", "src").env("INSULA_ADAPTER", "cpu").env_remove("RUST_LOG");
    let output = run(&mut command)?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Ok(())
}
