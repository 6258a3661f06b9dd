//! Triangles in the order of a space-filling curve (Morton 1966): neighbours in space are near each other in memory.

use crate::model::TriangleModel;
use glam::DVec3;

/// Bits of a Morton key per axis, and of a digit of the radix sort.
const AXIS_BITS: u32 = 10;
const DIGITS: usize = 1 << AXIS_BITS;

/// The numbers of the triangles, sorted by the Morton key of their first corner.
pub(super) fn space_filling_order(model: &TriangleModel) -> Vec<u32> {
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for position in &model.positions {
        (min, max) = (min.min(DVec3::from(*position)), max.max(DVec3::from(*position)));
    }
    let scale = (DIGITS - 1) as f64 / (max - min).max_element().max(f64::MIN_POSITIVE);
    let key = |triangle: &[u32; 3]| {
        let position = model.positions.get(triangle[0] as usize).copied().unwrap_or_default();
        let at = (DVec3::from(position) - min) * scale;
        spread_bits(at.x as u32) | spread_bits(at.y as u32) << 1 | spread_bits(at.z as u32) << 2
    };
    let keys = model.triangles.iter().map(key).zip(0..).collect();
    radix_sorted(keys).into_iter().map(|(_, triangle)| triangle).collect()
}

/// Ten bits with two zeros before each.
fn spread_bits(mut v: u32) -> u32 {
    for (shift, mask) in [(16, 0x0300_00ff), (8, 0x0300_f00f), (4, 0x030c_30c3), (2, 0x0924_9249)] {
        v = (v | v << shift) & mask;
    }
    v
}

/// Stable sort by keys of 30 bits.
fn radix_sorted(mut items: Vec<(u32, u32)>) -> Vec<(u32, u32)> {
    let mut sorted = items.clone();
    for shift in [0, AXIS_BITS, 2 * AXIS_BITS] {
        let digit = |key: u32| (key >> shift) as usize & (DIGITS - 1);
        let mut places = [0u32; DIGITS];
        items.iter().for_each(|(key, _)| places[digit(*key)] += 1);
        let mut before = 0;
        places.iter_mut().for_each(|place| before += std::mem::replace(place, before));
        for item in &items {
            let place = &mut places[digit(item.0)];
            sorted[*place as usize] = *item;
            *place += 1;
        }
        std::mem::swap(&mut items, &mut sorted);
    }
    items
}
