//! Pictures: streamed to their end, drawn in strips, and with what developers look at.

use super::fixture_city::{city, city_with_meshes};
use super::test_server::TestServer;
use super::viewers::{TIMEOUT, open_session, request};
use insula_client::picture::{Settling, draw_in_strips, draw_whole, settle};
use insula_shaders::layout::Shading;
use insula_viewer::frame::RenderSettings;
use insula_viewer::streamer::FrameRequest;
use std::collections::BTreeMap;

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

/// Numbers of pixels by their colour, in a view of the city with meshes.
fn colours(shading: Shading) -> BTreeMap<u32, usize> {
    let server = TestServer::start(city_with_meshes());
    let mut session = open_session(&server, 64);
    settle(&mut session, &large(), SETTLING, |_| true).unwrap();
    let settings = RenderSettings { shading, ..RenderSettings::default() };
    let mut pixels = draw_whole(&mut session, &large(), &settings).unwrap();
    if shading == Shading::Bounds {
        let strips = draw_in_strips(&mut session, &large(), &settings, |_| true).unwrap().unwrap();
        let same = strips.colour.iter().zip(&pixels.colour).filter(|(a, b)| a == b).count();
        assert!(same * 100 > pixels.colour.len() * 99, "{same} pixels are the same in strips");
    }
    let mut counts = BTreeMap::new();
    // Only what a mesh shows, or all with boxes.
    let meshes: Vec<bool> = session.frame_data(&large(), &settings).nodes.iter().map(|node| node.mesh != 0).collect();
    let is_shown = |hit: &u32| shading == Shading::Bounds || meshes.get(*hit as usize).is_some_and(|is_mesh| *is_mesh);
    for (colour, _) in pixels.colour.drain(..).zip(&pixels.hit).filter(|(_, hit)| is_shown(hit)) {
        *counts.entry(colour).or_default() += 1;
    }
    counts
}

#[test]
fn pictures_show_triangles_their_edges_and_the_boxes_of_nodes() {
    let count = |colours: &BTreeMap<u32, usize>, is_counted: &dyn Fn(u32) -> bool| -> usize {
        colours.iter().filter(|(colour, _)| is_counted(**colour)).map(|(_, count)| count).sum()
    };
    let brightness = |colour: u32| colour.to_le_bytes()[..3].iter().map(|v| u32::from(*v)).sum::<u32>();
    let (albedo, triangles) = (colours(Shading::Albedo), colours(Shading::Triangles));
    assert!(triangles.len() > 2 * albedo.len() && triangles.len() < 500, "{} colours", triangles.len());
    let wire = colours(Shading::Wire);
    let (dark, light) = (count(&wire, &|c| brightness(c) < 200), count(&wire, &|c| brightness(c) > 300));
    assert!(dark > 200 && light > 4 * dark, "{dark} dark and {light} light pixels");
    let boxes = colours(Shading::Bounds);
    let [white, black] = [0xffff_ffff, 0xff00_0000].map(|colour| boxes.get(&colour).copied().unwrap_or(0));
    assert!(white > 500 && black > white, "{white} white and {black} black pixels");
}
