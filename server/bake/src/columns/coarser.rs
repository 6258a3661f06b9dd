//! Whether a node shows the same as its children: level or evenly inclined ground of one colour and object, such as water and fields.
//! Then the children are not needed.

use insula_protocol::blockmap::{COLUMNS, NO_OBJECT, flag};
use insula_protocol::{BlockMap, NODE_CELLS, octahedral};

/// Largest distance between the tops of a node and of its children, in cells of a leaf.
const TOP_LEAF_CELLS: f32 = 0.125;
/// Largest difference of 8-bit colours.
const COLOUR: u8 = 3;
/// Largest difference of the occlusion, which is 0 to 63.
const OCCLUSION: u8 = 2;
/// Least cosine between normals: 3 degrees.
const NORMAL: f32 = 0.9986;
/// What a column must not have: children show its details.
const DETAILS: u8 = flag::EXPOSED | flag::GAP | flag::HOLES | flag::CLIPPED;

/// Whether `map` shows what its children do, within a part of a leaf's cell and of what one sees as different colours.
pub(crate) fn shows_children(map: &BlockMap, children: [Option<&BlockMap>; 4], leaf_cell_m: f32) -> bool {
    if map.ground.is_some() || map.flags.iter().any(|flags| flags & DETAILS != 0) {
        return false;
    }
    (0..4).zip(children).all(|(quadrant, child)| match child {
        Some(child) => {
            let is_plain = child.ground.is_none() && child.flags.iter().all(|flags| flags & DETAILS == 0);
            is_plain && (0..COLUMNS).all(|column| shows_column(map, child, quadrant, column, leaf_cell_m))
        }
        None => (0..COLUMNS).all(|column| map.flags[parent_column(quadrant, column)] & flag::OCCUPIED == 0),
    })
}

/// The column of a node over a child's column.
fn parent_column(quadrant: usize, column: usize) -> usize {
    let [x, y] = [column % NODE_CELLS, column / NODE_CELLS];
    let half = NODE_CELLS / 2;
    (y / 2 + (quadrant >> 1) * half) * NODE_CELLS + x / 2 + (quadrant & 1) * half
}

fn shows_column(map: &BlockMap, child: &BlockMap, quadrant: usize, column: usize, leaf_cell_m: f32) -> bool {
    let own = parent_column(quadrant, column);
    if (map.flags[own] ^ child.flags[column]) & !flag::INCLINED != 0 {
        return false;
    }
    if child.flags[column] & flag::OCCUPIED == 0 {
        return true;
    }
    let object = |map: &BlockMap, i: usize| map.objects.as_ref().map_or(NO_OBJECT, |objects| objects.roof[i]);
    if object(map, own) != object(child, column) {
        return false;
    }
    let (a, b) = (map.roof[own], child.roof[column]);
    let is_same_colour = a.rgb().iter().zip(b.rgb()).all(|(a, b)| a.abs_diff(b) <= COLOUR);
    let normals = [map.roof_normal[own], child.roof_normal[column]].map(octahedral::decode);
    let cosine: f32 = normals[0].iter().zip(normals[1]).map(|(a, b)| a * b).sum();
    if !is_same_colour || a.ao().abs_diff(b.ao()) > OCCLUSION || cosine < NORMAL {
        return false;
    }
    // From the middle of the node's column to the corners of the child's, in cells of the child.
    let ends = |along: usize| [-1.0, 0.0].map(|low: f32| low + (along % 2) as f32);
    let (xs, ys) = (ends(column % NODE_CELLS), ends(column / NODE_CELLS));
    let (middle_x, middle_y) = (xs[0] + 0.5, ys[0] + 0.5);
    let corners = xs.iter().flat_map(|x| ys.map(|y| [*x, y]));
    corners.into_iter().all(|[x, y]| {
        let cell_m = child.cell_m;
        let expected = top_m(child, column, [(x - middle_x) * cell_m, (y - middle_y) * cell_m]);
        (top_m(map, own, [x * cell_m, y * cell_m]) - expected).abs() <= TOP_LEAF_CELLS * leaf_cell_m
    })
}

