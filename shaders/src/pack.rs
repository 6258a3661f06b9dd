//! A V-BlockMap as the ray-caster reads it: pages of words.
//!
//! In: a decoded [`BlockMap`]. Out: [`PackedNode`]. Next: the client's cache gives it pages and a slot, `cpu::raycast` and
//! `raycast.wgsl` walk it.
//!
//! | page | word of column i |
//! |---|---|
//! | 0 walk | `z_max` (12 bits), `z_min` (12), flags (8). With [`flag::GAP`] the first two are the gap, so that a ray below an overhang reads no more: where what is above it begins, and where what is below it ends (or what is beyond the plane that clips the column, if that is higher) |
//! | 1 roof | texel |
//! | 2 attributes | roof normal (16), wall azimuth (8), offset of the plane that clips the column (8, signed) |
//! | 3 strips | address of its strip: a word of the atlas (0 if none) |
//! | 4... | strips; one never crosses a page. With [`flag::GAP`] two words before the texels are the gap, `low \| high << 16`, and `z_max \| z_min << 12`; with [`flag::CLIPPED`] two words before that are [`clip_word`] and the texel beyond |

use crate::layout::{BLOCK_CELLS, BLOCKS, PAGE_WORDS, PLANES, SUMMARY_WORDS};
use insula_protocol::{
    BlockMap, NODE_CELLS,
    blockmap::{COLUMNS, ColumnClip, STEPS_PER_CELL, flag, strip_rows},
    octahedral,
};

/// One page's words.
pub type Page = Box<[u32]>;

/// A node in pages; strip addresses are still relative to the first strip page.
#[derive(Debug, Clone)]
pub struct PackedNode {
    /// [`PLANES`] planes, then strip pages, each of [`PAGE_WORDS`] words.
    pub pages: Vec<Page>,
    /// Lowest and highest height codes per block, and tops per quad.
    pub summary: [u32; SUMMARY_WORDS],
    /// Side of a column.
    pub cell_m: f32,
    /// Metres of a height code.
    pub z_step_m: f32,
    /// Height of code 0 above the city's origin.
    pub z_base_m: f64,
    /// Lowest and highest point in codes, slopes included.
    pub z_range: [f32; 2],
    /// How far quarters lie below it, as [`Node::pages_and_quarters`](crate::layout::Node::pages_and_quarters) wants it.
    pub below: [u8; 4],
    /// The map's `z_shift`.
    pub z_shift: u32,
}

/// Pages that `map` takes, without packing it.
pub fn page_count(map: &BlockMap) -> usize {
    let mut layout = StripLayout::default();
    for i in 0..COLUMNS {
        layout.place(strip_words(map, i));
    }
    PLANES + layout.pages
}

/// Slope of an inclined column in height codes per cell along x and y; the plane rises against the normal.
pub fn slope_codes(normal_code: u16, z_shift: u32) -> [f32; 2] {
    let n = octahedral::decode(normal_code);
    // A top that leans so far that it could not be seen from above is no top; the bake never writes one.
    let scale = -(f32::from(STEPS_PER_CELL >> z_shift)) / n[2].max(0.1);
    [n[0] * scale, n[1] * scale]
}

fn strip_words(map: &BlockMap, i: usize) -> usize {
    let flags = map.flags[i];
    if flags & flag::EXPOSED == 0 {
        return 0;
    }
    usize::from(strip_rows(map.z_min[i], map.z_max[i], map.z_shift).1) + head_words(flags)
}

/// What a clipped column has besides its azimuth and offset: top of what is beyond (12 bits, 0 if nothing is), whether it is
/// a corner (1), a concave one (1), two bits of zero, azimuth (8) and offset (8, signed) of the corner's second plane.
pub fn clip_word(clip: &ColumnClip) -> u32 {
    let top = u32::from(clip.outer.map_or(0, |outer| outer.z));
    let corner = clip.corner.map_or(0, |c| {
        CORNER | if c.concave { CONCAVE } else { 0 } | u32::from(c.azimuth) << 16 | u32::from(c.offset as u8) << 24
    });
    top | corner
}

