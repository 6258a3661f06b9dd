//! Requests at their time, whether the server answers or not (an open loop), and the server that they go to.

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
    time::{Instant, sleep_until},
};

const CONNECTIONS: usize = 2000;

/// Milliseconds of each answer, by what it said.
#[derive(Default)]
pub(crate) struct Answers {
    pub(crate) accepted: Vec<f64>,
    pub(crate) refused: Vec<f64>,
    pub(crate) failed: usize,
}

pub(crate) fn percentile(values: &mut [f64], share: f64) -> f64 {
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
pub(crate) async fn offer(address: SocketAddr, paths: &Arc<Vec<String>>, rate: f64, time: Duration) -> Result<Answers> {
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

/// A running server; killed when dropped.
pub(crate) struct Served(pub(crate) Child, pub(crate) SocketAddr);

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

pub(crate) fn serve(server: &str, place: &str, settings: &[&str]) -> Result<Served> {
    let mut command = Command::new(server);
    command.args(["serve", place, "--listen", "127.0.0.1:0"]);
    settings.iter().for_each(|setting| {
        command.args(["--set", setting]);
    });
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn()?;
    let mut line = String::new();
    BufReader::new(child.stdout.take().context("no output")?).read_line(&mut line)?;
    let address = line.trim().strip_prefix("listening on http://").context(line.clone())?.parse()?;
    Ok(Served(child, address))
}

pub(crate) fn resident_mib(pid: u32) -> f64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|line| line.trim().split(' ').next()?.parse::<f64>().ok()).unwrap_or(0.0) / 1024.0
}
