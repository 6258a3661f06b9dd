//! Streaming from sources that never respond.

mod deep_city;

use super::*;
use crate::scene::TileState;
use crate::select::priority::TileRequest;
use crate::select::tests::{load, tree, tree_of_one_leaf, view};
use crate::source::FetchError;
use insula_protocol::TileId;

/// Never responds, or always with an error.
pub(super) struct Unresponsive {
    error: Option<FetchError>,
    started: Vec<(TileKey, u64)>,
}

impl Unresponsive {
    pub(super) fn new(error: Option<FetchError>) -> Self {
        Self { error, started: Vec::new() }
    }
}

impl TileFetcher for Unresponsive {
    fn start(&mut self, key: TileKey, ticket: u64) {
        self.started.push((key, ticket));
    }

    fn cancel(&mut self, _: TileKey) {}

    fn poll(&mut self) -> Option<FetchOutcome> {
        let result = Err(self.error.clone()?);
        let (key, ticket) = self.started.pop()?;
        Some(FetchOutcome { key, ticket, is_local: false, duration: Duration::ZERO, result })
    }

    fn jitter(&mut self) -> f64 {
        0.5
    }
}

const NOW: Duration = Duration::from_secs(100);

/// In a street, with only the root's tile resident, after a frame in which everything was visible.
fn after_first_frame(fails: bool) -> (Streamer<Unresponsive>, FrameRequest) {
    let mut tree = tree();
    load(&mut tree, TileKey::block_map(TileId::ROOT));
    let error = fails.then(|| FetchError::Network("connection refused".into()));
    let downloads = Downloads::new(Unresponsive::new(error), 12);
    let mut streamer = Streamer::new(tree, downloads, 10_000);
    let camera = view([1030.0, -10.0, 2.0], [1030.0, 3000.0, 2.0]).camera;
    let request = FrameRequest { camera, heading: None, size_px: [640, 360], tau_px: 1.0, switching: None };
    streamer.select_and_request(&request, NOW);
    let nodes: Vec<_> = streamer.selection.draw_tiles.iter().map(|tile| tile.node).collect();
    let pixels = vec![9; nodes.len()];
    let query = OcclusionQuery { nodes, view: streamer.view(&request, camera), generation: 1 };
    streamer.report_hits(&query, &pixels);
    (streamer, request)
}

/// Tiles that are wanted and not requested.
fn waiting(streamer: &Streamer<Unresponsive>) -> Vec<TileRequest> {
    let is_waiting =
        |w: &&TileRequest| streamer.tree().tile(w.key).is_some_and(|tile| tile.state() == TileState::Unknown);
    streamer.selection.requests.iter().filter(is_waiting).copied().collect()
}

#[test]
fn occludable_tiles_wait_unless_the_source_does_not_respond() {
    let (mut streamer, request) = after_first_frame(false);
    streamer.select_and_request(&request, NOW);
    let (waits, wanted) = (waiting(&streamer).len(), streamer.selection.requests.len());
    assert!(waits * 2 > wanted && waits < wanted, "{waits} of {wanted} wait");

    let (mut streamer, request) = after_first_frame(true);
    streamer.select_and_request(&request, NOW);
    assert!(streamer.downloads.poll(&mut streamer.tiles.tree, NOW).is_none());
    assert_eq!(streamer.downloads.failing_since(), Some(NOW));
    streamer.select_and_request(&request, NOW);
    assert!(streamer.selection.requests.len() * 2 > wanted && waiting(&streamer).is_empty());
}

#[test]
fn a_view_of_nothing_is_drawn_once_the_city_is_known() {
    let (mut streamer, request) = after_first_frame(false);
    let away = Camera { forward: -request.camera.forward, ..request.camera };
    streamer.select_and_request(&FrameRequest { camera: away, ..request }, NOW);
    assert!(streamer.selection.draw_tiles.is_empty() && streamer.has_frame());
    assert_eq!(streamer.stream_status(NOW), StreamStatus::Ready);

    let unknown = SceneTree::new(streamer.tree().manifest().clone());
    let downloads = Downloads::new(Unresponsive::new(None), 12);
    let mut streamer = Streamer::new(unknown, downloads, 10_000);
    streamer.select_and_request(&FrameRequest { camera: away, ..request }, NOW);
    assert!(!streamer.has_frame());
    assert_eq!(streamer.stream_status(NOW), StreamStatus::Loading);
}

#[test]
fn land_beside_the_nodes_of_a_city_is_drawn_before_their_tiles_arrive() {
    let mut tree = tree_of_one_leaf();
    load(&mut tree, TileKey::block_map(TileId::ROOT));
    let downloads = Downloads::new(Unresponsive::new(None), 12);
    let mut streamer = Streamer::new(tree, downloads, 10_000);
    // In the square of the root's child, and beside that child's.
    let camera = view([900.0, 880.0, 200.0], [900.0, 900.0, 0.0]).camera;
    let request = FrameRequest { camera, heading: None, size_px: [640, 360], tau_px: 1.0, switching: None };
    streamer.select_and_request(&request, NOW);
    assert!(streamer.selection.draw_tiles.is_empty() && streamer.lacks_tiles());
    assert!(streamer.is_blind() && streamer.has_frame());
    // The frame's hits let the tiles be requested.
    let query = OcclusionQuery { nodes: Vec::new(), view: streamer.view(&request, camera), generation: 1 };
    streamer.report_hits(&query, &[]);
    streamer.select_and_request(&request, NOW);
    assert!(!streamer.is_blind() && waiting(&streamer).is_empty());
}

#[test]
fn slow_frames_ask_for_less_and_a_rest_for_all_again() {
    let (mut streamer, request) = after_first_frame(false);
    streamer.select_and_request(&request, NOW);
    let chosen = streamer.selection.clone();
    streamer.set_tau_factor(4.0);
    streamer.select_and_request(&request, NOW);
    assert_eq!(streamer.view(&request, request.camera).tau_px, 4.0);
    let moving = &streamer.selection;
    assert!(moving.requests.len() * 4 < chosen.requests.len() * 3, "{} requests", moving.requests.len());
    assert!(!streamer.has_work());
    streamer.set_tau_factor(1.0);
    assert!(streamer.has_work(), "a shell that draws only what is new draws again");
    streamer.select_and_request(&request, NOW);
    assert!(streamer.selection == chosen, "a view that rests has the chosen detail");
}
