//! A city of 20 levels, full everywhere: more nodes than any memory holds.

use super::super::*;
use crate::cache::PackedTile;
use crate::cache::tests::NoAtlas;
use crate::camera::Camera;
use crate::decode::DecodedTile;
use crate::scene::MAX_SUBTREE_BYTES;
use glam::DVec3;
use insula_protocol::blockmap::{COLUMNS, MapColumn};
use insula_protocol::{BlockMap, Texel, TileId};
use insula_test_support::small_city::{empty_manifest, full_subtree};
use std::collections::{HashSet, VecDeque};

const DEPTH: u8 = 20;
/// Enough for every stop, so that the error threshold never rises.
const CACHE_PAGES: u32 = 4000;

/// Answers every request at the next poll.
#[derive(Default)]
struct DeepCityFetcher {
    waiting: VecDeque<(TileKey, u64)>,
    subtrees: u64,
}

fn block_map() -> PackedTile {
    let mut columns = vec![None; COLUMNS];
    columns[100] = Some(MapColumn { z_max: 7, roof: Texel::new([9; 3], 0), ..MapColumn::default() });
    PackedTile::node(&BlockMap::from_columns(TileId::ROOT, 1.0, 0, 4, &columns).unwrap())
}

impl TileFetcher for DeepCityFetcher {
    fn start(&mut self, key: TileKey, ticket: u64) {
        self.waiting.push_back((key, ticket));
    }

    fn cancel(&mut self, key: TileKey) {
        self.waiting.retain(|(waiting, _)| *waiting != key);
    }

    fn poll(&mut self) -> Option<FetchOutcome> {
        let (key, ticket) = self.waiting.pop_front()?;
        let tile = match key.kind() {
            TileKind::Subtree => {
                self.subtrees += 1;
                DecodedTile::Subtree(full_subtree(key.id, DEPTH, 1))
            }
            _ => DecodedTile::Packed(block_map()),
        };
        Some(FetchOutcome { key, ticket, is_local: false, duration: Duration::ZERO, result: Ok(tile) })
    }

    fn jitter(&mut self) -> f64 {
        0.5
    }
}

struct DeepCityTour {
    streamer: Streamer<DeepCityFetcher>,
    now: Duration,
}

impl DeepCityTour {
    fn new() -> Self {
        let downloads = Downloads::new(DeepCityFetcher::default(), 12);
        let streamer = Streamer::new(SceneTree::new(empty_manifest(DEPTH)), downloads, CACHE_PAGES);
        Self { streamer, now: Duration::from_secs(100) }
    }

    /// Looks around at a stop until nothing is missing. Returns the draw list: each node, and whose tile is drawn there.
    fn stop_at(&mut self, stop: u32) -> HashSet<(TileId, TileId)> {
        let side_m = empty_manifest(DEPTH).root_side_m;
        // Far from each other, so that only the topmost subtree is common.
        let [x, y] = [0.381, 0.618].map(|step: f64| (0.3 + f64::from(stop) * step).fract() * side_m);
        let position = DVec3::new(x, y, 30.0);
        let camera = Camera::look_at(position, position + DVec3::new(90.0, 200.0, -9.0), DVec3::Z, 1.0).unwrap();
        let request = FrameRequest { camera, heading: None, size_px: [160, 90], tau_px: 4.0, switching: None };
        for _ in 0..2000 {
            self.now += Duration::from_millis(20);
            self.streamer.update(&request, &mut NoAtlas, self.now);
            let tree = self.streamer.tree();
            assert!(tree.bytes() <= tree.max_bytes(), "{} of {} bytes", tree.bytes(), tree.max_bytes());
            assert_eq!(tree.nodes().count(), tree.len());
            if self.streamer.is_settled() && self.streamer.is_idle() {
                assert_eq!(self.streamer.selection.stats.tau_px, request.tau_px);
                let id = |node| tree.node(node).id;
                return self
                    .streamer
                    .selection
                    .draw_tiles
                    .iter()
                    .map(|tile| (id(tile.node), id(tile.source)))
                    .collect();
            }
        }
        panic!("stop {stop} does not settle: {:?}", self.streamer.selection.requests);
    }
}

#[test]
fn the_tree_stays_bounded_and_evicted_places_come_back_as_they_were() {
    let mut tour = DeepCityTour::new();
    let first = tour.stop_at(0);
    assert!(first.iter().any(|(node, source)| node == source && node.level() == DEPTH), "{first:?}");
    let subtrees_at_first = tour.streamer.tiles.counts.subtrees;
    let mut stop = 0;
    // Until four times the memory has passed through.
    while tour.streamer.tiles.counts.subtrees * (MAX_SUBTREE_BYTES as u64) < 4 * tour.streamer.tree().max_bytes() as u64
    {
        stop += 1;
        tour.stop_at(stop);
    }
    let before = tour.streamer.tiles.counts.subtrees;
    assert!(tour.stop_at(0) == first, "another draw list than at first");
    let fetched_again = tour.streamer.tiles.counts.subtrees - before;
    assert!(fetched_again > 0 && fetched_again <= subtrees_at_first, "{fetched_again} of {subtrees_at_first}");
    assert!(tour.streamer.fetched_again() > 0);
}

#[test]
fn a_view_that_needs_more_subtrees_than_fit_settles_with_those_that_do() {
    let mut tour = DeepCityTour::new();
    tour.streamer.tiles.tree.set_max_bytes(5 * MAX_SUBTREE_BYTES);
    for stop in [0, 1, 2, 0] {
        assert!(!tour.stop_at(stop).is_empty());
        let requests = tour.streamer.downloads.fetcher().subtrees;
        tour.stop_at(stop);
        assert_eq!(tour.streamer.downloads.fetcher().subtrees, requests, "a settled view fetches nothing");
    }
}

#[test]
fn hits_of_evicted_nodes_are_ignored() {
    let mut tour = DeepCityTour::new();
    tour.streamer.tiles.tree.set_max_bytes(8 * MAX_SUBTREE_BYTES);
    tour.stop_at(0);
    let nodes: Vec<_> = tour.streamer.selection.draw_tiles.iter().map(|tile| tile.node).collect();
    let view = tour.streamer.last_view.unwrap();
    (1..20).for_each(|stop| drop(tour.stop_at(stop)));
    assert!(nodes.iter().any(|node| !tour.streamer.tree().is_known(*node)));
    let pixels = vec![9; nodes.len()];
    tour.streamer.report_hits(&OcclusionQuery { nodes, view, generation: 1 }, &pixels);
    let request = tour.streamer.last_request.unwrap();
    tour.streamer.update(&request, &mut NoAtlas, tour.now);
    assert!(!tour.streamer.selection.draw_tiles.is_empty());
}
