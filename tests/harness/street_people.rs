//! People in the streets of a baked city, whose tiles arrive over a simulated link in simulated time.

use anyhow::{Context, Result};
use glam::DVec3;
use insula_archive::BakedCity;
use insula_protocol::{BlockMap, Manifest, NODE_CELLS, TileId, TileKind, blockmap::flag, mesh_tile};
use insula_test_support::rng::Rng;
use insula_viewer::{
    cache::pages_for,
    camera::Camera,
    decode::decode,
    render::CpuAdapter,
    scene::{SceneTree, TileKey},
    source::FetchError,
    streamer::{Downloads, FetchOutcome, Streamer, TileFetcher},
};
use std::{cell::Cell, rc::Rc, time::Duration};

/// Height of the eyes above the ground.
const EYE_M: f64 = 1.7;

/// Width and height of the window.
pub const SIZE_PX: [u32; 2] = [1280, 720];
const CACHE_BYTES: u64 = 512 << 20;

/// A link on which responses come one after the other.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct SimulatedLink {
    /// Megabits per second
    #[arg(long, default_value_t = 20.0)]
    bandwidth: f64,
    /// Round trip in milliseconds
    #[arg(long, default_value_t = 50)]
    rtt: u64,
    /// Requests at once to begin with
    #[arg(long, default_value_t = 12)]
    requests: usize,
}

/// A client that has no tiles yet, and what it draws with. Its time is that of `now`. `has_sets`: whether it fetches the city's sets of
/// what can be seen.
pub fn new_client<'a>(
    city: &'a BakedCity,
    has_sets: bool,
    link: SimulatedLink,
    now: &Rc<Cell<Duration>>,
) -> (Streamer<SimulatedFetcher<'a>>, CpuAdapter) {
    let fetcher = SimulatedFetcher {
        city,
        has_sets,
        link,
        now: Rc::clone(now),
        free_at: Duration::ZERO,
        in_flight: Vec::new(),
        fetched: Vec::new(),
    };
    let pages = pages_for(CACHE_BYTES);
    let tree = SceneTree::new(Manifest { street_sets: has_sets, ..city.manifest().clone() });
    (Streamer::new(tree, Downloads::new(fetcher, link.requests), pages), CpuAdapter::new(pages))
}

/// Reads tiles from a folder as if they came over a link.
pub struct SimulatedFetcher<'a> {
    city: &'a BakedCity,
    has_sets: bool,
    link: SimulatedLink,
    now: Rc<Cell<Duration>>,
    free_at: Duration,
    in_flight: Vec<(Duration, TileKey, u64, Duration)>,
    /// What has arrived, and its size in bytes.
    pub fetched: Vec<(TileKey, usize)>,
}

impl SimulatedFetcher<'_> {
    fn bytes(&self, key: TileKey) -> Result<Vec<u8>, FetchError> {
        let place = if key.kind() == TileKind::Mesh { mesh_tile::archive_id(key.id, key.lod) } else { Some(key.id) };
        let is_absent = key.kind() == TileKind::Visibility && !self.has_sets;
        let tile = place.filter(|_| !is_absent).and_then(|place| self.city.tile(key.kind(), place).ok().flatten());
        tile.map(|tile| tile.to_vec()).ok_or(FetchError::Missing)
    }
}

impl TileFetcher for SimulatedFetcher<'_> {
    fn start(&mut self, key: TileKey, ticket: u64) {
        let bytes = self.bytes(key).map_or(0, |bytes| bytes.len());
        let (rtt, bytes_per_sec) = (Duration::from_millis(self.link.rtt), self.link.bandwidth * 125_000.0);
        self.free_at = self.free_at.max(self.now.get() + rtt) + Duration::from_secs_f64(bytes as f64 / bytes_per_sec);
        self.in_flight.push((self.free_at, key, ticket, self.now.get()));
    }

    fn cancel(&mut self, key: TileKey) {
        self.in_flight.retain(|(_, other, ..)| *other != key);
    }

    fn poll(&mut self) -> Option<FetchOutcome> {
        let at = self.in_flight.iter().position(|(due, ..)| *due <= self.now.get())?;
        let (due, key, ticket, since) = self.in_flight.remove(at);
        let bytes = self.bytes(key);
        self.fetched.push((key, bytes.as_ref().map_or(0, Vec::len)));
        let result = bytes.and_then(|bytes| decode(key, &bytes).map_err(FetchError::Damaged));
        Some(FetchOutcome { key, ticket, is_local: false, duration: due - since, result })
    }

    fn jitter(&mut self) -> f64 {
        0.5
    }
}

/// A view of a person in a street, among buildings.
pub fn random_view(city: &BakedCity, rng: &mut Rng) -> Result<Camera> {
    let manifest = city.manifest();
    let leaves: Vec<TileId> =
        city.blockmaps().lengths().map(|(id, _)| id).filter(|id| id.level() == manifest.depth).collect();
    loop {
        let leaf = leaves[rng.below(leaves.len())];
        let map = BlockMap::decode(leaf, &city.tile(TileKind::BlockMap, leaf)?.context("a leaf is missing")?)?;
        // Among buildings: at least a tenth of the leaf is 3 m above its lowest top.
        let map = map.stand_on_ground();
        let tops: Vec<u16> =
            (0..map.z_max.len()).filter(|i| map.flags[*i] & flag::OCCUPIED != 0).map(|i| map.z_max[i]).collect();
        let Some(lowest) = tops.iter().min() else { continue };
        let high = tops.iter().filter(|top| f32::from(**top - lowest) * map.z_step_m() > 3.0).count();
        let i = rng.below(map.z_max.len());
        let height = map.z_base_m() + f64::from(map.z_max[i]) * f64::from(map.z_step_m());
        let is_low = f32::from(map.z_max[i].saturating_sub(*lowest)) * map.z_step_m() < 1.5;
        let yaw = rng.unit() * std::f64::consts::TAU;
        if high * 10 < map.z_max.len() || !is_low || map.flags[i] & flag::OCCUPIED == 0 {
            continue;
        }
        let [x, y, _] = manifest.node_corner(leaf);
        let cell = |v: usize| (v as f64 + 0.5) * manifest.cell_m;
        let eye = DVec3::new(x + cell(i % NODE_CELLS), y + cell(i / NODE_CELLS), manifest.origin[2] + height + EYE_M);
        return Ok(Camera::from_angles(eye, yaw, 0.05, 60f64.to_radians()));
    }
}
