//! Looks around a picture that rests: what a turn shows is here before it.

#![allow(clippy::unwrap_used)]

mod common;

use common::{Answer, Server, city, serve, session, shot, well};
use insula_client::{
    commands::snapshot::settle,
    session::{PrefetchStep, Session},
};
use insula_viewer::{frame::RenderSettings, streamer::FrameRequest};
use std::{
    sync::atomic::Ordering,
    time::{Duration, Instant},
};

const MOST: Duration = Duration::from_secs(60);

/// Over the roofs, to the north.
fn ahead() -> FrameRequest {
    shot([231.0, 250.0, 26.0], [231.0, 500.0, 10.0])
}

fn turned(shot: &FrameRequest, degrees: f64) -> FrameRequest {
    FrameRequest { camera: shot.camera.turned(degrees), ..*shot }
}

fn look_around(session: &mut Session, shot: &FrameRequest) {
    let begin = Instant::now();
    settle(session, shot, MOST).unwrap();
    while session.prefetch(shot).unwrap() != PrefetchStep::Done {
        assert!(begin.elapsed() < MOST, "it does not end");
        session.wait(Duration::from_millis(5));
        settle(session, shot, MOST).unwrap();
    }
}

fn colours(session: &mut Session, shot: &FrameRequest) -> Vec<u32> {
    let data = session.frame_data(shot, &RenderSettings::default());
    session.adapter_mut().draw(&data).unwrap().colour
}

fn requests(server: &Server) -> u32 {
    server.requests.load(Ordering::Relaxed)
}

#[test]
fn a_turn_to_either_side_shows_all_at_once_and_fetches_nothing() {
    for degrees in [30.0, 17.0, -30.0] {
        let [server, other] = [(), ()].map(|()| serve(city("test"), well()));
        let (mut looks, mut does_not) = (session(&server, 64), session(&other, 64));
        settle(&mut does_not, &ahead(), MOST).unwrap();
        let before = requests(&other);
        look_around(&mut looks, &ahead());
        let picture = colours(&mut looks, &ahead());
        assert!(picture == colours(&mut does_not, &ahead()), "the picture itself is the same");
        // To the other side, and of what stands behind something, nothing: most of the city is not fetched.
        let after = requests(&server);
        assert!(after > before && after < before * 3, "{before} requests for the picture, {after} in all");

        let beside = turned(&ahead(), degrees);
        looks.update(&beside);
        let at_once = colours(&mut looks, &beside);
        settle(&mut looks, &beside, MOST).unwrap();
        assert!(requests(&server) <= after + 1, "{} more requests at {degrees} degrees", requests(&server) - after);
        let differ = |a: &[u32], b: &[u32]| a.iter().zip(b).filter(|(a, b)| a != b).count();
        let wrong = differ(&at_once, &colours(&mut looks, &beside));
        // Who did not look around sees it come.
        does_not.update(&beside);
        let at_first = colours(&mut does_not, &beside);
        settle(&mut does_not, &beside, MOST).unwrap();
        assert!(requests(&other) > before + 1);
        let would_be_wrong = differ(&at_first, &colours(&mut does_not, &beside));
        assert!(wrong * 4 < would_be_wrong, "{degrees} degrees: {wrong} pixels, else {would_be_wrong}");
    }
}

#[test]
fn it_ends_whatever_the_server_does_and_leaves_a_full_cache_alone() {
    let ill = |_: &str, times: u32| if times == 0 { Answer::Cut } else { Answer::Well };
    look_around(&mut session(&serve(city("test"), Box::new(ill)), 64), &ahead());
    // Half of it never comes.
    let missing = |path: &str, _: u32| match path.contains("blockmaps/3") && path.ends_with(['1', '3', '5', '7']) {
        true => Answer::Status(404),
        false => Answer::Well,
    };
    look_around(&mut session(&serve(city("test"), Box::new(missing)), 64), &ahead());
    let server = serve(city("test"), well());
    let mut small = session(&server, 2);
    settle(&mut small, &ahead(), MOST).unwrap();
    let (evicted, picture) = (small.evicted(), colours(&mut small, &ahead()));
    look_around(&mut small, &ahead());
    assert!(small.cache().used_bytes() <= 2 << 20 && small.evicted() == evicted);
    assert!(colours(&mut small, &ahead()) == picture);
    // On to another place in the middle of it: that comes first, as if nothing had been.
    let mut hasty = session(&server, 64);
    settle(&mut hasty, &ahead(), MOST).unwrap();
    assert_eq!(hasty.prefetch(&ahead()).unwrap(), PrefetchStep::Drawn);
    let elsewhere = shot([111.0, 90.0, 6.0], [500.0, 90.0, 6.0]);
    settle(&mut hasty, &elsewhere, MOST).unwrap();
    let mut fresh = session(&server, 64);
    settle(&mut fresh, &elsewhere, MOST).unwrap();
    assert!(colours(&mut hasty, &elsewhere) == colours(&mut fresh, &elsewhere));
}
