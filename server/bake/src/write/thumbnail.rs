//! The city's file `thumbnail.png`: its roofs from above, north up, for lists and previews of links.
//!
//! Drawn from the V-BlockMaps of the coarsest level with a column or more per pixel, so it costs the same for any city.

use std::{io::Cursor, path::Path};

use image::{
    ExtendedColorType, ImageEncoder, Rgb, RgbImage,
    codecs::png::{CompressionType, FilterType, PngEncoder},
    imageops,
};
use insula_protocol::{BlockMap, Manifest, NODE_CELLS, TileId, blockmap::flag, texel::AO_MAX};

use super::{files::write_synced, tile_bytes::TileContent, tile_tree::TileTree};
use crate::error::BakeError;

pub(super) use insula_protocol::route::THUMBNAIL_FILE as FILE_NAME;

/// Longer side in pixels.
const SIDE_PX: u32 = 512;
/// Narrower cities are drawn this wide.
const MIN_SIDE_PX: u32 = 64;
/// Where there is no column.
const BACKGROUND: [f32; 3] = [222.0, 224.0, 226.0];
/// Direction of the light: from the north-west, 47 degrees high.
const TO_LIGHT: [f32; 3] = [-0.48, 0.48, 0.73];
/// Light on a surface that turns away from it, and what a surface that faces it has more.
const LIGHT: [f32; 2] = [0.45, 0.75];
/// Steeper slopes are shaded as this one: a wall between two columns is no slope of a roof.
const MAX_SLOPE: f32 = 1.5;

/// Writes the picture into `folder` and returns its size in bytes. Fails if a pack cannot be read, or the file not be written.
pub(super) fn write(
    folder: &Path,
    tree: &TileTree,
    tiles: &mut dyn TileContent,
    manifest: &Manifest,
) -> Result<u64, BakeError> {
    let path = folder.join(FILE_NAME);
    let corners = manifest.bounds.map(|corner| [0, 1].map(|axis| corner[axis] - manifest.origin[axis]));
    let mut plan = Plan::new(corners, manifest.cell_m, manifest.depth);
    for stored in tree.level(plan.level) {
        if !plan.meets(stored.id) {
            continue;
        }
        let bytes = tiles.tile(stored)?;
        let map = BlockMap::decode(stored.id, &bytes).map_err(|_| BakeError::Scratch { path: path.clone() })?;
        plan.add(&map.stand_on_ground());
    }
    let png = encode(&plan.draw()).map_err(|cause| BakeError::io(&path, "written", std::io::Error::other(cause)))?;
    write_synced(&path, &png)?;
    Ok(png.len() as u64)
}

fn encode(image: &RgbImage) -> image::ImageResult<Vec<u8>> {
    let mut png = Cursor::new(Vec::new());
    let encoder = PngEncoder::new_with_quality(&mut png, CompressionType::Best, FilterType::Adaptive);
    encoder.write_image(image.as_raw(), image.width(), image.height(), ExtendedColorType::Rgb8)?;
    Ok(png.into_inner())
}

/// The columns of one level in the city's bounds.
struct Plan {
    level: u8,
    cell_m: f32,
    /// Column of the level in the south-west corner.
    corner: [i64; 2],
    /// Number of columns along x and y.
    size: [usize; 2],
    /// Height and colour of each column, row by row from the south; `None` where there is none.
    columns: Vec<Option<(f32, [f32; 3])>>,
}

impl Plan {
    /// A plan between two corners, in metres from the root's. `cell_m` is the side of a column of the leaves.
    fn new([low, high]: [[f64; 2]; 2], cell_m: f64, depth: u8) -> Self {
        let side_m = (high[0] - low[0]).max(high[1] - low[1]);
        let cell_m_at = |level: u8| cell_m * f64::from(1u32 << (depth - level));
        let level = (0..depth).find(|level| cell_m_at(*level) * f64::from(SIDE_PX) <= side_m).unwrap_or(depth);
        let cell_m = cell_m_at(level);
        let corner = low.map(|m| (m / cell_m).floor() as i64);
        // Even bounds that no city has must not need more memory than this.
        let limit = i64::from(SIDE_PX) * 4;
        let size = [0, 1].map(|axis| ((high[axis] / cell_m).ceil() as i64 - corner[axis]).clamp(1, limit) as usize);
        Self { level, cell_m: cell_m as f32, corner, size, columns: vec![None; size[0] * size[1]] }
    }

    /// Position of a node's first column.
    fn start(&self, id: TileId) -> [i64; 2] {
        [(0, id.x()), (1, id.y())].map(|(axis, n)| i64::from(n) * NODE_CELLS as i64 - self.corner[axis])
    }

    fn meets(&self, id: TileId) -> bool {
        let start = self.start(id);
        (0..2).all(|axis| start[axis] < self.size[axis] as i64 && start[axis] + NODE_CELLS as i64 > 0)
    }

    fn add(&mut self, map: &BlockMap) {
        let start = self.start(map.id);
        for i in (0..map.flags.len()).filter(|i| map.flags[*i] & flag::OCCUPIED != 0) {
            let at = [(i % NODE_CELLS) as i64 + start[0], (i / NODE_CELLS) as i64 + start[1]];
            let Some(index) = self.index(at) else { continue };
            let height = map.z_base_m() as f32 + f32::from(map.z_max[i]) * map.z_step_m();
            let shade = 0.4 + 0.6 * f32::from(map.roof[i].ao()) / f32::from(AO_MAX);
            self.columns[index] = Some((height, map.roof[i].rgb().map(|channel| f32::from(channel) * shade)));
        }
    }

