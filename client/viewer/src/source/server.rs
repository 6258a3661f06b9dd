//! Tiles from an Insula server.

use super::{PendingTile, TileSource, Transport};
use crate::scene::TileKey;
use insula_archive::limits::max_tile_bytes;
use insula_protocol::{Manifest, TileKind, route};
use std::sync::Arc;

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

    fn location(&self) -> &str {
        &self.base
    }
}
