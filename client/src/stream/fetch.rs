//! HTTP requests: limited in time and in bytes, and counted.

use super::simulated_link::SimulatedLink;
use crate::error::{ClientError, Result};
use bytes::{Bytes, BytesMut};
use insula_command_line::http::{self, Elsewhere, Redirects};
use insula_protocol::DecodeError;
use insula_protocol::route::without_secrets;
use insula_viewer::source::{BoxFuture, ContentRange, FetchError, RangeResponse, Transport};
use reqwest::StatusCode;
use reqwest::header::{
    ACCEPT_ENCODING, CONTENT_ENCODING, CONTENT_RANGE, ETAG, LAST_MODIFIED, LOCATION, RANGE, RETRY_AFTER,
};
use std::future::Future;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;
use tokio::time::{Instant, timeout_at};

/// A response body may take one second longer for this many bytes received.
const MIN_BODY_BYTES_PER_SEC: f64 = 256.0;

/// Longest time for a response body, whatever its length.
const MAX_BODY_TIME: Duration = Duration::from_secs(600);

/// Time limits of a request, and whether it may be redirected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HttpOptions {
    /// Limit for opening a connection.
    pub connect: Duration,
    /// Limit for the time between two reads.
    pub read: Duration,
    /// Limit for a whole response body, before the allowance for its length. A response that arrives byte by byte would
    /// otherwise occupy a request for long.
    pub body: Duration,
    /// Whether redirects to other hosts are followed (`--follow-redirects`). They may lead into the network of this machine.
    pub follow_redirects: bool,
}

impl Default for HttpOptions {
    fn default() -> Self {
        let [connect, read, body] = [5, 15, 8].map(Duration::from_secs);
        Self { connect, read, body, follow_redirects: false }
    }
}

/// The client's connection pool with its threads and counters.
#[derive(Debug)]
pub struct Http {
    runtime: Option<tokio::runtime::Runtime>,
    handle: tokio::runtime::Handle,
    client: reqwest::Client,
    link: Option<SimulatedLink>,
    body_timeout: Duration,
    requests: AtomicU64,
    bytes: AtomicU64,
}

impl Http {
    /// Starts two network threads. All traffic passes `link` if there is one. Fails if the threads cannot be started.
    pub fn new(link: Option<SimulatedLink>) -> Result<Self> {
        Self::with_options(link, HttpOptions::default())
    }

    /// Like [`Http::new`] with other options.
    pub fn with_options(link: Option<SimulatedLink>, options: HttpOptions) -> Result<Self> {
        let failed = |e: &dyn std::fmt::Display| ClientError::Failed(format!("the network cannot be set up: {e}"));
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .max_blocking_threads(16)
            .thread_name("insula-net")
            .enable_all()
            .build()
            .map_err(|e| failed(&e))?;
        let redirects = if options.follow_redirects { Redirects::All } else { Redirects::SameHost };
        let client = http::client(redirects, Elsewhere::Response)
            .connect_timeout(options.connect)
            .read_timeout(options.read)
            .user_agent(concat!("insula/", env!("CARGO_PKG_VERSION")))
            .build()
            .map_err(|e| {
                let reason = std::error::Error::source(&e).map_or_else(|| e.to_string(), ToString::to_string);
                failed(&format!("{reason}: are certificates installed (package ca-certificates)?"))
            })?;
        let (requests, bytes) = (AtomicU64::new(0), AtomicU64::new(0));
        let handle = runtime.handle().clone();
        Ok(Self { runtime: Some(runtime), handle, client, link, body_timeout: options.body, requests, bytes })
    }

    /// Runs `future` on the network threads.
    pub fn spawn(&self, future: impl Future<Output = ()> + Send + 'static) -> tokio::task::AbortHandle {
        self.handle.spawn(future).abort_handle()
    }

    /// Waits for `future`. Must not be called from a network thread.
    pub fn block_on<T>(&self, future: impl Future<Output = T>) -> T {
        self.handle.block_on(future)
    }

    /// Fetches `url`. Fails if the body has more than `limit_bytes`.
    pub(super) async fn get(&self, url: &str, limit_bytes: usize) -> Result<Bytes, FetchError> {
        let response = self.send(self.client.get(url)).await?;
        check_status(&response)?;
        self.read_body(response, limit_bytes).await
    }

