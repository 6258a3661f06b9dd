//! Packing of rectangles into one texture.
//!
//! Rectangles are put on shelves, the tallest first. Charts of walls have few different heights, so this wastes hardly
//! more space than a packer of free rectangles. The order of the input does not affect the size of the atlas.

use insula_protocol::mesh_tile::{MAX_TEXTURE_PX, MAX_TEXTURE_SIDE_PX};

/// Widths that are tried, in percent of the side of a square that holds all rectangles.
const WIDTHS_PERCENT: [u32; 7] = [100, 110, 120, 135, 150, 175, 200];

/// Rectangles packed into one texture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ChartAtlas {
    /// Width and height in texels.
    pub(super) size: [u32; 2],
    /// Upper left corner of each rectangle, in the order of the input.
    pub(super) positions: Vec<[u32; 2]>,
}

/// Packs rectangles of the given widths and heights; `None` if they do not fit into the largest texture of a tile.
pub(super) fn pack(sizes: &[[u32; 2]]) -> Option<ChartAtlas> {
    let max_side = u32::from(MAX_TEXTURE_SIDE_PX);
    let area: u64 = sizes.iter().map(|[w, h]| u64::from(*w) * u64::from(*h)).sum();
    let widest = sizes.iter().map(|size| size[0]).max().unwrap_or(1);
    if area > MAX_TEXTURE_PX.into() || widest > max_side {
        return None;
    }
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|i| (std::cmp::Reverse([sizes[*i][1], sizes[*i][0]]), *i));
    let square_side = ((area as f64 * 1.05).sqrt().ceil() as u32).max(widest);
    let widths = WIDTHS_PERCENT.map(|percent| (square_side * percent / 100).min(max_side));
    let atlases = widths.into_iter().filter_map(|width| pack_shelves(sizes, &order, width));
    let atlas = atlases.min_by_key(|atlas| u64::from(atlas.size[0]) * u64::from(atlas.size[1]))?;
    let fits = atlas.size[1] <= max_side && atlas.size[0] * atlas.size[1] <= MAX_TEXTURE_PX;
    fits.then_some(atlas)
}

/// Fills shelves of `width` in the given order. `None` if the height overflows.
fn pack_shelves(sizes: &[[u32; 2]], order: &[usize], width: u32) -> Option<ChartAtlas> {
    let mut positions = vec![[0; 2]; sizes.len()];
    let (mut x, mut y, mut shelf_height, mut used_width) = (0u32, 0u32, 0, 1);
    for &i in order {
        let [w, h] = sizes[i];
        if x + w > width {
            (x, y, shelf_height) = (0, y.checked_add(shelf_height)?, 0);
        }
        positions[i] = [x, y];
        x += w;
        shelf_height = shelf_height.max(h);
        used_width = used_width.max(x);
    }
    Some(ChartAtlas { size: [used_width, y.checked_add(shelf_height)?.max(1)], positions })
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::rng::Rng;

    #[test]
    fn rectangles_do_not_overlap_and_little_space_is_wasted() {
        let mut rng = Rng::new(3);
        let mut random = |most: u32| 1 + rng.below_u32(most);
        for count in [1, 2, 7, 60, 400] {
            let sizes: Vec<[u32; 2]> = (0..count).map(|_| [random(60), random(40)]).collect();
            let atlas = pack(&sizes).unwrap();
            let mut taken = vec![false; (atlas.size[0] * atlas.size[1]) as usize];
            for ([w, h], [x, y]) in sizes.iter().zip(&atlas.positions) {
                assert!(x + w <= atlas.size[0] && y + h <= atlas.size[1]);
                for at in (*y..y + h).flat_map(|row| (*x..x + w).map(move |column| [row, column])) {
                    let texel = &mut taken[(at[0] * atlas.size[0] + at[1]) as usize];
                    assert!(!std::mem::replace(texel, true));
                }
            }
            let full = taken.iter().filter(|taken| **taken).count() as f64 / taken.len() as f64;
            assert!(count < 60 || full > 0.8, "{count}: {full}");
        }
    }

    #[test]
    fn too_large_rectangles_are_refused() {
        assert_eq!(pack(&[[4097, 1]]), None);
        assert_eq!(pack(&[[1, 4097]]), None);
        assert_eq!(pack(&[[2048, 2048], [1, 1]]), None);
        assert!(pack(&[[2048, 2048]]).is_some());
        assert_eq!(pack(&[]), Some(ChartAtlas { size: [1, 1], positions: vec![] }));
    }
}
