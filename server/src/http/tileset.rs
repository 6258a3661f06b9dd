//! A city as 3D Tiles for other programs (`insula_export::tiles3d`). Files are made when they are asked for, and cached.
//!
//! The addresses of files have the city's version, so that they are immutable; only `tileset.json` changes with the city.

use super::access_control::CityAccess;
use super::computed_cache::{ComputedBytes, ComputedKey, TilesetFile};
use super::fair_queue::{Shed, StopFlag};
use super::page_response::share_query;
use super::problem::{NO_ROUTE, Problem};
use super::representation::Representation;
use super::state::{AppState, MessageKind};
use super::tile::{find_city, find_version, unknown_name};
use super::work_queues::{RequestClient, WorkKind};
use crate::store::{CityStore, StoredCity};
use axum::extract::State;
use axum::http::Uri;
use axum::http::request::Parts;
use axum::response::Response;
use insula_bake::read::EarthPlace;
use insula_export::glb::ExportError;
use insula_export::selection::ObjectSelection;
use insula_export::tiles3d::Tileset;
use insula_protocol::route::{Route, RouteError, RouteTemplate, TilesetFileKind};
use std::sync::Arc;
use tokio::runtime::Handle;

const NO_FILE: Problem = Problem::not_found("this tileset has no such file");
const INVALID_NODE: Problem =
    Problem::bad_request("level, x and y must be plain decimal numbers, level at most 20, x and y below 2^level");

/// Why there is no file.
enum FileError {
    Missing,
    Failed(String),
}

/// `/v1/cities/{city}/3dtiles/tileset.json`, and the files that it names. Fails with 400 for invalid numbers, 401 without a required
/// token, 404 for an unknown city, version or file, or with a share link for a part of the city or read-only; 500 if the city is damaged, 503 if the
/// file cannot be made now.
pub(super) async fn tileset_file(State(state): State<AppState>, parts: Parts) -> Result<Response, Problem> {
    let (city, access, file) = requested(&state, &parts)?;
    if !access.admits_computed(RouteTemplate::Tileset) {
        return Err(NO_FILE);
    }
    let (read, runtime) = (Arc::clone(&city), Handle::current());
    let work = move |_: &StopFlag| make_now(&read, file, &runtime);
    let key = ComputedKey::File(city.serial(), file);
    let made = state.computed.find_or_make(key, state.work(WorkKind::Tileset), RequestClient::of(&parts), work).await;
    let made = made.map_err(Shed::problem)?.map_err(|error| problem(&state, &city, error))?;
    let made = with_share_link(made, file, &access, &parts.uri);
    let is_public = access.is_public();
    let representation = match file {
        TilesetFile::Root => Representation::changing(made.body, "application/json", is_public),
        TilesetFile::Node(TilesetFileKind::Subtree, _) => made.immutable("application/octet-stream", is_public),
        TilesetFile::Node(TilesetFileKind::Content, _) => made.immutable("model/gltf-binary", is_public),
    };
    Ok(representation.response_to(&parts))
}

/// The root with the share link of the request in the addresses that it names: programs do not add it by themselves.
fn with_share_link(root: ComputedBytes, file: TilesetFile, access: &CityAccess, uri: &Uri) -> ComputedBytes {
    let query = match (file, access) {
        (TilesetFile::Root, CityAccess::Link(_)) => share_query(uri),
        _ => None,
    };
    let (Some(query), Ok(json)) = (query, std::str::from_utf8(&root.body)) else { return root };
    let json = ["glb", "subtree"].into_iter().fold(json.to_owned(), |json, kind| {
        json.replace(&format!("/{{y}}.{kind}\""), &format!("/{{y}}.{kind}{query}\""))
    });
    ComputedBytes::new(json)
}

/// The city of an address that the request may see, and the file.
fn requested(state: &AppState, request: &Parts) -> Result<(Arc<CityStore>, CityAccess, TilesetFile), Problem> {
    match Route::parse(request.uri.path()) {
        Ok(Route::Tileset { city: name }) => {
            let (city, access) = find_city(state, RouteTemplate::Tileset, name, request)?;
            Ok((city, access, TilesetFile::Root))
        }
        Ok(Route::TilesetFile { city, version, kind, id }) => {
            let (city, access) = find_version(state, RouteTemplate::TilesetFile, city, version, request)?;
            Ok((city, access, TilesetFile::Node(kind, id)))
        }
        Err(RouteError::InvalidTile) => Err(INVALID_NODE),
        Err(RouteError::InvalidName) => Err(unknown_name(state, request)),
        _ => Err(NO_ROUTE),
    }
}

/// Reads what a file needs, and makes it. Waits for the network if the city is in an object store.
fn make_now(city: &CityStore, file: TilesetFile, runtime: &Handle) -> Result<Vec<u8>, FileError> {
    let failed = |error: &dyn std::fmt::Display| FileError::Failed(error.to_string());
    let read = |kind, id| runtime.block_on(city.checked_tile(kind, id));
    let manifest = city.manifest();
    let source = StoredCity::open(manifest, &read).map_err(|error| failed(&error))?;
    let place =
        manifest.crs.as_deref().and_then(EarthPlace::of).map(|place| place.above_sea_level(manifest.heights.is_some()));
    let to_geocentric = |point: [f64; 3]| place.as_ref()?.geocentric(point);
    let everything = ObjectSelection::default();
    let tileset = Tileset::new(&source, &everything, &to_geocentric).map_err(|error| failed(&error))?;
    let made: Result<Option<Vec<u8>>, ExportError> = match file {
        TilesetFile::Root => tileset.tileset_json(&format!("{}/", manifest.version)).map(Some),
        TilesetFile::Node(TilesetFileKind::Subtree, id) => tileset.subtree(id.level(), id.x(), id.y()),
        TilesetFile::Node(TilesetFileKind::Content, id) => tileset.content(id.level(), id.x(), id.y()),
    };
    made.map_err(|error| failed(&error))?.ok_or(FileError::Missing)
}

/// Logs a failure. The client learns only whether a retry may help.
fn problem(state: &AppState, city: &CityStore, error: FileError) -> Problem {
    match error {
        FileError::Missing => NO_FILE,
        FileError::Failed(reason) => {
            if state.admits_message(MessageKind::TileFailure) {
                tracing::error!(place = city.location(), reason, "cannot make a tile of the tileset");
            }
            Problem::damaged("the server cannot make this file from its copy of the city")
        }
    }
}