    /// Fetches a range of bytes that is not empty. The response is shorter only where the file ends. Fails if the host does
    /// not support range requests.
    pub(super) async fn get_range(&self, url: &str, range: Range<u64>) -> Result<RangeResponse, FetchError> {
        let (offset, last) = (range.start, range.end.saturating_sub(1));
        let max_bytes = (range.end - range.start) as usize;
        let request = self.client.get(url).header(RANGE, format!("bytes={offset}-{last}"));
        let response = self.send(request.header(ACCEPT_ENCODING, "identity")).await?;
        if response.status() == StatusCode::OK {
            return Err(FetchError::Unusable(format!(
                "{url}: this host does not serve byte ranges, which archives need: use insula-server"
            )));
        }
        check_status(&response)?;
        let header = |name| response.headers().get(name).and_then(|v| v.to_str().ok());
        let version = header(ETAG).or_else(|| header(LAST_MODIFIED)).map(str::to_owned);
        let range = header(CONTENT_RANGE).and_then(ContentRange::parse);
        let is_encoded = header(CONTENT_ENCODING).is_some_and(|encoding| encoding != "identity");
        let Some(range) = range.filter(|range| range.satisfies(offset, last) && !is_encoded) else {
            return Err(FetchError::Archive("the host returned another range than requested".into()));
        };
        let bytes = self.read_body(response, max_bytes).await?;
        if bytes.len() as u64 != range.last - range.first + 1 {
            return Err(FetchError::Network("the response is incomplete".into()));
        }
        Ok(RangeResponse { bytes, version, file_bytes: range.file_length })
    }

    async fn send(&self, request: reqwest::RequestBuilder) -> Result<reqwest::Response, FetchError> {
        self.requests.fetch_add(1, Ordering::Relaxed);
        if let Some(link) = &self.link {
            link.round_trip().await;
        }
        request.send().await.map_err(network_error)
    }

    async fn read_body(&self, mut response: reqwest::Response, limit_bytes: usize) -> Result<Bytes, FetchError> {
        let too_long = |found: u64| {
            FetchError::Damaged(DecodeError::Limit { what: "response bytes", found, limit: limit_bytes as u64 })
        };
        let announced = response.content_length().unwrap_or(0);
        if announced > limit_bytes as u64 {
            return Err(too_long(announced));
        }
        let breaks_off = self.link.as_ref().is_some_and(SimulatedLink::loses);
        let mut body = BytesMut::with_capacity(announced as usize);
        let begin = Instant::now();
        loop {
            let limit = self.body_timeout + Duration::from_secs_f64(body.len() as f64 / MIN_BODY_BYTES_PER_SEC);
            let chunk = timeout_at(begin + limit.min(MAX_BODY_TIME), response.chunk()).await;
            let chunk = chunk.map_err(|_| FetchError::Network("the response body is too slow".into()))?;
            let Some(chunk) = chunk.map_err(network_error)? else { break };
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
        if breaks_off { Err(lost_on_link()) } else { Ok(body.freeze()) }
    }

    /// Counts bytes read from a file as if they had come over the network, and sends them over the simulated link. Fails if the
    /// link loses them.
    pub async fn carry(&self, bytes: usize) -> Result<(), FetchError> {
        self.requests.fetch_add(1, Ordering::Relaxed);
        self.bytes.fetch_add(bytes as u64, Ordering::Relaxed);
        let Some(link) = &self.link else { return Ok(()) };
        link.round_trip().await;
        link.carry(bytes).await;
        if link.loses() { Err(lost_on_link()) } else { Ok(()) }
    }

    /// Number of requests so far.
    pub fn requests(&self) -> u64 {
        self.requests.load(Ordering::Relaxed)
    }

    /// Number of body bytes received so far.
    pub fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }
}

impl Transport for Http {
    fn get(&self, url: String, limit_bytes: usize) -> BoxFuture<'_, Result<Bytes, FetchError>> {
        Box::pin(async move { self.get(&url, limit_bytes).await })
    }

    fn get_range(&self, url: String, range: Range<u64>) -> BoxFuture<'_, Result<RangeResponse, FetchError>> {
        Box::pin(async move { self.get_range(&url, range).await })
    }
}

