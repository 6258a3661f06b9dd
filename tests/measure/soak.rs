//! Applies a constant load for a long time: no request may fail, and memory must not grow.
//!
//! `soak SERVER CITY PATHS.txt [SECONDS [REQUESTS_PER_SECOND]]`. The last line is JSON.

use anyhow::{Result, ensure};
use insula_tests::load::soak;

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [server, city, paths, rest @ ..] = &args[..] else {
        anyhow::bail!("usage: soak SERVER CITY PATHS [SECONDS [RATE]]")
    };
    let secs: u64 = rest.first().map_or(Ok(600), |secs| secs.parse())?;
    let rate: f64 = rest.get(1).map_or(Ok(500.0), |rate| rate.parse())?;
    let report = soak::run(server.as_ref(), city.as_ref(), paths.as_ref(), secs, rate)?;
    println!("{report}");
    ensure!(report["failed"] == 0, "{} requests failed", report["failed"]);
    Ok(())
}
