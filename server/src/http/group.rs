//! Groups of tiles ([`tile_group`]), which are immutable under their city's version, as tiles are.

use super::computed_cache::ComputedBytes;
use super::fair_queue::Shed;
use super::problem::{NO_ROUTE, Problem};
use super::state::AppState;
use super::thread_state::ThreadState;
use super::tile::{RequestedTile, find_version, unknown_name};
use super::tile_cache::TileCache;
use super::turns::end_turn;
use super::work_queues::{RequestClient, WorkKind};
use axum::body::Body;
use axum::extract::State;
use axum::http::{Request, StatusCode};
use axum::response::Response;
use bytes::Bytes;
use futures_util::future::try_join_all;
use insula_protocol::route::{Route, RouteError, RouteTemplate};
use insula_protocol::tile_group::{self, GroupMember};
use std::sync::Arc;

/// Tiles that are read before other clients have a turn on the thread.
const TILES_OF_TURN: usize = 4;

const NO_GROUP: Problem = Problem::not_found("this city has none of these tiles");
const INVALID_GROUP: Problem = Problem::bad_request(
    "a group has 2 to 64 subtrees, blockmaps or meshes, a power of two; x and y are multiples of its sides; lod is 0, of meshes at most 5",
);

/// `/v1/cities/{city}/{version}/groups/{kind}/{level}/{x}/{y}/{count}/{lod}`. Fails with 400 for invalid numbers, 401 without a required
/// token, 404 for an unknown city or version, or if none of the tiles exists, 500 if a directory is damaged, and 503 if they cannot be
/// read. Damaged tiles are left out: the response to a request for such a tile says what is wrong.
pub(super) async fn group(
    State(ThreadState { app, tiles }): State<ThreadState>,
    request: Request<Body>,
) -> Result<Response, Problem> {
    let (parts, _) = request.into_parts();
    let (city, version, group) = match Route::parse(parts.uri.path()) {
        Ok(Route::Group { city, version, group }) => (city, version, group),
        Err(RouteError::InvalidTile) => return Err(INVALID_GROUP),
        Err(RouteError::InvalidName) => return Err(unknown_name(&app, &parts)),
        _ => return Err(NO_ROUTE),
    };
    let (city, access) = find_version(&app, RouteTemplate::Groups, city, version, &parts)?;
    let of_node = |node| RequestedTile::of_city(Arc::clone(&city), access, group.kind(), node, group.lod());
    let requested: Vec<Option<RequestedTile>> = group.nodes().map(of_node).collect();
    let (reader, client) = (app.clone(), RequestClient::of(&parts));
    let work = async move { encode(requested, &reader, &tiles).await.map(ComputedBytes::new) };
    let made = app.work(WorkKind::Groups).wait_for(client, work).await.map_err(Shed::problem)??;
    Ok(made.immutable("application/octet-stream", access.is_public()).response_to(&parts))
}

/// The bytes of a group. Fails as [`group`].
async fn encode(requested: Vec<Option<RequestedTile>>, app: &AppState, tiles: &TileCache) -> Result<Bytes, Problem> {
    let length = async |tile: &Option<RequestedTile>| match tile {
        Some(tile) => tile.length(app).await,
        None => Ok(None),
    };
    let fitting = tile_group::fit(try_join_all(requested.iter().map(length)).await?);
    if fitting.iter().all(|member| *member == GroupMember::Absent) {
        return Err(NO_GROUP);
    }
    let members = requested.into_iter().zip(fitting).enumerate().map(async |(number, (tile, fitting))| {
        // Not one after the other, because tiles of a remote city are fetched together.
        for _ in 0..number / TILES_OF_TURN {
            end_turn().await;
        }
        member(tile, fitting, app, tiles).await
    });
    let members = try_join_all(members);
    let encoded = tile_group::encode(&members.await?);
    Ok(Bytes::from(encoded.map_err(|_| Problem::unavailable("these tiles cannot be read at the moment"))?))
}

/// Reads a tile that fits. Fails with 503 if it cannot be read.
async fn member(
    tile: Option<RequestedTile>,
    fitting: GroupMember<()>,
    state: &AppState,
    tiles: &TileCache,
) -> Result<GroupMember<Bytes>, Problem> {
    let tile = match (tile, fitting) {
        (Some(tile), GroupMember::Tile(())) => tile,
        (Some(_), GroupMember::LeftOut) => return Ok(GroupMember::LeftOut),
        _ => return Ok(GroupMember::Absent),
    };
    match tile.bytes(state, tiles).await {
        Ok(bytes) => Ok(GroupMember::Tile(bytes)),
        Err(problem) if problem.status == StatusCode::INTERNAL_SERVER_ERROR => Ok(GroupMember::LeftOut),
        Err(problem) => Err(problem),
    }
}
