//! Texture atlases whose parts repeat: each triangle is cut where its texture repeats, so that the texture coordinates of
//! each piece lie within its part of the atlas.

use super::mesh::NodeMesh;

/// Triangles over more repetitions are not cut: their texture is stretched instead.
const MAX_CELLS: i64 = 256;
/// All triangles of a node together are cut into at most this many times their number, and some.
const MAX_GROWTH: usize = 16;
/// Texture coordinates that are this close to a whole number are meant to be it.
const TOLERANCE: f32 = 1e-4;
const FULL: [u16; 4] = [0, 0, u16::MAX, u16::MAX];

/// A corner while it is cut.
#[derive(Debug, Clone, Copy)]
struct Corner {
    offset: [f64; 3],
    uv: [f32; 2],
    colour: [f32; 3],
}

/// Whether any vertex repeats a part of its texture only.
pub(super) fn has_regions(mesh: &NodeMesh) -> bool {
    !mesh.uv.is_empty() && mesh.regions.iter().any(|region| *region != FULL)
}

/// Maps all texture coordinates into the regions of the atlas. Returns the number of triangles whose texture is stretched,
/// because it repeats too often.
pub(super) fn flatten(mesh: &mut NodeMesh) -> u64 {
    let mut flat = NodeMesh { features: std::mem::take(&mut mesh.features), ..NodeMesh::default() };
    let mut stretched = 0;
    let limit = mesh.triangles.len() * MAX_GROWTH + 1024;
    for (triangle, feature) in mesh.triangles.iter().zip(&mesh.triangle_features) {
        let region = region_of(mesh, triangle[0]);
        let corners = triangle.map(|vertex| corner(mesh, vertex));
        let [low, high] = cells(&corners);
        let count = (high[0] - low[0] + 1).saturating_mul(high[1] - low[1] + 1);
        if count > MAX_CELLS || flat.triangles.len() > limit {
            stretched += 1;
            let corners = corners.map(|corner| squeezed(corner, low, high));
            flat.add_polygon(&corners, region, *feature);
            continue;
        }
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                let polygon = cut(&corners, [x as f32, y as f32]);
                let moved = polygon.into_iter().map(|corner| shifted(corner, [x as f32, y as f32]));
                flat.add_polygon(&moved.collect::<Vec<_>>(), region, *feature);
            }
        }
    }
    if mesh.colours.is_empty() {
        flat.colours.clear();
    }
    *mesh = flat;
    stretched
}

fn region_of(mesh: &NodeMesh, vertex: u32) -> [u16; 4] {
    mesh.regions.get(vertex as usize).copied().unwrap_or(FULL)
}

fn corner(mesh: &NodeMesh, vertex: u32) -> Corner {
    let at = vertex as usize;
    let uv = mesh.uv.get(at).copied().unwrap_or_default();
    Corner {
        offset: mesh.offsets.get(at).copied().unwrap_or_default(),
        uv: uv.map(snapped),
        colour: mesh.colours.get(at).copied().unwrap_or([255; 3]).map(f32::from),
    }
}

/// The number, or the whole number that it is meant to be. Numbers that are not finite are 0.
fn snapped(number: f32) -> f32 {
    let number = if number.is_finite() { number.clamp(-1e6, 1e6) } else { 0.0 };
    if (number - number.round()).abs() < TOLERANCE { number.round() } else { number }
}

/// The first and last repetition that a triangle has, in u and v.
fn cells(corners: &[Corner; 3]) -> [[i64; 2]; 2] {
    let axis = |axis: usize| {
        let numbers = corners.map(|corner| corner.uv[axis]);
        let low = numbers.iter().copied().fold(f32::MAX, f32::min);
        let high = numbers.iter().copied().fold(f32::MIN, f32::max);
        let first = low.floor() as i64;
        [first, (high.ceil() as i64 - 1).max(first)]
    };
    let [u, v] = [axis(0), axis(1)];
    [[u[0], v[0]], [u[1], v[1]]]
}

/// The corner with texture coordinates from 0 to 1 over all repetitions.
fn squeezed(mut corner: Corner, low: [i64; 2], high: [i64; 2]) -> Corner {
    for axis in 0..2 {
        corner.uv[axis] = (corner.uv[axis] - low[axis] as f32) / (high[axis] - low[axis] + 1) as f32;
    }
    corner
}

fn shifted(mut corner: Corner, cell: [f32; 2]) -> Corner {
    corner.uv = [corner.uv[0] - cell[0], corner.uv[1] - cell[1]];
    corner
}

