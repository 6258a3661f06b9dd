//! Tiles, which are immutable under their city's version.
//!
//! In: a [`TileRoute`]. Out: the tile's bytes as the archive holds them, with valid checksums. Next: the client's decoder.

use super::access_control::{AccessRequest, CityAccess, Credentials};
use super::problem::{NO_ROUTE, Problem};
use super::representation::{Representation, is_unconditional, quoted};
use super::response::{FullResponse, with_cors};
use super::state::{AppState, MessageKind};
use super::thread_state::ThreadState;
use super::tile_cache::{CachedTile, TileCache, TileCacheKey};
use crate::store::CityStore;
use axum::body::Body;
use axum::extract::State;
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderValue, Method, Request, StatusCode};
use axum::response::Response;
use bytes::Bytes;
use insula_archive::ReadError;
use insula_protocol::route::{Route, RouteError, RouteTemplate, TileRoute};
use insula_protocol::{TileId, TileKind, mesh_tile};
use std::sync::Arc;

const NO_TILE: Problem = Problem::not_found("this city has no such tile");
/// Clients that hold an old manifest must not take tiles of such a version for missing ones.
const OTHER_VERSION: Problem =
    Problem::new(StatusCode::GONE, "the city has another version now: fetch its manifest again");
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
        None => respond(&*tile.read(&app, &tiles).await?, &parts),
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
        match Route::parse(request.uri.path()) {
            Ok(Route::Tile(tile)) => Self::resolve(state, tile, request),
            Err(RouteError::InvalidTile) => Err(INVALID_TILE),
            Err(RouteError::InvalidName) => Err(unknown_name(state, request)),
            _ => Err(NO_ROUTE),
        }
    }

    /// Looks up city and version. Fails with 401 without a required token, or 404.
    fn resolve(state: &AppState, route: TileRoute<'_>, request: &Parts) -> Result<Self, Problem> {
        let template = Route::Tile(route).template();
        let (city, access) = find_version(state, template, route.city, route.version, request)?;
        Self::of_city(city, access, route.kind, route.id, route.lod).ok_or(NO_TILE)
    }

    /// A tile of `city`; of a mesh, its level of detail `lod`. `None` if it cannot exist, or `access` does not admit it.
    pub(super) fn of_city(
        city: Arc<CityStore>,
        access: CityAccess,
        kind: TileKind,
        node: TileId,
        lod: u8,
    ) -> Option<Self> {
        if let CityAccess::Link(scope) = access
            && !scope.admits_tile(city.manifest(), kind, node)
        {
            return None;
        }
        // Only leaves have meshes, so that each mesh has one route.
        let id = match kind {
            TileKind::Subtree | TileKind::BlockMap | TileKind::Objects | TileKind::Visibility => node,
            TileKind::Mesh => Some(node)
                .filter(|id| id.level() == city.manifest().depth)
                .and_then(|id| mesh_tile::archive_id(id, lod))?,
        };
        let key = TileCacheKey { serial: city.serial(), kind, id };
        Some(Self { city, key, access })
    }

    /// Length in bytes. `None` if the archive has no such tile. Fails with 500 if a directory is damaged, or 503 if it cannot be read.
    pub(super) async fn length(&self, state: &AppState) -> Result<Option<u64>, Problem> {
        let length = self.city.tile_bytes(self.key.kind, self.key.id).await;
        length.map_err(|error| self.report_failure(state, &error))
    }

    /// The response, if the tile is cached.
    pub(super) fn cached_response(&self, tiles: &TileCache, request: &Parts) -> Option<FullResponse> {
        tiles.get(&self.key).map(|tile| respond(&tile, request))
    }

    /// Reads the tile, checks and caches it. Fails with 404, 500 if it is damaged, or 503 if it cannot be read.
    async fn read(self, state: &AppState, tiles: &TileCache) -> Result<Arc<CachedTile>, Problem> {
        let body = match self.city.checked_tile(self.key.kind, self.key.id).await {
            Ok(body) => body.ok_or(NO_TILE)?,
            Err(error) => return Err(self.report_failure(state, &error)),
        };
        let tile = Arc::new(self.prepare(state, body));
        tiles.insert(self.key, Arc::clone(&tile));
        Ok(tile)
    }

    /// The tile's bytes, from the cache or the archive. Fails as [`RequestedTile::read`] does.
    pub(super) async fn bytes(self, state: &AppState, tiles: &TileCache) -> Result<Bytes, Problem> {
        let tile = match tiles.get(&self.key) {
            Some(tile) => tile,
            None => self.read(state, tiles).await?,
        };
        Ok(tile.representation.body.clone())
    }

    fn prepare(&self, state: &AppState, body: Bytes) -> CachedTile {
        // The version is a hash of the city's content, so version, kind and id determine the bytes.
        let etag = etag(&self.city.manifest().version, self.key.kind, self.key.id);
        let is_public = self.access.is_public();
        let representation = Representation::immutable(body, etag, "application/octet-stream", is_public);
        let whole = representation.clone().respond(&Method::GET, &HeaderMap::new());
        let headers = whole.into_parts().0.headers;
        CachedTile { headers: if state.allows_any_origin { with_cors(headers) } else { headers }, representation }
    }

    /// Logs and counts the failure. The client learns only whether a retry may help.
    fn report_failure(&self, state: &AppState, error: &ReadError) -> Problem {
        state.metrics.read_failed(error);
        let (place, kind, id) = (self.city.location(), self.key.kind.path_segment(), self.key.id);
        if state.admits_message(MessageKind::TileFailure) {
            tracing::error!(place, tile = %format_args!("{kind}/{id}"), %error, "cannot serve a tile");
        }
        match error {
            ReadError::Damaged(_) => Problem::damaged("the server's copy of this tile is damaged"),
            _ => Problem::unavailable("this tile cannot be read at the moment"),
        }
    }
}

