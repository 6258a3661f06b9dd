//! Twenty times more than a server can do, for a minute: what happens to those who are let in, to the others, to memory, and
//! afterwards. Requests come at their time whether the server answers or not (an open loop).
//!
//! `overload SERVER CITY PATHS.txt [SECONDS]`: the built `insula-server`, a baked city, the paths of its tiles.
//!
//! The capacity is one that the machine does not blur: tiles come from a store that takes 100 ms, nothing is cached, and 64
//! requests are let in at once, so that about 640 a second can be answered.

#[path = "../../faults/origin.rs"]
mod origin;

mod offer;

use anyhow::Result;
use offer::{Answers, offer, percentile, resident_mib, serve};
use std::{
    sync::{Arc, atomic::Ordering::Relaxed},
    time::Duration,
};
use tokio::time::sleep;

const SLOW_MILLIS: u64 = 100;
const IN_FLIGHT: usize = 64;

fn say(what: &str, answers: &mut Answers, secs: f64) -> (f64, f64) {
    let all = answers.accepted.len() + answers.refused.len() + answers.failed;
    let p99 = percentile(&mut answers.accepted, 0.99);
    let (p50, refused) = (percentile(&mut answers.accepted, 0.5), percentile(&mut answers.refused, 0.99));
    println!(
        "| {what} | {:.0} | {:.0} | {p50:.0} | {p99:.0} | {} | {refused:.1} | {} |",
        all as f64 / secs,
        answers.accepted.len() as f64 / secs,
        answers.refused.len(),
        answers.failed
    );
    (p99, answers.accepted.len() as f64 / secs)
}

#[tokio::main]
async fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [server, city, paths, rest @ ..] = &args[..] else {
        anyhow::bail!("usage: overload SERVER CITY PATHS [SECONDS]")
    };
    let secs: u64 = rest.first().map_or(Ok(60), |secs| secs.parse())?;
    let text = std::fs::read_to_string(paths)?;
    let paths: Arc<Vec<String>> =
        Arc::new(text.lines().filter(|l| l.contains("/blockmaps/")).map(str::to_owned).collect());
    let origin = origin::Origin::start(std::path::Path::new(city));
    let in_flight = format!("limits.in_flight={IN_FLIGHT}");
    let cold = ["cache.memory_bytes=0", "cache.block_bytes=4096", "cache.fetches=1000", "limits.tile_bytes=0"];
    let served = serve(server, &origin.url(), &[&cold[..], &[&in_flight, "log.requests=none"]].concat())?;
    origin.faults.slow_millis.store(SLOW_MILLIS, Relaxed);
    let (address, pid) = (served.1, served.0.id());
    println!(
        "| phase | offered/s | accepted/s | p50 ms | p99 ms | 503s | p99 of 503s ms | failed |\n|---|---|---|---|---|---|---|---|"
    );
    let mut unloaded = offer(address, &paths, 100.0, Duration::from_secs(15)).await?;
    let (calm, _) = say("unloaded", &mut unloaded, 15.0);
    let mut full = offer(address, &paths, 1500.0, Duration::from_secs(10)).await?;
    let (_, capacity) = say("over the capacity", &mut full, 10.0);
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
    let mut over = offer(address, &paths, 20.0 * capacity, Duration::from_secs(secs)).await?;
    let (loaded, accepted) = say("20 x capacity", &mut over, secs as f64);
    let highest = highest.await?;
    sleep(Duration::from_secs(1)).await;
    let mut after = offer(address, &paths, 0.8 * capacity, Duration::from_secs(10)).await?;
    let (late, _) = say("from a second after", &mut after, 10.0);
    println!("resident: {before:.0} MiB before, at most {highest:.0} MiB");
    let report = serde_json::json!({
        "capacity_per_second": capacity, "accepted_per_second_overloaded": accepted,
        "p99_ratio": loaded / calm, "p99_ratio_after": late / calm,
        "refused_after": after.refused.len(), "failed": over.failed, "resident_mib": [before, highest],
    });
    println!("{report}");
    Ok(())
}
