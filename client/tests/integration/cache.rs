//! Caches that are too small for the view.

use super::fixture_city::{city, city_with_meshes};
use super::test_server::TestServer;
use super::viewers::{SimulatedViewer, sideways, street};
use insula_client::stream::BackgroundFetcher;
use insula_viewer::streamer::Streamer;

const CACHE_MIB: u64 = 2;

fn assert_within_capacity(streamer: &Streamer<BackgroundFetcher>) {
    assert!(streamer.cache().used_bytes() <= CACHE_MIB << 20);
}

/// Moves there and back. Each frame must stay within the cache, and must be complete from the second view on.
fn move_sideways(viewer: &mut SimulatedViewer, steps: u32, step_m: f64) {
    for step in 0..steps {
        viewer.settle(&sideways(step, step_m), |streamer| {
            assert_within_capacity(streamer);
            assert!(step == 0 || streamer.selection().stats.drawn > 0);
        });
    }
}

#[test]
fn a_small_cache_is_never_exceeded_and_does_not_thrash() {
    let server = TestServer::start(city());
    let mut viewer = SimulatedViewer::new(&server, CACHE_MIB);
    viewer.settle(&street(), assert_within_capacity);
    let counters = viewer.streamer.selection().stats;
    assert!(counters.tau_px > 1.0 && counters.drawn > 1, "{counters:?}");
    let requests = server.requests();
    for _ in 0..50 {
        viewer.update(&street());
    }
    assert_eq!(server.requests(), requests, "a settled view requests tiles");
    move_sideways(&mut viewer, 12, 40.0);
}

#[test]
fn cross_fades_stay_within_a_small_cache() {
    let mut viewer = SimulatedViewer::new(&TestServer::start(city()), CACHE_MIB);
    viewer.streamer.set_transitions(true);
    move_sideways(&mut viewer, 12, 40.0);
}

#[test]
fn meshes_stay_within_a_small_cache() {
    let mut viewer = SimulatedViewer::new(&TestServer::start(city_with_meshes()), CACHE_MIB);
    move_sideways(&mut viewer, 6, 60.0);
}
