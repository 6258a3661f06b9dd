//! Servers that fail: lost, damaged, slow, missing and refused responses.

use super::fixture_city::{VERSION, block_map_path, city};
use super::frames::REFERENCE;
use super::test_server::{Reply, TestServer};
use super::viewers::{
    PATIENT, SimulatedViewer, WIDTH_PX, draw_until_settled, open_session, open_session_with, settle, street,
    update_until,
};
use insula_client::session::Session;
use insula_client::stream::fetch::HttpOptions;
use insula_protocol::TileId;
use insula_test_support::rng::Rng;
use insula_viewer::frame::RenderSettings;
use insula_viewer::scene::{TileKey, TileState};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// A random number from 0 to `n - 1` that depends on the path and the number of earlier requests for it.
fn random_below(n: usize, path: &str, times: u32) -> usize {
    let hash = path.bytes().fold(u64::from(times), |hash, byte| Rng::new(hash ^ u64::from(byte)).bits());
    Rng::new(hash).below(n)
}

#[test]
fn failed_responses_are_retried_until_the_frame_is_complete() {
    let policy = |path: &str, times: u32| match (path.len() * 7 + path.bytes().last().map_or(0, usize::from)) % 5 {
        _ if !path.contains("blockmaps") => Reply::Intact,
        0 if times == 0 => Reply::Status(503),
        1 if times == 0 => Reply::Truncated,
        2 if times < 2 => Reply::Damaged,
        _ => Reply::Intact,
    };
    let mut failing = open_session(&TestServer::with_policy(city(), policy), 64);
    settle(&mut failing, &street(), |_| {});
    let mut intact = open_session(&TestServer::start(city()), 64);
    settle(&mut intact, &street(), |_| {});
    let draw = |session: &mut Session| session.draw(&street(), &RenderSettings::default()).unwrap();
    assert_eq!(draw(&mut failing).colour, draw(&mut intact).colour);
    assert!(failing.report(1.0).requests > intact.report(1.0).requests);
}

/// Of 20 responses, two break off and one is damaged.
fn lossy(path: &str, times: u32) -> Reply {
    match random_below(20, path, times) {
        _ if !path.contains(&format!("/{VERSION}/")) => Reply::Intact,
        0 | 1 => Reply::Truncated,
        2 => Reply::Damaged,
        _ => Reply::Intact,
    }
}

#[test]
fn lost_and_damaged_responses_change_no_pixel() {
    let server = TestServer::with_policy(city(), lossy);
    let mut session = open_session(&server, 64);
    assert_eq!(draw_until_settled(&mut session), *REFERENCE);
    assert_eq!(session.report(1.0).tiles.bad, 0);
    let log = server.log();
    assert!(log.values().any(|count| *count > 1), "nothing was lost");
    for (path, count) in log {
        let faults = (0..100).take_while(|times| lossy(&path, *times) != Reply::Intact).count() as u32;
        // A tile that is hidden for a while is dropped and requested again.
        assert!(count <= faults + 3, "{count} requests for {path}, which fails {faults} times");
    }
}

/// The response to the first request for the root's tile is `status`, with a delay of a second.
fn check_retry_after(status: u16) {
    let path = block_map_path(0, 0, 0);
    let policy = {
        let root = path.clone();
        move |path: &str, times: u32| {
            if path == root && times == 0 { Reply::RetryAfter(status, 1) } else { Reply::Intact }
        }
    };
    let server = TestServer::with_policy(city(), policy);
    let mut viewer = SimulatedViewer::new(&server, 64);
    let mut retry_at = None;
    viewer.update_until(&street(), |streamer| {
        let root = streamer.tree().tile(TileKey::block_map(TileId::ROOT)).map(|tile| tile.state());
        if let Some(TileState::Failed { retry_at: at, .. }) = root {
            retry_at = Some(at);
        }
        retry_at.is_some() && streamer.downloads().in_flight() == 0
    });
    assert_eq!(retry_at, Some(viewer.now() + Duration::from_secs(1)));
    // List of cities, manifest, subtree, and one attempt for the root tile.
    assert_eq!(server.requests(), 4);
    viewer.update_until(&street(), |streamer| streamer.downloads().in_flight() > 0);
    assert!(Some(viewer.now()) >= retry_at, "{status}: a request at {:?}, before {retry_at:?}", viewer.now());
    assert_eq!(viewer.draw_until_settled(), *REFERENCE);
    assert_eq!(server.log()[&path], 2);
}

#[test]
fn retry_after_is_obeyed() {
    [429, 503].into_iter().for_each(check_retry_after);
}

