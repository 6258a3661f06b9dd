//! A web host of a folder with ranges and ETags, which knows nothing of cities. Its faults can be changed while it runs.

use crate::http::{self, Request};
use crate::rng::Rng;
use std::fs;
use std::io::Write;
use std::net::{SocketAddr, TcpStream};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::time::{Duration, UNIX_EPOCH};

/// Faults of a host; the default is none.
#[derive(Debug, Default)]
pub struct HostFaults {
    /// Percentage of requests that fail: in turn by a closed connection, a status 500 and half a body.
    pub failing_percent: AtomicU64,
    /// Percentage of range responses with one wrong byte.
    pub lying_percent: AtomicU64,
    /// Time before each response in milliseconds.
    pub delay_ms: AtomicU64,
    /// Closes every connection.
    pub is_gone: AtomicBool,
    /// Responds to ranges with the whole file.
    pub ignores_ranges: AtomicBool,
    /// Responds with a range that begins one byte early.
    pub shifts_ranges: AtomicBool,
    /// Sends half of every third body.
    pub truncates_every_third: AtomicBool,
    /// Number of requests after which every ETag changes; 0 for never.
    pub replaced_after: AtomicU64,
    requests: AtomicU64,
    range_requests: AtomicU64,
}

#[derive(Debug)]
pub struct FaultyHost {
    address: SocketAddr,
    /// What it does wrong.
    pub faults: Arc<HostFaults>,
}

impl FaultyHost {
    /// Serves the files of a folder on a free port until the process ends.
    pub fn start(folder: &Path) -> Self {
        let faults = Arc::new(HostFaults::default());
        let (shared, folder) = (faults.clone(), folder.to_owned());
        let address = http::serve(move |request, out| respond(request, out, &folder, &shared));
        Self { address, faults }
    }

    /// `http://127.0.0.1:PORT`.
    pub fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// Number of requests so far.
    pub fn requests(&self) -> u64 {
        self.faults.requests.load(Relaxed)
    }

    /// Number of requests for a range so far.
    pub fn range_requests(&self) -> u64 {
        self.faults.range_requests.load(Relaxed)
    }
}

/// The first and last byte of a `Range` header.
fn parse_range(line: &str) -> Option<(u64, u64)> {
    let lower = line.to_ascii_lowercase();
    let (first, last) = lower.strip_prefix("range: bytes=")?.split_once('-')?;
    Some((first.parse().ok()?, last.parse().ok()?))
}

/// The file of a request: without its query; of a folder, its page.
fn file_path(target: &str) -> String {
    let path = target.split('?').next().unwrap_or_default().trim_start_matches('/');
    if path.is_empty() || path.ends_with('/') { format!("{path}index.html") } else { path.to_owned() }
}

/// What browsers insist on.
fn content_type(path: &str) -> &'static str {
    match path.rsplit('.').next() {
        Some("html") => "text/html; charset=utf-8",
        Some("js" | "mjs") => "text/javascript",
        Some("css") => "text/css",
        Some("txt") => "text/plain",
        Some("json") => "application/json",
        Some("wasm") => "application/wasm",
        Some("png") => "image/png",
        Some("webp") => "image/webp",
        Some("svg") => "image/svg+xml",
        Some("webmanifest") => "application/manifest+json",
        _ => "application/octet-stream",
    }
}

/// Serves one request; `None` closes the connection.
fn respond(request: &Request, out: &mut TcpStream, folder: &Path, faults: &HostFaults) -> Option<()> {
    if faults.is_gone.load(Relaxed) {
        return None;
    }
    std::thread::sleep(Duration::from_millis(faults.delay_ms.load(Relaxed)));
    let number = faults.requests.fetch_add(1, Relaxed);
    // Spread evenly, so that a request and its retry do not fail both.
    let happens = |stride: u64, percent: &AtomicU64| number * stride % 100 < percent.load(Relaxed);
    let (fails, lies) = (happens(61, &faults.failing_percent), happens(37, &faults.lying_percent));
    let path = file_path(request.target());
    if fails && number.is_multiple_of(3) {
        return None;
    }
    if fails && number % 3 == 1 {
        return out.write_all(b"HTTP/1.1 500 Internal Server Error\r\nContent-Length: 0\r\n\r\n").ok();
    }
    let (Ok(file), Ok(metadata)) = (fs::File::open(folder.join(&path)), fs::metadata(folder.join(&path))) else {
        return out.write_all(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n").ok();
    };
    let length = metadata.len();
    let modified = metadata.modified().ok()?.duration_since(UNIX_EPOCH).ok()?.as_nanos();
    let replaced_after = faults.replaced_after.load(Relaxed);
    let is_replaced = replaced_after > 0 && number >= replaced_after;
    let range = request.head.iter().find_map(|line| parse_range(line)).filter(|_| !faults.ignores_ranges.load(Relaxed));
    let (mut first, mut last) = range.map_or((0, length - 1), |(first, last)| (first, last.min(length - 1)));
    if first > 0 && faults.shifts_ranges.load(Relaxed) {
        (first, last) = (first - 1, last - 1);
    }
    let mut body = vec![0; (last + 1 - first) as usize];
    file.read_exact_at(&mut body, first).ok()?;
    let mut headers = format!(
        "Content-Length: {}\r\nContent-Type: {}\r\nETag: \"{modified:x}{}\"\r\nLast-Modified: Sat, 21 Nov 2026 08:00:00 GMT\r\n",
        body.len(),
        content_type(&path),
        if is_replaced { "-new" } else { "" }
    );
    let status = if range.is_some() { "206 Partial Content" } else { "200 OK" };
    if range.is_some() {
        faults.range_requests.fetch_add(1, Relaxed);
        headers += &format!("Content-Range: bytes {first}-{last}/{length}\r\n");
        if lies {
            let at = Rng::new(number).below(body.len());
            body[at] ^= 4;
        }
    }
    out.write_all(format!("HTTP/1.1 {status}\r\n{headers}\r\n").as_bytes()).ok()?;
    let is_truncated = fails || number % 3 == 2 && faults.truncates_every_third.load(Relaxed);
    if !request.head.first()?.starts_with("HEAD ") {
        out.write_all(if is_truncated { &body[..body.len() / 2] } else { &body }).ok()?;
    }
    (!is_truncated).then_some(())
}
