//! Keys of diamonds in the queues of one update.

use super::dynamic::RoamMesh;
use super::priority::{Key, Node, Priority, ordered};
use glam::Vec3;
use std::collections::HashMap;

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
