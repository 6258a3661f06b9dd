//! Tiles, which are immutable under their city's version.
//!
//! In: a [`TileRoute`]. Out: the tile's bytes as the archive holds them, with valid checksums. Next: the client's decoder.

use super::{
    access_control::{AccessRequest, CityAccess, Credentials},
    problem::{NO_ROUTE, Problem},
    representation::{IMMUTABLE, IMMUTABLE_PRIVATE, Representation, is_unconditional, quoted},
    response::{FullResponse, with_cors},
    state::{AppState, MessageKind},
    thread_state::ThreadState,
    tile_cache::{CachedTile, TileCache, TileCacheKey},
};
use crate::store::CityStore;
use axum::{
    body::Body,
    extract::State,
    http::{HeaderMap, HeaderValue, Method, Request, StatusCode, header, request::Parts},
    response::Response,
};
use bytes::Bytes;
use insula_archive::ReadError;
use insula_protocol::{
    TileId, TileKind, mesh_tile,
    route::{Route, RouteError, RouteTemplate, TileRoute},
};
use std::sync::Arc;

const NO_TILE: Problem = Problem::not_found("this city has no such tile");
const INVALID_TILE: Problem = Problem::bad_request(
    "level, x and y must be plain decimal numbers, level at most 20, x and y below 2^level, lod at most 3",
);

/// A tile. Fails as [`RequestedTile::of_request`] and [`RequestedTile::read`].
pub(super) async fn tile(
    State(ThreadState { app, tiles }): State<ThreadState>,
    request: Request<Body>,
) -> Result<Response, Problem> {
    let (parts, _) = request.into_parts();
    let tile = RequestedTile::of_request(&app, &parts)?;
    let response = match tile.cached_response(&tiles, &parts) {
        Some(response) => response,
        None => tile.read(&app, &tiles, &parts).await?,
    };
    Ok(response.map(Body::from))
}

/// A tile of an open city that the request may see. The archive may still lack it.
pub(super) struct RequestedTile {
    city: Arc<CityStore>,
    key: TileCacheKey,
    access: CityAccess,
}

impl RequestedTile {
    /// The tile at a request's address. Fails with 400 for invalid numbers, 401 without a required token, or 404.
    pub(super) fn of_request(state: &AppState, request: &Parts) -> Result<Self, Problem> {
        let path = request.uri.path();
        let credentials = Credentials::new(&request.headers, &request.uri);
        match Route::parse(path) {
            Ok(Route::Tile(tile)) => Self::resolve(state, tile, credentials),
            Err(RouteError::InvalidTile) => Err(INVALID_TILE),
            // Such a city or version cannot exist. Without a token, the response must be the one for private cities.
            Err(RouteError::InvalidName) => {
                let (route, city) = (RouteTemplate::of_path(path), path.split('/').nth(3).unwrap_or_default());
                let request = AccessRequest { route, city, version: None };
                state.catalog().access().authorize(credentials, request)?;
                Err(Problem::not_found("there is no such city or version"))
            }
            _ => Err(NO_ROUTE),
        }
    }

    /// Looks up city and version. Fails with 401 without a required token, or 404.
    fn resolve(state: &AppState, route: TileRoute<'_>, credentials: Credentials<'_>) -> Result<Self, Problem> {
        let catalog = state.catalog();
        let found = catalog.store().version(route.city, route.version);
        let is_known = found.is_some() || catalog.store().city(route.city).is_some();
        let request = AccessRequest {
            route: Route::Tile(route).template(),
            city: route.city,
            version: is_known.then_some(route.version),
        };
        let access = catalog.access().authorize(credentials, request)?;
        let city = match found {
            Some(city) => Arc::clone(city),
            None if !is_known => return Err(Problem::not_found("there is no such city")),
            None => {
                return Err(Problem::not_found("the city has another version now: fetch its manifest again"));
            }
        };
        if let CityAccess::Link(scope) = access
            && !scope.admits_tile(city.manifest(), route.kind, route.id)
        {
            return Err(NO_TILE);
        }
        // Only leaves have meshes, so that each mesh has one route.
        let id = match route.kind {
            TileKind::Subtree | TileKind::BlockMap | TileKind::Objects => route.id,
            TileKind::Mesh => Some(route.id)
                .filter(|id| id.level() == city.manifest().depth)
                .and_then(|id| mesh_tile::archive_id(id, route.lod))
                .ok_or(NO_TILE)?,
        };
        let key = TileCacheKey { serial: city.serial(), kind: route.kind, id };
        Ok(Self { city, key, access })
    }

    /// The response, if the tile is cached.
    pub(super) fn cached_response(&self, tiles: &TileCache, request: &Parts) -> Option<FullResponse> {
        tiles.get(&self.key).map(|tile| respond(&tile, request))
    }

    /// Reads the tile, checks and caches it. Fails with 404, 500 if it is damaged, or 503 if it cannot be read.
    pub(super) async fn read(
        self,
        state: &AppState,
        tiles: &TileCache,
        request: &Parts,
    ) -> Result<FullResponse, Problem> {
        let body = match self.city.checked_tile(self.key.kind, self.key.id).await {
            Ok(body) => body.ok_or(NO_TILE)?,
            Err(error) => return Err(self.report_failure(state, &error)),
        };
        let tile = Arc::new(self.prepare(state, body));
        tiles.insert(self.key, Arc::clone(&tile));
        Ok(respond(&tile, request))
    }

    fn prepare(&self, state: &AppState, body: Bytes) -> CachedTile {
        let representation = Representation {
            body,
            content_type: HeaderValue::from_static("application/octet-stream"),
            // The version is a hash of the city's content, so version, kind and id determine the bytes.
            etag: etag(&self.city.manifest().version, self.key.kind, self.key.id),
            cache_control: if self.access.is_public() { IMMUTABLE } else { IMMUTABLE_PRIVATE },
            encoding: None,
            vary: None,
        };
        let whole = representation.clone().respond(&Method::GET, &HeaderMap::new());
        let headers = whole.into_parts().0.headers;
        CachedTile { headers: if state.allows_any_origin() { with_cors(headers) } else { headers }, representation }
    }

    /// Logs and counts the failure. The client learns only whether a retry may help.
    fn report_failure(&self, state: &AppState, error: &ReadError) -> Problem {
        state.metrics().read_failed(error);
        let (place, kind, id) = (self.city.location(), self.key.kind.path_segment(), self.key.id);
        if state.admits_message(MessageKind::TileFailure) {
            tracing::error!(place, tile = %format_args!("{kind}/{id}"), %error, "cannot serve a tile");
        }
        match error {
            ReadError::Damaged(_) => {
                Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "the server's copy of this tile is damaged")
                    .with(header::RETRY_AFTER, HeaderValue::from_static("60"))
            }
            _ => Problem::unavailable("this tile cannot be read at the moment"),
        }
    }
}

/// Plain GET requests, the common case, get the prepared headers.
fn respond(tile: &CachedTile, request: &Parts) -> FullResponse {
    if request.method == Method::GET && is_unconditional(&request.headers) {
        let mut whole = FullResponse::new(tile.representation.body.clone());
        *whole.headers_mut() = tile.headers.clone();
        whole
    } else {
        tile.representation.clone().respond(&request.method, &request.headers)
    }
}

fn etag(version: &str, kind: TileKind, id: TileId) -> HeaderValue {
    quoted(&format!("{version}-{}-{}-{}-{}", kind.path_segment(), id.level(), id.x(), id.y()))
}
