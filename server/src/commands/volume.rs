//! A node's voxels (Vacca 2008, 3.1 and figure 3.3) as a picture and as a PLY file.
//!
//! The picture has two axonometric views: from above the south-west on the left, from above the north-east on the right. The far
//! corner of the node is at the top of each.

use super::map_image::{BACKGROUND, shade};
use image::{Rgb, RgbImage};
use insula_protocol::blockmap::voxels::{ROWS_BELOW, VoxelFace, Voxels};
use insula_protocol::{Manifest, NODE_CELLS, TileId};

/// Half the width of a voxel in the picture, in pixels: the first of these with which the picture is not higher than [`MAX_HEIGHT`].
const HALF_WIDTHS: [u32; 4] = [8, 6, 4, 2];
/// Height of the picture in pixels, unless it has too many rows even for the smallest voxels.
const MAX_HEIGHT: u32 = 3000;
/// Space around the views in pixels.
const MARGIN: u32 = 16;
/// Light on tops and on the left and right sides, in 1/256.
const LIGHT: [u32; 3] = [256, 205, 160];
/// The same where voxels meet, as a share of it in 1/256.
const EDGE: u32 = 215;
/// Most faces of a PLY file, which then has about 250 MB.
const MAX_FACES: usize = 2_000_000;

/// A view from above a corner of the node.
struct VolumeView<'a> {
    voxels: &'a Voxels,
    /// Whether it is that from the north-east, not from the south-west.
    is_turned: bool,
    half_width: u32,
}

impl VolumeView<'_> {
    /// Height of a voxel's side. Tops are twice as wide as high, so the view is from 30 degrees above the horizon.
    fn rise(&self) -> u32 {
        // The cosine of 30 degrees by the square root of a half.
        (f64::from(self.half_width) * 1.2247).round() as u32
    }

    fn size(&self) -> [u32; 2] {
        let side = NODE_CELLS as u32;
        [2 * side * self.half_width, side * self.half_width + self.voxels.rows() as u32 * self.rise()]
    }

    /// Draws the voxels from the farthest to the nearest, so that near ones cover far ones.
    fn draw(&self, image: &mut RgbImage, left: u32) {
        let far = NODE_CELLS - 1;
        for (y, x) in (0..NODE_CELLS).rev().flat_map(|y| (0..NODE_CELLS).rev().map(move |x| (y, x))) {
            for row in 0..self.voxels.rows() {
                let at = if self.is_turned { [far - x, far - y, row] } else { [x, y, row] };
                let faces = if self.is_turned {
                    [VoxelFace::Above, VoxelFace::East, VoxelFace::North]
                } else {
                    [VoxelFace::Above, VoxelFace::West, VoxelFace::South]
                };
                let colours = faces.map(|face| self.voxels.face(at, face).map(shade));
                if colours.iter().any(Option::is_some) {
                    self.stamp(image, [x, y, row], left, colours);
                }
            }
        }
    }

    /// Draws one voxel, of which top, left and right side have these colours.
    fn stamp(&self, image: &mut RgbImage, at: [usize; 3], left: u32, colours: [Option<Rgb<u8>>; 3]) {
        let [x, y, row] = at.map(|n| n as u32);
        let (w, rise, side) = (self.half_width, self.rise(), NODE_CELLS as u32);
        let left = left + (side - 1 + x - y) * w;
        let top = MARGIN + (2 * (side - 1) - x - y) * w / 2 + (self.voxels.rows() as u32 - 1 - row) * rise;
        for (dx, dy) in (0..w + rise).flat_map(|dy| (0..2 * w).map(move |dx| (dx, dy))) {
            let Some((face, is_edge)) = face_of_pixel([dx, dy], w, rise) else { continue };
            let Some(colour) = colours[face] else { continue };
            // Lines would hide the colours of small voxels.
            let light = if is_edge && w > 4 { LIGHT[face] * EDGE / 256 } else { LIGHT[face] };
            let [x, y] = [left + dx, top + dy];
            if x < image.width() && y < image.height() {
                image.put_pixel(x, y, Rgb(colour.0.map(|part| (u32::from(part) * light / 256) as u8)));
            }
        }
    }
}

