//! People in the streets of a baked city, whose tiles arrive over a simulated link in simulated time.

use anyhow::{Context, Result};
use glam::DVec3;
use insula_archive::BakedCity;
use insula_protocol::{BlockMap, NODE_CELLS, TileId, TileKind, blockmap::flag, mesh_tile};
use insula_test_support::rng::Rng;
use insula_viewer::{
    camera::Camera,
    decode::decode,
    scene::TileKey,
    streamer::{FetchError, FetchOutcome, TileFetcher},
};
use std::{cell::Cell, rc::Rc, time::Duration};

/// Height of the eyes above the ground.
pub const EYE_M: f64 = 1.7;

/// A link on which responses come one after the other.
#[derive(Debug, Clone, Copy)]
pub struct SimulatedLink {
    pub bytes_per_sec: f64,
    pub rtt: Duration,
    /// Whether the city's sets of what can be seen are fetched as well.
    pub has_sets: bool,
}

/// Reads tiles from a folder as if they came over a link.
pub struct SimulatedFetcher<'a> {
    city: &'a BakedCity,
    link: SimulatedLink,
    now: Rc<Cell<Duration>>,
    free_at: Duration,
    in_flight: Vec<(Duration, TileKey, u64, Duration)>,
    /// What has arrived, and its size in bytes.
    pub fetched: Vec<(TileKey, usize)>,
}

impl<'a> SimulatedFetcher<'a> {
    /// A fetcher whose time is that of `now`.
    pub fn new(city: &'a BakedCity, link: SimulatedLink, now: Rc<Cell<Duration>>) -> Self {
        Self { city, link, now, free_at: Duration::ZERO, in_flight: Vec::new(), fetched: Vec::new() }
    }

    fn bytes(&self, key: TileKey) -> Result<Vec<u8>, FetchError> {
        let place = if key.kind() == TileKind::Mesh { mesh_tile::archive_id(key.id, key.lod) } else { Some(key.id) };
        let is_absent = key.kind() == TileKind::Visibility && !self.link.has_sets;
        let tile = place.filter(|_| !is_absent).and_then(|place| self.city.tile(key.kind(), place).ok().flatten());
        tile.map(|tile| tile.to_vec()).ok_or(FetchError::Missing)
    }
}

impl TileFetcher for SimulatedFetcher<'_> {
    fn start(&mut self, key: TileKey, ticket: u64) {
        let bytes = self.bytes(key).map_or(0, |bytes| bytes.len());
        self.free_at = self.free_at.max(self.now.get() + self.link.rtt)
            + Duration::from_secs_f64(bytes as f64 / self.link.bytes_per_sec);
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

    fn is_local(&self, _: TileKey) -> bool {
        false
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
