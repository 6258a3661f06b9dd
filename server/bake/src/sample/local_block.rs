//! A block's triangles in its own coordinates.
//!
//! In: [`BlockInput`]. Out: [`LocalBlock`]. Next: every other step of `sample`.

use crate::sample::settings::{BlockInput, SampleSettings};
use crate::scene::ObjectKind;
use glam::{DMat3, DVec3, Vec3};
use insula_protocol::NODE_CELLS;
use std::collections::HashMap;

/// Normals that rise more than this belong to a top, those that fall more to an underside, the others to walls.
pub(super) const TOP_Z: f32 = 0.35;
/// A triangle, metres from the block's south-west corner at the grid's height zero.
#[derive(Debug, Clone, Copy)]
pub(super) struct LocalTriangle {
    pub(super) corners: [Vec3; 3],
    /// Unit normal as the source turns it; terrain's points up.
    pub(super) normal: Vec3,
    pub(super) area_m2: f32,
    pub(super) terrain: bool,
    pub(super) object: u32,
    /// Lowest point of its object.
    pub(super) base_z_m: f32,
    /// West, south, east and north end of its object.
    pub(super) footprint_m: [f32; 4],
    /// Whether its object is a closed shell, turned outwards: then backs are never seen, and fronts are in their way.
    pub(super) closed: bool,
    /// Index into the scene's triangles.
    pub(super) source: u32,
}

/// A rectangle of whole leaves, and all triangles around it.
#[derive(Debug)]
pub(super) struct LocalBlock {
    pub(super) triangles: Vec<LocalTriangle>,
    pub(super) cell_m: f32,
    /// Width and height in cells.
    pub(super) cells: [usize; 2],
    /// South-west leaf, in leaves of the city.
    pub(super) first_leaf: [u32; 2],
    /// Lowest and highest point of what lies inside.
    pub(super) z_range: [f32; 2],
    /// How many directions over the horizon it is looked at from.
    pub(super) sky_directions: u32,
}

impl LocalBlock {
    /// `None` without leaves.
    pub(super) fn new(input: &BlockInput<'_>, settings: &SampleSettings) -> Option<Self> {
        let xs = input.leaves.iter().map(|l| l.x());
        let ys = input.leaves.iter().map(|l| l.y());
        let first_leaf = [xs.clone().min()?, ys.clone().min()?];
        let count = [xs.max()? - first_leaf[0] + 1, ys.max()? - first_leaf[1] + 1];
        let side = input.grid.node_side_m(input.grid.depth);
        let corner = [
            input.grid.corner[0] + f64::from(first_leaf[0]) * side,
            input.grid.corner[1] + f64::from(first_leaf[1]) * side,
            input.grid.corner[2],
        ];
        let mut triangles: Vec<LocalTriangle> =
            input.triangles.iter().filter_map(|i| local(input, *i, corner)).collect();
        find_footprints(&mut triangles);
        find_closed(&mut triangles);
        let extent = count.map(|n| (f64::from(n) * side) as f32);
        let z_range = heights(&triangles, extent);
        let cells = count.map(|n| n as usize * NODE_CELLS);
        let (cell_m, sky_directions) = (input.grid.cell_m as f32, settings.sky_directions);
        Some(Self { triangles, cell_m, cells, first_leaf, z_range, sky_directions })
    }

    /// Width and height in metres.
    pub(super) fn extent_m(&self) -> [f32; 2] {
        self.cells.map(|n| n as f32 * self.cell_m)
    }
}

fn local(input: &BlockInput<'_>, index: u32, corner: [f64; 3]) -> Option<LocalTriangle> {
    let triangle = input.scene.triangles.get(index as usize)?;
    let object = input.scene.objects.get(triangle.object as usize)?;
    let corners = triangle
        .corners
        .map(|c| Vec3::from_array(std::array::from_fn(|axis| (f64::from(c[axis]) - corner[axis]) as f32)));
    let cross = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let length = cross.length();
    if !length.is_finite() || length <= 1e-9 {
        return None;
    }
    let terrain = object.kind == ObjectKind::Terrain;
    let normal = cross / length;
    Some(LocalTriangle {
        corners,
        normal: if terrain && normal.z < 0.0 { -normal } else { normal },
        area_m2: length * 0.5,
        terrain,
        object: triangle.object,
        base_z_m: (f64::from(object.base_z_m) - corner[2]) as f32,
        footprint_m: [0.0; 4],
        closed: false,
        source: index,
    })
}

