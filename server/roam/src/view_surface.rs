//! The surface for a view: ROAM with a queue of splits.
//!
//! Diamonds have a fixed order for each view, in which those that must be halved before others come first. The surface of
//! a view is that of the longest run from the start of this order that has high enough priorities and no more triangles
//! than allowed.

use super::bounds::ErrorBounds;
use super::diamond::{Corners, Diamond, Place, roots};
use super::field::{DataCover, HeightField};
use super::mesh::{MeshBuilder, TerrainMesh};
use super::tile::draw;
use glam::Vec3;
use std::collections::{BinaryHeap, HashMap};

/// A closed surface of a height field that is refined where a view needs it.
pub(super) struct ViewSurface<'a> {
    field: &'a HeightField,
    bounds: &'a ErrorBounds,
    /// Distance of neighbouring samples.
    step_m: f32,
    /// Lowest and highest height in metres.
    height_range: [f32; 2],
    /// Priority of a metre of error in a box, given by its lower and upper corner: columns along x, rows along y, heights along z. It
    /// should not shrink for a larger box. Where it does, a diamond has the least priority of those that must be halved before it.
    scale: &'a dyn Fn([Vec3; 2]) -> f32,
    /// Whether the diamond in the middle of which a sample lies is halved.
    is_halved: Vec<bool>,
    /// Priorities that were computed.
    known: HashMap<usize, u32>,
}

impl<'a> ViewSurface<'a> {
    /// The coarsest surface: it is fine only where places without data and the field's end require it. `bounds` must be
    /// those of the field; `step_m` is the distance of neighbouring samples.
    pub(super) fn new(
        field: &'a HeightField,
        bounds: &'a ErrorBounds,
        step_m: f32,
        scale: &'a dyn Fn([Vec3; 2]) -> f32,
    ) -> Self {
        let is_halved = (0..field.len()).map(|index| bounds.error_m(index).is_infinite()).collect();
        Self { field, bounds, step_m, height_range: field.height_range(), scale, is_halved, known: HashMap::new() }
    }

    /// Halves diamonds above `threshold`, the highest first, as far as `max_triangles` allows. The coarsest surface may
    /// have more triangles than that.
    pub(super) fn refine(&mut self, threshold: f32, max_triangles: usize) {
        let threshold = ordered(threshold);
        let mut count = 0;
        self.draw(&mut |_| count += 1);
        let mut queue: BinaryHeap<Key> = BinaryHeap::new();
        for index in 0..self.field.len() {
            queue.extend(self.split_key(index));
        }
        while let Some(key) = queue.pop().filter(|key| key.priority > threshold) {
            count += self.gain(key.index);
            if count > max_triangles {
                return;
            }
            self.is_halved[key.index] = true;
            let parts: Vec<usize> = self.parts(key.index).collect();
            for part in parts {
                queue.extend(self.split_key(part));
            }
        }
    }

    /// The triangles.
    pub(super) fn mesh(&self) -> TerrainMesh {
        let mut mesh = MeshBuilder::default();
        self.draw(&mut |corners| mesh.add(corners));
        mesh.finish()
    }

    fn draw(&self, emit: &mut impl FnMut(Corners)) {
        let side = self.bounds.side();
        let [columns, rows] = self.field.size().map(|n| n.saturating_sub(1).div_ceil(side));
        for corner in (0..rows).flat_map(|y| (0..columns).map(move |x| [x * side, y * side])) {
            for root in roots(corner, side) {
                draw(self.field, root, &|index| self.is_halved[index], emit);
            }
        }
    }

    fn diamond(&self, index: usize) -> Option<Diamond> {
        Diamond::at(self.field.place(index), self.bounds.side())
    }

    /// Number of the diamond with this middle.
    fn number(&self, place: Place) -> Option<usize> {
        Diamond::at(place, self.bounds.side()).and(self.field.index(place))
    }

    /// Diamonds in the field that must be halved before this one.
    pub(super) fn parents(&self, index: usize) -> impl Iterator<Item = usize> {
        let apexes = self.diamond(index).into_iter().flat_map(|diamond| diamond.apexes);
        apexes.flatten().filter_map(|place| self.number(place))
    }

    /// Diamonds in the field that can be halved only after this one.
    fn parts(&self, index: usize) -> impl Iterator<Item = usize> {
        let parts = self.diamond(index).into_iter().flat_map(Diamond::parts);
        parts.filter_map(|place| self.number(place))
    }

    /// How many triangles more the surface has after a split.
    fn gain(&self, index: usize) -> usize {
        let triangles = self.diamond(index).into_iter().flat_map(Diamond::triangles);
        triangles.filter(|corners| self.field.cover(corners) == DataCover::Full).count()
    }

    /// The place in the order of a diamond that can be halved without halving others first.
    fn split_key(&mut self, index: usize) -> Option<Key> {
        let diamond = self.diamond(index)?;
        let can_split = !self.is_halved[index] && self.parents(index).all(|parent| self.is_halved[parent]);
        can_split.then(|| Key { priority: self.priority(index), rank: diamond.rank(), index })
    }

    /// A diamond's priority, at most that of those that must be halved before it.
    fn priority(&mut self, index: usize) -> u32 {
        if let Some(priority) = self.known.get(&index) {
            return *priority;
        }
        let error_m = self.bounds.error_m(index);
        if error_m.is_infinite() {
            return u32::MAX;
        }
        let own = self.reach_m(index).map_or(0, |reach_m| ordered(error_m * (self.scale)(reach_m)));
        let parents: Vec<usize> = self.parents(index).collect();
        let priority = parents.into_iter().fold(own, |least, parent| least.min(self.priority(parent)));
        self.known.insert(index, priority);
        priority
    }

    /// Lowest and highest corner of a box around a diamond and around those of all diamonds that can be halved only after
    /// it. `None` if no diamond has its middle at this sample.
    pub(super) fn reach_m(&self, index: usize) -> Option<[Vec3; 2]> {
        let diamond = self.diamond(index)?;
        let [x, y] = self.field.place(index);
        let [low, high] = self.height_range;
        let centre = Vec3::new(x as f32, y as f32, 0.0) * self.step_m;
        // Parts of parts reach this many steps away from the middle along an axis.
        let steps = diamond.half as f32 * if diamond.is_square { 3.0 } else { 2.0 };
        let reach = |sign: f32, z: f32| (centre + Vec3::splat(sign * steps * self.step_m)).with_z(z);
        Some([reach(-1.0, low), reach(1.0, high)])
    }
}

/// Order in which diamonds are halved: by priority, then the larger first, then by number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    /// Bits of a positive number, which have the same order.
    priority: u32,
    rank: u32,
    index: usize,
}

/// A priority's place in the order. Not a number and negative numbers count as zero.
fn ordered(priority: f32) -> u32 {
    if priority > 0.0 { priority.min(f32::MAX).to_bits() } else { 0 }
}
