//! Triangles in the order of a space-filling curve (Morton 1966): neighbours in space are near each other in memory.

use crate::model::TriangleModel;
use glam::DVec3;

/// Greatest number of an axis in a Morton key, which has ten bits of each.
const MOST: f64 = 1023.0;

/// The numbers of the triangles, sorted by the Morton key of their first corner.
pub(super) fn space_filling_order(model: &TriangleModel) -> Vec<u32> {
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for position in &model.positions {
        (min, max) = (min.min(DVec3::from(*position)), max.max(DVec3::from(*position)));
    }
    let scale = MOST / (max - min).max_element().max(f64::MIN_POSITIVE);
    let key = |triangle: &[u32; 3]| {
        let position = model.positions.get(triangle[0] as usize).copied().unwrap_or_default();
        let at = (DVec3::from(position) - min) * scale;
        spread_bits(at.x as u32) | spread_bits(at.y as u32) << 1 | spread_bits(at.z as u32) << 2
    };
    let mut keys: Vec<(u32, u32)> = model.triangles.iter().map(key).zip(0..).collect();
    keys.sort_unstable();
    keys.into_iter().map(|(_, triangle)| triangle).collect()
}

/// Ten bits with two zeros before each.
fn spread_bits(mut v: u32) -> u32 {
    for (shift, mask) in [(16, 0x0300_00ff), (8, 0x0300_f00f), (4, 0x030c_30c3), (2, 0x0924_9249)] {
        v = (v | v << shift) & mask;
    }
    v
}
