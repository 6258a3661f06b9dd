//! A node's three maps side by side, as in figure 3.10 of Vacca 2008.
//!
//! From the left: the geometry map (top height in red, bottom in green; exposed columns in blue, brighter for later wall
//! strips), the roof map (colour times ambient occlusion), and the wall map (the wall strips one after the other in column
//! order, each from bottom to top, in rows of 256 texels).

use image::{Rgb, RgbImage};
use insula_protocol::blockmap::{COLUMNS, flag, strip_rows};
use insula_protocol::texel::AO_MAX;
use insula_protocol::{BlockMap, NODE_CELLS, Texel};

/// Side of a texel in pixels.
const SCALE: u32 = 4;
/// Space around the maps in texels.
const GAP: u32 = 4;
/// Width of the wall map in texels.
const WALL_WIDTH: u32 = 256;
/// Rows of the wall map that are drawn at most. Real cities need fewer.
const WALL_HEIGHT_MAX: u32 = 1024;

pub(super) const BACKGROUND: Rgb<u8> = Rgb([40, 40, 48]);
const EMPTY: Rgb<u8> = Rgb([0, 0, 0]);
const SIDE: u32 = NODE_CELLS as u32;

/// Draws the three maps, north up.
pub(super) fn draw(map: &BlockMap) -> RgbImage {
    let maps = [geometry_map(map), roof_map(map), wall_map(&map.strips)];
    let width = maps.iter().map(RgbImage::width).sum::<u32>() + GAP * 4;
    let height = maps.iter().map(RgbImage::height).max().unwrap_or_default() + GAP * 2;
    let mut image = RgbImage::from_pixel(width, height, BACKGROUND);
    let mut left = GAP;
    for part in &maps {
        image::imageops::replace(&mut image, part, i64::from(left), i64::from(GAP));
        left += part.width() + GAP;
    }
    image::imageops::resize(&image, width * SCALE, height * SCALE, image::imageops::FilterType::Nearest)
}

fn geometry_map(map: &BlockMap) -> RgbImage {
    let highest = map.z_max.iter().copied().max().unwrap_or(1).max(1);
    let strip_starts = strip_starts(map);
    let strip_texels = map.strips.len().max(1);
    let height = |z: u16| (u32::from(z) * 255 / u32::from(highest)) as u8;
    draw_columns(map, |i| {
        // At least 64, so that the first wall strip differs from no strip.
        let exposed = map.flags[i] & flag::EXPOSED != 0;
        let blue = if exposed { 64 + (strip_starts[i] * 191 / strip_texels) as u8 } else { 0 };
        Rgb([height(map.z_max[i]), height(map.z_min[i]), blue])
    })
}

fn roof_map(map: &BlockMap) -> RgbImage {
    draw_columns(map, |i| shade(map.roof[i]))
}

fn wall_map(strips: &[Texel]) -> RgbImage {
    let height = (strips.len() as u32).div_ceil(WALL_WIDTH).clamp(SIDE, WALL_HEIGHT_MAX);
    let mut image = RgbImage::from_pixel(WALL_WIDTH, height, EMPTY);
    for (pixel, texel) in image.pixels_mut().zip(strips) {
        *pixel = if texel.is_open() { Rgb([255, 0, 255]) } else { shade(*texel) };
    }
    image
}

/// One pixel per column, north up; black where there is no column.
fn draw_columns(map: &BlockMap, colour: impl Fn(usize) -> Rgb<u8>) -> RgbImage {
    RgbImage::from_fn(SIDE, SIDE, |x, y| {
        let i = ((SIDE - 1 - y) * SIDE + x) as usize;
        if map.flags[i] & flag::OCCUPIED == 0 { EMPTY } else { colour(i) }
    })
}

/// Index of the first texel of each column's wall strip.
fn strip_starts(map: &BlockMap) -> Vec<usize> {
    let mut next = 0;
    let mut advance = |i: usize| {
        let start = next;
        if map.flags[i] & flag::EXPOSED != 0 {
            next += usize::from(strip_rows(map.z_min[i], map.z_max[i], map.z_shift).1);
        }
        start
    };
    (0..COLUMNS).map(&mut advance).collect()
}

/// A colour as it is under the sky.
pub(super) fn shade(texel: Texel) -> Rgb<u8> {
    let light = u32::from(texel.ao());
    Rgb(texel.rgb().map(|v| (u32::from(v) * light / u32::from(AO_MAX)) as u8))
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::TileId;
    use insula_protocol::blockmap::{MapColumn, WallStrip};

    /// Colour of the texel at `x`, `y` of the map whose left edge is at texel `left`.
    fn pixel(image: &RgbImage, left: u32, x: u32, y: u32) -> [u8; 3] {
        image.get_pixel((left + x) * SCALE + 2, (GAP + y) * SCALE + 2).0
    }

    #[test]
    fn texels_have_their_place_and_colour() {
        let mut columns = vec![None; COLUMNS];
        let grey = Texel::new([100; 3], AO_MAX);
        let wall = [Texel::new([9, 8, 7], AO_MAX), Texel::OPEN];
        // In the south-west corner a roof of half the height; east of it an exposed column with 2 texels.
        columns[0] =
            Some(MapColumn { z_min: 8, z_max: 16, roof: Texel::new([200, 100, 0], 31), ..MapColumn::default() });
        let strip = Some(WallStrip { texels: wall.to_vec(), azimuth: 0 });
        columns[1] = Some(MapColumn { z_min: 0, z_max: 32, roof: grey, strip, ..MapColumn::default() });
        let map = BlockMap::from_columns(TileId::ROOT, 1.0, 0, 0, &columns).unwrap();
        let image = draw(&map);
        assert_eq!(image.dimensions(), ((64 + 64 + 256 + 16) * SCALE, (64 + 8) * SCALE));
        let (geometry, roofs, walls, south) = (GAP, GAP * 2 + SIDE, GAP * 3 + SIDE * 2, SIDE - 1);
        assert_eq!(pixel(&image, geometry, 0, south), [127, 63, 0]);
        assert_eq!(pixel(&image, geometry, 1, south), [255, 0, 64]);
        assert_eq!(pixel(&image, geometry, 2, south), [0; 3]);
        assert_eq!(pixel(&image, roofs, 0, south), [98, 49, 0]);
        assert_eq!(pixel(&image, roofs, 1, south), [100; 3]);
        assert_eq!(pixel(&image, walls, 0, 0), [9, 8, 7]);
        assert_eq!(pixel(&image, walls, 1, 0), [255, 0, 255], "transparent texels are marked");
        assert_eq!(pixel(&image, walls, 2, 0), [0; 3]);
        assert_eq!(image.get_pixel(1, 1), &BACKGROUND);
    }

    #[test]
    fn empty_nodes_and_long_wall_maps_are_drawn() {
        let empty = BlockMap::empty(TileId::ROOT, 1.0, 0, 0);
        assert_eq!(draw(&empty).height(), (64 + 8) * SCALE);
        assert_eq!(wall_map(&vec![Texel::OPEN; 256 * 100 + 1]).dimensions(), (256, 101));
        assert_eq!(wall_map(&vec![Texel::OPEN; 1 << 20]).dimensions(), (256, WALL_HEIGHT_MAX));
    }
}
