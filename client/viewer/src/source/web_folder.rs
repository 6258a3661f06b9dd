//! A baked city's folder on any host that answers ranges: a web server, a bucket, a CDN.

use super::archive::{ArchivedCity, open_index, to_read_error};
use super::{ObjectSource, RangeResponse, Transport};
use crate::source::FetchError;
use bytes::Bytes;
use insula_archive::city::{MAX_SEARCH_BYTES, SEARCH_FILE};
use insula_archive::joined::joined;
use insula_archive::mark::mark_of;
use insula_archive::{RangeRead, RangeSource, ReadError, SharedSource};
use insula_protocol::release::SharedCity;
use insula_protocol::{Manifest, TileKind};
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// One archive of a host.
#[derive(Debug, Clone)]
struct WebArchive {
    url: String,
    http: Arc<dyn Transport>,
    /// Version and length of the file, as the first response has them.
    first: Arc<OnceLock<(Option<String>, Option<u64>)>>,
}

/// The city at `base`, an address without a slash at its end, in the version of its manifest.
pub fn open(base: &str, manifest: &Manifest, http: &Arc<dyn Transport>) -> impl ObjectSource + 'static {
    let (version, marks) = (&manifest.version, manifest.marks);
    let file = |folder: &str, version: &str, kind: TileKind| -> SharedSource {
        // The version keeps caches on the way from answering with files of another bake.
        let url = format!("{folder}/{}?v={version}", kind.file_name());
        Arc::new(WebArchive { url, http: http.clone(), first: Arc::default() })
    };
    let parent = base.rsplit_once('/').map_or("", |(parent, _)| parent);
    let archive = |kind: TileKind| {
        let mut shared = manifest
            .shared()
            .iter()
            .map(|SharedCity { name, version }| (file(&format!("{parent}/{name}"), version, kind), mark_of(version)));
        joined(file(base, version, kind), &mut shared)
    };
    let (url, index_http) = (format!("{base}/{SEARCH_FILE}?v={version}"), http.clone());
    ArchivedCity::new(base.to_owned(), manifest, archive, move || {
        let (url, http) = (url.clone(), index_http.clone());
        Box::pin(async move {
            match http.get(url, MAX_SEARCH_BYTES as usize).await {
                Err(FetchError::Missing) => Ok(None),
                response => open_index(response?, marks).map(Some),
            }
        })
    })
}

impl WebArchive {
    /// The response's bytes, if they are of the same file as the first response.
    fn check(&self, response: RangeResponse) -> Result<Bytes, ReadError> {
        let (version, length) = self.first.get_or_init(|| (response.version.clone(), response.file_bytes));
        if differs(version, &response.version) || differs(length, &response.file_bytes) {
            return Err(ReadError::Replaced);
        }
        Ok(response.bytes)
    }
}

/// A host may leave out what it knows.
fn differs<T: PartialEq>(a: &Option<T>, b: &Option<T>) -> bool {
    a.is_some() && b.is_some() && a != b
}

impl RangeSource for WebArchive {
    fn length(&self) -> Option<u64> {
        self.first.get().and_then(|(_, length)| *length)
    }

    fn read(&self, range: Range<u64>) -> RangeRead {
        let archive = self.clone();
        RangeRead::Pending(Box::pin(async move {
            let response = archive.http.get_range(archive.url.clone(), range).await.map_err(to_read_error)?;
            archive.check(response)
        }))
    }
}
