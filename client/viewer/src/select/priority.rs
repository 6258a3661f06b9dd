//! Requests for tiles, and the order in which they are fetched.

use crate::camera::View;
use crate::scene::TileKey;
use glam::DVec3;
use std::cmp::Ordering;

/// A tile is urgent if what is drawn instead of it has more than this multiple of tau as its error: two levels too coarse.
const URGENT_TAU_FACTOR: f64 = 4.0;

/// First criterion of the order: groups are served one after the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PriorityGroup {
    /// In view, and nothing or something much too coarse is drawn instead.
    Urgent,
    /// In view, and something a little too coarse is drawn instead.
    Normal,
    /// Out of view, but its shadow may be in view.
    Shadow,
    /// Needed soon, where the camera is heading.
    Preload,
}

/// Why a tile is requested.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum RequestReason {
    /// Everything else depends on it: the root's tile and subtree, and the subtrees around the eye. First in its group.
    EntryPoint,
    /// A subtree without which a node in view cannot be refined.
    UnknownChildren,
    /// The error is so large that the tile is requested before its visibility is known.
    LargeError,
    /// The last frames' rays hit the node.
    Visible,
    Mesh,
    /// Its shadow may be in view.
    ShadowCaster,
}

/// A tile to fetch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TileRequest {
    pub key: TileKey,
    pub group: PriorityGroup,
    pub reason: RequestReason,
    /// Order within the group, largest first: a screen-space error in pixels. Unused for [`RequestReason::EntryPoint`].
    pub weight_px: f64,
}

impl TileRequest {
    /// An urgent request for a tile that everything else depends on.
    pub(super) fn entry_point(key: TileKey) -> Self {
        Self { key, group: PriorityGroup::Urgent, reason: RequestReason::EntryPoint, weight_px: 0.0 }
    }

    /// Whether the request's weight exceeds `error_px`; entry points exceed any error.
    pub(crate) fn exceeds(&self, error_px: f64) -> bool {
        self.is_entry_point() || self.weight_px > error_px
    }

    fn is_entry_point(&self) -> bool {
        self.reason == RequestReason::EntryPoint
    }

    /// By group, then entry points, then weight; ties are broken by the key, so that equal views give equal orders.
    fn cmp_priority(&self, other: &Self) -> Ordering {
        (self.group.cmp(&other.group))
            .then(other.is_entry_point().cmp(&self.is_entry_point()))
            .then(other.weight_px.total_cmp(&self.weight_px))
            .then(self.key.cmp(&other.key))
    }
}

/// The group of a tile in view; `drawn_error_px` is the error of what is drawn instead, `None` if nothing is.
pub(super) fn group_in_view(drawn_error_px: Option<f64>, tau_px: f64) -> PriorityGroup {
    match drawn_error_px {
        Some(error_px) if error_px <= tau_px * URGENT_TAU_FACTOR => PriorityGroup::Normal,
        _ => PriorityGroup::Urgent,
    }
}

/// The weight of a tile with error `error_px` and centre `centre`: the error, falling to half of it away from the view's
/// direction, because the middle of the frame matters most.
pub(super) fn weight_px(error_px: f64, centre: DVec3, view: &View) -> f64 {
    let towards = (centre - view.camera.position).normalize_or(view.camera.forward);
    error_px * (0.5 + 0.5 * towards.dot(view.camera.forward).max(0.0))
}

/// Sorts requests, most important first.
pub(super) fn sort(requests: &mut [TileRequest]) {
    requests.sort_by(TileRequest::cmp_priority);
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::TileId;

    #[test]
    fn sorts_by_group_then_entry_point_then_weight() {
        assert_eq!(group_in_view(None, 1.0), PriorityGroup::Urgent);
        assert_eq!(group_in_view(Some(4.5), 1.0), PriorityGroup::Urgent);
        assert_eq!(group_in_view(Some(3.0), 1.0), PriorityGroup::Normal);
        let key = TileKey::block_map(TileId::ROOT);
        let mut all = [
            (PriorityGroup::Preload, 9.0),
            (PriorityGroup::Normal, 1.0),
            (PriorityGroup::Normal, 2.0),
            (PriorityGroup::Urgent, 0.1),
        ]
        .map(|(group, weight_px)| TileRequest { key, group, reason: RequestReason::Visible, weight_px })
        .to_vec();
        all.push(TileRequest::entry_point(key));
        sort(&mut all);
        assert_eq!(all.iter().map(|w| w.weight_px).collect::<Vec<_>>(), [0.0, 0.1, 2.0, 1.0, 9.0]);
    }
}
