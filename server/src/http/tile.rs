//! Tiles, immutable under their city's version.
//!
//! In: a [`TileAddress`]. Out: the tile's bytes as the archive holds them, every checksum right. Next: the client's decoder.

use super::{
    access_control::CityAccess,
    problem::Problem,
    representation::{IMMUTABLE, IMMUTABLE_PRIVATE, Representation, is_plain, quoted},
    response::{FullResponse, with_cors},
    state::AppState,
    tile_address::TileAddress,
    tile_cache::{CachedTile, TileCache, TileCacheKey},
};
use crate::store::CityStore;
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header, request::Parts};
use bytes::Bytes;
use http_body_util::Full;
use insula_archive::ReadError;
use insula_protocol::{TileId, mesh_tile, route::Layer};
use std::sync::Arc;

const NO_TILE: Problem = Problem::not_found("this city has no such tile");

/// A tile that exists as far as its address tells.
pub(super) struct TileRequest {
    city: Arc<CityStore>,
    key: TileCacheKey,
    sight: CityAccess,
}

impl TileRequest {
    /// Errors: 401, 404.
    pub(super) fn find(state: &AppState, address: TileAddress<'_>, headers: &HeaderMap) -> Result<Self, Problem> {
        let catalog = state.catalog();
        let sight = catalog.access().sight(address.city, headers)?;
        let city = match catalog.store().version(address.city, address.version) {
            Some(city) => Arc::clone(city),
            None if catalog.store().city(address.city).is_none() => {
                return Err(Problem::not_found("there is no such city"));
            }
            None => {
                return Err(Problem::not_found("the city has another version now: fetch its manifest again"));
            }
        };
        // Only leaves have meshes, so that none has a second address.
        let id = match address.layer {
            Layer::Subtrees | Layer::BlockMaps => address.id,
            Layer::Meshes => Some(address.id)
                .filter(|id| id.level() == city.manifest().depth)
                .and_then(|id| mesh_tile::place(id, address.lod))
                .ok_or(NO_TILE)?,
        };
        let key = TileCacheKey { serial: city.serial(), layer: address.layer, id };
        Ok(Self { city, key, sight })
    }

    /// The answer, if the tile is at hand.
    pub(super) fn at_hand(&self, tiles: &TileCache, request: &Parts) -> Option<FullResponse> {
        tiles.get(&self.key).map(|tile| answer(&tile, &request.method, &request.headers))
    }

    /// Reads the tile, checks it and keeps it at hand.
    pub(super) async fn read(
        self,
        state: &AppState,
        tiles: &TileCache,
        method: &Method,
        headers: &HeaderMap,
    ) -> Result<FullResponse, Problem> {
        let body = match self.city.checked_tile(self.key.layer, self.key.id).await {
            Ok(body) => body.ok_or(NO_TILE)?,
            Err(error) => return Err(self.failed(state, &error)),
        };
        let tile = Arc::new(self.ready(body));
        tiles.insert(self.key, Arc::clone(&tile));
        Ok(answer(&tile, method, headers))
    }

    fn ready(&self, body: Bytes) -> CachedTile {
        let representation = Representation {
            body,
            content_type: HeaderValue::from_static("application/octet-stream"),
            // The version is a hash of the city's content, so that version, layer and place name the bytes.
            etag: etag(&self.city.manifest().version, self.key.layer, self.key.id),
            cache_control: if self.sight == CityAccess::Private { IMMUTABLE_PRIVATE } else { IMMUTABLE },
            encoding: None,
            vary: None,
        };
        let whole = representation.clone().answer(&Method::GET, &HeaderMap::new());
        CachedTile { headers: with_cors(whole.into_parts().0.headers), representation }
    }

    /// What the host must know is logged and counted; the client learns that it is not its fault.
    fn failed(&self, state: &AppState, error: &ReadError) -> Problem {
        state.metrics().read_failed(error);
        let (place, layer, id) = (self.city.location(), self.key.layer.word(), self.key.id);
        tracing::error!(place, tile = %format_args!("{layer}/{id}"), %error, "a tile cannot be served");
        match error {
            ReadError::Damaged(_) => {
                let detail = "the server's copy of this tile is damaged";
                Problem::new(StatusCode::INTERNAL_SERVER_ERROR, detail)
                    .with(header::RETRY_AFTER, HeaderValue::from_static("60"))
            }
            _ => Problem::unavailable("this tile cannot be read at the moment"),
        }
    }
}

/// The common question has its answer's headers ready.
fn answer(tile: &CachedTile, method: &Method, headers: &HeaderMap) -> FullResponse {
    if *method == Method::GET && is_plain(headers) {
        let mut whole = FullResponse::new(Full::new(tile.representation.body.clone()));
        *whole.headers_mut() = tile.headers.clone();
        whole
    } else {
        tile.representation.clone().answer(method, headers)
    }
}

fn etag(version: &str, layer: Layer, id: TileId) -> HeaderValue {
    quoted(&format!("{version}-{}-{}-{}-{}", layer.word(), id.level(), id.x(), id.y()))
}
