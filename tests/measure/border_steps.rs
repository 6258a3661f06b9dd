//! Compares how much neighbouring columns differ inside of leaves with how much they differ across the borders of leaves.
//!
//! Coding must not add steps at borders. The pairs are columns with level tops of about the same height, and rows of walls
//! that face the same way; a step is the mean absolute difference of a pair, occlusion of 63 and luma of 255.
//!
//! `cargo run --release -p insula-measure --bin border_steps -- CITY...`

use anyhow::Result;
use insula_protocol::{
    BlockMap, NODE_CELLS, Texel,
    blockmap::{flag, strip_rows},
    octahedral,
};
use insula_server::store::CityStore;
use std::{collections::HashMap, path::Path};

/// Largest difference of two tops of one surface, in metres.
const LEVEL_M: f32 = 0.1;
/// Least z of a level top's normal.
const LEVEL_Z: f32 = 0.98;
/// Largest difference of the azimuths of one wall, in 256ths of a turn.
const SAME_AZIMUTH: u8 = 2;

/// Sums of the steps of some pairs.
#[derive(Debug, Clone, Copy, Default)]
struct Steps {
    /// Of occlusion and of luma.
    sums: [f64; 2],
    count: f64,
}

impl Steps {
    fn add(&mut self, a: Texel, b: Texel) {
        let occlusion = (f64::from(a.ao()) - f64::from(b.ao())).abs();
        self.sums = [self.sums[0] + occlusion, self.sums[1] + (luma(a) - luma(b)).abs()];
        self.count += 1.0;
    }

    fn mean(&self) -> [f64; 2] {
        self.sums.map(|sum| sum / self.count.max(1.0))
    }
}

/// A leaf, and where the strip of each of its columns starts.
struct Leaf {
    map: BlockMap,
    strip_starts: Vec<usize>,
}

impl Leaf {
    fn new(map: BlockMap) -> Self {
        let mut start = 0;
        let starts = (0..map.flags.len()).map(|i| {
            let own = start;
            if map.flags[i] & flag::EXPOSED != 0 {
                start += usize::from(strip_rows(map.z_min[i], map.z_max[i], map.z_shift).1);
            }
            own
        });
        let strip_starts = starts.collect();
        Self { map, strip_starts }
    }

    /// Height and texel of a level top.
    fn level_top(&self, i: usize) -> Option<(f32, Texel)> {
        let map = &self.map;
        let is_level = octahedral::decode(map.roof_normal[i])[2] > LEVEL_Z;
        let top_m = map.z_base_m() as f32 + f32::from(map.z_max[i]) * map.z_step_m();
        (map.flags[i] & flag::OCCUPIED != 0 && is_level).then(|| (top_m, map.roof[i]))
    }

    /// Rows of a wall from the bottom up, and the row of the first above the grid's height zero.
    fn wall(&self, i: usize) -> Option<(i32, &[Texel])> {
        let map = &self.map;
        let (first, count) = strip_rows(map.z_min[i], map.z_max[i], map.z_shift);
        let texels = map.strips.get(self.strip_starts[i]..)?.get(..usize::from(count))?;
        (map.flags[i] & (flag::EXPOSED | flag::HOLES) == flag::EXPOSED)
            .then(|| (map.z_base_cells + i32::from(first), texels))
    }
}

fn luma(texel: Texel) -> f64 {
    let [r, g, b] = texel.rgb().map(f64::from);
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Adds the steps between two neighbouring columns.
fn compare(a: &Leaf, i: usize, b: &Leaf, j: usize, tops: &mut Steps, walls: &mut Steps) {
    if let (Some((high, first)), Some((low, second))) = (a.level_top(i), b.level_top(j))
        && (high - low).abs() < LEVEL_M
    {
        tops.add(first, second);
    }
    let turn = a.map.wall_azimuth[i].wrapping_sub(b.map.wall_azimuth[j]);
    if let (Some((first_a, rows_a)), Some((first_b, rows_b))) = (a.wall(i), b.wall(j))
        && turn.min(turn.wrapping_neg()) <= SAME_AZIMUTH
    {
        for (row, texel) in (first_a..).zip(rows_a) {
            if let Some(other) = usize::try_from(row - first_b).ok().and_then(|row| rows_b.get(row)) {
                walls.add(*texel, *other);
            }
        }
    }
}

fn main() -> Result<()> {
    println!("{:<28} {:>6} {:>10} {:>10} {:>8}", "", "pairs", "inside", "borders", "ratio");
    for city in std::env::args().skip(1) {
        let store = CityStore::open(Path::new(&city))?;
        let depth = store.manifest().depth;
        let mut leaves = HashMap::new();
        for (id, bytes) in store.blockmaps().tiles().filter(|(id, _)| id.level() == depth) {
            leaves.insert((id.x(), id.y()), Leaf::new(BlockMap::decode(id, &bytes?)?));
        }
        // Inside and at borders.
        let (mut tops, mut walls) = ([Steps::default(); 2], [Steps::default(); 2]);
        let last = NODE_CELLS - 1;
        for (&(x, y), leaf) in &leaves {
            let at = |column: usize, row: usize| row * NODE_CELLS + column;
            for k in 0..NODE_CELLS {
                for n in 0..last {
                    compare(leaf, at(n, k), leaf, at(n + 1, k), &mut tops[0], &mut walls[0]);
                    compare(leaf, at(k, n), leaf, at(k, n + 1), &mut tops[0], &mut walls[0]);
                }
                if let Some(east) = leaves.get(&(x + 1, y)) {
                    compare(leaf, at(last, k), east, at(0, k), &mut tops[1], &mut walls[1]);
                }
                if let Some(north) = leaves.get(&(x, y + 1)) {
                    compare(leaf, at(k, last), north, at(k, 0), &mut tops[1], &mut walls[1]);
                }
            }
        }
        println!("{city}");
        for (surface, [inside, border]) in [("tops", tops), ("walls", walls)] {
            for (k, what) in ["occlusion", "luma"].into_iter().enumerate() {
                let (a, b) = (inside.mean()[k], border.mean()[k]);
                println!(
                    "{:<28} {:>6} {a:>10.3} {b:>10.3} {:>8.2}",
                    format!("  {what} of {surface}"),
                    border.count,
                    b / a
                );
            }
        }
    }
    Ok(())
}