impl Drop for Http {
    fn drop(&mut self) {
        // The last owner may be a task of the runtime, which must not wait for itself.
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

fn lost_on_link() -> FetchError {
    FetchError::Network("lost on the simulated link".into())
}

fn network_error(error: reqwest::Error) -> FetchError {
    FetchError::Network(http::cause_of(&error))
}

fn check_status(response: &reqwest::Response) -> Result<(), FetchError> {
    let status = response.status();
    match status {
        StatusCode::OK | StatusCode::PARTIAL_CONTENT => Ok(()),
        StatusCode::REQUEST_TIMEOUT | StatusCode::TOO_MANY_REQUESTS | StatusCode::TOO_EARLY => {
            Err(busy_error(response))
        }
        _ if status.is_redirection() => {
            let to =
                response.headers().get(LOCATION).map_or("nowhere".into(), |to| String::from_utf8_lossy(to.as_bytes()));
            Err(FetchError::Unusable(format!(
                "{} redirects to {}, another host: use that address if you trust it, or --follow-redirects",
                without_secrets(response.url().as_str()),
                without_secrets(&to)
            )))
        }
        StatusCode::GONE => Err(FetchError::replaced()),
        _ if status.is_client_error() => Err(FetchError::Missing),
        // Temporary failures are 502, 503 or 504. A 500 means that the server cannot read this tile.
        StatusCode::INTERNAL_SERVER_ERROR => Err(FetchError::Broken),
        _ => Err(busy_error(response)),
    }
}

fn busy_error(response: &reqwest::Response) -> FetchError {
    let secs = response.headers().get(RETRY_AFTER).and_then(|v| v.to_str().ok()).and_then(|v| v.trim().parse().ok());
    FetchError::Busy { status: response.status().as_u16(), retry_after: secs.map(Duration::from_secs) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_viewer::scene::tile::retry_delay;
    use std::io::{Read, Write};
    use std::net::TcpListener;

    /// Sends the next of `responses` on each connection.
    fn serve(responses: Vec<String>) -> String {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}/x", listener.local_addr().unwrap());
        std::thread::spawn(move || {
            for response in responses {
                let (mut stream, _) = listener.accept().unwrap();
                let mut request = [0; 2048];
                let _ = stream.read(&mut request);
                stream.write_all(response.as_bytes()).unwrap();
            }
        });
        url
    }

    fn response(head: &str, body: &str) -> String {
        let length = body.len();
        format!("HTTP/1.1 {head}\r\nconnection: close\r\ncontent-length: {length}\r\n\r\n{body}")
    }

    #[test]
    fn failed_responses_become_fetch_errors() {
        let url = serve(vec![
            response("200 OK", "hello"),
            response("404 Not Found", "{}"),
            response("503 Service Unavailable\r\nretry-after: 3", ""),
            response("200 OK", "far too long"),
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
        assert!(matches!(get(), Err(FetchError::Network(_))), "the server is gone");
        assert_eq!((http.requests(), http.bytes()), (6, 5 + 4));
    }

    #[test]
    fn no_retry_after_delays_beyond_the_limit() {
        let values = [
            "99999999", "18446744073709551615", "99999999999999999999999", "-1", "1e9", "Thu, 01 Jan 2099 00:00:00 GMT",
        ];
        let busy = |value| response(&format!("503 Service Unavailable\r\nretry-after: {value}"), "");
        let url = serve(values.map(busy).to_vec());
        let http = Http::new(None).unwrap();
        for value in values {
            let error = http.block_on(http.get(&url, 8)).unwrap_err();
            assert!(matches!(error, FetchError::Busy { .. }), "{value}: {error}");
            for attempts in [1, u8::MAX] {
                let delay = retry_delay(attempts, error.retry_after(), 0.0);
                assert!(delay <= Duration::from_secs(30), "{value}: {delay:?}");
            }
        }
    }

    #[test]
    fn other_hosts_are_reached_only_if_redirects_are_asked_for() {
        // Another port of the loopback interface: a private address, and not the one that was asked.
        let redirect = |to: &str| response(&format!("302 Found\r\nlocation: {to}"), "");
        for follow_redirects in [false, true] {
            let secret = serve(vec![response("200 OK", "secret")]);
            let public = serve(vec![redirect("/elsewhere"), redirect(&secret)]);
            let http = Http::with_options(None, HttpOptions { follow_redirects, ..HttpOptions::default() }).unwrap();
            match http.block_on(http.get(&public, 100)) {
                Ok(body) => assert!(follow_redirects && body == "secret"),
                Err(FetchError::Unusable(why)) => assert!(!follow_redirects && why.contains(&secret), "{why}"),
                other => panic!("{other:?}"),
            }
        }
    }

    #[test]
    fn redirects_do_not_pass_on_a_share_link() {
        let target = TcpListener::bind("127.0.0.1:0").unwrap();
        let location = format!("http://{}/", target.local_addr().unwrap());
        let request = std::thread::spawn(move || {
            let mut stream = target.accept().unwrap().0;
            let mut request = [0; 2048];
            let length = stream.read(&mut request).unwrap();
            stream.write_all(response("200 OK", "").as_bytes()).unwrap();
            String::from_utf8_lossy(&request[..length]).into_owned()
        });
        let url = serve(vec![response(&format!("302 Found\r\nlocation: {location}"), "")]);
        let options = HttpOptions { follow_redirects: true, ..HttpOptions::default() };
        let http = Http::with_options(None, options).unwrap();
        http.block_on(http.get(&format!("{url}?share=secret"), 100)).unwrap();
        let request = request.join().unwrap();
        assert!(request.starts_with("GET / ") && !request.contains("secret"), "{request}");
    }

    #[test]
    fn content_ranges_must_match_the_request() {
        let satisfies = |text: &str| ContentRange::parse(text).is_some_and(|range| range.satisfies(10, 19));
        for good in ["bytes 10-19/100", "bytes 10-19/*", "bytes 10-15/16"] {
            assert!(satisfies(good), "{good}");
        }
        for wrong in [
            "bytes 10-15/100", "bytes 10-15/*", "bytes 0-9/100", "bytes 12-19/100", "bytes 10-25/100", "bytes 10-5/6",
            "items 10-19/100",
        ] {
            assert!(!satisfies(wrong), "{wrong}");
        }
    }
}
