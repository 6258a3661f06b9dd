//! Depth maps of one pair of opposite directions (Mischitelli 2007, 3.2.1), drawn on the CPU.
//!
//! One drawing serves both directions: the first sees what is nearest to its viewer, the other what is farthest from him.
//! Coverage is exact, by whole numbers and the rule of all GPUs: a triangle covers a texel whose centre it contains, and a
//! centre on an edge belongs to the triangle of which it is a top or left edge.

use crate::prepared::SUBTEXEL_BITS;

/// Steps of a texel.
const TEXEL: i32 = 1 << SUBTEXEL_BITS;
/// Steps from a texel's corner to its centre.
const HALF: i32 = TEXEL / 2;
/// Texels that are drawn at once.
const LANES: usize = 4;
/// Triangles up to this many steps wide and high are drawn with numbers of 32 bits.
const SMALL: i32 = 64 * TEXEL;

/// Depths of texels that lie side by side.
#[derive(Debug, Clone, Copy)]
struct TexelGroup {
    /// Largest depth towards the viewer.
    near: [f32; LANES],
    /// Smallest depth.
    far: [f32; LANES],
}

const EMPTY: TexelGroup = TexelGroup { near: [f32::MIN; LANES], far: [f32::MAX; LANES] };

/// Nearest and farthest depths.
pub(crate) struct DepthMap {
    size_px: u32,
    groups_per_row: usize,
    groups: Vec<TexelGroup>,
}

/// A projected vertex: right and down in steps of a texel, then its depth towards the viewer.
pub(crate) type Projected = [i32; 3];

/// A line between two corners: at least 0 inside of the triangle, including edges that own their points.
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
    /// An empty map.
    pub(crate) fn new(size_px: u32) -> Self {
        let groups_per_row = (size_px as usize).div_ceil(LANES);
        Self { size_px, groups_per_row, groups: vec![EMPTY; groups_per_row * size_px as usize] }
    }

    /// Bytes of a map.
    pub(crate) fn bytes(size_px: u32) -> usize {
        (size_px as usize).div_ceil(LANES) * size_px as usize * size_of::<TexelGroup>()
    }

    /// Removes everything.
    pub(crate) fn clear(&mut self) {
        self.groups.fill(EMPTY);
    }

    /// Nearest and farthest depth at a texel; [`f32::MIN`] and [`f32::MAX`] where nothing is.
    pub(crate) fn depths(&self, x: i32, y: i32) -> [f32; 2] {
        let at = y as usize * self.groups_per_row + x as usize / LANES;
        let group = self.groups.get(at).unwrap_or(&EMPTY);
        [group.near[x as usize % LANES], group.far[x as usize % LANES]]
    }

    /// Draws a triangle, seen from either side.
    #[inline]
    pub(crate) fn draw(&mut self, [a, b, c]: [Projected; 3]) {
        let bounds = |axis: usize| {
            let (low, high) = (a[axis].min(b[axis]).min(c[axis]), a[axis].max(b[axis]).max(c[axis]));
            let texels = [((low + HALF - 1) >> SUBTEXEL_BITS).max(0), ((high - HALF) >> SUBTEXEL_BITS).min(self.size_px as i32 - 1)];
            (texels, high - low)
        };
        let ((x, width), (y, height)) = (bounds(0), bounds(1));
        if x[0] > x[1] || y[0] > y[1] {
            return;
        }
        // Groups begin at multiples of their size.
        let covered = TexelBox { x: [x[0] & !(LANES as i32 - 1), x[1]], y };
        let area = cross([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
        if area == 0 {
            return;
        }
        let (b, c) = if area > 0 { (b, c) } else { (c, b) };
        let edges = [edge(a, b, covered), edge(b, c, covered), edge(c, a, covered)];
        let plane = depth_plane([a, b, c], area.abs(), covered);
        if width.max(height) < SMALL {
            self.fill_small(edges, plane, covered);
        } else {
            self.fill_large(edges, plane, covered);
        }
    }

    /// Tests all texels of the bounding box.
    fn fill_small(&mut self, edges: [Edge; 3], plane: DepthPlane, covered: TexelBox) {
        // A box of at most 67 texels, so that values stay below 2^30.
        let mut row = edges.map(|edge| lanes(edge.value as i32, edge.right as i32));
        let down = edges.map(|edge| edge.down as i32);
        let right = edges.map(|edge| edge.right as i32 * LANES as i32);
        let mut depth_row = depth_lanes(plane);
        let (first, last) = (covered.x[0] as usize / LANES, covered.x[1] as usize / LANES);
        for y in covered.y[0] as usize..=covered.y[1] as usize {
            let (mut values, mut depth) = (row, depth_row);
            let from = y * self.groups_per_row;
            for group in &mut self.groups[from + first..=from + last] {
                let inside = std::array::from_fn(|i| values[0][i] | values[1][i] | values[2][i]);
                group.add(inside, depth, plane);
                for (values, right) in values.iter_mut().zip(right) {
                    values.iter_mut().for_each(|value| *value += right);
                }
                depth.iter_mut().for_each(|depth| *depth += plane.right * LANES as f32);
            }
            for (row, down) in row.iter_mut().zip(down) {
                row.iter_mut().for_each(|value| *value += down);
            }
            depth_row.iter_mut().for_each(|depth| *depth += plane.down);
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
                let x: [i32; LANES] = std::array::from_fn(|i| (at * LANES + i) as i32);
                let inside = x.map(|x| (x - low as i32) | (high as i32 - x));
                group.add(inside, x.map(|x| start + plane.right * x as f32), plane);
            }
        }
    }
}

