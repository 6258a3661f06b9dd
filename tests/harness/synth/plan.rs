//! Which blocks a city of a given size has.
//!
//! Blocks are numbered in two directions, with 0, 0 in the centre. The city consists of
//! rings of blocks; the last blocks of the outermost ring are empty when the number of buildings is reached.

use super::blocks::{self, Block};
use super::streets::{JITTER_M, PITCH_M, street};
use glam::DVec2;

/// Ground beyond the outermost streets.
const RIM_M: f64 = 12.0;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Totals {
    pub buildings: u64,
    /// Triangles of buildings, trees and ground.
    pub triangles: u64,
}

#[derive(Debug, Clone)]
pub struct Plan {
    rings: i32,
    /// Number of blocks with buildings in the outermost ring.
    last_blocks: usize,
    /// Number of buildings in the last of them.
    last_buildings: usize,
    totals: Totals,
}

/// The blocks of a ring, in order.
fn ring(r: i32) -> Vec<[i32; 2]> {
    let all = (-r..=r).flat_map(|j| (-r..=r).map(move |i| [i, j]));
    all.filter(|[i, j]| i.abs().max(j.abs()) == r).collect()
}

/// Index of a block in [`ring`].
fn place_in_ring(r: i32, [i, j]: [i32; 2]) -> usize {
    let row = (2 * r + 1) as usize;
    let place = match j {
        _ if j == -r => i + r,
        _ if j == r => 2 * (2 * r - 1) + i + r,
        _ => 2 * (j + r - 1) + i32::from(i == r),
    };
    place as usize + if j == -r { 0 } else { row }
}

impl Plan {
    /// A plan of exactly `buildings` buildings (at least one).
    pub fn new(buildings: u64) -> Self {
        let wanted = buildings.max(1);
        let mut plan = Self { rings: 0, last_blocks: 0, last_buildings: 0, totals: Totals::default() };
        for r in 0.. {
            plan.rings = r;
            let blocks = ring(r);
            for (n, [i, j]) in blocks.iter().copied().enumerate() {
                let mut block = blocks::block(i, j);
                let left = (wanted - plan.totals.buildings) as usize;
                (plan.last_blocks, plan.last_buildings) = (n + 1, block.buildings.len().min(left));
                block.buildings.truncate(left);
                plan.totals.buildings += block.buildings.len() as u64;
                plan.totals.triangles += block.triangles();
                if plan.totals.buildings == wanted {
                    plan.totals.triangles += (blocks.len() - n - 1) as u64 * blocks::GROUND_TRIANGLES;
                    return plan;
                }
            }
        }
        plan
    }

    pub fn totals(&self) -> Totals {
        self.totals
    }

    /// Corners of the ground.
    pub fn bounds(&self) -> [DVec2; 2] {
        let r = self.rings;
        let low = DVec2::new(street(0, -r), street(1, -r)) - RIM_M;
        [low, DVec2::new(street(0, r + 1), street(1, r + 1)) + RIM_M]
    }

    /// The block `[i, j]`; `None` outside the city.
    pub fn block(&self, [i, j]: [i32; 2]) -> Option<Block> {
        let r = i.abs().max(j.abs());
        if r > self.rings {
            return None;
        }
        let mut block = blocks::block(i, j);
        if r == self.rings {
            let place = place_in_ring(r, [i, j]);
            if place + 1 > self.last_blocks {
                block.clear();
            } else if place + 1 == self.last_blocks {
                block.buildings.truncate(self.last_buildings);
            }
        }
        Some(block)
    }

    /// The blocks that may reach into a rectangle, row by row.
    pub fn blocks_in(&self, low: DVec2, high: DVec2) -> impl Iterator<Item = [i32; 2]> + use<> {
        let r = self.rings;
        let first = |v: f64, axis: usize| (((v - JITTER_M) / PITCH_M[axis]).floor() as i32 - 1).clamp(-r, r);
        let last = |v: f64, axis: usize| (((v + JITTER_M) / PITCH_M[axis]).floor() as i32 + 1).clamp(-r, r);
        let columns = first(low.x, 0)..=last(high.x, 0);
        (first(low.y, 1)..=last(high.y, 1)).flat_map(move |j| columns.clone().map(move |i| [i, j]))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::super::streets::half_street;
    use super::*;

    #[test]
    fn a_plan_has_the_requested_number_of_buildings() {
        for wanted in [1, 10, 1000, 5000] {
            let plan = Plan::new(wanted);
            let [low, high] = plan.bounds();
            let blocks: Vec<Block> = plan.blocks_in(low, high).map(|at| plan.block(at).unwrap()).collect();
            assert_eq!(blocks.iter().map(|b| b.buildings.len() as u64).sum::<u64>(), wanted);
            assert_eq!(blocks.iter().map(Block::triangles).sum::<u64>(), plan.totals().triangles);
            assert_eq!(plan.totals().buildings, wanted);
        }
    }

    #[test]
    fn place_in_ring_is_the_index_in_the_ring() {
        for r in 0..5 {
            assert!(ring(r).into_iter().enumerate().all(|(n, at)| place_in_ring(r, at) == n), "{r}");
        }
    }

    #[test]
    fn a_smaller_city_is_the_middle_of_a_larger_one() {
        let (small, large) = (Plan::new(1000), Plan::new(10_000));
        for at in [[0, 0], [1, -2], [-2, 2]] {
            assert_eq!(small.block(at).unwrap().buildings, large.block(at).unwrap().buildings);
        }
    }

    #[test]
    fn blocks_lie_between_their_streets() {
        for i in -20..20 {
            let block = blocks::block(i, 3 * i);
            let low = DVec2::new(street(0, i) + half_street(i), street(1, 3 * i) + half_street(3 * i));
            let high = DVec2::new(street(0, i + 1), street(1, 3 * i + 1));
            assert!(block.low == low && block.high.cmplt(high).all() && block.low.cmplt(block.high).all());
            for part in block.parts().filter(|part| part.bottom_m == 0.0) {
                let reach = part.reach();
                let inside = (part.centre - reach).cmpge(low - 0.5).all() && (part.centre + reach).cmple(high).all();
                assert!(inside, "block {i}: {part:?}");
            }
        }
    }
}
