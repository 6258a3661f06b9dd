//! A baked city's folder on any host that answers ranges: a web server, a bucket, a CDN.
//!
//! In: ranges of its archives. Out: bytes. Next: `archive`.

use super::archive::{Archives, Ranges};
use crate::stream::fetch::Http;
use bytes::Bytes;
use insula_viewer::streamer::FetchError;
use std::sync::Arc;

/// One archive of a host.
#[derive(Clone)]
pub struct WebRanges {
    url: String,
    http: Arc<Http>,
}

/// The city at `base`, an address without a slash at its end.
pub fn open(base: &str, http: &Arc<Http>) -> Archives<WebRanges> {
    Archives::new(base.to_owned(), |layer| WebRanges {
        url: format!("{base}/{}", layer.file_name()),
        http: http.clone(),
    })
}

impl Ranges for WebRanges {
    async fn read(&self, offset: u64, length: usize) -> Result<(Bytes, Option<String>), FetchError> {
        self.http.get_range(&self.url, offset, length).await
    }
}
