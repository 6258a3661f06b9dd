//! Vector drawings of a city (`insula_draw`), made of the options in the body of a request. Off by default.
//!
//! The only route that reads a body, and the only one that takes seconds: so the body is small and must arrive soon, few drawings are
//! made at once on threads of their own, few requests wait, and a drawing that nobody waits for ends. The part of the city that was read
//! and sorted is kept, so that another view of it takes less.

use super::{
    access_control::{AccessRequest, Credentials},
    computed_cache::ComputedKey,
    fair_queue::StopFlag,
    problem::{NO_ROUTE, Problem},
    response::DRAWING_METHODS,
    state::{AppState, MessageKind},
    tile::unknown_name,
    work_queues::{RequestClient, WorkKind},
};
use crate::store::{CityStore, StoredCity};
use axum::{
    body::{Body, to_bytes},
    extract::State,
    http::{HeaderMap, HeaderName, HeaderValue, StatusCode, Uri, header},
    response::Response,
};
use bytes::Bytes;
use insula_archive::ReadError;
use insula_bake::read::EarthPlace;
use insula_draw::{
    DrawError, DrawLimits, DrawnPart, draw_part,
    error::DrawStep,
    file::{DrawingFormat, encode},
    options::DrawingOptions,
};
use insula_protocol::route::{Route, RouteError, RouteTemplate};
use std::{sync::Arc, time::Duration};
use tokio::{runtime::Handle, time::timeout};

/// Largest body.
const MAX_BODY_BYTES: usize = 64 << 10;
/// Time within which the body must arrive.
const BODY_TIME: Duration = Duration::from_secs(10);
/// Largest drawing.
const MAX_DRAWING_BYTES: usize = 64 << 20;

const NO_CITY: Problem = Problem::not_found("there is no such city");
const NOT_JSON: Problem =
    Problem::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "the options must be JSON: content-type: application/json");
const TOO_LARGE: Problem =
    Problem::bad_request("the drawing would be too large: choose a smaller bbox, a filter, or a smaller scale");
const EMPTY: Problem = Problem::bad_request(
    "nothing to draw: no surface of the selection is in the view: choose another bbox, filter or view",
);