/// In a [`clip_word`]: there is a second plane.
pub const CORNER: u32 = 1 << 12;
/// In a [`clip_word`]: the column fills the inner side of either plane, not of both.
pub const CONCAVE: u32 = 1 << 13;

/// Words before a strip's texels: [`clip_word`] and the texel beyond of a clipped column, then the gap and the column's bounds.
pub fn head_words(flags: u8) -> usize {
    (usize::from(flags & flag::CLIPPED != 0) + usize::from(flags & flag::GAP != 0)) * 2
}

/// Places strips one after the other, none across a page.
#[derive(Default)]
struct StripLayout {
    pages: usize,
    used: usize,
}

impl StripLayout {
    /// Word, relative to the first strip page, where `words` go. A strip is shorter than a page: 4095 codes at most.
    fn place(&mut self, words: usize) -> usize {
        if words == 0 {
            return 0;
        }
        if self.pages == 0 || self.used + words > PAGE_WORDS {
            self.pages += 1;
            self.used = 0;
        }
        let at = (self.pages - 1) * PAGE_WORDS + self.used;
        self.used += words;
        at
    }
}

impl PackedNode {
    /// Packs a decoded map (whose decoder has checked every height and length).
    pub fn new(map: &BlockMap) -> Self {
        let mut pages: Vec<Page> = vec![vec![0; PAGE_WORDS].into(); page_count(map)];
        let mut layout = StripLayout::default();
        let (mut gaps, mut clips, mut strips) = (map.gaps.iter(), map.clips.iter(), &map.strips[..]);
        for i in 0..COLUMNS {
            let flags = map.flags[i];
            let bounds = u32::from(map.z_max[i]) | u32::from(map.z_min[i]) << 12;
            pages[0][i] = bounds | u32::from(flags) << 24;
            pages[1][i] = map.roof[i].0;
            let clip = (flags & flag::CLIPPED != 0).then(|| clips.next()).flatten();
            let offset = clip.map_or(0, |clip| clip.offset as u8);
            pages[2][i] =
                u32::from(map.roof_normal[i]) | u32::from(map.wall_azimuth[i]) << 16 | u32::from(offset) << 24;
            let words = strip_words(map, i);
            if words == 0 {
                continue;
            }
            let at = layout.place(words);
            pages[3][i] = at as u32;
            let outer = clip.map(|clip| [clip_word(clip), clip.outer.map_or(0, |outer| outer.roof.0)]);
            let gap = (flags & flag::GAP != 0).then(|| gaps.next()).flatten();
            let gap = gap.map(|[low, high]| {
                let solid = u32::from(*low).max(clip.and_then(|clip| clip.outer).map_or(0, |outer| u32::from(outer.z)));
                pages[0][i] = u32::from(*high) | solid << 12 | u32::from(flags) << 24;
                [u32::from(*low) | u32::from(*high) << 16, bounds]
            });
            let page = &mut pages[PLANES + at / PAGE_WORDS][at % PAGE_WORDS..][..words];
            let (before, texels) = page.split_at_mut(head_words(flags));
            for (word, value) in before.iter_mut().zip(outer.into_iter().chain(gap).flatten()) {
                *word = value;
            }
            let (head, tail) = strips.split_at(texels.len().min(strips.len()));
            strips = tail;
            for (word, texel) in texels.iter_mut().zip(head) {
                *word = texel.0;
            }
        }
        let (summary, z_range, below) = summarise(map);
        let (cell_m, z_step_m, z_base_m) = (map.cell_m, map.z_step_m(), map.z_base_m());
        Self { pages, summary, cell_m, z_step_m, z_base_m, z_range, below, z_shift: u32::from(map.z_shift) }
    }

