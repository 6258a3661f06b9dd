//! A mesh that follows a view: ROAM with a queue of splits and a queue of merges.
//!
//! Diamonds have a fixed order for each view, in which those that must be halved before others come first. The mesh of
//! a view is that of the longest run from the start of this order that has high enough priorities and no more triangles
//! than allowed. `update` moves from any mesh to this one, so the result does not depend on the meshes before.

use super::bounds::{ErrorBounds, root_corners};
use super::diamond::{Corners, Diamond, Place, roots};
use super::field::{DataCover, HeightField};
use super::mesh::{MeshBuilder, TerrainMesh};
use super::priority::{Key, Node, Priority, ordered};
use super::tile::draw;
use glam::Vec3;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap, HashSet};

/// A closed surface of a height field that is refined where a view needs it.
#[derive(Debug, Clone)]
pub struct RoamMesh<'a> {
    pub(super) field: &'a HeightField,
    pub(super) bounds: &'a ErrorBounds,
    /// Distance of neighbouring samples.
    pub(super) step_m: f32,
    /// Lowest and highest height in metres.
    pub(super) height_range: [f32; 2],
    /// Whether the diamond in the middle of which a sample lies is halved.
    is_halved: Vec<bool>,
    triangle_count: usize,
    /// Diamonds that can be halved without halving others first.
    splittable: HashSet<usize>,
    /// Halved diamonds of which no part is halved.
    mergeable: HashSet<usize>,
}

/// Diamonds that an update halved and put together.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Changes {
    pub splits: usize,
    pub merges: usize,
}

impl<'a> RoamMesh<'a> {
    /// The coarsest mesh: it is fine only where places without data and the field's end require it. `bounds` must be
    /// those of the field; `step_m` is the distance of neighbouring samples.
    pub fn new(field: &'a HeightField, bounds: &'a ErrorBounds, step_m: f32) -> Self {
        let is_halved = (0..field.len()).map(|index| bounds.error_m(index).is_infinite()).collect();
        let mut mesh = Self {
            field,
            bounds,
            step_m,
            height_range: field.height_range(),
            is_halved,
            triangle_count: 0,
            splittable: HashSet::new(),
            mergeable: HashSet::new(),
        };
        mesh.splittable = (0..field.len()).filter(|index| mesh.can_split(*index)).collect();
        let mut count = 0;
        mesh.draw(&mut |_| count += 1);
        mesh.triangle_count = count;
        mesh
    }

    /// Refines and coarsens until all diamonds above `threshold` are halved and no others, as far as `max_triangles`
    /// allows. The coarsest mesh may have more triangles than that.
    pub fn update(&mut self, priority: &impl Priority, threshold: f32, max_triangles: usize) -> Changes {
        let mut keys = Keys::new(priority);
        let mut splits: BinaryHeap<Key> = self.splittable.iter().map(|i| keys.of(self, *i)).collect();
        let mut merges: BinaryHeap<Reverse<Key>> = self.mergeable.iter().map(|i| Reverse(keys.of(self, *i))).collect();
        let threshold = ordered(threshold);
        let mut changes = Changes::default();
        loop {
            // Diamonds that can no longer be split or merged stay in the queues until they come first.
            while splits.peek().is_some_and(|key| !self.splittable.contains(&key.index)) {
                splits.pop();
            }
            while merges.peek().is_some_and(|Reverse(key)| !self.mergeable.contains(&key.index)) {
                merges.pop();
            }
            let wanted = splits.peek().filter(|key| key.priority > threshold).copied();
            let least = merges.peek().map(|Reverse(key)| *key);
            let fits = |key: &Key| self.triangle_count + self.gain(key.index) <= max_triangles;
            if let Some(key) = wanted.filter(fits) {
                self.set(key.index, true);
                changes.splits += 1;
                merges.push(Reverse(key));
                splits.extend(self.parts(key.index).filter(|i| self.splittable.contains(i)).map(|i| keys.of(self, i)));
            } else if let Some(key) = least.filter(|least| {
                least.priority <= threshold || self.triangle_count > max_triangles || wanted > Some(*least)
            }) {
                self.set(key.index, false);
                changes.merges += 1;
                splits.push(key);
                let parents = self.parents(key.index).filter(|i| self.mergeable.contains(i));
                merges.extend(parents.map(|i| Reverse(keys.of(self, i))));
            } else {
                return changes;
            }
        }
    }

    /// Halves the diamond with this middle, after those that must be halved first. Whether it was not halved before.
    pub fn split(&mut self, place: Place) -> bool {
        let Some(index) = self.number(place).filter(|index| !self.is_halved[*index]) else { return false };
        for parent in self.parents(index).collect::<Vec<_>>() {
            self.split(self.field.place(parent));
        }
        self.set(index, true);
        true
    }

    /// Puts the diamond with this middle together again. `false` if it is not halved, if a part of it is, or if it
    /// covers places without data.
    pub fn merge(&mut self, place: Place) -> bool {
        let Some(index) = self.number(place).filter(|index| self.mergeable.contains(index)) else { return false };
        self.set(index, false);
        true
    }

