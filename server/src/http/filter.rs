//! Which objects of a city pass a filter, so that clients need not fetch all objects.
//!
//! The address has a city's version and the filter, so that the response is immutable as a tile is.

use super::computed_cache::ComputedKey;
use super::fair_queue::{Shed, StopFlag};
use super::problem::Problem;
use super::search::decode_text;
use super::state::{AppState, MessageKind};
use super::tile::{find_version, unknown_name};
use super::work_queues::{RequestClient, WorkKind};
use crate::store::CityStore;
use axum::extract::State;
use axum::http::request::Parts;
use axum::response::Response;
use insula_objects::filter::{Filter, FilterBuilder, MAX_FILTER_BYTES};
use insula_objects::{ObjectBlock, Schema};
use insula_protocol::TileKind;
use insula_protocol::object_tile::{self, BLOCK_OBJECTS, SCHEMA_ID, block_id};
use insula_protocol::route::{Route, RouteTemplate};
use std::fmt::Display;
use tokio::runtime::Handle;

const INVALID_TEXT: Problem = Problem::bad_request("q must be a filter of 1 to 4096 characters, percent-encoded UTF-8");
const NO_OBJECTS: Problem = Problem::not_found("this city has no objects");
const NO_FILTER: Problem =
    Problem::bad_request("expr is no filter for the attributes of this city, which objects/schema lists");

/// Why a filter has no result.
enum Failure {
    NoObjects,
    /// The text is no filter for this city.
    Invalid,
    /// Nobody waits for the result.
    Stopped,
    Unreadable(String),
}

/// `/v1/cities/{city}/{version}/filter`. Fails with 400 for an invalid `expr`, 401 without a required token, 404 for an unknown city or
/// version, without objects, or with a share link for a part of the city or read-only; 500 if objects are damaged, 503 if there is no time.
pub(super) async fn filter(State(state): State<AppState>, parts: Parts) -> Result<Response, Problem> {
    let text = text_of(parts.uri.query().unwrap_or_default()).ok_or(INVALID_TEXT)?;
    let (city, access) = match Route::parse(parts.uri.path()) {
        Ok(Route::Filter { city, version }) => find_version(&state, RouteTemplate::Filter, city, version, &parts)?,
        _ => return Err(unknown_name(&state, &parts)),
    };
    if !access.admits_computed(RouteTemplate::Filter) {
        return Err(NO_OBJECTS);
    }
    let (filtered, runtime) = (city.clone(), Handle::current());
    let key = ComputedKey::Filtered(city.serial(), text.clone().into());
    let work = move |stop: &StopFlag| evaluate(&filtered, &text, &runtime, stop);
    let made = state.computed.find_or_make(key, state.work(WorkKind::Filter), RequestClient::of(&parts), work).await;
    let made = made.map_err(Shed::problem)?.map_err(|failure| problem(&state, &city, failure))?;
    Ok(made.immutable("application/octet-stream", access.is_public()).response_to(&parts))
}

/// The filter of a query; `None` if there is none, or not one.
fn text_of(query: &str) -> Option<String> {
    let pairs = query.split('&').filter_map(|pair| pair.split_once('='));
    let mut texts = pairs.filter(|(key, _)| *key == "expr").map(|(_, value)| value);
    let text = decode_text(texts.next()?, MAX_FILTER_BYTES)?;
    texts.next().is_none().then_some(text)
}

/// The bytes of [`FilteredObjects`](insula_objects::filter::FilteredObjects). Waits for the network if the city is in an object store.
fn evaluate(city: &CityStore, text: &str, runtime: &Handle, stop: &StopFlag) -> Result<Vec<u8>, Failure> {
    let unreadable = |error: &dyn Display| Failure::Unreadable(error.to_string());
    let read = |id| {
        let tile = runtime.block_on(city.checked_tile(TileKind::Objects, id)).map_err(|error| unreadable(&error))?;
        tile.map(|tile| object_tile::decode(id, &tile)).transpose().map_err(|error| unreadable(&error))
    };
    let content = read(SCHEMA_ID)?.ok_or(Failure::NoObjects)?;
    let schema: Schema = serde_json::from_slice(&content).map_err(|error| unreadable(&error))?;
    schema.check().map_err(|error| unreadable(&error))?;
    let filter = Filter::parse(text, &schema).map_err(|_| Failure::Invalid)?;
    let block = |number| {
        if stop.is_stopped() {
            return Err(Failure::Stopped);
        }
        let Some(content) = block_id(number).map(&read).transpose()?.flatten() else { return Ok(None) };
        ObjectBlock::decode(number, &content, &schema).map(Some).map_err(|error| unreadable(&error))
    };
    let mut builder = FilterBuilder::default();
    for number in 0..schema.objects.div_ceil(BLOCK_OBJECTS) {
        if let Some(block) = block(number)? {
            builder.add(&block, &filter);
        }
    }
    for [parents, parts] in builder.apart() {
        if let (Some(parents), Some(parts)) = (block(parents)?, block(parts)?) {
            builder.add_apart(&parents, &parts, &filter);
        }
    }
    Ok(builder.finish().encode())
}

/// Logs failures of the city's files.
fn problem(state: &AppState, city: &CityStore, failure: Failure) -> Problem {
    match failure {
        Failure::NoObjects => NO_OBJECTS,
        Failure::Invalid => NO_FILTER,
        Failure::Stopped => Shed.problem(),
        Failure::Unreadable(reason) => {
            if state.admits_message(MessageKind::TileFailure) {
                tracing::error!(place = city.location(), reason, "cannot filter the objects of a city");
            }
            Problem::damaged("the server cannot read the objects of this city")
        }
    }
}