impl TexelGroup {
    /// Adds depths where `inside` is not negative.
    #[inline]
    fn add(&mut self, inside: [i32; LANES], depth: [f32; LANES], plane: DepthPlane) {
        for i in 0..LANES {
            let depth = if depth[i] > plane.low { depth[i] } else { plane.low };
            let depth = if depth < plane.high { depth } else { plane.high };
            let near = if depth > self.near[i] { depth } else { self.near[i] };
            let far = if depth < self.far[i] { depth } else { self.far[i] };
            self.near[i] = if inside[i] >= 0 { near } else { self.near[i] };
            self.far[i] = if inside[i] >= 0 { far } else { self.far[i] };
        }
    }
}

fn lanes(value: i32, step: i32) -> [i32; LANES] {
    [value, value + step, value + 2 * step, value + 3 * step]
}

fn depth_lanes(plane: DepthPlane) -> [f32; LANES] {
    std::array::from_fn(|i| plane.value + plane.right * i as f32)
}

/// Positive if `b` is clockwise of `a` in a map, whose second axis points down.
fn cross(a: [i32; 2], b: [i32; 2]) -> i64 {
    i64::from(a[0]) * i64::from(b[1]) - i64::from(a[1]) * i64::from(b[0])
}

/// The edge from `a` to `b` of a triangle whose corners turn clockwise.
#[inline]
fn edge(a: Projected, b: Projected, covered: TexelBox) -> Edge {
    let along = [b[0] - a[0], b[1] - a[1]];
    // Clockwise with y down, top edges run to the right, and left edges up.
    let is_owner = along[1] < 0 || along[1] == 0 && along[0] > 0;
    let centre = [covered.x[0] * TEXEL + HALF - a[0], covered.y[0] * TEXEL + HALF - a[1]];
    Edge {
        value: cross(along, centre) - i64::from(!is_owner),
        right: -i64::from(along[1]) * i64::from(TEXEL),
        down: i64::from(along[0]) * i64::from(TEXEL),
    }
}

#[inline]
fn depth_plane([a, b, c]: [Projected; 3], area: i64, covered: TexelBox) -> DepthPlane {
    let [ab, ac] = [b, c].map(|p| std::array::from_fn::<f64, 3, _>(|k| f64::from(p[k] - a[k])));
    let per_area = 1.0 / area as f64;
    let right = (ab[2] * ac[1] - ac[2] * ab[1]) * per_area;
    let down = (ac[2] * ab[0] - ab[2] * ac[0]) * per_area;
    let centre = [covered.x[0] * TEXEL + HALF - a[0], covered.y[0] * TEXEL + HALF - a[1]];
    DepthPlane {
        value: (f64::from(a[2]) + right * f64::from(centre[0]) + down * f64::from(centre[1])) as f32,
        right: (right * f64::from(TEXEL)) as f32,
        down: (down * f64::from(TEXEL)) as f32,
        low: a[2].min(b[2]).min(c[2]) as f32,
        high: a[2].max(b[2]).max(c[2]) as f32,
    }
}