/// Height of a column's top at a place from its middle, in metres above the city's origin.
fn top_m(map: &BlockMap, column: usize, from_middle_m: [f32; 2]) -> f32 {
    let level_m = map.z_base_m() as f32 + f32::from(map.z_max[column]) * map.z_step_m();
    if map.flags[column] & flag::INCLINED == 0 {
        return level_m;
    }
    let [nx, ny, nz] = octahedral::decode(map.roof_normal[column]);
    level_m - (nx * from_middle_m[0] + ny * from_middle_m[1]) / nz.max(f32::EPSILON)
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::blockmap::MapColumn;
    use insula_protocol::{Texel, TileId};

    const LEAF_CELL_M: f32 = 1.0;

    /// A node in which each column is as `column` makes it, of its middle in metres from the parent's corner.
    fn node(id: TileId, cell_m: f32, column: impl Fn(f32, f32) -> Option<MapColumn>) -> BlockMap {
        let corner = if id.level() == 0 { [0.0; 2] } else { [id.x(), id.y()].map(|n| n as f32 * 64.0 * cell_m) };
        let all: Vec<Option<MapColumn>> = (0..COLUMNS)
            .map(|i| {
                let [x, y] = [i % NODE_CELLS, i / NODE_CELLS].map(|n| (n as f32 + 0.5) * cell_m);
                column(corner[0] + x, corner[1] + y)
            })
            .collect();
        BlockMap::from_columns(id, cell_m, 0, 0, &all).unwrap()
    }

    /// Whether a root shows its four children, all made by the same rule; the root's heights have codes half as fine.
    fn is_shown(column: impl Fn(f32, f32, f32) -> Option<MapColumn>) -> bool {
        let root = node(TileId::ROOT, 2.0, |x, y| column(x, y, 8.0));
        let children = [0, 1, 2, 3].map(|q| node(TileId::ROOT.child(q).unwrap(), 1.0, |x, y| column(x, y, 16.0)));
        shows_children(&root, children.each_ref().map(Some), LEAF_CELL_M)
    }

    fn ground(height_m: f32, codes_per_m: f32, normal: [f32; 3]) -> Option<MapColumn> {
        Some(MapColumn {
            z_max: (height_m * codes_per_m).round() as u16,
            inclined: normal[2] < 1.0,
            roof: Texel::new([90, 100, 80], 60),
            roof_normal: octahedral::encode(normal),
            ..MapColumn::default()
        })
    }

    const UP: [f32; 3] = [0.0, 0.0, 1.0];

    #[test]
    fn level_and_inclined_ground_is_shown() {
        assert!(is_shown(|_, _, codes| ground(12.0, codes, UP)));
        assert!(is_shown(|_, _, codes| ground(12.06, codes, UP)), "within the steps of heights");
        // The normal's bytes have this slope exactly.
        let normal = octahedral::decode(octahedral::encode([-0.2, 0.1, 1.0]));
        let slope = |x: f32, y: f32| 40.0 - (normal[0] * x + normal[1] * y) / normal[2];
        assert!(is_shown(|x, y, codes| ground(slope(x, y), codes, normal)));
        assert!(is_shown(|x, _, codes| if x < 64.0 { ground(12.0, codes, UP) } else { None }));
    }

    #[test]
    fn details_are_not_shown() {
        let ripples =
            |x: f32, _: f32, codes: f32| ground(if (x as u32).is_multiple_of(2) { 12.0 } else { 12.5 }, codes, UP);
        assert!(!is_shown(ripples));
        assert!(!is_shown(|x, _, codes| {
            let column = ground(12.0, codes, UP)?;
            let roof = if x as u32 == 71 { Texel::new([98, 100, 80], 60) } else { column.roof };
            Some(MapColumn { roof, ..column })
        }));
        assert!(!is_shown(|x, _, codes| if x as u32 == 70 { None } else { ground(12.0, codes, UP) }));
        assert!(!is_shown(|x, _, codes| {
            let column = ground(12.0, codes, UP)?;
            Some(MapColumn { reflective: x as u32 == 70, ..column })
        }));
        // Three children and a root that goes on under the missing one.
        let root = node(TileId::ROOT, 2.0, |_, _| ground(12.0, 8.0, UP));
        let child = |q| node(TileId::ROOT.child(q).unwrap(), 1.0, |_, _| ground(12.0, 16.0, UP));
        let children = [child(0), child(1), child(2)];
        let [a, b, c] = children.each_ref().map(Some);
        assert!(!shows_children(&root, [a, b, c, None], LEAF_CELL_M));
        let part = node(TileId::ROOT, 2.0, |x, y| ground(12.0, 8.0, UP).filter(|_| x < 64.0 || y < 64.0));
        assert!(shows_children(&part, [a, b, c, None], LEAF_CELL_M));
    }
}
