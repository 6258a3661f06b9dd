//! Which nodes a selection reaches, so that others need not be read.

use crate::selection::ObjectSelection;
use crate::source::{ExportSource, SourceError};
use insula_objects::{BLOCK_OBJECTS, ObjectBlock};
use insula_protocol::TileId;
use std::collections::BTreeSet;

/// Nodes along a side of an object's bounds, at most: larger objects are covered by coarser nodes.
const MAX_NODES: u32 = 16;

/// The nodes that a selection may reach.
pub(crate) struct Reach<'a> {
    source: &'a dyn ExportSource,
    selection: &'a ObjectSelection,
    /// Nodes that cover the bounds of the selected objects, and all nodes above those; `None` if the selection names no objects.
    objects: Option<[BTreeSet<TileId>; 2]>,
}

impl<'a> Reach<'a> {
    /// Reads the bounds of the selected objects. Fails if a block of objects cannot be read.
    pub(crate) fn new(source: &'a dyn ExportSource, selection: &'a ObjectSelection) -> Result<Self, SourceError> {
        let mut reach = Self { source, selection, objects: None };
        let Some(selected) = &selection.objects else { return Ok(reach) };
        let mut cover = BTreeSet::new();
        // The last block that was read, with its number.
        let mut last: Option<(u32, Option<ObjectBlock>)> = None;
        for id in selected {
            let number = id / BLOCK_OBJECTS as u32;
            let block = match last.take().filter(|(known, _)| *known == number) {
                Some((_, block)) => block,
                None => source.objects(number)?,
            };
            match block.as_ref().and_then(|block| block.bounds(id)) {
                Some(bounds) => cover.extend(reach.cover([bounds.min, bounds.max])),
                // It may be anywhere, if the city has it at all.
                None => cover.extend(block.as_ref().and_then(|block| block.kind(id)).map(|_| TileId::ROOT)),
            }
            last = Some((number, block));
        }
        let above = cover.iter().flat_map(|node| (0..node.level()).filter_map(|level| node.ancestor(level))).collect();
        reach.objects = Some([cover, above]);
        Ok(reach)
    }

    /// The nodes of one level that cover a box, in decimetres from the city's origin.
    fn cover(&self, bounds: [[i32; 3]; 2]) -> Vec<TileId> {
        let manifest = self.source.manifest();
        let place = |level: u8| {
            let last = (1u32 << level) - 1;
            let side = manifest.node_side_m(level);
            // The cast saturates: a box may reach beyond the city.
            bounds.map(|corner| [0, 1].map(|k| ((f64::from(corner[k]) / 10.0 / side).floor() as u32).min(last)))
        };
        let is_small = |level: &u8| {
            let [min, max] = place(*level);
            (0..2).all(|k| max[k].saturating_sub(min[k]) < MAX_NODES)
        };
        let level = (0..=manifest.depth).rev().find(is_small).unwrap_or(0);
        let [min, max] = place(level);
        let columns = min[0]..=max[0];
        columns.flat_map(|x| (min[1]..=max[1]).filter_map(move |y| TileId::new(level, x, y))).collect()
    }

    /// Whether a node may have something that is selected. Never false if it has.
    pub(crate) fn has(&self, node: TileId) -> bool {
        let manifest = self.source.manifest();
        let [x, y, _] = manifest.node_corner(node);
        let side = manifest.node_side_m(node.level());
        let has_objects = self.objects.as_ref().is_none_or(|[cover, above]| {
            above.contains(&node)
                || (0..=node.level()).filter_map(|level| node.ancestor(level)).any(|above| cover.contains(&above))
        });
        has_objects && self.selection.may_touch([[x, y], [x + side, y + side]])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::glb::test_city::city;

    #[test]
    fn objects_reach_the_nodes_of_their_bounds_only() {
        let mut city = city();
        city.manifest = crate::glb::test_city::manifest(4, 1.0);
        let node = |level, x, y| TileId::new(level, x, y).unwrap();
        // House 4 is at 10 to 22 m to the east and 74 to 86 m to the north of the city's corner, terrain at 0 to 128 m.
        let house = ObjectSelection { objects: Some([4].into_iter().collect()), ..ObjectSelection::default() };
        let reach = Reach::new(&city, &house).unwrap();
        assert!(reach.has(TileId::ROOT) && reach.has(node(2, 0, 0)) && reach.has(node(4, 0, 1)));
        assert!(!reach.has(node(4, 0, 0)) && !reach.has(node(1, 1, 1)));
        let land = ObjectSelection { objects: Some([0].into_iter().collect()), ..ObjectSelection::default() };
        let reach = Reach::new(&city, &land).unwrap();
        assert!(reach.has(node(4, 2, 2)) && !reach.has(node(4, 3, 0)));
        // Objects that do not exist.
        let none = ObjectSelection { objects: Some([2, 9000].into_iter().collect()), ..ObjectSelection::default() };
        assert!(!Reach::new(&city, &none).unwrap().has(TileId::ROOT));
    }

    #[test]
    fn large_objects_are_covered_by_coarser_nodes() {
        let mut city = city();
        city.manifest = crate::glb::test_city::manifest(10, 1.0);
        let everything = ObjectSelection::default();
        let reach = Reach::new(&city, &everything).unwrap();
        let all = reach.cover([[-500, 0, 0], [i32::MAX, 655_359, 10]]);
        assert_eq!((all.len(), all[0].level()), (256, 4));
        assert_eq!(reach.cover([[-9, -9, 0], [-5, -5, 0]]), [TileId::new(10, 0, 0).unwrap()]);
        assert!(reach.has(TileId::new(10, 1023, 1023).unwrap()));
    }
}
