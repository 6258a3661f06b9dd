//! How much there is in a block of leaves, by which its memory is estimated before it is baked.

use crate::scene::SceneTriangle;

/// Amount of what is in a block, without its margin. Areas are upper bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct BlockContent {
    pub(crate) triangles: u64,
    pub(crate) surface_m2: f64,
    /// Area of the surface seen from above, overlaps counted each.
    pub(crate) flat_m2: f64,
    /// Lowest and highest point of the triangles.
    pub(crate) z_range_m: [f32; 2],
}

impl Default for BlockContent {
    fn default() -> Self {
        Self { triangles: 0, surface_m2: 0.0, flat_m2: 0.0, z_range_m: [f32::MAX, f32::MIN] }
    }
}

impl BlockContent {
    /// Adds a triangle, as far as it is in the square with south-west corner `low` and side `side_m`.
    pub(super) fn add(&mut self, triangle: &TriangleExtent, low: [f64; 2], side_m: f64) {
        let TriangleExtent { xy, area_m2, flat_area_m2, z_range_m } = triangle;
        let overlap: [f64; 2] =
            std::array::from_fn(|axis| xy[axis][1].min(low[axis] + side_m) - xy[axis][0].max(low[axis]));
        if overlap[0] < 0.0 || overlap[1] < 0.0 {
            return;
        }
        // A slab of a share of the extent contains less than twice that share of a triangle.
        let share = [0, 1].map(|axis: usize| {
            let extent_m = xy[axis][1] - xy[axis][0];
            if extent_m > 0.0 { (2.0 * overlap[axis] / extent_m).min(1.0) } else { 1.0 }
        });
        let share = share[0].min(share[1]);
        let flat_m2 = (flat_area_m2 * share).min(overlap[0] * overlap[1]);
        let slope = if *flat_area_m2 > 0.0 { area_m2 / flat_area_m2 } else { f64::INFINITY };
        self.triangles += 1;
        self.surface_m2 += (area_m2 * share).min(if flat_m2 > 0.0 { flat_m2 * slope } else { f64::INFINITY });
        self.flat_m2 += flat_m2;
        self.z_range_m = [self.z_range_m[0].min(z_range_m[0]), self.z_range_m[1].max(z_range_m[1])];
    }
}

/// Extent and area of a triangle.
pub(super) struct TriangleExtent {
    /// West and east end, south and north end, in metres from the grid's corner.
    xy: [[f64; 2]; 2],
    area_m2: f64,
    /// Seen from above.
    flat_area_m2: f64,
    z_range_m: [f32; 2],
}

impl TriangleExtent {
    /// `p` are the corners seen from above, in metres from the grid's corner.
    pub(super) fn new(triangle: &SceneTriangle, p: &[[f64; 2]; 3]) -> Self {
        let [a, b, c] = triangle.corners.map(glam::Vec3::from_array);
        let normal = (b - a).cross(c - a);
        let (area_m2, flat_area_m2) = (f64::from(normal.length()) * 0.5, f64::from(normal.z.abs()) * 0.5);
        Self { xy: [span(p, 0), span(p, 1)], area_m2, flat_area_m2, z_range_m: [a.min(b).min(c).z, a.max(b).max(c).z] }
    }
}

/// Lowest and highest coordinate along an axis.
pub(super) fn span(p: &[[f64; 2]; 3], axis: usize) -> [f64; 2] {
    let v = p.map(|corner| corner[axis]);
    [v[0].min(v[1]).min(v[2]), v[0].max(v[1]).max(v[2])]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_bounds_what_is_in_a_block() {
        // A wall of 10 m in each of two blocks, a floor of a quarter of a block, a plane over all blocks.
        let wall = [[118.0, 5.0, 0.0], [138.0, 5.0, 0.0], [118.0, 5.0, 1000.0]];
        let floor = [[0.0, 0.0, 0.0], [64.0, 0.0, 0.0], [0.0, 128.0, 0.0]];
        let plane = [[-1000.0, -1000.0, 1.0], [5000.0, -1000.0, 1.0], [-1000.0, 5000.0, 1.0]];
        let content = |corners: [[f32; 3]; 3]| {
            let mut all = BlockContent::default();
            let triangle = SceneTriangle { corners, uv: [[0.0; 2]; 3], material: 0, object: 0 };
            let xy = corners.map(|[x, y, _]| [f64::from(x), f64::from(y)]);
            all.add(&TriangleExtent::new(&triangle, &xy), [0.0; 2], 128.0);
            all
        };
        let [wall, floor, plane] = [wall, floor, plane].map(content);
        assert_eq!((wall.surface_m2, wall.flat_m2, wall.z_range_m), (10_000.0, 0.0, [0.0, 1000.0]));
        assert_eq!((floor.surface_m2, floor.flat_m2), (4096.0, 4096.0));
        assert_eq!((plane.surface_m2, plane.triangles), (128.0 * 128.0, 1));
        assert_eq!(content([[129.0, 0.0, 0.0], [140.0, 0.0, 0.0], [129.0, 9.0, 0.0]]), BlockContent::default());
    }
}
