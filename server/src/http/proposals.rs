//! The proposals of a city for its page: what they add to it and remove from it.

use super::computed_cache::ComputedKey;
use super::fair_queue::{Shed, StopFlag};
use super::posted::{requested_city, unreadable, with_source};
use super::problem::Problem;
use super::representation::{REVALIDATE_PRIVATE, Representation};
use super::state::AppState;
use super::work_queues::{RequestClient, WorkKind};
use crate::proposal::document;
use axum::extract::State;
use axum::http::request::Parts;
use axum::response::Response;
use insula_export::source::SourceError;
use std::sync::Arc;
use tokio::runtime::Handle;

/// `GET /v1/cities/{city}/proposals.json`: an empty list if the setting `site.proposals` names none of the city. Proposals that cannot be
/// used are logged and left out. Fails with 401 without a required token, 404 for an unknown city and with a share link for a part of the
/// city or read-only; 500 if the city is damaged, 503 if too many requests wait.
pub(super) async fn proposals(State(state): State<AppState>, parts: Parts) -> Result<Response, Problem> {
    let city = requested_city(&state, &parts)?;
    let (read, runtime) = (Arc::clone(&city), Handle::current());
    let folder = state.brand.proposals_of(&city.manifest().name).map(ToOwned::to_owned);
    let work = move |stop: &StopFlag| {
        let (json, faults) = with_source(&read, (&runtime, stop), |source| document(folder.as_deref(), source))?;
        faults.iter().for_each(|fault| tracing::warn!(fault, "a proposal is left out"));
        Ok::<_, SourceError>(json.into_bytes())
    };
    let key = ComputedKey::Proposals(city.serial());
    let made = state.computed.find_or_make(key, state.work(WorkKind::Filter), RequestClient::of(&parts), work).await;
    let made = made.map_err(Shed::problem)?.map_err(|error| unreadable(&state, &city, &error))?;
    let representation =
        Representation { cache_control: REVALIDATE_PRIVATE, ..made.immutable("application/json", false) };
    Ok(representation.response_to(&parts))
}