    /// Number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.triangle_count
    }

    /// The triangles.
    pub fn mesh(&self) -> TerrainMesh {
        let mut mesh = MeshBuilder::default();
        self.draw(&mut |corners| mesh.add(corners));
        mesh.finish()
    }

    fn draw(&self, emit: &mut impl FnMut(Corners)) {
        for corner in root_corners(self.field, self.bounds.side()) {
            for root in roots(corner, self.bounds.side()) {
                draw(self.field, root, &|index| self.is_halved[index], emit);
            }
        }
    }
}

/// Neighbours in the order of halving.
impl RoamMesh<'_> {
    /// Number of the diamond with this middle.
    fn number(&self, place: Place) -> Option<usize> {
        self.diamond(place).and(self.field.index(place))
    }

    pub(super) fn diamond(&self, place: Place) -> Option<Diamond> {
        Diamond::at(place, self.bounds.side())
    }

    /// Diamonds in the field that must be halved before this one.
    pub(super) fn parents(&self, index: usize) -> impl Iterator<Item = usize> {
        let apexes = self.diamond(self.field.place(index)).into_iter().flat_map(|diamond| diamond.apexes);
        apexes.flatten().filter_map(|place| self.number(place))
    }

    /// Diamonds in the field that can be halved only after this one.
    fn parts(&self, index: usize) -> impl Iterator<Item = usize> {
        let parts = self.diamond(self.field.place(index)).into_iter().flat_map(Diamond::parts);
        parts.filter_map(|place| self.number(place))
    }

    /// How many triangles more the mesh has after a split.
    fn gain(&self, index: usize) -> usize {
        let triangles = self.diamond(self.field.place(index)).into_iter().flat_map(Diamond::triangles);
        triangles.filter(|corners| self.field.cover(corners) == DataCover::Full).count()
    }

    fn can_split(&self, index: usize) -> bool {
        let is_diamond = self.diamond(self.field.place(index)).is_some();
        is_diamond && !self.is_halved[index] && self.parents(index).all(|parent| self.is_halved[parent])
    }

    fn can_merge(&self, index: usize) -> bool {
        let is_free = self.is_halved[index] && self.bounds.error_m(index).is_finite();
        is_free && !self.parts(index).any(|part| self.is_halved[part])
    }

    /// Splits or merges a diamond and keeps the sets.
    fn set(&mut self, index: usize, is_halved: bool) {
        let gain = self.gain(index);
        self.triangle_count = if is_halved { self.triangle_count + gain } else { self.triangle_count - gain };
        self.is_halved[index] = is_halved;
        let around: Vec<usize> = self.parts(index).chain(self.parents(index)).chain([index]).collect();
        for other in around {
            let (can_split, can_merge) = (self.can_split(other), self.can_merge(other));
            keep(&mut self.splittable, other, can_split);
            keep(&mut self.mergeable, other, can_merge);
        }
    }
}

fn keep(set: &mut HashSet<usize>, index: usize, is_in: bool) {
    if is_in {
        set.insert(index);
    } else {
        set.remove(&index);
    }
}

/// Keys that were computed for one view.
pub(super) struct Keys<'p, P> {
    priority: &'p P,
    known: HashMap<usize, u32>,
}

impl<'p, P: Priority> Keys<'p, P> {
    pub(super) fn new(priority: &'p P) -> Self {
        Self { priority, known: HashMap::new() }
    }

    pub(super) fn of(&mut self, mesh: &RoamMesh, index: usize) -> Key {
        let rank = mesh.diamond(mesh.field.place(index)).map_or(0, |diamond| diamond.rank());
        Key { priority: self.priority(mesh, index), rank, index }
    }

    /// A diamond's priority, at most that of those that must be halved before it.
    fn priority(&mut self, mesh: &RoamMesh, index: usize) -> u32 {
        if let Some(priority) = self.known.get(&index) {
            return *priority;
        }
        if mesh.bounds.error_m(index).is_infinite() {
            return u32::MAX;
        }
        let own = mesh.node(index).map_or(0, |node| ordered(self.priority.priority(&node)));
        let priority = mesh.parents(index).fold(own, |least, parent| least.min(self.priority(mesh, parent)));
        self.known.insert(index, priority);
        priority
    }
}

impl RoamMesh<'_> {
    /// What priorities are computed from. `None` if no diamond has its middle at this sample.
    pub(super) fn node(&self, index: usize) -> Option<Node> {
        let place = self.field.place(index);
        let diamond = self.diamond(place)?;
        let [low, high] = self.height_range;
        let corner = |place: [u32; 2]| {
            let height = self.field.height(place);
            let z = if height.is_nan() { low } else { height };
            (Vec3::new(place[0] as f32, place[1] as f32, 0.0) * self.step_m).with_z(z)
        };
        let [a, b] = diamond.ends;
        let [c, d] = diamond.apexes.map(|apex| apex.filter(|p| self.field.index(*p).is_some()).unwrap_or(a));
        // Parts of parts reach this many steps away from the middle along an axis.
        let steps = diamond.half as f32 * if diamond.is_square { 3.0 } else { 2.0 };
        let reach = |sign: f32, z: f32| (corner(place) + Vec3::splat(sign * steps * self.step_m)).with_z(z);
        let error_m = self.bounds.error_m(index);
        Some(Node { corners_m: [a, b, c, d].map(corner), reach_m: [reach(-1.0, low), reach(1.0, high)], error_m })
    }
}