    fn index(&self, [x, y]: [i64; 2]) -> Option<usize> {
        let is_inside = |v: i64, axis: usize| (0..self.size[axis] as i64).contains(&v);
        (is_inside(x, 0) && is_inside(y, 1)).then(|| y as usize * self.size[0] + x as usize)
    }

    /// The picture, its longer side [`SIDE_PX`].
    fn draw(&self) -> RgbImage {
        let [width, height] = self.size.map(|columns| columns as u32);
        let image = RgbImage::from_fn(width, height, |x, y| {
            Rgb(self.colour([i64::from(x), i64::from(height - 1 - y)]).map(|channel| channel.clamp(0.0, 255.0) as u8))
        });
        let scale = SIDE_PX as f32 / width.max(height) as f32;
        let scaled = |columns: u32| ((columns as f32 * scale).round() as u32).clamp(MIN_SIDE_PX, SIDE_PX);
        imageops::resize(&image, scaled(width), scaled(height), imageops::FilterType::Triangle)
    }

    fn colour(&self, [x, y]: [i64; 2]) -> [f32; 3] {
        let at = |at| self.index(at).and_then(|index| self.columns[index]);
        let Some((own, rgb)) = at([x, y]) else { return BACKGROUND };
        let height = |position| at(position).map_or(own, |(height, _)| height);
        let slope = |low, high| ((height(high) - height(low)) / (2.0 * self.cell_m)).clamp(-MAX_SLOPE, MAX_SLOPE);
        let (east, north) = (slope([x - 1, y], [x + 1, y]), slope([x, y - 1], [x, y + 1]));
        let facing = TO_LIGHT[2] - TO_LIGHT[0] * east - TO_LIGHT[1] * north;
        let lambert = (facing / (east * east + north * north + 1.0).sqrt()).max(0.0);
        rgb.map(|channel| channel * (LIGHT[0] + LIGHT[1] * lambert))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::{Texel, blockmap::MapColumn};

    /// A plan from the south-west corner of a root of 128 m.
    fn plan(north_east: [f64; 2], depth: u8) -> Plan {
        Plan::new([[0.0; 2], north_east], 2.0 / f64::from(1u32 << depth), depth)
    }

    #[test]
    fn roofs_have_their_place_and_colour() {
        let mut plan = plan([128.0, 64.0], 0);
        assert_eq!((plan.level, plan.size), (0, [64, 32]));
        let mut columns = vec![None; NODE_CELLS * NODE_CELLS];
        let roof = |rgb| Some(MapColumn { z_max: 8, roof: Texel::new(rgb, AO_MAX), ..MapColumn::default() });
        columns[0] = roof([200, 0, 0]);
        columns[31 * NODE_CELLS + 63] = roof([0, 0, 200]);
        columns[32 * NODE_CELLS] = roof([0, 200, 0]);
        plan.add(&BlockMap::from_columns(TileId::ROOT, 2.0, 0, 0, &columns).unwrap());
        let image = plan.draw();
        assert_eq!(image.dimensions(), (512, 256));
        let [r, g, b] = image.get_pixel(2, 253).0;
        assert!(r > 150 && g < 10 && b < 10, "south-west: {r} {g} {b}");
        let [r, g, b] = image.get_pixel(509, 2).0;
        assert!(b > 150 && r < 10 && g < 10, "north-east: {r} {g} {b}");
        assert_eq!(image.get_pixel(2, 2).0, BACKGROUND.map(|channel| channel as u8), "beyond the bounds");
        assert!(encode(&image).unwrap().len() < 5_000);
    }

    #[test]
    fn level_has_a_column_per_pixel_or_is_the_finest() {
        for (side_m, depth, level) in [(128.0, 10, 3), (16.0, 10, 6), (128.0, 2, 2), (1e9, 10, 0)] {
            assert_eq!(plan([side_m; 2], depth).level, level, "{side_m}");
        }
        let small = plan([16.0; 2], 10);
        assert!(small.meets(TileId::new(6, 0, 7).unwrap()) && !small.meets(TileId::new(6, 0, 8).unwrap()));
        assert!(plan([1e9; 2], 10).columns.len() <= 1 << 22, "bounds that no city has");
    }

    #[test]
    fn slopes_that_face_the_light_are_brighter() {
        let mut plan = plan([128.0; 2], 0);
        let mut columns = vec![None; NODE_CELLS * NODE_CELLS];
        for (i, column) in columns.iter_mut().enumerate() {
            let x = i % NODE_CELLS;
            let z_max = 100 + 8 * x.min(63 - x) as u16;
            *column = Some(MapColumn { z_max, roof: Texel::new([120; 3], AO_MAX), ..MapColumn::default() });
        }
        plan.add(&BlockMap::from_columns(TileId::ROOT, 2.0, 0, 0, &columns).unwrap());
        assert!(plan.colour([10, 30])[0] > plan.colour([53, 30])[0] + 10.0, "the west faces the light");
    }
}
