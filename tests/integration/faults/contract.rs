//! The server's responses against its OpenAPI document, by schemathesis.

use super::server;
use insula_test_support::programs::find_installed;
use std::process::Command;

/// Sends requests made from the document and checks the responses against it.
pub(super) fn matches_openapi() {
    let (_folder, server) = server::start_small_city(&[]);
    let scratch = tempfile::tempdir().unwrap();
    // A schema cannot say that x and y are below 2^level, so the server refuses some requests that the schema allows.
    let output = Command::new(find_installed("schemathesis").unwrap())
        .args(["run", &format!("http://{}/v1/openapi.json", server.address), "--max-examples", "25", "--seed", "1"])
        .args(["--checks", "all", "--exclude-checks", "positive_data_acceptance", "--no-color"])
        .current_dir(scratch.path())
        .output()
        .unwrap();
    let report = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{report}");
    println!("{}", report.lines().filter(|line| line.contains("generated")).collect::<String>());
}
