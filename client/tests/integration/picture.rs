//! Pictures: streamed to their end, and drawn in strips.

use super::{
    fixture_city::city,
    test_server::TestServer,
    viewers::{TIMEOUT, open_session, request},
};
use insula_client::picture::{Settling, draw_in_strips, settle};
use insula_viewer::{frame::RenderSettings, streamer::FrameRequest};

/// A picture that has several strips, of which the last is incomplete.
fn large() -> FrameRequest {
    FrameRequest { size_px: [512, 393], ..request([231.0, 250.0, 26.0], [231.0, 500.0, 10.0]) }
}

const SETTLING: Settling = Settling { feedback_px: [256, 196], timeout: TIMEOUT };

#[test]
fn strips_are_the_picture_and_can_be_cancelled() {
    let server = TestServer::start(city());
    let mut session = open_session(&server, 64);
    settle(&mut session, &large(), SETTLING, |_| true).unwrap();
    let settings = RenderSettings::default();
    let whole = session.draw(&large(), &settings).unwrap();
    let mut shares = Vec::new();
    let strips = draw_in_strips(&mut session, &large(), &settings, |share| {
        shares.push(share);
        true
    });
    let strips = strips.unwrap().unwrap();
    assert_eq!((strips.width_px, strips.height_px, strips.colour.len()), (512, 393, whole.colour.len()));
    assert!(shares.len() > 2 && shares.is_sorted() && shares[0] == 0.0, "{shares:?}");
    // Rays differ by their last bits, which decides at edges.
    let differs = |a: u32, b: u32| a.to_le_bytes().iter().zip(b.to_le_bytes()).any(|(a, b)| a.abs_diff(b) > 2);
    let differing = strips.colour.iter().zip(&whole.colour).filter(|(a, b)| differs(**a, **b)).count();
    assert!(differing * 200 < whole.colour.len(), "{differing} pixels differ");

    let cancelled = draw_in_strips(&mut session, &large(), &settings, |share| share == 0.0);
    assert_eq!(cancelled.unwrap(), None);
}

#[test]
fn a_cancelled_picture_does_not_wait_for_its_tiles() {
    let server = TestServer::start(city());
    let mut session = open_session(&server, 64);
    settle(&mut session, &large(), SETTLING, |_| false).unwrap();
    assert!(!session.has_frame());
}
