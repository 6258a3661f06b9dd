//! The same load for a long time: memory must not grow and nothing may fail.
//!
//! `soak SERVER CITY PATHS.txt [SECONDS [REQUESTS_PER_SECOND]]`

mod offer;

use anyhow::{Result, ensure};
use offer::{offer, percentile, resident_mib, serve};
use std::{sync::Arc, time::Duration};

#[tokio::main]
async fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [server, city, paths, rest @ ..] = &args[..] else {
        anyhow::bail!("usage: soak SERVER CITY PATHS [SECONDS [RATE]]")
    };
    let secs: u64 = rest.first().map_or(Ok(600), |secs| secs.parse())?;
    let rate: f64 = rest.get(1).map_or(Ok(500.0), |rate| rate.parse())?;
    let paths: Arc<Vec<String>> = Arc::new(std::fs::read_to_string(paths)?.lines().map(str::to_owned).collect());
    let served = serve(server, city, &[])?;
    let (address, pid) = (served.1, served.0.id());
    let mut minutes = Vec::new();
    let (mut asked, mut failed) = (0, 0);
    for minute in 0..secs / 60 {
        let mut answers = offer(address, &paths, rate, Duration::from_secs(60)).await?;
        asked += answers.accepted.len();
        failed += answers.failed + answers.refused.len();
        minutes.push(resident_mib(pid));
        let p99 = percentile(&mut answers.accepted, 0.99);
        println!(
            "minute {}: {} requests, p99 {p99:.1} ms, resident {:.1} MiB",
            minute + 1,
            answers.accepted.len(),
            minutes[minute as usize]
        );
    }
    let growth = match minutes[..] {
        [_, second, .., last] => last / second,
        _ => 1.0,
    };
    println!(
        "{}",
        serde_json::json!({ "requests": asked, "failed": failed, "resident_last_over_second_minute": growth })
    );
    ensure!(failed == 0, "{failed} requests failed");
    Ok(())
}