/// The face of a voxel (top, left, right) that a pixel of its hexagon shows, and whether the pixel is on the upper border of that.
fn face_of_pixel([x, y]: [u32; 2], half_width: u32, rise: u32) -> Option<(usize, bool)> {
    // Pixels from the nearer end of the line, and how far tops and sides begin below the highest point there.
    let from_end = if x < half_width { x } else { 2 * half_width - 1 - x };
    let (above, below) = ((half_width - 1 - from_end) / 2, (half_width + from_end) / 2);
    let side = if x < half_width { 1 } else { 2 };
    if y < above {
        None
    } else if y < below + 1 {
        Some((0, y == above))
    } else {
        (y < below + 1 + rise).then_some((side, y == below + 1 || x == half_width))
    }
}

/// The picture of a node.
pub(super) fn draw(voxels: &Voxels) -> RgbImage {
    let view = |is_turned, half_width| VolumeView { voxels, is_turned, half_width };
    let fits = |width: &&u32| view(false, **width).size()[1] <= MAX_HEIGHT;
    let half_width = HALF_WIDTHS.iter().find(fits).or(HALF_WIDTHS.last()).copied().unwrap_or(2);
    let [width, height] = view(false, half_width).size();
    let mut image = RgbImage::from_pixel(2 * width + 3 * MARGIN, height + 2 * MARGIN, BACKGROUND);
    for (is_turned, left) in [(false, MARGIN), (true, width + 2 * MARGIN)] {
        view(is_turned, half_width).draw(&mut image, left);
    }
    image
}

/// The visible faces of a node as squares with colours, in metres of the city's coordinate system, as a PLY file. The second value is
/// their number; `None` if there are more than 2 million.
pub(super) fn write_ply(voxels: &Voxels, node: TileId, z_base_m: f64, manifest: &Manifest) -> Option<(Vec<u8>, usize)> {
    let faces: Vec<_> = voxels.visible_faces().take(MAX_FACES + 1).collect();
    if faces.len() > MAX_FACES {
        return None;
    }
    let side_m = manifest.root_side_m / f64::from(1u32 << node.level());
    let cell_m = side_m / NODE_CELLS as f64;
    let lowest_m = z_base_m - ROWS_BELOW as f64 * cell_m;
    let corner = [f64::from(node.x()) * side_m, f64::from(node.y()) * side_m, lowest_m];
    let mut out = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nelement face {}\n\
         property list uchar uint vertex_indices\nend_header\n",
        4 * faces.len(),
        faces.len()
    )
    .into_bytes();
    for (at, face, texel) in &faces {
        for step in corners(*face) {
            for axis in 0..3 {
                let metres = manifest.origin[axis] + corner[axis] + (at[axis] + step[axis]) as f64 * cell_m;
                out.extend(metres.to_le_bytes());
            }
            out.extend(shade(*texel).0);
        }
    }
    for first in (0..faces.len() as u32).map(|face| 4 * face) {
        out.push(4);
        (first..first + 4).for_each(|vertex| out.extend(vertex.to_le_bytes()));
    }
    Some((out, faces.len()))
}

