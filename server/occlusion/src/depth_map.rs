//! Depth maps of one pair of opposite directions (Mischitelli 2007, 3.2.1), drawn on the CPU.
//!
//! One drawing serves both directions: the first sees what is nearest to its viewer, the other what is farthest from him.
//! Coverage is exact, by whole numbers and the rule of all GPUs: a triangle covers a texel whose centre it contains, and a
//! centre on an edge belongs to the triangle of which it is a top or left edge.

use crate::prepared::SUBTEXEL_BITS;
use glam::{BVec4A, Vec4};

/// Steps of a texel.
const TEXEL: i32 = 1 << SUBTEXEL_BITS;
/// Steps from a texel's corner to its centre.
const HALF: i32 = TEXEL / 2;
/// Texels that are drawn at once.
const LANES: usize = 4;
/// Triangles below this number of steps are small: all values of their edges, at most 2^24, are exact in 32 bits.
const SMALL: i32 = 128 * TEXEL;
/// Triangles that are seen from the side lose digits of their depths. Beyond this slope, in steps for each texel, depths are
/// kept within those of the corners.
const MAX_EXACT_SLOPE: f32 = (1 << 22) as f32;

/// Texels from the first of a group.
const STEPS: Vec4 = Vec4::new(0.0, 1.0, 2.0, 3.0);

/// Depths of texels that lie side by side.
#[derive(Debug, Clone, Copy)]
struct TexelGroup {
    /// Largest depth towards the viewer.
    near: Vec4,
    /// Smallest depth.
    far: Vec4,
}

const EMPTY: TexelGroup = TexelGroup { near: Vec4::splat(f32::MIN), far: Vec4::splat(f32::MAX) };

pub(crate) struct DepthMap {
    size_px: u32,
    groups_per_row: usize,
    groups: Vec<TexelGroup>,
}

/// A projected vertex: right and down in steps of a texel, then its depth towards the viewer.
pub(crate) type Projected = [i32; 3];

/// A line between two corners: at least 0 inside of the triangle, including edges that own their points. Between centres of
/// texels, products change by multiples of [`TEXEL`], so that only their quotients by it are kept.
#[derive(Debug, Clone, Copy)]
struct Edge {
    /// Value at the centre of the first texel of the bounding box.
    value: i64,
    /// What a step of one texel adds.
    right: i64,
    down: i64,
}

/// Depth on the plane of a triangle.
#[derive(Debug, Clone, Copy)]
struct DepthPlane {
    /// At the centre of the first texel of the bounding box.
    value: f32,
    /// What a step of one texel adds.
    right: f32,
    down: f32,
    /// Depths of the corners limit the rounding errors of triangles that are seen from the side.
    low: f32,
    high: f32,
}

/// Texels whose centres may be covered.
#[derive(Debug, Clone, Copy)]
struct TexelBox {
    x: [i32; 2],
    y: [i32; 2],
}

impl DepthMap {
    pub(crate) fn new(size_px: u32) -> Self {
        let groups_per_row = (size_px as usize).div_ceil(LANES);
        Self { size_px, groups_per_row, groups: vec![EMPTY; groups_per_row * size_px as usize] }
    }

    pub(crate) fn bytes(size_px: u32) -> usize {
        (size_px as usize).div_ceil(LANES) * size_px as usize * size_of::<TexelGroup>()
    }

    pub(crate) fn clear(&mut self) {
        self.groups.fill(EMPTY);
    }

    /// Nearest and farthest depth at a texel; [`f32::MIN`] and [`f32::MAX`] where nothing is.
    #[inline(always)]
    pub(crate) fn depths(&self, x: i32, y: i32) -> [f32; 2] {
        let at = y as usize * self.groups_per_row + x as usize / LANES;
        let group = self.groups.get(at).unwrap_or(&EMPTY);
        [group.near[x as usize % LANES], group.far[x as usize % LANES]]
    }

