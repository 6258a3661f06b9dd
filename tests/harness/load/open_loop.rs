//! An open-loop load generator: it sends requests at fixed times, whether or not earlier ones are finished.

use anyhow::{Context, Result, ensure};
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;
use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::TcpStream;
use tokio::time::{Instant, sleep_until};

const MAX_CONNECTIONS: usize = 2000;

/// Results of a run. Times are in milliseconds, from when a request was due.
#[derive(Default)]
pub struct LoadResults {
    /// Times of responses with 200.
    pub accepted_ms: Vec<f64>,
    /// Times of responses with 503.
    pub rejected_ms: Vec<f64>,
    /// Number of other responses and broken connections.
    pub failed: usize,
}

/// The value below which `fraction` of the values lie. Sorts them.
pub fn percentile(values: &mut [f64], fraction: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(((values.len() as f64 * fraction) as usize).min(values.len().saturating_sub(1))).copied().unwrap_or(0.0)
}

/// Sends one request and reads its response. Returns the status code.
async fn get(stream: &mut BufReader<TcpStream>, path: &str) -> Result<u16> {
    stream.write_all(format!("GET {path} HTTP/1.1\r\nHost: x\r\n\r\n").as_bytes()).await?;
    let (mut line, mut status, mut length) = (String::new(), 0, 0);
    loop {
        line.clear();
        ensure!(stream.read_line(&mut line).await? > 0, "the server closed the connection");
        if status == 0 {
            status = line.split(' ').nth(1).context("the response has no status")?.parse()?;
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

/// Sends `rate` requests per second for `time`, spread evenly over all connections. Fails if a task panics.
pub async fn run(address: SocketAddr, paths: &Arc<Vec<String>>, rate: f64, time: Duration) -> Result<LoadResults> {
    let connections = ((rate / 4.0) as usize).clamp(64, MAX_CONNECTIONS);
    let interval = Duration::from_secs_f64(connections as f64 / rate);
    let start = Instant::now() + Duration::from_millis(500);
    let next = Arc::new(AtomicU64::new(0));
    let mut tasks = tokio::task::JoinSet::new();
    for number in 0..connections {
        let (paths, next) = (paths.clone(), next.clone());
        tasks.spawn(async move {
            let mut results = LoadResults::default();
            let mut stream = None;
            let mut due = start + interval.mul_f64(number as f64 / connections as f64);
            while due < start + time {
                sleep_until(due).await;
                if stream.is_none() {
                    let connected = TcpStream::connect(address).await;
                    stream = connected.ok().map(BufReader::new);
                }
                let path = &paths[next.fetch_add(7919, Relaxed) as usize % paths.len()];
                let status = match &mut stream {
                    Some(stream) => get(stream, path).await,
                    None => Err(anyhow::anyhow!("no connection")),
                };
                let millis = due.elapsed().as_secs_f64() * 1e3;
                match status {
                    Ok(200) => results.accepted_ms.push(millis),
                    Ok(503) => results.rejected_ms.push(millis),
                    _ => {
                        results.failed += 1;
                        stream = None;
                    }
                }
                due += interval;
            }
            results
        });
    }
    let mut all = LoadResults::default();
    while let Some(results) = tasks.join_next().await {
        let results = results?;
        all.accepted_ms.extend(results.accepted_ms);
        all.rejected_ms.extend(results.rejected_ms);
        all.failed += results.failed;
    }
    Ok(all)
}

/// Resident memory of a process in MiB; 0 if it has ended.
pub fn resident_mib(pid: u32) -> f64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|line| line.trim().split(' ').next()?.parse::<f64>().ok()).unwrap_or(0.0) / 1024.0
}
