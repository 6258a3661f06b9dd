//! Overloads a server with 20 times its capacity for a minute, in an open loop. Measures accepted and rejected requests,
//! memory, and the recovery.
//!
//! `overload SERVER CITY PATHS.txt [SECONDS]`: the built `insula-server`, a baked city, the paths of its tiles. With fewer seconds
//! than 60, the other phases are shorter, too. The last line is JSON.

use anyhow::Result;
use insula_tests::load::overload;

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [server, city, paths, rest @ ..] = &args[..] else {
        anyhow::bail!("usage: overload SERVER CITY PATHS [SECONDS]")
    };
    let secs: u64 = rest.first().map_or(Ok(60), |secs| secs.parse())?;
    println!("{}", overload::run(server.as_ref(), city.as_ref(), paths.as_ref(), secs)?);
    Ok(())
}
