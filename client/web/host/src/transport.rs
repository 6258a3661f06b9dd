//! HTTP by the browser's `fetch`.

use crate::host::{Host, Response};
use bytes::Bytes;
use insula_protocol::DecodeError;
use insula_viewer::source::{BoxFuture, ContentRange, FetchError, RangeResponse, Transport};
use std::cell::Cell;
use std::ops::Range;
use std::time::Duration;
use wasm_bindgen::JsCast;
use wasm_bindgen_futures::JsFuture;

/// Requests of one module.
#[derive(Debug)]
pub struct BrowserTransport {
    host: Host,
    last_request: Cell<u32>,
}

/// Aborts its request when the future that waits for it is dropped. An answer that has arrived is not affected.
struct AbortOnDrop<'a> {
    host: &'a Host,
    number: u32,
}

impl Drop for AbortOnDrop<'_> {
    fn drop(&mut self) {
        self.host.abort(self.number);
    }
}

impl BrowserTransport {
    /// Numbers of requests begin after `last_request`: modules that share a host need other ones.
    pub fn new(host: Host, last_request: u32) -> Self {
        Self { host, last_request: Cell::new(last_request) }
    }

    async fn send(&self, url: &str, range: Option<String>, limit_bytes: u64) -> Result<Response, FetchError> {
        let number = self.last_request.get().wrapping_add(1);
        self.last_request.set(number);
        let _abort = AbortOnDrop { host: &self.host, number };
        let answer = JsFuture::from(self.host.fetch(url, range, limit_bytes as f64, number)).await;
        let failed = |_| FetchError::Network("the request failed".into());
        let response: Response = answer.map_err(failed)?.unchecked_into();
        if response.too_long() {
            let error = DecodeError::Limit { what: "response bytes", found: limit_bytes + 1, limit: limit_bytes };
            return Err(FetchError::Damaged(error));
        }
        match (response.error(), response.status()) {
            (Some(error), _) => Err(FetchError::Network(error)),
            (None, 200 | 206) => Ok(response),
            (None, status @ (408 | 425 | 429)) => Err(busy_error(&response, status)),
            (None, 410) => Err(FetchError::replaced()),
            (None, 400..500) => Err(FetchError::Missing),
            // Temporary failures are 502, 503 or 504. A 500 means that the server cannot read this tile.
            (None, 500) => Err(FetchError::Broken),
            (None, status) => Err(busy_error(&response, status)),
        }
    }

    async fn range(&self, url: &str, range: Range<u64>) -> Result<RangeResponse, FetchError> {
        let (first, last) = (range.start, range.end.saturating_sub(1));
        let response = self.send(url, Some(format!("bytes={first}-{last}")), range.end - range.start).await?;
        if response.status() == 200 {
            return Err(FetchError::Unusable(format!(
                "{url}: this host does not serve byte ranges, which archives need: use insula-server"
            )));
        }
        let version = response.header("etag").or_else(|| response.header("last-modified"));
        let bytes = Bytes::from(response.bytes().to_vec());
        // Hosts of other origins often hide this header from scripts: the length must do then.
        let Some(header) = response.header("content-range") else {
            let is_whole = bytes.len() as u64 == range.end - range.start;
            let file_bytes = (!is_whole).then_some(first + bytes.len() as u64);
            return Ok(RangeResponse { bytes, version, file_bytes });
        };
        let Some(found) = ContentRange::parse(&header).filter(|found| found.satisfies(first, last)) else {
            return Err(FetchError::Archive("the host returned another range than requested".into()));
        };
        if bytes.len() as u64 != found.last - found.first + 1 {
            return Err(FetchError::Network("the response is incomplete".into()));
        }
        Ok(RangeResponse { bytes, version, file_bytes: found.file_length })
    }
}

impl Transport for BrowserTransport {
    fn get(&self, url: String, limit_bytes: usize) -> BoxFuture<'_, Result<Bytes, FetchError>> {
        Box::pin(async move {
            let response = self.send(&url, None, limit_bytes as u64).await?;
            Ok(Bytes::from(response.bytes().to_vec()))
        })
    }

    fn get_range(&self, url: String, range: Range<u64>) -> BoxFuture<'_, Result<RangeResponse, FetchError>> {
        Box::pin(async move { self.range(&url, range).await })
    }
}

fn busy_error(response: &Response, status: u16) -> FetchError {
    let secs = response.header("retry-after").and_then(|value| value.trim().parse().ok());
    FetchError::Busy { status, retry_after: secs.map(Duration::from_secs) }
}
