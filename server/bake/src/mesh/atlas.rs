//! Rectangles side by side in one picture.
//!
//! In: sizes. Out: places that do not overlap. Next: `picture`.
//!
//! Shelves, the highest first: charts of walls are of few heights, so hardly anything is lost to what a packer of free
//! rectangles would do, and the order of the source decides nothing.

use insula_protocol::mesh_tile::{MAX_TEXTURE_PX, MAX_TEXTURE_SIDE_PX};

/// Where rectangles lie, and how large the picture is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ChartAtlas {
    pub(super) size: [u32; 2],
    /// Left upper corner of each, in the order of the sizes.
    pub(super) places: Vec<[u32; 2]>,
}

/// `None` if they do not fit into the largest picture that a tile may have.
pub(super) fn pack(sizes: &[[u32; 2]]) -> Option<ChartAtlas> {
    let most = u32::from(MAX_TEXTURE_SIDE_PX);
    let area: u64 = sizes.iter().map(|[w, h]| u64::from(*w) * u64::from(*h)).sum();
    let widest = sizes.iter().map(|size| size[0]).max().unwrap_or(1);
    if area > MAX_TEXTURE_PX.into() || widest > most {
        return None;
    }
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|i| (std::cmp::Reverse([sizes[*i][1], sizes[*i][0]]), *i));
    let about = ((area as f64 * 1.05).sqrt().ceil() as u32).max(widest);
    // Of a few widths, the one that leaves least empty.
    let widths = [100, 110, 120, 135, 150, 175, 200].map(|percent| (about * percent / 100).min(most));
    let packed = widths.into_iter().filter_map(|width| shelves(sizes, &order, width));
    let packed = packed.min_by_key(|atlas| u64::from(atlas.size[0]) * u64::from(atlas.size[1]))?;
    let fits = packed.size[1] <= most && packed.size[0] * packed.size[1] <= MAX_TEXTURE_PX;
    fits.then_some(packed)
}

fn shelves(sizes: &[[u32; 2]], order: &[usize], width: u32) -> Option<ChartAtlas> {
    let mut places = vec![[0; 2]; sizes.len()];
    let (mut x, mut y, mut height, mut used) = (0u32, 0u32, 0, 1);
    for &i in order {
        let [w, h] = sizes[i];
        if x + w > width {
            (x, y, height) = (0, y.checked_add(height)?, 0);
        }
        places[i] = [x, y];
        x += w;
        height = height.max(h);
        used = used.max(x);
    }
    Some(ChartAtlas { size: [used, y.checked_add(height)?.max(1)], places })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_overlaps_and_little_is_empty() {
        let mut seed = 3u32;
        let mut random = |most: u32| {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            1 + (seed >> 10) % most
        };
        for count in [1, 2, 7, 60, 400] {
            let sizes: Vec<[u32; 2]> = (0..count).map(|_| [random(60), random(40)]).collect();
            let atlas = pack(&sizes).unwrap();
            let mut taken = vec![false; (atlas.size[0] * atlas.size[1]) as usize];
            for ([w, h], [x, y]) in sizes.iter().zip(&atlas.places) {
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
    fn what_cannot_be_is_refused() {
        assert_eq!(pack(&[[4097, 1]]), None);
        assert_eq!(pack(&[[1, 4097]]), None);
        assert_eq!(pack(&[[2048, 2048], [1, 1]]), None);
        assert!(pack(&[[2048, 2048]]).is_some());
        assert_eq!(pack(&[]), Some(ChartAtlas { size: [1, 1], places: vec![] }));
    }
}
