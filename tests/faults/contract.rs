//! The server against its OpenAPI document, by schemathesis.

use crate::{
    common,
    program::{Served, find, text},
};
use std::process::Command;

pub(crate) fn kept() {
    let (folder, notes) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    common::write_city(folder.path(), "two");
    let server = Served::start(text(folder.path()), &[]);
    // That x and y are below 2^level cannot be said in a schema: some requests that it allows are rightly refused.
    let output = Command::new(find("schemathesis").unwrap())
        .args(["run", &format!("http://{}/v1/openapi.json", server.address), "--max-examples", "25", "--seed", "1"])
        .args(["--checks", "all", "--exclude-checks", "positive_data_acceptance", "--no-color"])
        .current_dir(notes.path())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}");
    println!("{}", said.lines().filter(|line| line.contains("generated")).collect::<String>());
}