    /// Draws a triangle, seen from either side.
    #[inline]
    pub(crate) fn draw(&mut self, a: Projected, b: Projected, c: Projected) {
        let (left, right) = (a[0].min(b[0]).min(c[0]), a[0].max(b[0]).max(c[0]));
        let (top, bottom) = (a[1].min(b[1]).min(c[1]), a[1].max(b[1]).max(c[1]));
        let last = self.size_px as i32 - 1;
        let x = [((left + HALF - 1) >> SUBTEXEL_BITS).max(0), ((right - HALF) >> SUBTEXEL_BITS).min(last)];
        let y = [((top + HALF - 1) >> SUBTEXEL_BITS).max(0), ((bottom - HALF) >> SUBTEXEL_BITS).min(last)];
        if x[0] > x[1] || y[0] > y[1] {
            return;
        }
        let area = cross([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
        if area == 0 {
            return;
        }
        let (b, c) = if area > 0 { (b, c) } else { (c, b) };
        // Groups begin at multiples of their size.
        let covered = TexelBox { x: [x[0] & !(LANES as i32 - 1), x[1]], y };
        let plane = depth_plane(a, b, c, area.abs(), covered);
        let edges = [edge(a, b, covered), edge(b, c, covered), edge(c, a, covered)];
        if (right - left).max(bottom - top) < SMALL && plane.right.abs().max(plane.down.abs()) < MAX_EXACT_SLOPE {
            self.fill_small(edges, plane, covered);
        } else {
            self.fill_large(edges, plane, covered);
        }
    }

    /// Tests all texels of the bounding box.
    #[inline(always)]
    fn fill_small(&mut self, [a, b, c]: [Edge; 3], plane: DepthPlane, covered: TexelBox) {
        let mut rows = [a.lanes(), b.lanes(), c.lanes()];
        let right = [a.right_of_group(), b.right_of_group(), c.right_of_group()];
        let down = [Vec4::splat(a.down as f32), Vec4::splat(b.down as f32), Vec4::splat(c.down as f32)];
        let mut depth_row = plane.value + plane.right * STEPS;
        let (depth_right, depth_down) = (Vec4::splat(plane.right * LANES as f32), Vec4::splat(plane.down));
        let (first, last) = (covered.x[0] as usize / LANES, covered.x[1] as usize / LANES);
        for y in covered.y[0] as usize..=covered.y[1] as usize {
            let [mut a, mut b, mut c] = rows;
            let mut depth = depth_row;
            let from = y * self.groups_per_row;
            for group in &mut self.groups[from + first..=from + last] {
                group.add(a.min(b).min(c).cmpge(Vec4::ZERO), depth);
                a += right[0];
                b += right[1];
                c += right[2];
                depth += depth_right;
            }
            rows[0] += down[0];
            rows[1] += down[1];
            rows[2] += down[2];
            depth_row += depth_down;
        }
    }

    /// Computes for each row which texels are inside.
    fn fill_large(&mut self, edges: [Edge; 3], plane: DepthPlane, covered: TexelBox) {
        for y in 0..=covered.y[1] - covered.y[0] {
            // Texels from the left end of the box.
            let (mut low, mut high) = (0, i64::from(covered.x[1] - covered.x[0]));
            for edge in edges {
                let value = edge.value + edge.down * i64::from(y);
                match edge.right {
                    0 if value < 0 => high = -1,
                    0 => {}
                    right if right > 0 => low = low.max((-value + right - 1).div_euclid(right)),
                    right => high = high.min(value.div_euclid(-right)),
                }
            }
            if low > high {
                continue;
            }
            let from = (covered.y[0] + y) as usize * self.groups_per_row + covered.x[0] as usize / LANES;
            let (first, last) = (low as usize / LANES, high as usize / LANES);
            let start = plane.value + plane.down * y as f32;
            for (group, at) in self.groups[from + first..=from + last].iter_mut().zip(first..) {
                let x = STEPS + (at * LANES) as f32;
                let inside = x.cmpge(Vec4::splat(low as f32)) & x.cmple(Vec4::splat(high as f32));
                let depth = start + plane.right * x;
                group.add(inside, depth.max(Vec4::splat(plane.low)).min(Vec4::splat(plane.high)));
            }
        }
    }
}

impl TexelGroup {
    #[inline(always)]
    fn add(&mut self, inside: BVec4A, depth: Vec4) {
        self.near = self.near.max(Vec4::select(inside, depth, EMPTY.near));
        self.far = self.far.min(Vec4::select(inside, depth, EMPTY.far));
    }
}

impl Edge {
    /// Values at the first texels of the bounding box.
    #[inline(always)]
    fn lanes(self) -> Vec4 {
        self.value as f32 + self.right as f32 * STEPS
    }

    /// What a step of a whole group adds.
    #[inline(always)]
    fn right_of_group(self) -> Vec4 {
        Vec4::splat(self.right as f32 * LANES as f32)
    }
}

/// Positive if `b` is clockwise of `a` in a map, whose second axis points down.
#[inline(always)]
fn cross(a: [i32; 2], b: [i32; 2]) -> i64 {
    i64::from(a[0]) * i64::from(b[1]) - i64::from(a[1]) * i64::from(b[0])
}

/// The edge from `a` to `b` of a triangle whose corners turn clockwise.
#[inline(always)]
fn edge(a: Projected, b: Projected, covered: TexelBox) -> Edge {
    let along = [b[0] - a[0], b[1] - a[1]];
    // Clockwise with y down, top edges run to the right, and left edges up.
    let is_owner = along[1] < 0 || along[1] == 0 && along[0] > 0;
    let centre = [covered.x[0] * TEXEL + HALF - a[0], covered.y[0] * TEXEL + HALF - a[1]];
    Edge {
        value: (cross(along, centre) - i64::from(!is_owner)) >> SUBTEXEL_BITS,
        right: -i64::from(along[1]),
        down: i64::from(along[0]),
    }
}

#[inline(always)]
fn depth_plane(a: Projected, b: Projected, c: Projected, area: i64, covered: TexelBox) -> DepthPlane {
    let difference = |p: Projected, axis: usize| f64::from(p[axis] - a[axis]);
    let per_area = 1.0 / area as f64;
    let (ab, ac) = (difference(b, 2), difference(c, 2));
    let right = (ab * difference(c, 1) - ac * difference(b, 1)) * per_area;
    let down = (ac * difference(b, 0) - ab * difference(c, 0)) * per_area;
    let centre = [covered.x[0] * TEXEL + HALF - a[0], covered.y[0] * TEXEL + HALF - a[1]];
    DepthPlane {
        value: (f64::from(a[2]) + right * f64::from(centre[0]) + down * f64::from(centre[1])) as f32,
        right: (right * f64::from(TEXEL)) as f32,
        down: (down * f64::from(TEXEL)) as f32,
        low: a[2].min(b[2]).min(c[2]) as f32,
        high: a[2].max(b[2]).max(c[2]) as f32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::rng::Rng;

    const SIZE: u32 = 150;

    /// Whether a texel's centre belongs to a triangle, by the definition.
    fn covers(mut corners: [Projected; 3], x: i32, y: i32) -> bool {
        let cross = |a: Projected, b: Projected, c: [i64; 2]| {
            let [along_x, along_y] = [0, 1].map(|k| i64::from(b[k]) - i64::from(a[k]));
            along_x * (c[1] - i64::from(a[1])) - along_y * (c[0] - i64::from(a[0]))
        };
        let area = cross(corners[0], corners[1], [0, 1].map(|k| i64::from(corners[2][k])));
        if area < 0 {
            corners.swap(1, 2);
        }
        let centre = [x, y].map(|v| i64::from(v * TEXEL + HALF));
        area != 0
            && (0..3).all(|k| {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                let is_top_or_left = b[1] < a[1] || b[1] == a[1] && b[0] > a[0];
                let value = cross(a, b, centre);
                value > 0 || value == 0 && is_top_or_left
            })
    }

    fn drawn(map: &DepthMap, x: i32, y: i32) -> bool {
        map.depths(x, y)[0] > f32::MIN
    }

    #[test]
    fn triangles_of_all_sizes_cover_what_the_definition_says() {
        let mut rng = Rng::new(3);
        for size in [300, 3_000, 30_000, 3_000_000] {
            for _ in 0..60 {
                // Whole and half texels, so that centres lie on edges.
                let mut number = || (rng.below(size) as i32 - size as i32 / 2) / 128 * 128 + 75 * TEXEL;
                let corners = [(); 3].map(|()| [number(), number(), number()]);
                let mut map = DepthMap::new(SIZE);
                map.draw(corners[0], corners[1], corners[2]);
                for (x, y) in (0..SIZE as i32).flat_map(|y| (0..SIZE as i32).map(move |x| (x, y))) {
                    assert_eq!(drawn(&map, x, y), covers(corners, x, y), "{corners:?} at {x}, {y}");
                }
            }
        }
    }

    #[test]
    fn depths_lie_on_the_plane_and_the_extremes_stay() {
        for scale in [1, 20] {
            let corner = |x: i32, y: i32, z: i32| [x * TEXEL * scale, y * TEXEL * scale, z];
            let mut map = DepthMap::new(SIZE);
            // Depth is 100 x + 1000 y, in texels.
            map.draw(corner(0, 0, 0), corner(7, 0, 700 * scale), corner(0, 7, 7000 * scale));
            map.draw(corner(0, 0, 9), corner(2, 0, 9), corner(0, 2, 9));
            let [near, far] = map.depths(0, 0);
            assert!((near - 550.0).abs() < 0.01 && far == 9.0, "{near} {far}");
            let [near, far] = map.depths(3 * scale, 2 * scale);
            let plane = 100.0 * (3 * scale) as f32 + 1000.0 * (2 * scale) as f32 + 550.0;
            assert!((near - plane).abs() < 0.1 && near == far, "{near} {plane}");
            map.clear();
            assert_eq!(map.depths(0, 0), [f32::MIN, f32::MAX]);
        }
    }
}