/// The corners of a face of the voxel at the origin, counter-clockwise from outside.
fn corners(face: VoxelFace) -> [[usize; 3]; 4] {
    match face {
        VoxelFace::West => [[0, 0, 0], [0, 0, 1], [0, 1, 1], [0, 1, 0]],
        VoxelFace::East => [[1, 0, 0], [1, 1, 0], [1, 1, 1], [1, 0, 1]],
        VoxelFace::South => [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]],
        VoxelFace::North => [[0, 1, 0], [0, 1, 1], [1, 1, 1], [1, 1, 0]],
        VoxelFace::Below => [[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0]],
        VoxelFace::Above => [[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::blockmap::{COLUMNS, MapColumn, WallStrip};
    use insula_protocol::texel::AO_MAX;
    use insula_protocol::{BlockMap, Texel};
    use insula_test_support::small_city::empty_manifest;

    /// A tower of two voxels above its base at the south-western corner, with a gap in its middle, and a low one beside it to the east.
    fn tower() -> Voxels {
        let texel = |rgb| Texel::new(rgb, AO_MAX);
        let strip = Some(WallStrip { texels: vec![texel([0, 0, 250]); 3], azimuth: 0 });
        let gap = Some([16, 32]);
        let mut columns = vec![None; COLUMNS];
        columns[0] = Some(MapColumn { z_max: 48, roof: texel([250, 0, 0]), strip, gap, ..MapColumn::default() });
        columns[1] = Some(MapColumn { z_max: 16, roof: texel([0, 250, 0]), ..MapColumn::default() });
        Voxels::of(BlockMap::from_columns(TileId::ROOT, 1.0, 2, 0, &columns).unwrap())
    }

    #[test]
    fn near_voxels_cover_far_ones_in_both_views() {
        let image = draw(&tower());
        let (w, rise, side) = (8, 10, NODE_CELLS as u32);
        assert_eq!(image.dimensions(), (4 * side * w + 3 * MARGIN, side * w + 4 * rise + 2 * MARGIN));
        let colour = |x: u32, y: u32| image.get_pixel(x, y).0;
        let lit = |face: usize| (250 * LIGHT[face] / 256) as u8;
        // From the south-west, the tower's corner is the lowest point. Its western side is on the left.
        let (middle, floor) = (MARGIN + side * w, MARGIN + side * w + 4 * rise);
        assert_eq!(colour(middle - 4, floor - rise - 6), [0, 0, lit(1)]);
        assert_eq!(colour(middle + 4, floor - rise - 6), [0, 0, lit(2)]);
        assert_eq!(colour(middle + 3, floor - 4 * rise - 4), [lit(0), 0, 0], "the top");
        assert_eq!(colour(middle + 3, floor - 2 * rise - 4), [lit(0), 0, 0], "the lower top, in the gap");
        assert_eq!(colour(middle + w + 3, floor - 2 * rise - w / 2 - 4), [0, lit(0), 0], "the low one");
        // From the north-east, the tower is farthest, and the low one is before it on the left.
        let (middle, far) = (MARGIN * 2 + side * w * 3, MARGIN);
        assert_eq!(colour(middle + 3, far + 4), [lit(0), 0, 0]);
        assert_eq!(colour(middle - w + 3, far + 2 * rise + w / 2 + 4), [0, lit(0), 0]);
        assert_eq!(colour(MARGIN, MARGIN), BACKGROUND.0);
        assert_eq!(draw(&Voxels::default()).height(), side * w + 2 * MARGIN);
    }

    #[test]
    fn faces_are_written_where_they_are_in_the_city() {
        let (file, faces) = {
            let manifest = Manifest { origin: [1000.0, 2000.0, 30.0], root_side_m: 128.0, ..empty_manifest(0) };
            write_ply(&tower(), TileId::ROOT, 4.0, &manifest).unwrap()
        };
        // The lower two voxels lack their eastern sides, the upper one nothing, the low ones their western sides. None has an underside.
        assert_eq!(faces, 7 + 6 + 7);
        let end = b"end_header\n";
        let head = file.windows(end.len()).position(|part| part == end).unwrap() + end.len();
        assert!(String::from_utf8_lossy(&file[..head]).contains("element vertex 80\n"));
        assert_eq!(file.len(), head + 80 * 27 + faces * 17);
        let number = |at: usize| f64::from_le_bytes(file[head + at..head + at + 8].try_into().unwrap());
        let heights: Vec<f64> = (0..80).map(|vertex| number(27 * vertex + 16)).collect();
        assert!(heights.iter().all(|z| [32.0, 34.0, 36.0, 38.0, 40.0].contains(z)), "{heights:?}");
        assert!((0..80).all(|vertex| (1000.0..=1004.0).contains(&number(27 * vertex))));
        for face in VoxelFace::ALL {
            let [a, b, c, _] = corners(face).map(|corner| corner.map(|n| n as i32));
            let [u, v] = [b, c].map(|p| [0, 1, 2].map(|axis| p[axis] - a[axis]));
            let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
            assert_eq!(normal, face.step(), "{face:?} is counter-clockwise from outside");
        }
    }
}