/// A city that the request may see. Fails with 401 without a required token, or 404.
pub(super) fn find_city(
    state: &AppState,
    route: RouteTemplate,
    name: &str,
    request: &Parts,
) -> Result<(Arc<CityStore>, CityAccess), Problem> {
    let catalog = state.catalog();
    let city = catalog.store().city(name);
    let version = city.map(|city| city.manifest().version.as_str());
    let access = catalog.access.authorize(Credentials::of(request), AccessRequest { route, city: name, version })?;
    let city = city.ok_or(Problem::not_found("there is no such city"))?;
    Ok((Arc::clone(city), access))
}

/// A version of a city that the request may see. Fails with 401 without a required token, 404, or 410 if the city has other versions.
pub(super) fn find_version(
    state: &AppState,
    route: RouteTemplate,
    city: &str,
    version: &str,
    request: &Parts,
) -> Result<(Arc<CityStore>, CityAccess), Problem> {
    let catalog = state.catalog();
    let found = catalog.store().version(city, version);
    let is_known = found.is_some() || catalog.store().city(city).is_some();
    let asked = AccessRequest { route, city, version: is_known.then_some(version) };
    let access = catalog.access.authorize(Credentials::of(request), asked)?;
    match found {
        Some(city) => Ok((Arc::clone(city), access)),
        None if !is_known => Err(Problem::not_found("there is no such city")),
        None => Err(OTHER_VERSION),
    }
}

/// The response for a city or version that cannot exist: 404, or without a token the one for private cities.
pub(super) fn unknown_name(state: &AppState, request: &Parts) -> Problem {
    let path = request.uri.path();
    let (route, city) = (RouteTemplate::of_path(path), path.split('/').nth(3).unwrap_or_default());
    let asked = AccessRequest { route, city, version: None };
    let denied = state.catalog().access.authorize(Credentials::of(request), asked).err();
    denied.unwrap_or(Problem::not_found("there is no such city or version"))
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
