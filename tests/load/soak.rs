//! Applies a constant load for a long time: no request may fail, and memory must not grow.
//!
//! `soak SERVER CITY PATHS.txt [SECONDS [REQUESTS_PER_SECOND]]`

use anyhow::{Result, ensure};
use insula_test_support::programs::ServerProcess;
use insula_tests::open_loop::{self, percentile, resident_mib};
use std::{process::Command, sync::Arc, time::Duration};

#[tokio::main]
async fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [server, city, paths, rest @ ..] = &args[..] else {
        anyhow::bail!("usage: soak SERVER CITY PATHS [SECONDS [RATE]]")
    };
    let secs: u64 = rest.first().map_or(Ok(600), |secs| secs.parse())?;
    let rate: f64 = rest.get(1).map_or(Ok(500.0), |rate| rate.parse())?;
    let paths: Arc<Vec<String>> = Arc::new(std::fs::read_to_string(paths)?.lines().map(str::to_owned).collect());
    let process = ServerProcess::start(&mut Command::new(server), city, "127.0.0.1:0", &[])?;
    let (address, pid) = (process.address, process.pid());
    let mut resident = Vec::new();
    let (mut requests, mut failed) = (0, 0);
    // Minutes, except in a short run.
    let interval = Duration::from_secs(60.min(secs / 3).max(1));
    for number in 0..secs / interval.as_secs() {
        let mut results = open_loop::run(address, &paths, rate, interval).await?;
        requests += results.accepted_ms.len();
        failed += results.failed + results.rejected_ms.len();
        resident.push(resident_mib(pid));
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
    println!(
        "{}",
        serde_json::json!({ "requests": requests, "failed": failed, "resident_last_over_second_minute": growth })
    );
    ensure!(failed == 0, "{failed} requests failed");
    Ok(())
}
