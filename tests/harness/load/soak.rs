//! Applies a constant load for a long time, and measures failures and memory.

use super::open_loop::{self, percentile, resident_mib};
use anyhow::Result;
use insula_test_support::programs::ServerProcess;
use serde_json::{Value, json};
use std::{path::Path, process::Command, sync::Arc, time::Duration};
use tokio::runtime::Runtime;

/// Runs the program `server` on the folder `city` for `secs`, and sends `rate` requests per second for the paths that the file
/// `paths` has, one in each line. Prints what happens in each interval; returns the figures. Fails if the server does not start.
pub fn run(server: &Path, city: &Path, paths: &Path, secs: u64, rate: f64) -> Result<Value> {
    let paths = Arc::new(std::fs::read_to_string(paths)?.lines().map(str::to_owned).collect());
    let process = ServerProcess::start(&mut Command::new(server), city, "127.0.0.1:0", &[])?;
    Runtime::new()?.block_on(measure(&process, &paths, secs, rate))
}

async fn measure(process: &ServerProcess, paths: &Arc<Vec<String>>, secs: u64, rate: f64) -> Result<Value> {
    let mut resident = Vec::new();
    let (mut requests, mut failed) = (0, 0);
    // Minutes, except in a short run.
    let interval = Duration::from_secs(60.min(secs / 3).max(1));
    for number in 0..secs / interval.as_secs() {
        let mut results = open_loop::run(process.address, paths, rate, interval).await?;
        requests += results.accepted_ms.len();
        failed += results.failed + results.rejected_ms.len();
        resident.push(resident_mib(process.pid()));
        let p99 = percentile(&mut results.accepted_ms, 0.99);
        println!(
            "after {} s: {} requests, p99 {p99:.1} ms, resident {:.1} MiB",
            (number + 1) * interval.as_secs(),
            results.accepted_ms.len(),
            resident[number as usize]
        );
    }
    let growth = match resident[..] {
        [_, second, .., last] => last / second,
        _ => 1.0,
    };
    Ok(json!({ "requests": requests, "failed": failed, "resident_last_over_second_minute": growth }))
}
