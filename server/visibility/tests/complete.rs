//! Sets have everything that rays hit, and lack what walls hide.

#![allow(clippy::unwrap_used)] // In a test, the panic is the report.

use insula_protocol::blockmap::{COLUMNS, MapColumn, STEPS_PER_CELL, WallStrip, strip_rows};
use insula_protocol::visibility_tile::block_of_leaf;
use insula_protocol::{BlockMap, NODE_CELLS, Texel, TileId, VisibilityTile};
use insula_test_support::rng::Rng;
use insula_visibility::{CityExtent, CitySets, Settings};

/// Level of the leaves: 8 x 8 of them, 64 m wide.
const DEPTH: u8 = 3;
const LEAVES: u32 = 1 << DEPTH;
const CELLS: usize = NODE_CELLS * LEAVES as usize;

/// Solids of a column in metres.
#[derive(Debug, Clone, Copy, Default)]
struct Tower {
    top_m: u16,
    gap_m: Option<[u16; 2]>,
}

/// Columns of 1 m on ground at height 0, which is a metre thick.
struct City(Vec<Tower>);

impl City {
    fn flat() -> Self {
        Self(vec![Tower::default(); CELLS * CELLS])
    }

    fn build(&mut self, [x, y]: [usize; 2], [width, depth]: [usize; 2], tower: Tower) {
        for row in y..(y + depth).min(CELLS) {
            self.0[row * CELLS..][x..(x + width).min(CELLS)].fill(tower);
        }
    }

    fn map(&self, id: TileId) -> BlockMap {
        let code = |z_m: u16| (z_m + 1) * STEPS_PER_CELL;
        let columns: Vec<Option<MapColumn>> = (0..COLUMNS)
            .map(|i| {
                let (x, y) =
                    (id.x() as usize * NODE_CELLS + i % NODE_CELLS, id.y() as usize * NODE_CELLS + i / NODE_CELLS);
                let tower = self.0[y * CELLS + x];
                let (z_max, gap) = (code(tower.top_m), tower.gap_m.map(|gap| gap.map(code)));
                let rows = usize::from(strip_rows(0, z_max, 0).1);
                let roof = Texel::new([90; 3], 63);
                let strip = gap.map(|_| WallStrip { texels: vec![roof; rows], azimuth: 0 });
                Some(MapColumn { z_max, gap, roof, strip, ..MapColumn::default() })
            })
            .collect();
        BlockMap::from_columns(id, 1.0, -1, 0, &columns).unwrap()
    }

    fn sets(&self, reach: u8) -> CitySets {
        let leaves = (0..LEAVES * LEAVES).map(|i| TileId::new(DEPTH, i % LEAVES, i / LEAVES).unwrap());
        let extent = CityExtent { depth: DEPTH, cell_m: 1.0, lowest_m: -10.0, terminals: leaves.collect() };
        let settings = Settings { reach, ..Settings::default() };
        let read = |id: TileId| Ok::<_, ()>(self.map(id));
        CitySets::compute(&extent, &settings, read, || ()).unwrap().unwrap()
    }

    fn is_solid(&self, p: [f64; 3]) -> bool {
        let tower = self.0[p[1] as usize * CELLS + p[0] as usize];
        let in_gap = tower.gap_m.is_some_and(|[low, high]| p[2] > f64::from(low) && p[2] < f64::from(high));
        p[2] < f64::from(tower.top_m) && !in_gap
    }

    /// The leaf that a ray hits.
    fn cast(&self, eye: [f64; 3], way: [f64; 3]) -> Option<TileId> {
        let mut p = eye;
        loop {
            p = std::array::from_fn(|axis| p[axis] + 0.1 * way[axis]);
            if !(0..2).all(|axis| p[axis] >= 0.0 && p[axis] < CELLS as f64) || p[2] > 60.0 {
                return None;
            }
            if self.is_solid(p) {
                return leaf_at(p);
            }
        }
    }
}

fn leaf_at(p: [f64; 3]) -> Option<TileId> {
    TileId::new(DEPTH, p[0] as u32 / NODE_CELLS as u32, p[1] as u32 / NODE_CELLS as u32)
}

fn tile(sets: &CitySets, leaf: TileId) -> VisibilityTile {
    let tile = sets.tile(block_of_leaf(leaf));
    VisibilityTile::decode(tile.id, &tile.encode().unwrap()).unwrap()
}

