//! The tops of a node's cells.

use insula_protocol::blockmap::{COLUMNS, ColumnClip, NO_OBJECT, flag};
use insula_protocol::{BlockMap, Manifest};

/// What lies at the middle of a cell, seen from above.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellTop {
    /// World metres.
    pub height: f32,
    /// [`NO_OBJECT`] where there is none, as on generated ground.
    pub object: u32,
    /// Direction of the normal of the wall below the top in 1/256 turns, 0 east, 64 north; `None` without a wall.
    pub wall: Option<u8>,
    /// Octahedral code of the normal of a slope; `None` of a level top.
    pub normal: Option<u16>,
    /// Whether it is generated ground, where the source has nothing.
    pub is_generated: bool,
}

/// The tops of the columns, row-major from the south-west. Where a wall cuts a column and the middle of its cell lies beyond the wall,
/// the top there.
pub(super) fn node_tops(manifest: &Manifest, map: BlockMap) -> Vec<Option<CellTop>> {
    // The objects of columns do not change by the ground below them. Where it adds a column, there is no object.
    let objects = map.objects.clone();
    let given: Vec<bool> = map.flags.iter().map(|flags| flags & flag::OCCUPIED != 0).collect();
    let map = map.stand_on_ground();
    let base = manifest.origin[2] + map.z_base_m();
    let step = f64::from(map.z_step_m());
    let mut clips = map.clips.iter();
    let mut tops = vec![None; COLUMNS];
    for (cell, top) in tops.iter_mut().enumerate() {
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
        let wall = (outer.is_none() && flags & flag::EXPOSED != 0).then(|| map.wall_azimuth[cell]);
        let is_slope = outer.is_none() && flags & flag::INCLINED != 0;
        let normal = is_slope.then(|| map.roof_normal[cell]);
        let height = (base + f64::from(code) * step) as f32;
        let (object, is_generated) = (object.unwrap_or(NO_OBJECT), !given[cell]);
        *top = Some(CellTop { height, object, wall, normal, is_generated });
    }
    tops
}

/// Whether the middle of a cell is on the inner side of the wall: not beyond its planes.
fn is_inside(clip: &ColumnClip) -> bool {
    let first = clip.offset >= 0;
    match clip.corner {
        None => first,
        Some(corner) if corner.concave => first || corner.offset >= 0,
        Some(corner) => first && corner.offset >= 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::test_city::manifest;
    use insula_protocol::TileId;
    use insula_protocol::blockmap::NodeGround;

    #[test]
    fn ground_that_the_source_does_not_have_is_marked() {
        let mut map = BlockMap::empty(TileId::ROOT, 0.5, 0, 0);
        map.flags[7] = flag::OCCUPIED;
        map.z_max[7] = 400;
        map.ground = Some(Box::new(NodeGround { squares: u64::MAX, ..NodeGround::default() }));
        let tops = node_tops(&manifest(2), map);
        let marks: Vec<bool> = tops.iter().flatten().map(|top| top.is_generated).collect();
        let given: Vec<usize> = (0..marks.len()).filter(|cell| !marks[*cell]).collect();
        assert_eq!((marks.len(), given), (COLUMNS, vec![7]));
    }
}
