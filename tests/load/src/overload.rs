//! Twenty times more than a server can do, for a minute: what happens to those who are let in, to the others, to memory, and
//! afterwards. Requests come at their time whether the server answers or not (an open loop).
//!
//! `overload SERVER CITY PATHS.txt [SECONDS]`: the built `insula-server`, a baked city, the paths of its tiles.
//!
//! The capacity is one that the machine does not blur: tiles come from a store that takes 100 ms, nothing is cached, and 64
//! requests are let in at once, so that about 640 a second can be answered.

#[path = "../../faults/origin.rs"]
mod origin;

use anyhow::{Context, Result, ensure};
use std::{
    io::{BufRead, BufReader},
    net::SocketAddr,
    process::{Child, Command, Stdio},
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering::Relaxed},
    },
    time::Duration,
};
use tokio::{
    io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader as AsyncBufReader},
    net::TcpStream,
    time::{Instant, sleep, sleep_until},
};

const SLOW_MILLIS: u64 = 100;
const IN_FLIGHT: usize = 64;
const CONNECTIONS: usize = 2000;

/// Milliseconds of each answer, by what it said.
#[derive(Default)]
struct Answers {
    accepted: Vec<f64>,
    refused: Vec<f64>,
    failed: usize,
}

fn percentile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(((values.len() as f64 * share) as usize).min(values.len().saturating_sub(1))).copied().unwrap_or(0.0)
}

async fn one(stream: &mut AsyncBufReader<TcpStream>, path: &str) -> Result<u16> {
    stream.write_all(format!("GET {path} HTTP/1.1\r\nHost: x\r\n\r\n").as_bytes()).await?;
    let (mut line, mut status, mut length) = (String::new(), 0, 0);
    loop {
        line.clear();
        ensure!(stream.read_line(&mut line).await? > 0, "closed");
        if status == 0 {
            status = line.split(' ').nth(1).context("no status")?.parse()?;
        } else if line == "\r\n" {
            break;
        } else if let Some(value) = line.strip_prefix("content-length: ") {
            length = value.trim().parse()?;
        }
    }
    let mut body = vec![0; length];
    stream.read_exact(&mut body).await?;
    Ok(status)
}

/// `rate` requests a second for `time`, spread over all connections; times count from when each was due.
async fn offer(address: SocketAddr, paths: &Arc<Vec<String>>, rate: f64, time: Duration) -> Result<Answers> {
    let connections = ((rate / 4.0) as usize).clamp(64, CONNECTIONS);
    let every = Duration::from_secs_f64(connections as f64 / rate);
    let start = Instant::now() + Duration::from_millis(500);
    let next = Arc::new(AtomicU64::new(0));
    let mut tasks = tokio::task::JoinSet::new();
    for number in 0..connections {
        let (paths, next) = (paths.clone(), next.clone());
        tasks.spawn(async move {
            let mut answers = Answers::default();
            let mut stream = None;
            let mut due = start + every.mul_f64(number as f64 / connections as f64);
            while due < start + time {
                sleep_until(due).await;
                if stream.is_none() {
                    let connected = TcpStream::connect(address).await;
                    stream = connected.ok().map(AsyncBufReader::new);
                }
                let path = &paths[next.fetch_add(7919, Relaxed) as usize % paths.len()];
                let answer = match &mut stream {
                    Some(stream) => one(stream, path).await,
                    None => Err(anyhow::anyhow!("no connection")),
                };
                let millis = due.elapsed().as_secs_f64() * 1e3;
                match answer {
                    Ok(200) => answers.accepted.push(millis),
                    Ok(503) => answers.refused.push(millis),
                    _ => {
                        answers.failed += 1;
                        stream = None;
                    }
                }
                due += every;
            }
            answers
        });
    }
    let mut all = Answers::default();
    while let Some(answers) = tasks.join_next().await {
        let answers = answers?;
        all.accepted.extend(answers.accepted);
        all.refused.extend(answers.refused);
        all.failed += answers.failed;
    }
    Ok(all)
}

struct Served(Child, SocketAddr);

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn serve(server: &str, url: &str) -> Result<Served> {
    let in_flight = format!("limits.in_flight={IN_FLIGHT}");
    let settings = [&in_flight, "cache.memory_bytes=0", "cache.block_bytes=4096", "limits.tile_bytes=0", "log.requests=none", "cache.fetches=1000"];
    let mut command = Command::new(server);
    command.args(["serve", url, "--listen", "127.0.0.1:0"]);
    settings.iter().for_each(|setting| {
        command.args(["--set", setting]);
    });
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn()?;
    let mut line = String::new();
    BufReader::new(child.stdout.take().context("no output")?).read_line(&mut line)?;
    let address = line.trim().strip_prefix("listening on http://").context(line.clone())?.parse()?;
    Ok(Served(child, address))
}

fn resident_mib(pid: u32) -> f64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|line| line.trim().split(' ').next()?.parse::<f64>().ok()).unwrap_or(0.0) / 1024.0
}

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
    let [server, city, paths, rest @ ..] = &args[..] else { anyhow::bail!("usage: overload SERVER CITY PATHS [SECONDS]") };
    let secs: u64 = rest.first().map_or(Ok(60), |secs| secs.parse())?;
    let text = std::fs::read_to_string(paths)?;
    let paths: Arc<Vec<String>> = Arc::new(text.lines().filter(|l| l.contains("/blockmaps/")).map(str::to_owned).collect());
    let origin = origin::Origin::start(std::path::Path::new(city));
    let served = serve(server, &origin.url())?;
    origin.faults.slow_millis.store(SLOW_MILLIS, Relaxed);
    let (address, pid) = (served.1, served.0.id());
    println!("| phase | offered/s | accepted/s | p50 ms | p99 ms | 503s | p99 of 503s ms | failed |\n|---|---|---|---|---|---|---|---|");
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
