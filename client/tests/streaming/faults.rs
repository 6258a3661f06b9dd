//! Servers that fail: lost, damaged, slow, missing and refused responses.

use super::{
    fixture_city::{VERSION, city},
    frames::REFERENCE,
    test_server::{Reply, TestServer},
    viewers::{WIDTH_PX, draw_until_settled, open_session, open_session_with, settle, street},
};
use insula_client::{session::Session, stream::fetch::HttpOptions};
use insula_protocol::{TileId, route, tile::TileKind};
use insula_test_support::rng::Rng;
use insula_viewer::frame::RenderSettings;
use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU32, Ordering},
    },
    time::{Duration, Instant},
};

/// A random number from 0 to `n - 1` that depends on the path and the number of earlier requests for it.
fn random_below(n: usize, path: &str, times: u32) -> usize {
    let hash = path.bytes().fold(u64::from(times), |hash, byte| Rng::new(hash ^ u64::from(byte)).bits());
    Rng::new(hash).below(n)
}

fn block_map_path(level: u8, x: u32, y: u32) -> String {
    route::tile("test", VERSION, TileKind::BlockMap, TileId::new(level, x, y).unwrap())
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

#[test]
fn lost_and_damaged_responses_change_no_pixel() {
    let server = TestServer::with_policy(city(), |path, times| match random_below(20, path, times) {
        _ if !path.contains(&format!("/{VERSION}/")) => Reply::Intact,
        0 | 1 => Reply::Truncated,
        2 => Reply::Damaged,
        _ => Reply::Intact,
    });
    let mut session = open_session(&server, 64);
    assert_eq!(draw_until_settled(&mut session), REFERENCE.colours);
    assert_eq!(session.report(1.0).tiles.bad, 0);
    let (found, intact) = (server.requests(), REFERENCE.requests);
    assert!(found > intact && found < intact * 3 / 2 + 10, "{found} requests, {intact} without faults");
}

fn check_retry_after(status: u16) {
    let begin = Instant::now();
    let busy = Duration::from_millis(900);
    let server = TestServer::with_policy(city(), move |path, _| {
        let is_busy = path.contains("blockmaps") && begin.elapsed() < busy;
        if is_busy { Reply::RetryAfter(status, 1) } else { Reply::Intact }
    });
    let mut session = open_session(&server, 64);
    while begin.elapsed() < busy {
        session.update(&street());
        session.wait(Duration::from_millis(5));
    }
    // List of cities, manifest, subtree, and one attempt for the root tile.
    assert!(server.requests() <= 4, "{status}: {} requests while the server is busy", server.requests());
    assert_eq!(draw_until_settled(&mut session), REFERENCE.colours);
    assert!(server.requests() <= REFERENCE.requests + 8);
}

#[test]
fn retry_after_is_obeyed_for_429() {
    check_retry_after(429);
}

#[test]
fn retry_after_is_obeyed_for_503() {
    check_retry_after(503);
}

#[test]
fn slow_bodies_are_abandoned_and_fetched_again() {
    let server = TestServer::with_policy(city(), |path, times| {
        let is_slow = times == 0 && path.contains("blockmaps") && random_below(4, path, 0) == 0;
        if is_slow { Reply::Trickle } else { Reply::Intact }
    });
    let options = HttpOptions { body: Duration::from_millis(500), ..HttpOptions::default() };
    let mut session = open_session_with(&server, 64, options);
    assert_eq!(draw_until_settled(&mut session), REFERENCE.colours);
    let (found, intact) = (server.requests(), REFERENCE.requests);
    assert!(found > intact && found <= intact * 2, "{found} requests, {intact} without faults");
}

/// Holds request number `held` back until two more have come. Fails if the client does not send them.
fn check_slow_response(held: u32) {
    let (requests, is_blocked) = (AtomicU32::new(0), Arc::new(AtomicBool::new(false)));
    let blocked = is_blocked.clone();
    let server = TestServer::with_policy(city(), move |_, _| {
        if requests.fetch_add(1, Ordering::Relaxed) == held {
            let begin = Instant::now();
            while requests.load(Ordering::Relaxed) < held + 3 && !blocked.load(Ordering::Relaxed) {
                blocked.store(begin.elapsed() > Duration::from_secs(4), Ordering::Relaxed);
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        Reply::Intact
    });
    assert_eq!(draw_until_settled(&mut open_session(&server, 64)), REFERENCE.colours);
    assert!(!is_blocked.load(Ordering::Relaxed), "request {held} of {} blocks others", REFERENCE.requests);
}

#[test]
fn a_slow_response_does_not_block_others() {
    // After the list, the manifest, the subtree and the root tile, which everything else needs.
    let held = 4..REFERENCE.requests - 3;
    assert!(held.len() >= 3, "{} requests are too few for this test", REFERENCE.requests);
    std::thread::scope(|scope| held.for_each(|held| drop(scope.spawn(move || check_slow_response(held)))));
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
    let server = TestServer::with_policy(city(), |_, _| {
        std::thread::sleep(Duration::from_millis(30));
        Reply::Intact
    });
    let mut session = open_session(&server, 64);
    while !session.has_frame() {
        session.update(&street());
        session.wait(Duration::from_millis(5));
    }
    server.set_down(true);
    let connections = server.connections();
    let timeout = Duration::from_millis(500);
    while session.check(timeout).is_ok() {
        session.update(&street());
        assert!(session.has_frame() && !session.is_settled());
        session.wait(Duration::from_millis(5));
    }
    assert!(session.downloads().failing_since().is_some() && session.check(Duration::from_secs(60)).is_ok());
    let attempts = server.connections() - connections;
    assert!((1..=12 * 4).contains(&attempts), "{attempts} connections to a server that is down");
    server.set_down(false);
    settle(&mut session, &street(), |_| {});
    assert!(session.downloads().failing_since().is_none());
}
