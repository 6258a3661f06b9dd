//! One HTTP request: bounded in time and in bytes, counted.
//!
//! In: a URL. Out: bytes, or a [`FetchError`] that says what to make of it. Next: `decode`.

use super::link::Link;
use crate::error::{ClientError, Result};
use bytes::{Bytes, BytesMut};
use insula_protocol::DecodeError;
use insula_viewer::streamer::FetchError;
use reqwest::{
    StatusCode,
    header::{ACCEPT_ENCODING, CONTENT_ENCODING, CONTENT_RANGE, ETAG, LAST_MODIFIED, RANGE, RETRY_AFTER},
};
use std::{
    future::Future,
    ops::Range,
    sync::atomic::{AtomicU64, Ordering},
    time::Duration,
};
use tokio::time::{Instant, timeout_at};

const CONNECT: Duration = Duration::from_secs(5);
const READ: Duration = Duration::from_secs(15);
/// An answer's body may take so long, and a second more for so many bytes: who trickles holds a place that others need.
const BODY: Duration = Duration::from_secs(8);
const BODY_BYTES_PER_SEC: f64 = 256.0;

/// The client's one connection pool, its threads and its counters.
#[derive(Debug)]
pub struct Http {
    runtime: Option<tokio::runtime::Runtime>,
    handle: tokio::runtime::Handle,
    client: reqwest::Client,
    link: Option<Link>,
    requests: AtomicU64,
    bytes: AtomicU64,
}

/// Part of a file, and what tells the file's version.
#[derive(Debug)]
pub struct RangeResponse {
    pub(super) bytes: Bytes,
    /// ETag or date of the file, if the host sends one.
    pub(super) version: Option<String>,
    /// Length of the whole file, if the host sends it.
    pub(super) file_bytes: Option<u64>,
}

impl Http {
    /// Starts two threads for the network.
    pub fn new(link: Option<Link>) -> Result<Self> {
        let failed = |e: &dyn std::fmt::Display| ClientError::Failed(format!("the network cannot be set up: {e}"));
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .max_blocking_threads(16)
            .thread_name("insula-net")
            .enable_all()
            .build()
            .map_err(|e| failed(&e))?;
        let client = reqwest::Client::builder()
            .connect_timeout(CONNECT)
            .read_timeout(READ)
            .user_agent(concat!("insula/", env!("CARGO_PKG_VERSION")))
            .build()
            .map_err(|e| failed(&e))?;
        let (requests, bytes) = (AtomicU64::new(0), AtomicU64::new(0));
        let handle = runtime.handle().clone();
        Ok(Self { runtime: Some(runtime), handle, client, link, requests, bytes })
    }

    /// Runs `future` on the network's threads.
    pub fn spawn(&self, future: impl Future<Output = ()> + Send + 'static) -> tokio::task::AbortHandle {
        self.handle.spawn(future).abort_handle()
    }

    /// Waits for `future`; not to be called from the network's threads.
    pub fn block_on<T>(&self, future: impl Future<Output = T>) -> T {
        self.handle.block_on(future)
    }

    /// Gets at most `limit_bytes`.
    pub async fn get(&self, url: &str, limit_bytes: usize) -> Result<Bytes, FetchError> {
        let response = self.send(self.client.get(url)).await?;
        check_status(&response)?;
        self.body(response, limit_bytes).await
    }

    /// Gets a range that is not empty; fewer bytes only where the file ends.
    pub async fn get_range(&self, url: &str, range: Range<u64>) -> Result<RangeResponse, FetchError> {
        let (offset, last) = (range.start, range.end.saturating_sub(1));
        let request = self.client.get(url).header(RANGE, format!("bytes={offset}-{last}"));
        let response = self.send(request.header(ACCEPT_ENCODING, "identity")).await?;
        if response.status() == StatusCode::OK {
            return Err(FetchError::Unusable(format!(
                "{url}: this host does not answer ranges, which streaming from an archive needs: use insula-server"
            )));
        }
        check_status(&response)?;
        let header = |name| response.headers().get(name).and_then(|v| v.to_str().ok());
        let version = header(ETAG).or_else(|| header(LAST_MODIFIED)).map(str::to_owned);
        let content = header(CONTENT_RANGE).and_then(content_range);
        let packed = header(CONTENT_ENCODING).is_some_and(|encoding| encoding != "identity");
        let fits = |(first, end, whole): (u64, u64, Option<u64>)| {
            // Less than was asked for only if there is no more.
            first == offset && end >= first && (end == last || end < last && whole == end.checked_add(1))
        };
        let Some((first, end, file_bytes)) = content.filter(|range| fits(*range) && !packed) else {
            return Err(FetchError::Archive("the host answers another range than was asked for".into()));
        };
        let bytes = self.body(response, (range.end - range.start) as usize).await?;
        if bytes.len() as u64 != end - first + 1 {
            return Err(FetchError::Network("half an answer".into()));
        }
        Ok(RangeResponse { bytes, version, file_bytes })
    }

    async fn send(&self, request: reqwest::RequestBuilder) -> Result<reqwest::Response, FetchError> {
        self.requests.fetch_add(1, Ordering::Relaxed);
        if let Some(link) = &self.link {
            link.round_trip().await;
        }
        request.send().await.map_err(network)
    }

