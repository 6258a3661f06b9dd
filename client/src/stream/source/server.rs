//! An Insula server.
//!
//! In: a [`TileKey`]. Out: the server's answer. Next: `decode`.

use super::{Pending, Source};
use crate::stream::fetch::Http;
use insula_archive::limits::max_tile_bytes;
use insula_protocol::{Manifest, TileKind, route};
use insula_viewer::scene::TileKey;
use std::sync::Arc;

/// One city on a server, in one version.
#[derive(Debug)]
pub struct Server {
    http: Arc<Http>,
    base: String,
    name: String,
    version: String,
}

impl Server {
    /// On the server at `base` (`http://host:port`).
    pub fn new(http: Arc<Http>, base: &str, manifest: &Manifest) -> Self {
        let base = base.trim_end_matches('/').to_owned();
        Self { http, base, name: manifest.name.clone(), version: manifest.version.clone() }
    }
}

impl Source for Server {
    fn tile(&self, key: TileKey) -> Pending<'_> {
        let path = match key.layer() {
            TileKind::Mesh => route::mesh(&self.name, &self.version, key.id, key.lod),
            layer => route::tile(&self.name, &self.version, layer, key.id),
        };
        let url = format!("{}{path}", self.base);
        Box::pin(async move { self.http.get(&url, max_tile_bytes(key.layer())).await })
    }

    fn place(&self) -> &str {
        &self.base
    }
}
