//! What to fetch first.
//!
//! In: a missing tile, what is drawn in its place. Out: [`TileRequest`] in order. Next: `stream::queue`.

use crate::{camera::View, scene::TileKey};
use glam::DVec3;

/// Drawn coarser than this many times tau: urgent.
const URGENT_TIMES_TAU: f64 = 4.0;

/// Why a tile is wanted; the groups are served in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PriorityGroup {
    /// On screen, nothing or something two levels too coarse is drawn in its place: everybody sees that.
    Urgent,
    /// On screen, something a little too coarse is drawn in its place.
    Normal,
    /// Out of the picture, its shadow is in it.
    Shadow,
    /// Where the camera will be in a moment.
    Preload,
}

/// A tile to fetch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TileRequest {
    /// What.
    pub key: TileKey,
    /// First order.
    pub group: PriorityGroup,
    /// Second order, largest first.
    pub weight: f64,
}

/// The group of a tile in whose place something with `drawn_error_px` is drawn (`None`: nothing).
pub fn group(drawn_error_px: Option<f64>, tau_px: f64) -> PriorityGroup {
    match drawn_error_px {
        Some(error) if error <= tau_px * URGENT_TIMES_TAU => PriorityGroup::Normal,
        _ => PriorityGroup::Urgent,
    }
}

/// `error_px`, down to half of it at the picture's edge: what one looks at comes first.
pub fn weight(error_px: f64, centre: DVec3, view: &View) -> f64 {
    let towards = (centre - view.camera.position).normalize_or(view.camera.forward);
    error_px * (0.5 + 0.5 * towards.dot(view.camera.forward).max(0.0))
}

/// Sorts by group, then weight, then name, so that equal views ask in equal order.
pub fn sort(wanted: &mut [TileRequest]) {
    wanted.sort_by(|a, b| a.group.cmp(&b.group).then(b.weight.total_cmp(&a.weight)).then(a.key.cmp(&b.key)));
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::TileId;

    #[test]
    fn holes_come_before_blur_before_the_future() {
        assert_eq!(group(None, 1.0), PriorityGroup::Urgent);
        assert_eq!(group(Some(4.5), 1.0), PriorityGroup::Urgent);
        assert_eq!(group(Some(3.0), 1.0), PriorityGroup::Normal);
        let key = TileKey::block_map(TileId::ROOT);
        let mut all = [
            (PriorityGroup::Preload, 9.0),
            (PriorityGroup::Normal, 1.0),
            (PriorityGroup::Normal, 2.0),
            (PriorityGroup::Urgent, 0.1),
        ]
        .map(|(group, weight)| TileRequest { key, group, weight });
        sort(&mut all);
        assert_eq!(all.map(|w| w.weight), [0.1, 2.0, 1.0, 9.0]);
    }
}