    /// Makes strip addresses absolute, once the cache has said which atlas pages the node gets (one per entry of
    /// [`PackedNode::pages`], in order).
    pub fn relocate(&mut self, atlas_pages: &[u32]) {
        let count = self.pages.len();
        let (planes, strips) = self.pages.split_at_mut(PLANES.min(count));
        if strips.is_empty() || atlas_pages.len() < PLANES + strips.len() {
            return;
        }
        let [walk, .., addresses] = planes else { return };
        for (word, walk) in addresses.iter_mut().zip(walk.iter()) {
            if (walk >> 24) as u8 & flag::EXPOSED != 0 {
                let at = *word as usize;
                *word = atlas_pages[PLANES + at / PAGE_WORDS] * PAGE_WORDS as u32 + (at % PAGE_WORDS) as u32;
            }
        }
    }
}

/// Per block the lowest bottom and the highest top (slopes included) and its quads' tops, bottom and top of the whole node, and
/// how far its quarters lie below that.
fn summarise(map: &BlockMap) -> ([u32; SUMMARY_WORDS], [f32; 2], [u8; 4]) {
    let mut bounds = [[u32::from(u16::MAX), 0]; BLOCKS];
    let mut quads = [[0u32; 16]; BLOCKS];
    let block_cells = BLOCK_CELLS as usize;
    for i in (0..COLUMNS).filter(|i| map.flags[*i] & flag::OCCUPIED != 0) {
        let (x, y) = (i % NODE_CELLS, i / NODE_CELLS);
        let mut top = u32::from(map.z_max[i]);
        if map.flags[i] & flag::INCLINED != 0 {
            let [sx, sy] = slope_codes(map.roof_normal[i], u32::from(map.z_shift));
            top += (0.5 * (sx.abs() + sy.abs())).ceil() as u32;
        }
        let top = top.min(u32::from(u16::MAX));
        let at = y / block_cells * (NODE_CELLS / block_cells) + x / block_cells;
        let block = &mut bounds[at];
        block[0] = block[0].min(u32::from(map.z_min[i]));
        block[1] = block[1].max(top);
        let quad = &mut quads[at][y / 2 % 4 * 4 + x / 2 % 4];
        *quad = (*quad).max(top);
    }
    let low = bounds.iter().map(|b| b[0]).min().unwrap_or(0);
    let high = bounds.iter().map(|b| b[1]).max().unwrap_or(0);
    let mut tops = [low; 4];
    for (at, [_, top]) in bounds.iter().enumerate() {
        let half = NODE_CELLS / block_cells / 2;
        let quarter = at / half % 2 + at / (BLOCKS / 2) * 2;
        tops[quarter] = tops[quarter].max(*top);
    }
    // Rounded down: a quarter is never higher than its byte says.
    let below = tops.map(|top| ((high.max(low) - top) * 255 / (high.max(low) - low).max(1)) as u8);
    let mut summary = [0; SUMMARY_WORDS];
    for (block, [low, high]) in bounds.into_iter().enumerate() {
        let words = &mut summary[block * 4..][..4];
        for (word, byte) in words.iter_mut().zip([low, low >> 8, high, high >> 8]) {
            *word = byte << 24;
        }
        let share = |top: u32| (top.saturating_sub(low) * 63).div_ceil((high.max(low) - low).max(1));
        for (quad, top) in quads[block].into_iter().enumerate() {
            words[quad / 4] |= share(top).min(63) << (quad % 4 * 6);
        }
    }
    (summary, [low as f32, high as f32], below)
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::{
        Texel, TileId,
        blockmap::{CornerWall, MapColumn, OuterTop, WallStrip},
    };

    fn tall(z_min: u16, z_max: u16, gap: Option<[u16; 2]>) -> MapColumn {
        let rows = strip_rows(z_min, z_max, 0).1;
        let texels = (0..rows).map(|r| Texel::new([r as u8, 1, 2], 63, 3)).collect();
        MapColumn { z_min, z_max, gap, strip: Some(WallStrip { texels, azimuth: 7 }), ..MapColumn::default() }
    }

    #[test]
    fn planes_lie_beside_azimuths_and_before_gaps() {
        let mut columns = vec![None; COLUMNS];
        let corner = Some(CornerWall { azimuth: 200, offset: -2, concave: true });
        let outer = Some(OuterTop { z: 30, roof: Texel(0xc0ffee) });
        columns[9] =
            Some(MapColumn { clip: Some(ColumnClip { offset: -3, corner, outer }), ..tall(5, 400, Some([100, 200])) });
        columns[10] =
            Some(MapColumn { clip: Some(ColumnClip { offset: 4, ..ColumnClip::default() }), ..tall(5, 400, None) });
        let packed = PackedNode::new(&BlockMap::from_columns(TileId::ROOT, 1.0, 0, 0, &columns).unwrap());
        assert_eq!(packed.pages[2][9] >> 16, 0xfd07);
        let at = |i: usize| &packed.pages[PLANES][packed.pages[3][i] as usize..];
        let clip = [30 | CORNER | CONCAVE | 200 << 16 | 0xfe << 24, 0xc0ffee];
        assert_eq!((&at(9)[..2], &at(9)[2..4]), (&clip[..], &[100 | 200 << 16, 400 | 5 << 12][..]));
        assert_eq!(Texel(at(9)[4]).rgb(), [0, 1, 2]);
        assert_eq!(at(10)[..2], [0, 0]);
        let heights = |i: usize| packed.pages[0][i] & 0xff_ffff;
        assert_eq!([heights(9), heights(10)], [200 | 100 << 12, 400 | 5 << 12]);
    }

    #[test]
    fn strips_are_found_again_and_never_cross_a_page() {
        let mut columns = vec![None; COLUMNS];
        for i in 0..100 {
            columns[i * 3] = Some(tall(5, 4000 - i as u16, (i % 2 == 0).then_some([100, 200])));
        }
        let map = BlockMap::from_columns(TileId::ROOT, 1.0, 0, 0, &columns).unwrap();
        let mut packed = PackedNode::new(&map);
        assert_eq!(packed.pages.len(), page_count(&map));
        let atlas_pages: Vec<u32> = (0..packed.pages.len() as u32).map(|p| 1000 - p * 3).collect();
        packed.relocate(&atlas_pages);
        for i in 0..100 {
            let address = packed.pages[3][i * 3];
            let page = atlas_pages.iter().position(|p| *p == address / PAGE_WORDS as u32).unwrap();
            let words = &packed.pages[page][address as usize % PAGE_WORDS..];
            let texels = if i % 2 == 0 {
                assert_eq!(words[0], 100 | 200 << 16);
                &words[2..]
            } else {
                words
            };
            assert_eq!(Texel(texels[17]).rgb(), [17, 1, 2]);
        }
    }

    #[test]
    fn summaries_hold_slopes() {
        let mut columns = vec![None; COLUMNS];
        let roof_normal = octahedral::encode([0.5, 0.0, 0.866]);
        columns[8] = Some(MapColumn { z_min: 10, z_max: 20, inclined: true, roof_normal, ..MapColumn::default() });
        let map = BlockMap::from_columns(TileId::ROOT, 1.0, 0, 0, &columns).unwrap();
        let packed = PackedNode::new(&map);
        assert_eq!(packed.summary[..4], [0xff << 24, 0xff << 24, 0, 0], "an empty block");
        assert_eq!(packed.z_range[0], 10.0);
        assert_eq!(packed.below, [0, 255, 255, 255], "all but the south-west quarter are empty");
        // Column 8 is in the first quad of the second block, and its highest.
        assert_eq!(packed.summary[4], 63 | 10 << 24);
        assert!((25..=26).contains(&(packed.summary[6] >> 24)), "{}", packed.summary[6] >> 24);
        assert_eq!([packed.summary[5], packed.summary[6] & 0xff_ffff, packed.summary[7]], [0, 0, 0]);
    }
}
