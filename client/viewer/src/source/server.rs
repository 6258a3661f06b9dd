//! Tiles from an Insula server.

use super::{BoxFuture, PendingTile, TileSource, Transport};
use crate::{scene::TileKey, streamer::FetchError};
use insula_archive::limits::max_tile_bytes;
use insula_objects::search::SearchHit;
use insula_protocol::{DecodeError, Manifest, TileKind, route};
use percent_encoding::{NON_ALPHANUMERIC, utf8_percent_encode};
use serde::Deserialize;
use std::sync::Arc;

/// Largest response of a search.
const MAX_HITS_BYTES: usize = 1 << 20;

/// A hit as the server sends it.
#[derive(Deserialize)]
struct HitJson {
    text: String,
    object: u32,
    typos: u8,
}

impl From<HitJson> for SearchHit {
    fn from(HitJson { text, object, typos }: HitJson) -> Self {
        Self { text, object, typos }
    }
}

/// One version of a city on a server.
#[derive(Debug)]
pub struct ServerSource {
    http: Arc<dyn Transport>,
    base: String,
    /// Appended to each address: a share link, or empty.
    query: String,
    name: String,
    version: String,
}

impl ServerSource {
    /// The city of `manifest` on the server at `base` (`http://host:port`). `query` is appended to the address of each tile.
    pub fn new(http: Arc<dyn Transport>, base: &str, query: &str, manifest: &Manifest) -> Self {
        let base = base.trim_end_matches('/').to_owned();
        Self { http, base, query: query.to_owned(), name: manifest.name.clone(), version: manifest.version.clone() }
    }
}

impl TileSource for ServerSource {
    fn tile(&self, key: TileKey) -> PendingTile<'_> {
        let path = match key.kind() {
            TileKind::Mesh => route::mesh(&self.name, &self.version, key.id, key.lod),
            kind => route::tile(&self.name, &self.version, kind, key.id),
        };
        let url = format!("{}{path}{}", self.base, self.query);
        self.http.get(url, max_tile_bytes(key.kind()))
    }

    fn search<'a>(&'a self, query: &'a str, limit: usize) -> BoxFuture<'a, Result<Option<Vec<SearchHit>>, FetchError>> {
        let text = utf8_percent_encode(query, NON_ALPHANUMERIC);
        let share = self.query.strip_prefix('?').map(|share| format!("&{share}")).unwrap_or_default();
        let path = route::search(&self.name, &self.version);
        let url = format!("{}{path}?q={text}&limit={limit}{share}", self.base);
        Box::pin(async move {
            let bytes = match self.http.get(url, MAX_HITS_BYTES).await {
                Err(FetchError::Missing) => return Ok(None),
                response => response?,
            };
            let hits: Vec<HitJson> = serde_json::from_slice(&bytes)
                .map_err(|_| FetchError::Damaged(DecodeError::Invalid("the hits of the search are not JSON")))?;
            Ok(Some(hits.into_iter().map(SearchHit::from).take(limit).collect()))
        })
    }

    fn location(&self) -> &str {
        &self.base
    }
}
