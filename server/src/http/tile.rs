//! Tiles, immutable under their city's version.
//!
//! In: `/v1/cities/{city}/{version}/{layer}/{level}/{x}/{y}`. Out: the tile's bytes as the archive holds them.
//! Next: the client's decoder.

use super::{
    AppState, Problem,
    headers::{IMMUTABLE, Representation, quoted},
};
use crate::store::CityStore;
use axum::{
    extract::{Path, State, rejection::PathRejection},
    http::{HeaderMap, HeaderValue, Method},
    response::Response,
};
use insula_protocol::{TileId, route::Layer};

type Parts = (String, String, String, String, String);
type MeshParts = (String, String, String, String, String, String);

/// A tile of `layer`.
pub(super) async fn tile(
    layer: Layer,
    State(app): State<AppState>,
    path: Result<Path<Parts>, PathRejection>,
    method: Method,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let Path((city, version, level, x, y)) = path.map_err(|_| NOT_TEXT)?;
    let id = tile_id(&level, &x, &y)?;
    let city = versioned(&app, &city, &version)?;
    let body = city.tile(layer, id).ok_or(Problem::not_found("this city has no such tile"))?;
    let representation = Representation {
        body,
        content_type: HeaderValue::from_static("application/octet-stream"),
        // The version is a hash of the city's content, so that version, layer and place name the bytes.
        etag: quoted(&format!("{version}-{}-{level}-{x}-{y}", layer.word())),
        cache_control: IMMUTABLE,
        vary: None,
    };
    Ok(representation.answer(&method, &headers))
}

/// Mesh LODs: the addresses are reserved, no city has any yet.
pub(super) async fn mesh(
    State(app): State<AppState>,
    path: Result<Path<MeshParts>, PathRejection>,
) -> Result<Response, Problem> {
    let Path((city, version, level, x, y, lod)) = path.map_err(|_| NOT_TEXT)?;
    tile_id(&level, &x, &y)?;
    number(&lod).filter(|lod| *lod <= u32::from(u8::MAX)).ok_or(NOT_A_TILE)?;
    versioned(&app, &city, &version)?;
    Err(Problem::not_found("this city has no meshes"))
}

const NOT_TEXT: Problem = Problem::bad_request("the address is not UTF-8 text");
const NOT_A_TILE: Problem =
    Problem::bad_request("level, x and y must be plain decimal numbers, level at most 20, x and y below 2^level");

fn versioned<'a>(app: &'a AppState, city: &str, version: &str) -> Result<&'a CityStore, Problem> {
    let city = app.store().city(city).ok_or(Problem::not_found("there is no such city"))?;
    if city.manifest().version != version {
        return Err(Problem::not_found("the city has another version now: fetch its manifest again"));
    }
    Ok(city)
}

fn tile_id(level: &str, x: &str, y: &str) -> Result<TileId, Problem> {
    let part = |text| number(text).ok_or(NOT_A_TILE);
    let level = u8::try_from(part(level)?).map_err(|_| NOT_A_TILE)?;
    TileId::new(level, part(x)?, part(y)?).ok_or(NOT_A_TILE)
}

/// Decimal digits without sign or leading zeros, so that each tile has one address and caches hold it once.
fn number(text: &str) -> Option<u32> {
    let plain = text.bytes().all(|b| b.is_ascii_digit()) && (text == "0" || !text.starts_with('0'));
    if plain { text.parse().ok() } else { None }
}