/// Extents of the objects, as far as their triangles are here.
fn find_footprints(triangles: &mut [LocalTriangle]) {
    const NOTHING: [f32; 4] = [f32::MAX, f32::MAX, f32::MIN, f32::MIN];
    let mut extents: HashMap<u32, [f32; 4]> = HashMap::new();
    for triangle in triangles.iter() {
        let e = extents.entry(triangle.object).or_insert(NOTHING);
        for c in triangle.corners {
            *e = [e[0].min(c.x), e[1].min(c.y), e[2].max(c.x), e[3].max(c.y)];
        }
    }
    for triangle in triangles {
        triangle.footprint_m = extents.get(&triangle.object).copied().unwrap_or(NOTHING);
    }
}

/// Marks the triangles of closed shells. An object's triangles follow each other.
fn find_closed(triangles: &mut [LocalTriangle]) {
    for object in triangles.chunk_by_mut(|a, b| a.object == b.object) {
        let closed = !object[0].terrain && is_closed(object);
        object.iter_mut().for_each(|triangle| triangle.closed = closed);
    }
}

/// Divergence theorem: over a closed surface the normals' integral is zero, and that of position times normal is the
/// volume times the unit matrix. It needs no common vertices, so that a corner on another polygon's edge does no harm.
fn is_closed(triangles: &[LocalTriangle]) -> bool {
    /// Share of the surface (of the volume) that may be missing.
    const TOLERANCE: f64 = 1e-4;
    let origin = triangles[0].corners[0].as_dvec3();
    let (mut area, mut surface, mut moment) = (DVec3::ZERO, 0.0, DMat3::ZERO);
    for triangle in triangles {
        let [a, b, c] = triangle.corners.map(|corner| corner.as_dvec3() - origin);
        let normal = (b - a).cross(c - a) * 0.5;
        let middle = (a + b + c) / 3.0;
        area += normal;
        surface += normal.length();
        moment += DMat3::from_cols(middle * normal.x, middle * normal.y, middle * normal.z);
    }
    let volume = (moment.x_axis.x + moment.y_axis.y + moment.z_axis.z) / 3.0;
    let off = (moment - DMat3::from_diagonal(DVec3::splat(volume))).to_cols_array();
    let size = off.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    volume > 0.0 && area.length() < TOLERANCE * surface && size < TOLERANCE * 10.0 * volume
}

/// Of what overlaps the block; `[0, 0]` if nothing does.
fn heights(triangles: &[LocalTriangle], extent: [f32; 2]) -> [f32; 2] {
    let inside = |t: &&LocalTriangle| {
        let low = t.corners.iter().fold(Vec3::MAX, |m, c| m.min(*c));
        let high = t.corners.iter().fold(Vec3::MIN, |m, c| m.max(*c));
        low.x < extent[0] && low.y < extent[1] && high.x > 0.0 && high.y > 0.0
    };
    let range = triangles
        .iter()
        .filter(inside)
        .flat_map(|t| t.corners)
        .fold([f32::MAX, f32::MIN], |[low, high], c| [low.min(c.z), high.max(c.z)]);
    if range[0] > range[1] { [0.0; 2] } else { range }
}

#[cfg(test)]
mod tests {
    use crate::sample::local_block::*;

    /// A box of 4 x 3 x 2 m; the first triangle of the floor is `0`, of the top `2`, of the walls `4`.
    fn shell() -> Vec<LocalTriangle> {
        let corner = |i: usize| Vec3::new((i & 1) as f32 * 4.0, (i >> 1 & 1) as f32 * 3.0, (i >> 2) as f32 * 2.0);
        const FACES: [[usize; 4]; 6] =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [3, 2, 6, 7], [2, 0, 4, 6], [1, 3, 7, 5]];
        FACES.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).map(|t| triangle(t.map(corner))).collect()
    }

    fn triangle(corners: [Vec3; 3]) -> LocalTriangle {
        LocalTriangle {
            corners,
            normal: Vec3::Z,
            area_m2: 1.0,
            terrain: false,
            object: 0,
            base_z_m: 0.0,
            footprint_m: [0.0; 4],
            closed: false,
            source: 0,
        }
    }

    #[test]
    fn only_whole_shells_that_face_outwards_are_closed() {
        assert!(is_closed(&shell()));
        let inside_out: Vec<_> = shell().iter().map(|t| triangle([t.corners[0], t.corners[2], t.corners[1]])).collect();
        assert!(!is_closed(&inside_out));
        for missing in [0..1, 0..2, 0..4, 4..8, 0..12] {
            let mut open = shell();
            open.drain(missing);
            assert!(open.is_empty() || !is_closed(&open));
        }
        let mut split = shell();
        // One half of the top, cut at the middle of an edge that the wall below does not know.
        let [a, b, c] = split[2].corners;
        split[2] = triangle([a, (a + b) * 0.5, c]);
        split.push(triangle([(a + b) * 0.5, b, c]));
        assert!(is_closed(&split));
    }
}
