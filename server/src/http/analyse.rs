//! Analyses of a part of a city (`insula_analysis`), as the body of a request asks for them. Off by default.

use super::fair_queue::StopFlag;
use super::posted::{json_body, requested_city, response_with, unreadable, with_source};
use super::problem::Problem;
use super::state::AppState;
use super::work_queues::{RequestClient, WorkKind};
use super::work_threads::WorkThreads;
use crate::analysis::error::RequestError;
use crate::analysis::request::{AnalysisRequest, AnswerFormat, AnswerLimits};
use crate::store::CityStore;
use axum::body::Body;
use axum::extract::State;
use axum::http::header;
use axum::http::request::Parts;
use axum::response::Response;
use insula_draw::DrawLimits;
use insula_export::table::ExportError;
use std::sync::Arc;
use tokio::runtime::Handle;

/// Type of the problem of an area of more cells than the server reads at once. The page has words for it.
const TOO_LARGE: &str = "#area-too-large";
/// The same of an area without a part of the city.
const OUTSIDE: &str = "#area-outside";

/// `POST /v1/cities/{city}/analyse`. Fails with 400 for options that are invalid and for areas that are too large, 401 without a required
/// token, 404 for an unknown city, with a share link for a part of the city, and if no analyses are made; 408, 413 and 415 for a body that is
/// slow, too large or not JSON; 500 if the city is damaged, 503 if too many requests wait or there is no time.
pub(super) async fn analyse(State(state): State<AppState>, parts: Parts, body: Body) -> Result<Response, Problem> {
    let city = requested_city(&state, &parts)?;
    let body = json_body(&parts.headers, body).await?;
    let asked = AnalysisRequest::parse(&body).map_err(|error| Problem::explained(&error.to_string()))?;
    let (read, runtime) = (Arc::clone(&city), Handle::current());
    let format = asked.format();
    let drawing = DrawLimits::of_triangles(state.drawings.triangles);
    let limits = AnswerLimits { cells: state.analyses.cells, drawing };
    let threads = WorkThreads::new(state.analyses.at_once, "analyse");
    let work = move |stop: &StopFlag| {
        threads.install(|| {
            let goes_on = |_: f64| !stop.is_stopped();
            with_source(&read, (&runtime, stop), |source| asked.answer(source, limits, &goes_on))
                .map_err(|error| RequestError::Source(ExportError::Source(error)))?
        })
    };
    let made = state.work(WorkKind::Analyse).run(RequestClient::of(&parts), work).await.map_err(|_| no_time())?;
    let answer = made.map_err(|error| problem(&state, &city, &error))?;
    let content_type = match format {
        AnswerFormat::GeoJson => "application/json",
        AnswerFormat::Pdf => "application/pdf",
        AnswerFormat::Png => "image/png",
    };
    Ok(response_with(
        answer,
        &[(header::CONTENT_TYPE, content_type), (header::CONTENT_SECURITY_POLICY, "default-src 'none'")],
    ))
}

fn no_time() -> Problem {
    Problem::unavailable("too many analyses at once, or too much to compute: retry later, or choose a smaller area")
}

fn problem(state: &AppState, city: &CityStore, error: &RequestError) -> Problem {
    match error {
        RequestError::Invalid(reason) => Problem::explained(reason),
        RequestError::Outside(reason) => Problem::explained(reason).of_type(OUTSIDE),
        RequestError::TooLarge => Problem::explained(&error.to_string()).of_type(TOO_LARGE),
        RequestError::Stopped => no_time(),
        RequestError::Source(reason) => unreadable(state, city, reason),
    }
}