/// The part of a triangle whose texture coordinates lie in a cell of side 1 (Sutherland and Hodgman 1974).
fn cut(corners: &[Corner; 3], cell: [f32; 2]) -> Vec<Corner> {
    let mut polygon = corners.to_vec();
    for axis in 0..2 {
        for (limit, sign) in [(cell[axis], 1.0), (cell[axis] + 1.0, -1.0)] {
            let inside = |corner: &Corner| (corner.uv[axis] - limit) * sign;
            let mut kept = Vec::with_capacity(polygon.len() + 2);
            for (i, to) in polygon.iter().enumerate() {
                let from = &polygon[(i + polygon.len() - 1) % polygon.len()];
                let (a, b) = (inside(from), inside(to));
                if (a < 0.0) != (b < 0.0) {
                    kept.push(between(from, to, f64::from(a / (a - b))));
                }
                if b >= 0.0 {
                    kept.push(*to);
                }
            }
            polygon = kept;
            if polygon.len() < 3 {
                return Vec::new();
            }
        }
    }
    polygon
}

fn between(from: &Corner, to: &Corner, share: f64) -> Corner {
    let small = share as f32;
    Corner {
        offset: [0, 1, 2].map(|axis| from.offset[axis] + (to.offset[axis] - from.offset[axis]) * share),
        uv: [0, 1].map(|axis| from.uv[axis] + (to.uv[axis] - from.uv[axis]) * small),
        colour: [0, 1, 2].map(|axis| from.colour[axis] + (to.colour[axis] - from.colour[axis]) * small),
    }
}

impl NodeMesh {
    /// Adds a convex polygon with texture coordinates from 0 to 1 as a fan of triangles in a region of the atlas.
    fn add_polygon(&mut self, corners: &[Corner], region: [u16; 4], feature: u32) {
        if corners.len() < 3 {
            return;
        }
        let first = self.offsets.len() as u32;
        let [u0, v0, u1, v1] = region.map(|number| f32::from(number) / 65535.0);
        for corner in corners {
            let [u, v] = corner.uv.map(|number| number.clamp(0.0, 1.0));
            self.offsets.push(corner.offset);
            self.uv.push([u0 + (u1 - u0) * u, v0 + (v1 - v0) * v]);
            self.colours.push(corner.colour.map(|number| number.round() as u8));
        }
        for i in 1..corners.len() as u32 - 1 {
            self.triangles.push([first, first + i, first + i + 1]);
            self.triangle_features.push(feature);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mesh(uv: [[f32; 2]; 3], region: [u16; 4]) -> NodeMesh {
        NodeMesh {
            offsets: vec![[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]],
            uv: uv.to_vec(),
            regions: vec![region; 3],
            triangles: vec![[0, 1, 2]],
            triangle_features: vec![7],
            ..NodeMesh::default()
        }
    }

    fn area(mesh: &NodeMesh) -> f64 {
        let at = |vertex: u32| mesh.offsets[vertex as usize];
        mesh.triangles
            .iter()
            .map(|[a, b, c]| {
                let (a, b, c) = (at(*a), at(*b), at(*c));
                ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2.0
            })
            .sum()
    }

    #[test]
    fn triangles_within_one_repetition_are_only_moved() {
        let mut mesh = mesh([[3.0, 2.0], [4.0, 2.0], [3.0, 3.0]], [0, 32768, 32767, 65535]);
        assert!(has_regions(&mesh));
        assert_eq!(flatten(&mut mesh), 0);
        assert_eq!((mesh.triangles.len(), mesh.triangle_features[0]), (1, 7));
        for (found, expected) in mesh.uv.iter().zip([[0.0, 0.5], [0.5, 0.5], [0.0, 1.0]]) {
            assert!((found[0] - expected[0]).abs() < 1e-3 && (found[1] - expected[1]).abs() < 1e-3, "{found:?}");
        }
        assert!(mesh.colours.is_empty());
    }

    #[test]
    fn repetitions_are_cut_without_gaps_and_stay_in_the_region() {
        let region = [0, 0, 16384, 65535];
        let mut mesh = mesh([[0.0, 0.0], [4.0, 0.0], [0.0, 4.0]], region);
        assert_eq!(flatten(&mut mesh), 0);
        assert!((area(&mesh) - 8.0).abs() < 1e-3, "{}", area(&mesh));
        assert!(mesh.triangles.len() >= 10);
        assert!(mesh.uv.iter().all(|uv| (0.0..=0.2501).contains(&uv[0]) && (0.0..=1.0).contains(&uv[1])));
        assert_eq!(mesh.check(), Ok(()));
    }

    #[test]
    fn absurd_repetitions_are_stretched() {
        let mut far = mesh([[0.0, 0.0], [1e9, 0.0], [f32::NAN, 1e5]], [0, 0, 100, 100]);
        assert_eq!(flatten(&mut far), 1);
        assert_eq!(far.triangles.len(), 1);
        assert!(!has_regions(&mesh([[0.0; 2]; 3], FULL)));
    }
}
