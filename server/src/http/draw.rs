//! Vector drawings of a city (`insula_draw`), made of the options in the body of a request. Off by default.
//!
//! The part of the city that was read and sorted is kept, so that another view of it takes less.

use super::computed_cache::ComputedKey;
use super::fair_queue::StopFlag;
use super::posted::{json_body, requested_city, response_with, unreadable, with_source};
use super::problem::Problem;
use super::state::AppState;
use super::work_queues::{RequestClient, WorkKind};
use super::work_threads::WorkThreads;
use crate::store::CityStore;
use axum::body::Body;
use axum::extract::State;
use axum::http::header;
use axum::http::request::Parts;
use axum::response::Response;
use insula_analysis::eye::lifted_camera;
use insula_bake::read::EarthPlace;
use insula_draw::error::DrawStep;
use insula_draw::file::{DrawingFormat, encode};
use insula_draw::options::DrawingOptions;
use insula_draw::view::DrawView;
use insula_draw::{DrawError, DrawLimits, DrawnPart, draw_part};
use insula_export::source::{ExportSource, SourceError};
use std::sync::Arc;
use tokio::runtime::Handle;

const MAX_DRAWING_BYTES: usize = 64 << 20;

const TOO_LARGE: Problem =
    Problem::bad_request("the drawing would be too large: choose a smaller bbox, a filter, or a smaller scale");
const EMPTY: Problem = Problem::bad_request(
    "nothing to draw: no surface of the selection is in the view: choose another bbox, filter or view",
);

/// `POST /v1/cities/{city}/draw`. Fails with 400 for invalid options and for drawings that are too large, 401 without a required token,
/// 404 for an unknown city, with a share link for a part of the city, and if no drawings are made; 408, 413 and 415 for a body that is
/// slow, too large or not JSON; 500 if the city is damaged, 503 if too many requests wait or there is no time.
pub(super) async fn draw(State(state): State<AppState>, parts: Parts, body: Body) -> Result<Response, Problem> {
    let city = requested_city(&state, &parts)?;
    let body = json_body(&parts.headers, body).await?;
    let options = DrawingOptions::parse(&body).map_err(|error| Problem::explained(&error.to_string()))?;
    let format = options.format;
    let (shared, drawn, runtime) = (state.clone(), Arc::clone(&city), Handle::current());
    let limits = DrawLimits::of_triangles(state.drawings.triangles);
    let threads = WorkThreads::new(state.drawings.at_once, "draw");
    let work = move |stop: &StopFlag| {
        threads.install(|| {
            let reader = (&runtime, stop);
            with_source(&drawn, reader, |source| make_now(&shared, &drawn, source, &options, limits, reader))
                .map_err(DrawError::Source)?
        })
    };
    let made = state.work(WorkKind::Draw).run(RequestClient::of(&parts), work).await.map_err(|_| no_time())?;
    let drawing = made.map_err(|error| problem(&state, &city, &error))?;
    let (content_type, policy) = match format {
        DrawingFormat::Svg => ("image/svg+xml", "default-src 'none'; style-src 'unsafe-inline'; sandbox"),
        DrawingFormat::Pdf => ("application/pdf", "default-src 'none'"),
        DrawingFormat::Dxf => ("image/vnd.dxf", "default-src 'none'; sandbox"),
    };
    Ok(response_with(drawing, &[(header::CONTENT_TYPE, content_type), (header::CONTENT_SECURITY_POLICY, policy)]))
}

fn no_time() -> Problem {
    Problem::unavailable("too many drawings at once, or too much to draw: retry later, or choose a smaller bbox")
}

/// Reads the part of the city, unless an earlier drawing did, and draws it.
fn make_now(
    state: &AppState,
    city: &CityStore,
    source: &dyn ExportSource,
    options: &DrawingOptions,
    limits: DrawLimits,
    (runtime, stop): (&Handle, &StopFlag),
) -> Result<Vec<u8>, DrawError> {
    let on_map = |degrees| EarthPlace::of(city.manifest().crs.as_deref()?)?.box_on_map(degrees);
    let mut request = options.request(source, limits)?;
    if !options.keep_camera {
        request.view = lifted(source, request.view).map_err(DrawError::Source)?;
    }
    let progress = |_: DrawStep, _: f64| !stop.is_stopped();
    let key = ComputedKey::Part(city.serial(), options.part_name().into());
    let kept = runtime.block_on(state.computed.part(&key));
    let is_kept = kept.is_some();
    let part = match kept {
        Some(part) => part,
        None => {
            request.selection = options.selection(source, &on_map)?;
            Arc::new(DrawnPart::read(source, &request, &progress)?)
        }
    };
    state.metrics.drawing_part(is_kept);
    let drawing = draw_part(source, &part, &request, &progress);
    runtime.block_on(state.computed.keep_part(key, part));
    let bytes = encode(&drawing?, options.format);
    if bytes.len() > MAX_DRAWING_BYTES {
        return Err(DrawError::TooManyParts { limit: limits.parts });
    }
    Ok(bytes)
}

/// The view, whose eye is lifted out of buildings and the ground. Fails if tiles cannot be read.
fn lifted(source: &dyn ExportSource, view: DrawView) -> Result<DrawView, SourceError> {
    let DrawView::Perspective(camera) = view else { return Ok(view) };
    Ok(lifted_camera(source, camera)?.map_or(view, DrawView::Perspective))
}

/// Logs failures of the city's files.
fn problem(state: &AppState, city: &CityStore, error: &DrawError) -> Problem {
    match error {
        DrawError::Invalid(text) => Problem::explained(text),
        DrawError::TooManyTriangles { .. } | DrawError::TooManyParts { .. } => TOO_LARGE,
        DrawError::Empty => EMPTY,
        DrawError::Cancelled => no_time(),
        DrawError::Source(_) | DrawError::City(_) | DrawError::Write { .. } => unreadable(state, city, error),
    }
}
