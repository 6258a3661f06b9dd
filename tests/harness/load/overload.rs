//! Overloads a server with 20 times its capacity, in an open loop. Measures accepted and rejected requests, memory, and the
//! recovery.
//!
//! The capacity does not depend on the machine: tiles come from a store that takes 100 ms, nothing is cached, and 64 requests
//! may be in flight, so the server can serve about 640 requests per second.

use super::open_loop::{self, LoadResults, percentile, resident_mib};
use anyhow::Result;
use insula_test_support::faulty_host::FaultyHost;
use insula_test_support::programs::ServerProcess;
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;
use tokio::runtime::Runtime;
use tokio::time::sleep;

const STORE_DELAY_MS: u64 = 100;
const IN_FLIGHT: usize = 64;
/// Longest time of the other phases.
const MAX_PHASE_SECS: u64 = 15;

/// Runs the program `server` on the folder `city`, and requests the tiles whose paths the file `paths` has, one in each line. The
/// overload lasts `secs`. Prints a table of the phases; returns the figures. Fails if the server does not start.
pub fn run(server: &Path, city: &Path, paths: &Path, secs: u64) -> Result<Value> {
    let text = std::fs::read_to_string(paths)?;
    let paths = Arc::new(text.lines().filter(|l| l.contains("/blockmaps/")).map(str::to_owned).collect());
    let host = FaultyHost::start(city);
    let in_flight = format!("limits.in_flight={IN_FLIGHT}");
    let cold = ["cache.memory_bytes=0", "cache.block_bytes=4096", "cache.fetches=1000", "limits.tile_bytes=0"];
    let settings = [&cold[..], &[&in_flight, "log.requests=none"]].concat();
    let process = ServerProcess::start(&mut Command::new(server), host.url(), "127.0.0.1:0", &settings)?;
    host.faults.delay_ms.store(STORE_DELAY_MS, Relaxed);
    Runtime::new()?.block_on(measure(&process, &paths, secs))
}

async fn measure(process: &ServerProcess, paths: &Arc<Vec<String>>, secs: u64) -> Result<Value> {
    let (address, pid) = (process.address, process.pid());
    println!(
        "| phase | offered/s | accepted/s | p50 ms | p99 ms | 503s | p99 of 503s ms | failed |\n|---|---|---|---|---|---|---|---|"
    );
    let phase = Duration::from_secs(secs.clamp(1, MAX_PHASE_SECS));
    let mut unloaded = open_loop::run(address, paths, 100.0, phase).await?;
    let (calm, _) = print_row("unloaded", &mut unloaded, phase.as_secs_f64());
    let mut full = open_loop::run(address, paths, 1500.0, phase).await?;
    let (_, capacity) = print_row("above capacity", &mut full, phase.as_secs_f64());
    sleep(Duration::from_secs(1)).await;
    let before = resident_mib(pid);
    let highest = tokio::spawn(async move {
        let mut highest: f64 = 0.0;
        for _ in 0..secs {
            sleep(Duration::from_secs(1)).await;
            highest = highest.max(resident_mib(pid));
        }
        highest
    });
    let mut over = open_loop::run(address, paths, 20.0 * capacity, Duration::from_secs(secs)).await?;
    let (loaded, accepted) = print_row("20 x capacity", &mut over, secs as f64);
    let highest = highest.await?;
    sleep(Duration::from_secs(1)).await;
    let mut after = open_loop::run(address, paths, 0.8 * capacity, phase).await?;
    let (late, _) = print_row("one second later", &mut after, phase.as_secs_f64());
    println!("resident memory: {before:.0} MiB before, at most {highest:.0} MiB");
    Ok(json!({
        "capacity_per_second": capacity, "accepted_per_second_overloaded": accepted,
        "p99_ratio": loaded / calm, "p99_ratio_after": late / calm,
        "refused_after": after.rejected_ms.len(), "failed": over.failed, "resident_mib": [before, highest],
    }))
}

/// Prints a row of the table. Returns the 99th percentile in ms and the accepted requests per second.
fn print_row(phase: &str, results: &mut LoadResults, secs: f64) -> (f64, f64) {
    let all = results.accepted_ms.len() + results.rejected_ms.len() + results.failed;
    let p99 = percentile(&mut results.accepted_ms, 0.99);
    let (p50, rejected) = (percentile(&mut results.accepted_ms, 0.5), percentile(&mut results.rejected_ms, 0.99));
    println!(
        "| {phase} | {:.0} | {:.0} | {p50:.0} | {p99:.0} | {} | {rejected:.1} | {} |",
        all as f64 / secs,
        results.accepted_ms.len() as f64 / secs,
        results.rejected_ms.len(),
        results.failed
    );
    (p99, results.accepted_ms.len() as f64 / secs)
}