    async fn body(&self, mut response: reqwest::Response, limit_bytes: usize) -> Result<Bytes, FetchError> {
        let too_long = |found: u64| {
            FetchError::Damaged(DecodeError::Limit { what: "an answer's bytes", found, limit: limit_bytes as u64 })
        };
        let announced = response.content_length().unwrap_or(0);
        if announced > limit_bytes as u64 {
            return Err(too_long(announced));
        }
        let breaks_off = self.link.as_ref().is_some_and(Link::loses);
        let mut body = BytesMut::with_capacity(announced as usize);
        let begin = Instant::now();
        loop {
            let most = BODY + Duration::from_secs_f64(body.len() as f64 / BODY_BYTES_PER_SEC);
            let chunk = timeout_at(begin + most, response.chunk()).await;
            let chunk = chunk.map_err(|_| FetchError::Network("the answer trickles".into()))?;
            let Some(chunk) = chunk.map_err(network)? else { break };
            self.bytes.fetch_add(chunk.len() as u64, Ordering::Relaxed);
            if let Some(link) = &self.link {
                link.carry(chunk.len()).await;
            }
            if body.len() + chunk.len() > limit_bytes {
                return Err(too_long((body.len() + chunk.len()) as u64));
            }
            body.extend_from_slice(&chunk);
            if breaks_off {
                break;
            }
        }
        if breaks_off { Err(FetchError::Network("the simulated link lost it".into())) } else { Ok(body.freeze()) }
    }

    /// Counts bytes that came from a file as if they had come over the network, and lets the simulated link carry them.
    pub async fn carry(&self, bytes: usize) -> Result<(), FetchError> {
        self.requests.fetch_add(1, Ordering::Relaxed);
        self.bytes.fetch_add(bytes as u64, Ordering::Relaxed);
        let Some(link) = &self.link else { return Ok(()) };
        link.round_trip().await;
        link.carry(bytes).await;
        if link.loses() { Err(FetchError::Network("the simulated link lost it".into())) } else { Ok(()) }
    }

    /// Requests sent so far.
    pub fn requests(&self) -> u64 {
        self.requests.load(Ordering::Relaxed)
    }

    /// Bytes of bodies received so far.
    pub fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }
}

impl Drop for Http {
    fn drop(&mut self) {
        // The last owner may be one of the runtime's own tasks, which must not wait for itself.
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

fn network(error: reqwest::Error) -> FetchError {
    // The innermost cause is the one that means something ("connection refused").
    let mut cause: &dyn std::error::Error = &error;
    while let Some(next) = cause.source() {
        cause = next;
    }
    FetchError::Network(cause.to_string())
}

fn check_status(response: &reqwest::Response) -> Result<(), FetchError> {
    let status = response.status();
    match status {
        StatusCode::OK | StatusCode::PARTIAL_CONTENT => Ok(()),
        StatusCode::REQUEST_TIMEOUT | StatusCode::TOO_MANY_REQUESTS | StatusCode::TOO_EARLY => Err(busy(response)),
        _ if status.is_client_error() => Err(FetchError::Missing),
        // Where others are at fault, a host says 502, 503 or 504.
        StatusCode::INTERNAL_SERVER_ERROR => Err(FetchError::Broken),
        _ => Err(busy(response)),
    }
}

/// First and last byte, and the whole file's length, of `bytes 0-99/1000`; the length may be `*`.
fn content_range(text: &str) -> Option<(u64, u64, Option<u64>)> {
    let (range, whole) = text.trim().strip_prefix("bytes")?.trim_start().split_once('/')?;
    let (first, last) = range.split_once('-')?;
    Some((first.trim().parse().ok()?, last.trim().parse().ok()?, whole.trim().parse().ok()))
}

fn busy(response: &reqwest::Response) -> FetchError {
    let secs = response.headers().get(RETRY_AFTER).and_then(|v| v.to_str().ok()).and_then(|v| v.trim().parse().ok());
    FetchError::Busy { status: response.status().as_u16(), retry_after: secs.map(Duration::from_secs) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{
        io::{Read, Write},
        net::TcpListener,
    };

    /// Answers each connection with the next of `answers`.
    fn server(answers: Vec<String>) -> String {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}/x", listener.local_addr().unwrap());
        std::thread::spawn(move || {
            for answer in answers {
                let (mut stream, _) = listener.accept().unwrap();
                let mut request = [0; 2048];
                let _ = stream.read(&mut request);
                stream.write_all(answer.as_bytes()).unwrap();
            }
        });
        url
    }

    fn answer(head: &str, body: &str) -> String {
        let length = body.len();
        format!("HTTP/1.1 {head}\r\nconnection: close\r\ncontent-length: {length}\r\n\r\n{body}")
    }

    #[test]
    fn answers_and_what_to_make_of_them() {
        let url = server(vec![
            answer("200 OK", "hello"),
            answer("404 Not Found", "{}"),
            answer("503 Service Unavailable\r\nretry-after: 3", ""),
            answer("200 OK", "far too long"),
            "HTTP/1.1 200 OK\r\nconnection: close\r\ncontent-length: 50\r\n\r\nhalf".into(),
        ]);
        let http = Http::new(None).unwrap();
        let get = || http.block_on(http.get(&url, 8));
        assert_eq!(&get().unwrap()[..], b"hello");
        assert!(matches!(get(), Err(FetchError::Missing)));
        assert!(matches!(get(), Err(FetchError::Busy { retry_after: Some(d), .. }) if d.as_secs() == 3));
        assert!(matches!(get(), Err(FetchError::Damaged(_))));
        let cut_off = http.block_on(http.get(&url, 100));
        assert!(matches!(cut_off, Err(FetchError::Network(_))), "{cut_off:?}");
        assert!(matches!(get(), Err(FetchError::Network(_))), "nobody listens any more");
        assert_eq!((http.requests(), http.bytes()), (6, 5 + 4));
    }
}
