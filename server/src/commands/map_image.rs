//! A node's three maps side by side, as in figure 3.10 of Vacca 2008.
//!
//! In: a [`BlockMap`]. Out: a picture. Next: `inspect --png`.
//!
//! From the left: the geometry map (top in red, bottom in green, exposed columns in blue, brighter the later their strip
//! comes), the roofs map (colour times AO), the walls map (strips one after the other in column order, each bottom to top,
//! as lines of 256 texels from the top).

use image::{Rgb, RgbImage};
use insula_protocol::{
    BlockMap, NODE_CELLS, Texel,
    blockmap::{COLUMNS, flag, strip_rows},
    texel::AO_MAX,
};

/// A texel becomes a square of so many pixels.
const SCALE: u32 = 4;
/// Texels between the maps.
const GAP: u32 = 4;
/// Texels in a line of the walls map.
const WALL_WIDTH: u32 = 256;
/// Lines of the walls map that are drawn; no node of a real city needs as many.
const WALL_HEIGHT_MAX: u32 = 1024;

const PAPER: Rgb<u8> = Rgb([40, 40, 48]);
const NOTHING: Rgb<u8> = Rgb([0, 0, 0]);
const SIDE: u32 = NODE_CELLS as u32;

/// Draws all three, north up.
pub(super) fn draw(map: &BlockMap) -> RgbImage {
    let maps = [geometry(map), roofs(map), walls(&map.strips)];
    let width = maps.iter().map(RgbImage::width).sum::<u32>() + GAP * 4;
    let height = maps.iter().map(RgbImage::height).max().unwrap_or_default() + GAP * 2;
    let mut sheet = RgbImage::from_pixel(width, height, PAPER);
    let mut left = GAP;
    for part in &maps {
        image::imageops::replace(&mut sheet, part, i64::from(left), i64::from(GAP));
        left += part.width() + GAP;
    }
    image::imageops::resize(&sheet, width * SCALE, height * SCALE, image::imageops::FilterType::Nearest)
}

fn geometry(map: &BlockMap) -> RgbImage {
    let highest = map.z_max.iter().copied().max().unwrap_or(1).max(1);
    let places = strip_places(map);
    let all = map.strips.len().max(1);
    let height = |z: u16| (u32::from(z) * 255 / u32::from(highest)) as u8;
    columns(map, |i| {
        // 64 and more, so that the first strip too can be told from none.
        let exposed = map.flags[i] & flag::EXPOSED != 0;
        let blue = if exposed { 64 + (places[i] * 191 / all) as u8 } else { 0 };
        Rgb([height(map.z_max[i]), height(map.z_min[i]), blue])
    })
}

fn roofs(map: &BlockMap) -> RgbImage {
    columns(map, |i| shade(map.roof[i]))
}

fn walls(strips: &[Texel]) -> RgbImage {
    let height = (strips.len() as u32).div_ceil(WALL_WIDTH).clamp(SIDE, WALL_HEIGHT_MAX);
    let mut picture = RgbImage::from_pixel(WALL_WIDTH, height, NOTHING);
    for (pixel, texel) in picture.pixels_mut().zip(strips) {
        *pixel = if texel.alpha() == 0 { Rgb([255, 0, 255]) } else { shade(*texel) };
    }
    picture
}

/// One pixel a column, north up; where there is none, black.
fn columns(map: &BlockMap, colour: impl Fn(usize) -> Rgb<u8>) -> RgbImage {
    RgbImage::from_fn(SIDE, SIDE, |x, y| {
        let i = ((SIDE - 1 - y) * SIDE + x) as usize;
        if map.flags[i] & flag::OCCUPIED == 0 { NOTHING } else { colour(i) }
    })
}

/// Where each column's strip begins.
fn strip_places(map: &BlockMap) -> Vec<usize> {
    let mut next = 0;
    let mut place = |i: usize| {
        let start = next;
        if map.flags[i] & flag::EXPOSED != 0 {
            next += usize::from(strip_rows(map.z_min[i], map.z_max[i], map.z_shift).1);
        }
        start
    };
    (0..COLUMNS).map(&mut place).collect()
}

fn shade(texel: Texel) -> Rgb<u8> {
    let light = u32::from(texel.ao());
    Rgb(texel.rgb().map(|v| (u32::from(v) * light / u32::from(AO_MAX)) as u8))
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::{
        TileId,
        blockmap::{Column, Strip},
    };

    /// The middle of the square that is the texel at `x`, `y` of the map that begins at `left`.
    fn pixel(picture: &RgbImage, left: u32, x: u32, y: u32) -> [u8; 3] {
        picture.get_pixel((left + x) * SCALE + 2, (GAP + y) * SCALE + 2).0
    }

    #[test]
    fn each_map_is_where_it_should_be() {
        let mut columns = vec![None; COLUMNS];
        let grey = Texel::new([100; 3], AO_MAX, 3);
        let wall = [Texel::new([9, 8, 7], AO_MAX, 3), Texel::TRANSPARENT];
        // South-west corner: a roof of half the height. Its eastern neighbour: exposed, 2 texels.
        columns[0] = Some(Column { z_min: 8, z_max: 16, roof: Texel::new([200, 100, 0], 31, 3), ..Column::default() });
        let strip = Some(Strip { texels: wall.to_vec(), azimuth: 0 });
        columns[1] = Some(Column { z_min: 0, z_max: 32, roof: grey, strip, ..Column::default() });
        let map = BlockMap::from_columns(TileId::ROOT, 1.0, 0, 0, &columns).unwrap();
        let picture = draw(&map);
        assert_eq!(picture.dimensions(), ((64 + 64 + 256 + 16) * SCALE, (64 + 8) * SCALE));
        let (geometry, roofs, walls, south) = (GAP, GAP * 2 + SIDE, GAP * 3 + SIDE * 2, SIDE - 1);
        assert_eq!(pixel(&picture, geometry, 0, south), [127, 63, 0]);
        assert_eq!(pixel(&picture, geometry, 1, south), [255, 0, 64]);
        assert_eq!(pixel(&picture, geometry, 2, south), [0; 3]);
        assert_eq!(pixel(&picture, roofs, 0, south), [98, 49, 0]);
        assert_eq!(pixel(&picture, roofs, 1, south), [100; 3]);
        assert_eq!(pixel(&picture, walls, 0, 0), [9, 8, 7]);
        assert_eq!(pixel(&picture, walls, 1, 0), [255, 0, 255], "holes are seen");
        assert_eq!(pixel(&picture, walls, 2, 0), [0; 3]);
        assert_eq!(picture.get_pixel(1, 1), &PAPER);
    }

    #[test]
    fn an_empty_node_and_long_walls_are_drawn() {
        let empty = BlockMap::empty(TileId::ROOT, 1.0, 0, 0);
        assert_eq!(draw(&empty).height(), (64 + 8) * SCALE);
        assert_eq!(walls(&vec![Texel::TRANSPARENT; 256 * 100 + 1]).dimensions(), (256, 101));
        assert_eq!(walls(&vec![Texel::TRANSPARENT; 1 << 20]).dimensions(), (256, WALL_HEIGHT_MAX));
    }
}
