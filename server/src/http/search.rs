//! The search of a city's objects by their texts.
//!
//! The address has a city's version, `q` and `limit`; the response has the hits as JSON, immutable under the version as a tile is. The work
//! of a search is bounded (`insula_objects::search`); the first one reads the index.

use super::computed_cache::ComputedBytes;
use super::fair_queue::{Shed, StopFlag};
use super::problem::Problem;
use super::state::{AppState, MessageKind};
use super::tile::{find_version, unknown_name};
use super::work_queues::{RequestClient, WorkKind};
use crate::store::{CityStore, SearchFileError};
use axum::extract::State;
use axum::http::request::Parts;
use axum::response::Response;
use insula_objects::search::MAX_QUERY_CHARS;
use insula_protocol::route::{Route, RouteTemplate};
use percent_encoding::percent_decode_str;
use std::sync::Arc;
use tokio::runtime::Handle;

const DEFAULT_LIMIT: usize = 10;
const MAX_LIMIT: usize = 100;

const INVALID_TEXT: Problem = Problem::bad_request("q must be a text of 1 to 128 characters, percent-encoded UTF-8");
const INVALID_LIMIT: Problem = Problem::bad_request("limit must be a number from 1 to 100");
const NO_INDEX: Problem = Problem::not_found("this city has no search");

#[derive(Debug, PartialEq, Eq)]
struct SearchRequest {
    /// 1 to [`MAX_QUERY_CHARS`] characters.
    text: String,
    /// 1 to [`MAX_LIMIT`].
    limit: usize,
}

/// `/v1/cities/{city}/{version}/search`. Fails with 400 for an invalid `q` or `limit`, 401 without a required token, 404 for an unknown
/// city or version, without an index, or with a share link for a part of the city; 500 if the index is damaged, 503 if it cannot be
/// read.
pub(super) async fn search(State(state): State<AppState>, parts: Parts) -> Result<Response, Problem> {
    let SearchRequest { text, limit } = search_request(parts.uri.query().unwrap_or_default())?;
    let (city, access) = match Route::parse(parts.uri.path()) {
        Ok(Route::Search { city, version }) => find_version(&state, RouteTemplate::Search, city, version, &parts)?,
        _ => return Err(unknown_name(&state, &parts)),
    };
    if !city.has_search() || !access.admits_computed(RouteTemplate::Search) {
        return Err(NO_INDEX);
    }
    let (searched, computed, runtime) = (city.clone(), state.computed.clone(), Handle::current());
    let work = move |_: &StopFlag| {
        let index = match runtime.block_on(computed.index(searched.serial())) {
            Some(index) => index,
            None => {
                let index = searched.search_index()?;
                runtime.block_on(computed.keep_index(searched.serial(), index.clone()));
                index
            }
        };
        Ok(ComputedBytes::new(serde_json::to_vec(&index.search(&text, limit)).unwrap_or_default()))
    };
    let found = state.work(WorkKind::Search).run(RequestClient::of(&parts), work).await.map_err(Shed::problem)?;
    let hits = found.map_err(|error| report_failure(&state, &city, &error))?;
    Ok(hits.immutable("application/json", access.is_public()).response_to(&parts))
}

/// Logs the failure. The client learns only whether a retry may help.
fn report_failure(state: &AppState, city: &Arc<CityStore>, error: &SearchFileError) -> Problem {
    if state.admits_message(MessageKind::TileFailure) {
        tracing::error!(place = city.location(), %error, "cannot search a city");
    }
    match error {
        SearchFileError::None { .. } => NO_INDEX,
        SearchFileError::Unreadable { .. } => Problem::unavailable("the search index cannot be read at the moment"),
        SearchFileError::Damaged { .. } => Problem::damaged("the server's copy of the search index is damaged"),
    }
}

/// What a query asks for. Other parameters are ignored. Fails with 400 without a `q`, and for values that are invalid or given twice.
fn search_request(query: &str) -> Result<SearchRequest, Problem> {
    let (mut text, mut limit) = (None, None);
    for (key, value) in query.split('&').map(|pair| pair.split_once('=').unwrap_or((pair, ""))) {
        match key {
            "q" if text.is_none() => text = Some(decode_text(value, MAX_QUERY_CHARS).ok_or(INVALID_TEXT)?),
            "q" => return Err(INVALID_TEXT),
            "limit" if limit.is_none() => {
                let is_plain = value.bytes().all(|byte| byte.is_ascii_digit());
                let number = value.parse().ok().filter(|number| is_plain && (1..=MAX_LIMIT).contains(number));
                limit = Some(number.ok_or(INVALID_LIMIT)?);
            }
            "limit" => return Err(INVALID_LIMIT),
            _ => {}
        }
    }
    Ok(SearchRequest { text: text.ok_or(INVALID_TEXT)?, limit: limit.unwrap_or(DEFAULT_LIMIT) })
}

/// The text of a query parameter, in which browsers write blanks as `+`. `None` if it is empty, too long or not UTF-8.
pub(super) fn decode_text(value: &str, max_chars: usize) -> Option<String> {
    // A character has at most 4 bytes, each of 3 characters.
    if value.len() > 12 * max_chars {
        return None;
    }
    let value = value.replace('+', " ");
    let text = percent_decode_str(&value).decode_utf8().ok()?;
    let is_valid = !text.trim().is_empty() && text.chars().count() <= max_chars;
    is_valid.then(|| text.into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::StatusCode;

    #[test]
    fn queries_are_decoded_and_limited() {
        let parse = |query: &str| search_request(query).ok().map(|request| (request.text, request.limit));
        let found = |text: &str, limit| Some((text.to_owned(), limit));
        assert_eq!(parse("q=kerk"), found("kerk", 10));
        assert_eq!(parse("limit=3&q=Oude+Kerk%20M%C3%BCller%2B&share=x&other"), found("Oude Kerk Müller+", 3));
        let longest = "%F0%9F%8F%A0".repeat(MAX_QUERY_CHARS);
        assert_eq!(parse(&format!("q={longest}&limit=100")), found(&"🏠".repeat(MAX_QUERY_CHARS), 100));
        let too_long = [format!("q={}", "a".repeat(MAX_QUERY_CHARS + 1)), format!("q={longest}a")];
        for invalid in
            ["", "q", "q=", "q=+%20", "q=%ff", "q=a&q=b", "Q=a"].into_iter().chain(too_long.iter().map(String::as_str))
        {
            assert_eq!(search_request(invalid).unwrap_err().respond().status(), StatusCode::BAD_REQUEST, "{invalid}");
        }
        for limit in ["", "0", "101", "-1", "+1", "1.0", "x", "1&limit=1", "99999999999999999999"] {
            assert_eq!(parse(&format!("q=a&limit={limit}")), None, "{limit}");
        }
    }
}