/// `POST /v1/cities/{city}/draw`. Fails with 400 for invalid options and for drawings that are too large, 401 without a required token,
/// 404 for an unknown city, with a share link for a part of the city, and if no drawings are made; 408, 413 and 415 for a body that is
/// slow, too large or not JSON; 500 if the city is damaged, 503 if too many requests wait or there is no time.
pub(super) async fn draw(
    State(state): State<AppState>,
    RequestClient(client): RequestClient,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Problem> {
    let drawings = *state.drawings().ok_or(NO_ROUTE)?;
    let city = requested(&state, &uri, &headers)?;
    if !is_json(&headers) {
        return Err(NOT_JSON);
    }
    let options = DrawingOptions::parse(&read(body).await?).map_err(|error| Problem::explained(&error.to_string()))?;
    let format = options.format;
    let (shared, drawn, runtime) = (state.clone(), Arc::clone(&city), Handle::current());
    let limits = DrawLimits::of_triangles(drawings.max_triangles);
    let work = move |stop: &StopFlag| {
        let make = || make_now(&shared, &drawn, &options, limits, (&runtime, stop));
        match drawings.pool() {
            Some(threads) => threads.install(make),
            // On the process's own.
            None => make(),
        }
    };
    let made = state.work(WorkKind::Draw).run(client, work).await.map_err(|_| no_time())?;
    let drawing = made.map_err(|error| problem(&state, &city, &error))?;
    let mut response = Response::new(Body::from(drawing));
    let (content_type, policy) = match format {
        DrawingFormat::Svg => ("image/svg+xml", "default-src 'none'; style-src 'unsafe-inline'; sandbox"),
        DrawingFormat::Pdf => ("application/pdf", "default-src 'none'"),
        DrawingFormat::Dxf => ("image/vnd.dxf", "default-src 'none'; sandbox"),
    };
    let all: [(HeaderName, &'static str); 4] = [
        (header::CONTENT_TYPE, content_type),
        (header::CONTENT_SECURITY_POLICY, policy),
        (header::CACHE_CONTROL, "no-store"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    ];
    response.headers_mut().extend(all.map(|(name, value)| (name, HeaderValue::from_static(value))));
    Ok(response)
}

/// The response to other methods.
pub(super) async fn other_method(State(state): State<AppState>) -> Problem {
    if !state.is_drawing() {
        return NO_ROUTE;
    }
    Problem::new(StatusCode::METHOD_NOT_ALLOWED, "drawings are made of the options in the body of a POST request")
        .with(header::ALLOW, DRAWING_METHODS)
}

fn no_time() -> Problem {
    Problem::unavailable("too many drawings at once, or too much to draw: retry later, or choose a smaller bbox")
}

/// The city of the address, if the request may have drawings of all of it.
fn requested(state: &AppState, uri: &Uri, headers: &HeaderMap) -> Result<Arc<CityStore>, Problem> {
    let name = match Route::parse(uri.path()) {
        Ok(Route::Draw { city }) => city,
        Err(RouteError::InvalidName) => return Err(unknown_name(state, uri, headers)),
        _ => return Err(NO_ROUTE),
    };
    let catalog = state.catalog();
    let city = catalog.store().city(name);
    let version = city.map(|city| city.manifest().version.as_str());
    let request = AccessRequest { route: RouteTemplate::Draw, city: name, version };
    let access = catalog.access().authorize(Credentials::new(headers, uri), request)?;
    let city = city.ok_or(NO_CITY)?;
    if !access.admits_computed(RouteTemplate::Draw) {
        return Err(NO_CITY);
    }
    Ok(Arc::clone(city))
}

/// Pages of other origins cannot send this type without asking, so they cannot make a browser's user draw.
fn is_json(headers: &HeaderMap) -> bool {
    let text = headers.get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok()).unwrap_or_default();
    text.split(';').next().is_some_and(|kind| kind.trim().eq_ignore_ascii_case("application/json"))
}

async fn read(body: Body) -> Result<Bytes, Problem> {
    const TOO_LONG: Problem =
        Problem::new(StatusCode::PAYLOAD_TOO_LARGE, "the options are longer than 64 KiB, or the body ended early");
    const TOO_SLOW: Problem = Problem::new(StatusCode::REQUEST_TIMEOUT, "the options did not arrive within 10 seconds");
    let read = timeout(BODY_TIME, to_bytes(body, MAX_BODY_BYTES)).await.map_err(|_| TOO_SLOW)?;
    read.map_err(|_| TOO_LONG)
}

/// Reads the part of the city, unless an earlier drawing did, and draws it. Waits for the network if the city is in an object store.
fn make_now(
    state: &AppState,
    city: &CityStore,
    options: &DrawingOptions,
    limits: DrawLimits,
    (runtime, stop): (&Handle, &StopFlag),
) -> Result<Vec<u8>, DrawError> {
    let read = |kind, id| {
        if stop.is_stopped() {
            return Err(ReadError::Failed("nobody waits for the drawing".to_owned()));
        }
        runtime.block_on(city.checked_tile(kind, id))
    };
    let schema = StoredCity::read_schema(&read).map_err(DrawError::Source)?;
    let source = StoredCity::new(city.manifest(), &schema, &read);
    let on_map = |degrees| EarthPlace::of(city.manifest().crs.as_deref()?)?.box_on_map(degrees);
    let mut request = options.request(&source, limits)?;
    let progress = |_: DrawStep, _: f64| !stop.is_stopped();
    let key = ComputedKey::Part(city.serial(), options.part_name().into());
    let kept = runtime.block_on(state.computed().part(&key));
    let is_kept = kept.is_some();
    let part = match kept {
        Some(part) => part,
        None => {
            request.selection = options.selection(&source, &on_map)?;
            Arc::new(DrawnPart::read(&source, &request, &progress)?)
        }
    };
    state.metrics().drawing_part(is_kept);
    let drawing = draw_part(&source, &part, &request, &progress);
    runtime.block_on(state.computed().keep_part(key, part));
    let bytes = encode(&drawing?, options.format);
    if bytes.len() > MAX_DRAWING_BYTES {
        return Err(DrawError::TooManyParts { limit: limits.parts });
    }
    Ok(bytes)
}

/// Logs failures of the city's files.
fn problem(state: &AppState, city: &CityStore, error: &DrawError) -> Problem {
    match error {
        DrawError::Invalid(text) => Problem::explained(text),
        DrawError::TooManyTriangles { .. } | DrawError::TooManyParts { .. } => TOO_LARGE,
        DrawError::Empty => EMPTY,
        DrawError::Cancelled => no_time(),
        DrawError::Source(_) | DrawError::City(_) | DrawError::Write { .. } => {
            if state.admits_message(MessageKind::TileFailure) {
                tracing::error!(place = city.location(), reason = %error, "cannot draw a city");
            }
            Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "the server cannot read this city")
                .with(header::RETRY_AFTER, HeaderValue::from_static("60"))
        }
    }
}
