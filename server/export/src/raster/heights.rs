//! The heights of a node's cells.

use super::NODATA;
use crate::selection::ObjectSelection;
use insula_protocol::{
    BlockMap, Manifest, NODE_CELLS,
    blockmap::{COLUMNS, NO_OBJECT, flag},
};

/// World heights of the cells of a node, row-major from the south-west.
pub(super) struct NodeHeights(Vec<f32>);

impl NodeHeights {
    pub(super) fn of(manifest: &Manifest, map: BlockMap, selection: &ObjectSelection) -> Self {
        // The objects of columns do not change by the ground below them. Where it adds a column, there is no object.
        let objects = map.objects.clone();
        let map = map.stand_on_ground();
        let base = manifest.origin[2] + map.z_base_m();
        let step = f64::from(map.z_step_m());
        let is_selected = |object: Option<u32>| {
            selection
                .objects
                .as_ref()
                .is_none_or(|all| object.is_some_and(|object| object != NO_OBJECT && all.contains(object)))
        };
        let mut clips = map.clips.iter();
        let mut heights = vec![NODATA; COLUMNS];
        for (cell, height) in heights.iter_mut().enumerate() {
            let flags = map.flags[cell];
            if flags & flag::OCCUPIED == 0 {
                continue;
            }
            let clip = if flags & flag::CLIPPED != 0 { clips.next() } else { None };
            let outer = clip.filter(|clip| !is_inside(clip)).and_then(|clip| clip.outer);
            let (code, object) = match outer {
                Some(outer) => (outer.z, objects.as_ref().map(|objects| objects.lower[cell])),
                None => (map.z_max[cell], objects.as_ref().map(|objects| objects.roof[cell])),
            };
            if is_selected(object) {
                *height = (base + f64::from(code) * step) as f32;
            }
        }
        Self(heights)
    }

    pub(super) fn at(&self, [x, y]: [usize; 2]) -> f32 {
        self.0.get(y * NODE_CELLS + x).copied().unwrap_or(NODATA)
    }
}

/// Whether the middle of a cell is on the inner side of the wall: not beyond its planes.
fn is_inside(clip: &insula_protocol::blockmap::ColumnClip) -> bool {
    let first = clip.offset >= 0;
    match clip.corner {
        None => first,
        Some(corner) if corner.concave => first || corner.offset >= 0,
        Some(corner) => first && corner.offset >= 0,
    }
}
