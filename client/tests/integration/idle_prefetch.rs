//! The idle prefetch: while the view rests, the tiles that a turn would show are fetched.

use super::fixture_city::{block_map_path, city};
use super::test_server::{Reply, TestServer};
use super::viewers::{TIMEOUT, open_session, request};
use insula_client::commands::headless::settle;
use insula_client::session::{PrefetchStep, Session};
use insula_viewer::frame::RenderSettings;
use insula_viewer::streamer::FrameRequest;
use std::time::{Duration, Instant};

/// A view over the roofs to the north.
fn north() -> FrameRequest {
    request([231.0, 250.0, 26.0], [231.0, 500.0, 10.0])
}

fn prefetch_all(session: &mut Session, request: &FrameRequest) {
    let begin = Instant::now();
    settle(session, request, TIMEOUT).unwrap();
    while session.prefetch(request).unwrap() != PrefetchStep::Done {
        assert!(begin.elapsed() < TIMEOUT, "the prefetch does not end");
        session.wait(Duration::from_millis(5));
        settle(session, request, TIMEOUT).unwrap();
    }
}

fn colours(session: &mut Session, request: &FrameRequest) -> Vec<u32> {
    let data = session.frame_data(request, &RenderSettings::default());
    session.adapter_mut().draw(&data).unwrap().colour
}

/// The number of pixels that differ between the first frame of a view and its settled frame.
fn pixels_that_change(session: &mut Session, request: &FrameRequest) -> usize {
    session.update(request);
    let first = colours(session, request);
    settle(session, request, TIMEOUT).unwrap();
    first.iter().zip(colours(session, request)).filter(|(a, b)| **a != *b).count()
}

fn check_turn(degrees: f64) {
    let [server, other] = [(), ()].map(|()| TestServer::start(city()));
    let (mut prefetched, mut plain) = (open_session(&server, 64), open_session(&other, 64));
    settle(&mut plain, &north(), TIMEOUT).unwrap();
    settle(&mut prefetched, &north(), TIMEOUT).unwrap();
    let (requests, of_frame) = (other.requests(), server.requests());
    prefetch_all(&mut prefetched, &north());
    assert!(colours(&mut prefetched, &north()) == colours(&mut plain, &north()), "the prefetch changed the frame");
    let (all, log) = (server.requests(), server.log());
    assert!(all > of_frame, "{of_frame} requests for the frame, {all} with the prefetch");
    // Only two turns are prefetched: what lies behind is not.
    for (x, y) in (0..8).flat_map(|x| (0..3).map(move |y| (x, y))) {
        assert!(!log.contains_key(&block_map_path(3, x, y)), "leaf {x} {y} was fetched");
    }

    let turned = FrameRequest { camera: north().camera.turned(degrees), ..north() };
    let changed = pixels_that_change(&mut prefetched, &turned);
    assert!(server.requests() <= all + 1, "{} more requests at {degrees} degrees", server.requests() - all);
    let changed_without = pixels_that_change(&mut plain, &turned);
    assert!(other.requests() > requests + 1);
    assert!(changed * 4 < changed_without, "{degrees} degrees: {changed} pixels, {changed_without} without prefetch");
}

#[test]
fn a_turn_to_the_left_needs_no_further_tiles() {
    check_turn(30.0);
    check_turn(17.0);
}

#[test]
fn a_turn_to_the_right_needs_no_further_tiles() {
    check_turn(-30.0);
}

#[test]
fn the_prefetch_ends_although_responses_fail() {
    let fails_once = |_: &str, times: u32| if times == 0 { Reply::Truncated } else { Reply::Intact };
    prefetch_all(&mut open_session(&TestServer::with_policy(city(), fails_once), 64), &north());
    let half_missing = |path: &str, _: u32| {
        let is_missing = path.contains("blockmaps/3") && path.ends_with(['1', '3', '5', '7']);
        if is_missing { Reply::Status(404) } else { Reply::Intact }
    };
    prefetch_all(&mut open_session(&TestServer::with_policy(city(), half_missing), 64), &north());
}

#[test]
fn the_prefetch_evicts_nothing_from_a_full_cache() {
    let mut small = open_session(&TestServer::start(city()), 2);
    settle(&mut small, &north(), TIMEOUT).unwrap();
    let (evicted, frame) = (small.evicted(), colours(&mut small, &north()));
    prefetch_all(&mut small, &north());
    assert!(small.cache().used_bytes() <= 2 << 20 && small.evicted() == evicted);
    assert!(colours(&mut small, &north()) == frame);
}

#[test]
fn a_new_view_interrupts_the_prefetch() {
    let server = TestServer::start(city());
    let mut interrupted = open_session(&server, 64);
    settle(&mut interrupted, &north(), TIMEOUT).unwrap();
    assert_eq!(interrupted.prefetch(&north()).unwrap(), PrefetchStep::Drawn);
    let elsewhere = request([111.0, 90.0, 6.0], [500.0, 90.0, 6.0]);
    settle(&mut interrupted, &elsewhere, TIMEOUT).unwrap();
    let mut fresh = open_session(&server, 64);
    settle(&mut fresh, &elsewhere, TIMEOUT).unwrap();
    assert!(colours(&mut interrupted, &elsewhere) == colours(&mut fresh, &elsewhere));
}
