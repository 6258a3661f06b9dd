//! How far what a node draws lies from the source, and the source from it.
//!
//! Both are measured at some points of either surface. A leaf is compared with the triangles, a parent with points of its leaves
//! and with its children.

use super::column_field::ColumnField;
use super::voxels::VoxelNode;
use crate::scene::{ObjectKind, Scene};
use glam::{DVec2, DVec3};
use insula_protocol::blockmap::voxel_error_m;
use insula_protocol::subtree::NodeDeviation;
use insula_protocol::{BlockMap, NODE_CELLS};
use insula_simplify::surface::Surface;

/// Share of the measured points that lie within the distance that is selected by, so that 99.9% of all points do.
const SHARE: f64 = 0.9995;
/// Rays that find the points of what is drawn.
const RAYS: usize = 3000;
/// Larger distances count as this, in cells.
const MOST_CELLS: f64 = 32.0;
/// Points nearer to a node's border than this, in cells, do not count: what is nearest may belong to a neighbour.
const MARGIN_CELLS: f64 = 1.0;
/// Rays that find the points of a leaf that its ancestors are compared with.
const LEAF_RAYS: usize = 150;
/// Most such points of a node.
const MAX_POINTS: usize = 6000;

/// The triangles that leaves are compared with: those of a scene without generated ground. `corner` is the root's south-west corner
/// and height zero in the scene's coordinates. `None` without such triangles.
pub(crate) fn source_surface(scene: &Scene, corner: [f64; 3]) -> Option<Surface> {
    let is_source = |object: u32| scene.objects[object as usize].kind != ObjectKind::GeneratedGround;
    let place = |c: [f32; 3]| std::array::from_fn(|axis| f64::from(c[axis]) - corner[axis]);
    let triangles = scene.triangles.iter().filter(|triangle| is_source(triangle.object));
    Surface::new(triangles.map(|triangle| triangle.corners.map(place)).collect())
}

/// The distances of a leaf from the surface around it; none without one.
pub(crate) fn of_leaf(map: &BlockMap, node: &VoxelNode, source: Option<&Surface>) -> NodeDeviation {
    let cell_m = f64::from(map.cell_m);
    let (Some(field), Some(source)) = (ColumnField::new([map]), source) else { return NodeDeviation::default() };
    let drawn = field.seen_points(RAYS, MARGIN_CELLS * cell_m).into_iter();
    let drawn = drawn.map(|p| source.distance(p.to_array()).min(MOST_CELLS * cell_m)).collect();
    deviation(drawn, to_field(map, &field, &node.surface))
}

/// Points on what a leaf draws, more of them the larger its surface is: metres from the root's corner and above height zero.
pub(crate) fn leaf_points(map: &BlockMap) -> Vec<[f32; 3]> {
    let points = ColumnField::new([map]).map(|field| field.seen_points(LEAF_RAYS, 0.0));
    points.unwrap_or_default().into_iter().map(|p| p.as_vec3().to_array()).collect()
}

/// At most [`MAX_POINTS`] of the points, evenly spread over them.
pub(crate) fn spread(points: Vec<[f32; 3]>) -> Vec<[f32; 3]> {
    let (count, kept) = (points.len(), points.len().min(MAX_POINTS));
    (0..kept).map(|i| points[i * count / kept]).collect()
}

/// The leaves of a node whose children are no leaves.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FarLeaves<'a> {
    /// Points on what they draw.
    pub(crate) points: &'a [[f32; 3]],
    pub(crate) cell_m: f64,
}

/// The distances of a parent from the source. `below` are the largest ones of its children.
///
/// From the source to what is drawn, points of the leaves tell the distances: half the diagonal of their voxels is added. If the
/// children are leaves, their own distances are added. In the other direction, only the children are known. What is drawn but not
/// there comes from one level in most cases, at which the distance from the other ones is a usual one: half the diagonal of a
/// child's voxel.
pub(crate) fn of_parent<'a>(
    map: &BlockMap,
    children: impl Iterator<Item = &'a BlockMap>,
    below: &NodeDeviation,
    far_leaves: Option<FarLeaves<'_>>,
) -> NodeDeviation {
    let (Some(own), Some(finer)) = (ColumnField::new([map]), ColumnField::new(children)) else { return *below };
    let cell_m = f64::from(map.cell_m);
    let points = |field: &ColumnField| field.seen_points(RAYS, MARGIN_CELLS * cell_m).into_iter();
    let drawn = points(&own).map(|p| finer.distance_m(p, MOST_CELLS * cell_m)).collect();
    let (source, leaf_m) = match far_leaves {
        Some(leaves) => (to_field(map, &own, leaves.points), [voxel_error_m(leaves.cell_m) as f32; 2]),
        None => {
            let source = points(&finer).map(|p| own.distance_m(p, MOST_CELLS * cell_m)).collect();
            (source, [below.source_m, below.source_max_m])
        }
    };
    let steps = deviation(drawn, source);
    let usual_m = voxel_error_m(cell_m / 2.0) as f32;
    NodeDeviation {
        drawn_m: steps.drawn_m + usual_m,
        drawn_max_m: steps.drawn_max_m + below.drawn_max_m,
        source_m: steps.source_m + leaf_m[0],
        source_max_m: steps.source_max_m + leaf_m[1],
    }
    .max(below)
    .rounded()
}

/// Distances of those of the points from what the node draws that do not lie at its border.
fn to_field(map: &BlockMap, field: &ColumnField, points: &[[f32; 3]]) -> Vec<f64> {
    let cell_m = f64::from(map.cell_m);
    let corner = DVec2::new(f64::from(map.id.x()), f64::from(map.id.y())) * NODE_CELLS as f64;
    let is_inner = |p: &DVec3| {
        let place = p.truncate() / cell_m - corner;
        place.min_element() > MARGIN_CELLS && place.max_element() < NODE_CELLS as f64 - MARGIN_CELLS
    };
    let points = points.iter().map(|p| DVec3::from(p.map(f64::from))).filter(is_inner);
    points.map(|p| field.distance_m(p, MOST_CELLS * cell_m)).collect()
}

fn deviation(drawn: Vec<f64>, source: Vec<f64>) -> NodeDeviation {
    let [[drawn_m, drawn_max_m], [source_m, source_max_m]] = [drawn, source].map(|mut distances| {
        distances.sort_unstable_by(f64::total_cmp);
        let at = (SHARE * distances.len() as f64).ceil() as usize;
        let metres = |at: usize| distances.get(at).map_or(0.0, |m| *m as f32);
        [metres(at.saturating_sub(1)), metres(distances.len().saturating_sub(1))]
    });
    // As in subtrees, so that an updated city equals a new one.
    NodeDeviation { drawn_m, drawn_max_m, source_m, source_max_m }.rounded()
}