#[test]
fn slow_bodies_are_abandoned_and_fetched_again() {
    let is_slow = |path: &str| path.contains("blockmaps") && random_below(4, path, 0) == 0;
    let policy = move |path: &str, times: u32| if times == 0 && is_slow(path) { Reply::Trickle } else { Reply::Intact };
    let server = TestServer::with_policy(city(), policy);
    let options = HttpOptions { body: Duration::from_millis(500), ..PATIENT };
    let mut session = open_session_with(&server, 64, options);
    assert_eq!(draw_until_settled(&mut session), *REFERENCE);
    assert!(server.log().iter().any(|(path, count)| is_slow(path) && *count > 1), "no body was abandoned");
}

/// Holds the response to the request for the `held`-th tile after the root back, until all others that the frame needs are there.
fn check_slow_response(held: u32) {
    let (tiles, released) = (Arc::new(AtomicU32::new(0)), Arc::new(OnceLock::new()));
    let policy = {
        let (tiles, released) = (tiles.clone(), released.clone());
        move |path: &str, _: u32| {
            let is_tile = path.contains("/blockmaps/") && !path.contains("/groups/");
            if is_tile && tiles.fetch_add(1, Ordering::Relaxed) == held {
                released.wait();
            }
            Reply::Intact
        }
    };
    let mut viewer = SimulatedViewer::new(&TestServer::with_policy(city(), policy), 64);
    // Tiles that the one on its way may hide do not wait for it for ever.
    viewer.runs_always = true;
    viewer.draw_until(|streamer| {
        let is_only_one = streamer.selection().requests.len() == 1 && streamer.downloads().in_flight() == 1;
        // The others may have shown that it is hidden.
        (is_only_one || streamer.is_settled()) && tiles.load(Ordering::Relaxed) >= held + 3
    });
    released.set(()).unwrap();
    assert_eq!(viewer.draw_until_settled(), *REFERENCE);
}

#[test]
fn a_slow_response_does_not_block_others() {
    std::thread::scope(|scope| (1..4).for_each(|held| drop(scope.spawn(move || check_slow_response(held)))));
}

#[test]
fn the_parent_is_drawn_where_a_tile_stays_bad() {
    let (damaged, missing) = (block_map_path(3, 0, 0), block_map_path(2, 0, 1));
    let server = TestServer::with_policy(city(), move |path, _| match path {
        p if p == damaged => Reply::Damaged,
        p if p == missing => Reply::Status(404),
        _ => Reply::Intact,
    });
    let mut session = open_session(&server, 64);
    settle(&mut session, &street(), |_| {});
    let drawn: Vec<TileId> =
        session.selection().draw_tiles.iter().map(|item| session.tree().node(item.source).id).collect();
    let [grandparent, parent] = [(1, 0, 0), (2, 0, 0)].map(|(level, x, y)| TileId::new(level, x, y).unwrap());
    assert_eq!(session.report(1.0).tiles.bad, 1 + u64::from(!drawn.contains(&grandparent)));
    assert!(drawn.contains(&grandparent) || drawn.contains(&parent), "{drawn:?}");
    // Below the horizon, every ray hits.
    let pixels = session.draw(&street(), &RenderSettings::default()).unwrap();
    assert!(pixels.distance[80 * WIDTH_PX + 20..80 * WIDTH_PX + 140].iter().all(|d| d.is_finite()));
}

#[test]
fn a_tile_that_the_server_cannot_read_is_bad() {
    let unreadable = block_map_path(3, 0, 0);
    let policy = move |path: &str, _: u32| if path == unreadable { Reply::Status(500) } else { Reply::Intact };
    let mut session = open_session(&TestServer::with_policy(city(), policy), 64);
    settle(&mut session, &street(), |_| {});
    assert_eq!(session.report(1.0).tiles.bad, 1);
}

#[test]
fn drawing_continues_while_the_server_is_down_and_streaming_resumes() {
    let server = TestServer::start(city());
    let mut session = open_session(&server, 64);
    update_until(&mut session, &street(), |session| session.has_frame());
    server.set_down(true);
    let connections = server.connections();
    let mut most_in_flight = usize::MAX;
    update_until(&mut session, &street(), |session| {
        assert!(session.has_frame() && !session.is_settled());
        let downloads = session.downloads();
        if downloads.failing_since().is_some() {
            assert!(downloads.in_flight() <= most_in_flight, "several requests try at a time");
            most_in_flight = downloads.in_flight().max(1);
        } else {
            most_in_flight = usize::MAX;
        }
        session.check(Duration::from_millis(500)).is_err() && server.connections() > connections
    });
    assert!(session.downloads().failing_since().is_some());
    server.set_down(false);
    settle(&mut session, &street(), |_| {});
    assert!(session.downloads().failing_since().is_none());
}