/// Streets between blocks of houses, some on pillars, and a few towers.
fn town(rng: &mut Rng) -> City {
    let mut city = City::flat();
    for y in (4..CELLS).step_by(26) {
        for x in (4..CELLS).step_by(22) {
            let gap_m = rng.one_in(6).then_some([0, 3]);
            let top_m = if rng.one_in(20) { 45 } else { rng.between(6, 16) };
            city.build([x, y], [12 + rng.below(8), 12 + rng.below(12)], Tower { top_m, gap_m });
        }
    }
    city
}

#[test]
fn no_ray_hits_what_a_set_lacks() {
    cast_rays(8);
}

/// With a reach of one square, most of the city is in the coarser scales.
#[test]
fn no_ray_hits_what_the_coarser_scales_lack() {
    cast_rays(1);
}

fn cast_rays(reach: u8) {
    let mut rng = Rng::new(3);
    let city = town(&mut rng);
    let sets = city.sets(reach);
    let tile = tile(&sets, TileId::new(DEPTH, 0, 0).unwrap());
    let (mut hits, mut hidden) = (0, 0);
    for _ in 0..30_000 {
        let eye = [rng.unit() * CELLS as f64, rng.unit() * CELLS as f64, 0.05 + rng.unit() * 19.9];
        if city.is_solid(eye) {
            continue;
        }
        let (yaw, pitch) = (rng.unit() * std::f64::consts::TAU, rng.range(-0.3, 0.3));
        let leaf = leaf_at(eye).unwrap();
        let set = tile.set_at(leaf.x(), leaf.y(), eye[2]).unwrap();
        if let Some(hit) = city.cast(eye, [yaw.cos() * pitch.cos(), yaw.sin() * pitch.cos(), pitch.sin()]) {
            assert!(set.may_see(hit), "{hit} from {eye:?}");
            hits += 1;
        }
        let all = (0..LEAVES * LEAVES).map(|i| TileId::new(DEPTH, i % LEAVES, i / LEAVES).unwrap());
        hidden += usize::from(eye[2] < 3.0) * all.filter(|id| !set.may_see(*id)).count();
    }
    assert!(hits > 10_000 && (hidden > 1_000 || reach < 8), "{hits} hits, {hidden} hidden");
}

/// A court of one leaf, with walls twelve metres thick and 40 m high.
fn court(gate: Tower) -> City {
    let mut city = City::flat();
    let (low, side) = (3 * NODE_CELLS, NODE_CELLS);
    let wall = Tower { top_m: 40, gap_m: None };
    city.build([low - 12, low - 12], [side + 24, side + 24], wall);
    city.build([low, low], [side, side], Tower::default());
    city.build([low + side, low + 20], [12, 24], gate);
    city
}

#[test]
fn walls_hide_what_lies_behind_and_gates_do_not() {
    let leaf = TileId::new(DEPTH, 3, 3).unwrap();
    let count = |city: &City| {
        let tile = tile(&city.sets(8), leaf);
        let set = tile.set_at(3, 3, 1.7).unwrap();
        let all = (0..LEAVES * LEAVES).map(|i| TileId::new(DEPTH, i % LEAVES, i / LEAVES).unwrap());
        let far = all.filter(|id| set.may_see(*id) && id.x().abs_diff(3).max(id.y().abs_diff(3)) > 1).count();
        (far, set.may_see(TileId::new(DEPTH, 7, 3).unwrap()))
    };
    assert_eq!(count(&court(Tower { top_m: 40, gap_m: None })), (0, false), "a closed court");
    let (far, through) = count(&court(Tower::default()));
    assert!(through && far < 30, "a gap between walls: {far}");
    let (far, through) = count(&court(Tower { top_m: 40, gap_m: Some([0, 4]) }));
    assert!(through && far < 30, "a gate: {far}");
}

#[test]
fn sets_do_not_depend_on_the_number_of_threads() {
    let city = town(&mut Rng::new(5));
    let bytes = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let sets = pool.install(|| city.sets(8));
        sets.blocks().into_iter().flat_map(|block| sets.tile(block).encode().unwrap()).collect::<Vec<u8>>()
    };
    assert_eq!(bytes(1), bytes(3));
}
