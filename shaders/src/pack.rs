//! A V-BlockMap as the ray-caster reads it: pages of words. The client's cache assigns pages of the atlas and a slot for
//! its summary.
//!
//! | page | word of column i |
//! |---|---|
//! | 0 walk | `z_max` (12 bits), `z_min` (12), flags (8). With [`flag::GAP`] the two heights are those of the gap, so that a ray below an overhang reads nothing else: where the part above the gap begins, and where the part below it (or beyond the clipping plane, if that is higher) ends |
//! | 1 roof | texel |
//! | 2 attributes | roof normal (16), wall azimuth (8), offset of the plane that clips the column (8, signed). With [`flag::HOLES`] and without [`flag::CLIPPED`], that offset is the code of the share of a thin column's sides, and the normal that of its top; 0 if it is not thin |
//! | 3 strips | address of the column's strip: a word of the atlas, 0 without a strip |
//! | last | objects of a node that has some: 1 + places in the palette, of the top (12 bits), the wall (12) and the lower top (8). The palette is among the strips: a word per object, see [`crate::layout::PALETTE_COLOURED`] |
//! | 4... | strips; none crosses a page. With [`flag::GAP`] the two words before the texels are the gap, `low \| high << 16`, and `z_max \| z_min << 12`; with [`flag::CLIPPED`] the two words before those are [`clip_word`] and the texel beyond the plane |

use crate::atmosphere::LUMINANCE;
use crate::layout::{
    ATTRIBUTE_PLANE, BLOCK_CELLS, NODE_BLOCKS, OBJECT_BITS, PAGE_WORDS, PLANES, QUAD_TOP_BITS, QUAD_TOP_MAX,
    ROOF_PLANE, STRIP_PLANE, SUMMARY_BYTE_SHIFT, SUMMARY_WORDS, WALK_PLANE,
};
use crate::srgb::linear_of;
use crate::words;
use insula_protocol::blockmap::{
    COLUMNS, ColumnClip, MIN_NORMAL_Z, NO_OBJECT, STEPS_PER_CELL, ThinShare, flag, strip_rows,
};
use insula_protocol::{BlockMap, NODE_CELLS, octahedral};
use serde::{Deserialize, Serialize};

/// Bits of a height in a word of the walk plane or of a column's bounds.
pub(crate) const HEIGHT_BITS: u32 = 12;
/// A height in such a word, shifted down.
pub(crate) const HEIGHT_MASK: u32 = (1 << HEIGHT_BITS) - 1;
/// Where the flags begin in a word of the walk plane.
pub(crate) const FLAGS_SHIFT: u32 = 24;
/// Where the azimuth begins in an attribute or a [`clip_word`].
pub(crate) const AZIMUTH_SHIFT: u32 = 16;
/// Azimuths of a full turn.
pub(crate) const AZIMUTHS: u32 = 256;
/// Where the plane's offset begins in an attribute or a [`clip_word`].
pub(crate) const CLIP_OFFSET_SHIFT: u32 = 24;
/// In a [`clip_word`]: there is a second plane.
pub const CLIP_CORNER: u32 = 1 << HEIGHT_BITS;
/// In a [`clip_word`]: the column fills the inner side of either plane, not of both.
pub const CLIP_CONCAVE: u32 = 1 << 13;
/// What the number of a column adds to the thresholds of rays that meet it, in 65,536ths: the golden ratio.
pub(crate) const THIN_STEP: u32 = 40503;
/// Where the visible share of the sky begins in a texel.
pub(crate) const AO_SHIFT: u32 = 26;

/// One page's words.
pub type Page = Box<[u32]>;

/// A node in pages. Until [`PackedNode::relocate`], strip addresses are relative to the first strip page.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct PackedNode {
    /// [`PLANES`] planes, then strip pages, then the objects' plane if there are objects, each of [`PAGE_WORDS`] words.
    #[serde(with = "words::pages")]
    pub pages: Vec<Page>,
    /// Bounds of each block and tops of its quads, as [`SUMMARY_WORDS`] says.
    #[serde(with = "words::array")]
    pub summary: [u32; SUMMARY_WORDS],
    /// Side of a column, in metres.
    pub cell_m: f32,
    /// Metres of a height code.
    pub z_step_m: f32,
    /// Height of code 0 above the city's origin, in metres.
    pub z_base_m: f64,
    /// Lowest and highest point in height codes, slopes included.
    pub z_range: [f32; 2],
    /// How far its quarters are below it, for
    /// [`DrawNode::pages_and_quarters`](crate::layout::DrawNode::pages_and_quarters).
    pub below: [u8; 4],
    pub z_shift: u32,
    /// Mean log2 of the luminances of its texels, at most 0.
    pub albedo_log2: f32,
    /// The objects, if it has some.
    pub objects: Option<PackedObjects>,
}

/// The objects of a packed tile: a word each, one after the other, in one page.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PackedObjects {
    /// Numbers in the city, in the order of the palette.
    pub list: Vec<u32>,
    /// First word of the palette: relative to the first page of strips of a node, to the first page of a mesh, until the tile is
    /// relocated.
    pub palette: u32,
}

/// Most objects of a column's palette.
const MAX_OBJECTS: usize = (1 << OBJECT_BITS) - 1;
/// Most objects that can be those of lower tops: they come first.
const MAX_LOWER_OBJECTS: usize = 255;

/// The objects of a map in the order of their palette: first those of lower tops, then the others, each ascending. Of too many, the
/// last ones are left out.
fn palette_of(map: &BlockMap) -> Vec<u32> {
    let Some(objects) = &map.objects else { return Vec::new() };
    let mut list: Vec<u32> = objects.lower.iter().copied().filter(|object| *object != NO_OBJECT).collect();
    list.sort_unstable();
    list.dedup();
    list.truncate(MAX_LOWER_OBJECTS);
    let first: std::collections::BTreeSet<u32> = list.iter().copied().collect();
    list.extend(objects.distinct().into_iter().filter(|object| !first.contains(object)));
    list.truncate(MAX_OBJECTS);
    list
}

fn object_plane(map: &BlockMap, list: &[u32]) -> Page {
    let mut page: Page = vec![0; PAGE_WORDS].into();
    let Some(objects) = &map.objects else { return page };
    let places: std::collections::BTreeMap<u32, u32> =
        (1..).zip(list).map(|(place, object)| (*object, place)).collect();
    let place = |object: u32| places.get(&object).copied().unwrap_or(0);
    for (i, word) in page.iter_mut().enumerate().take(COLUMNS) {
        let lower = Some(place(objects.lower[i])).filter(|place| *place as usize <= MAX_LOWER_OBJECTS).unwrap_or(0);
        *word = place(objects.roof[i]) | place(objects.wall[i]) << OBJECT_BITS | lower << (2 * OBJECT_BITS);
    }
    page
}

/// Number of pages that `map` takes when packed.
pub fn page_count(map: &BlockMap) -> usize {
    let mut layout = StripLayout::default();
    for i in 0..COLUMNS {
        layout.place(strip_words(map, i));
    }
    let objects = palette_of(map).len();
    layout.place(objects);
    PLANES + layout.pages + usize::from(objects > 0)
}

/// Slope of an inclined column's top in height codes per cell along x and y: the plane rises against its normal.
pub fn slope_codes(normal_code: u16, z_shift: u32) -> [f32; 2] {
    let n = octahedral::decode(normal_code);
    let scale = -(f32::from(STEPS_PER_CELL >> z_shift)) / n[2].max(MIN_NORMAL_Z);
    [n[0] * scale, n[1] * scale]
}

fn strip_words(map: &BlockMap, i: usize) -> usize {
    let flags = map.flags[i];
    if flags & flag::EXPOSED == 0 {
        return 0;
    }
    usize::from(strip_rows(map.z_min[i], map.z_max[i], map.z_shift).1) + head_words(flags)
}

/// A clipped column's data besides its azimuth and offset: top of the part beyond the plane (12 bits, 0 if
/// there is none), [`CLIP_CORNER`], [`CLIP_CONCAVE`], two bits of zero, azimuth (8) and offset (8, signed) of the
/// corner's second plane.
pub fn clip_word(clip: &ColumnClip) -> u32 {
    let top = u32::from(clip.outer.map_or(0, |outer| outer.z));
    let corner = clip.corner.map_or(0, |c| {
        let concave = if c.concave { CLIP_CONCAVE } else { 0 };
        CLIP_CORNER | concave | plane_bits(c.azimuth, c.offset)
    });
    top | corner
}

fn plane_bits(azimuth: u8, offset: i8) -> u32 {
    u32::from(azimuth) << AZIMUTH_SHIFT | u32::from(offset as u8) << CLIP_OFFSET_SHIFT
}

/// Attributes of a thin column: share of the top (8 bits, instead of its normal), a byte of zero, azimuth, share of the sides.
fn thin_bits(share: ThinShare, azimuth: u8) -> u32 {
    u32::from(share.top) | plane_bits(azimuth, 0) | u32::from(share.side) << CLIP_OFFSET_SHIFT
}

/// Words before a strip's texels: a clipped column's [`clip_word`] and the texel beyond its plane, then the gap and the
/// column's bounds.
pub fn head_words(flags: u8) -> usize {
    (usize::from(flags & flag::CLIPPED != 0) + usize::from(flags & flag::GAP != 0)) * 2
}

/// Places strips one after the other, none across a page boundary.
#[derive(Default)]
struct StripLayout {
    pages: usize,
    used: usize,
}

impl StripLayout {
    /// Word, relative to the first strip page, of a strip of `words`. A strip is shorter than a page: 4095 codes at
    /// most.
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
    /// Packs a decoded map, whose decoder has checked every height and length.
    pub fn new(map: &BlockMap) -> Self {
        let mut pages: Vec<Page> = vec![vec![0; PAGE_WORDS].into(); page_count(map)];
        let mut layout = StripLayout::default();
        let (mut gaps, mut clips, mut strips) = (map.gaps.iter(), map.clips.iter(), &map.strips[..]);
        let mut thin = map.thin.iter().peekable();
        for i in 0..COLUMNS {
            let flags = map.flags[i];
            let bounds = u32::from(map.z_max[i]) | u32::from(map.z_min[i]) << HEIGHT_BITS;
            pages[WALK_PLANE][i] = bounds | u32::from(flags) << FLAGS_SHIFT;
            pages[ROOF_PLANE][i] = map.roof[i].0;
            let clip = (flags & flag::CLIPPED != 0).then(|| clips.next()).flatten();
            let offset = clip.map_or(0, |clip| clip.offset);
            let share = thin.next_if(|(column, _)| usize::from(*column) == i).map(|(_, share)| share);
            pages[ATTRIBUTE_PLANE][i] = match share {
                Some(share) => thin_bits(*share, map.wall_azimuth[i]),
                None => u32::from(map.roof_normal[i]) | plane_bits(map.wall_azimuth[i], offset),
            };
            let words = strip_words(map, i);
            if words == 0 {
                continue;
            }
            let at = layout.place(words);
            pages[STRIP_PLANE][i] = at as u32;
            let outer = clip.map(|clip| [clip_word(clip), clip.outer.map_or(0, |outer| outer.roof.0)]);
            let gap = (flags & flag::GAP != 0).then(|| gaps.next()).flatten();
            let gap = gap.map(|[low, high]| {
                let solid = u32::from(*low).max(clip.and_then(|clip| clip.outer).map_or(0, |outer| u32::from(outer.z)));
                pages[WALK_PLANE][i] = u32::from(*high) | solid << HEIGHT_BITS | u32::from(flags) << FLAGS_SHIFT;
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
        let list = palette_of(map);
        let objects = (!list.is_empty()).then(|| {
            if let Some(last) = pages.last_mut() {
                *last = object_plane(map, &list);
            }
            PackedObjects { palette: layout.place(list.len()) as u32, list }
        });
        let NodeSummary { words: summary, z_range, below } = summarise(map);
        let (cell_m, z_step_m, z_base_m) = (map.cell_m, map.z_step_m(), map.z_base_m());
        let (z_shift, albedo_log2) = (u32::from(map.z_shift), mean_albedo_log2(map));
        Self { pages, summary, cell_m, z_step_m, z_base_m, z_range, below, z_shift, albedo_log2, objects }
    }

    /// Makes strip addresses absolute. `atlas_pages` are the pages that the cache has assigned, one per entry of
    /// [`PackedNode::pages`].
    pub fn relocate(&mut self, atlas_pages: &[u32]) {
        let count = self.pages.len();
        let (planes, strips) = self.pages.split_at_mut(PLANES.min(count));
        if strips.is_empty() || atlas_pages.len() < PLANES + strips.len() {
            return;
        }
        let [walk, .., addresses] = planes else { return };
        let absolute = |at: usize| atlas_pages[PLANES + at / PAGE_WORDS] * PAGE_WORDS as u32 + (at % PAGE_WORDS) as u32;
        if let Some(objects) = &mut self.objects {
            objects.palette = absolute(objects.palette as usize);
        }
        for (word, walk) in addresses.iter_mut().zip(walk.iter()) {
            if (walk >> FLAGS_SHIFT) as u8 & flag::EXPOSED != 0 {
                *word = absolute(*word as usize);
            }
        }
    }
}

/// Texels of walls of which one counts for the mean albedo: neighbours are alike.
const COUNTED_TEXELS: usize = 4;
/// Least luminance that it tells from black.
const BLACK: f32 = 1.0 / 256.0;

/// Mean log2 of the luminances of a map's texels.
fn mean_albedo_log2(map: &BlockMap) -> f32 {
    let roofs = map.roof.iter().zip(&map.flags).filter(|(_, flags)| *flags & flag::OCCUPIED != 0).map(|(roof, _)| roof);
    let walls = map.strips.iter().step_by(COUNTED_TEXELS).filter(|texel| !texel.is_open());
    let (sum, count) = roofs.chain(walls).fold((0.0, 0.0), |(sum, count), texel| {
        (sum + linear_of(texel.0).dot(LUMINANCE).max(BLACK).log2(), count + 1.0)
    });
    if count > 0.0 { sum / count } else { 0.0 }
}

/// Bounds of a node's height, for rays that pass above or below its parts.
struct NodeSummary {
    /// See [`SUMMARY_WORDS`].
    words: [u32; SUMMARY_WORDS],
    /// Lowest and highest point in height codes, slopes included.
    z_range: [f32; 2],
    /// How far the quarters lie below the highest point, in 255ths of the node's height.
    below: [u8; 4],
}

fn summarise(map: &BlockMap) -> NodeSummary {
    const BLOCKS: usize = NODE_BLOCKS * NODE_BLOCKS;
    let mut bounds = [[u32::from(u16::MAX), 0]; BLOCKS];
    let mut quads = [[0u32; 16]; BLOCKS];
    for i in (0..COLUMNS).filter(|i| map.flags[*i] & flag::OCCUPIED != 0) {
        let (x, y) = (i % NODE_CELLS, i / NODE_CELLS);
        let mut top = u32::from(map.z_max[i]);
        if map.flags[i] & flag::INCLINED != 0 {
            let [sx, sy] = slope_codes(map.roof_normal[i], u32::from(map.z_shift));
            top += (0.5 * (sx.abs() + sy.abs())).ceil() as u32;
        }
        let top = top.min(u32::from(u16::MAX));
        let at = y / BLOCK_CELLS * NODE_BLOCKS + x / BLOCK_CELLS;
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
        let half = NODE_BLOCKS / 2;
        let quarter = at / half % 2 + at / (BLOCKS / 2) * 2;
        tops[quarter] = tops[quarter].max(*top);
    }
    // Rounded down: a quarter is never higher than its byte says.
    let below = tops.map(|top| ((high.max(low) - top) * 255 / (high.max(low) - low).max(1)) as u8);
    let mut summary = [0; SUMMARY_WORDS];
    for (block, [low, high]) in bounds.into_iter().enumerate() {
        let words = &mut summary[block * 4..][..4];
        for (word, byte) in words.iter_mut().zip([low, low >> 8, high, high >> 8]) {
            *word = byte << SUMMARY_BYTE_SHIFT;
        }
        let share = |top: u32| (top.saturating_sub(low) * QUAD_TOP_MAX).div_ceil((high.max(low) - low).max(1));
        for (quad, top) in quads[block].into_iter().enumerate() {
            words[quad / 4] |= share(top).min(QUAD_TOP_MAX) << (quad as u32 % 4 * QUAD_TOP_BITS);
        }
    }
    NodeSummary { words: summary, z_range: [low as f32, high as f32], below }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::blockmap::{CornerWall, MapColumn, OuterTop, WallStrip};
    use insula_protocol::{Texel, TileId};

    fn tall(z_min: u16, z_max: u16, gap: Option<[u16; 2]>) -> MapColumn {
        let rows = strip_rows(z_min, z_max, 0).1;
        let texels = (0..rows).map(|r| Texel::new([r as u8, 1, 2], 63)).collect();
        MapColumn { z_min, z_max, gap, strip: Some(WallStrip { texels, azimuth: 7 }), ..MapColumn::default() }
    }

    #[test]
    fn the_mean_albedo_counts_roofs_and_walls() {
        let mean = |columns: &[Option<MapColumn>]| {
            PackedNode::new(&BlockMap::from_columns(TileId::ROOT, 1.0, 0, 0, columns).unwrap()).albedo_log2
        };
        let mut columns = vec![None; COLUMNS];
        assert_eq!(mean(&columns), 0.0);
        let roof = |grey: u8| Some(MapColumn { z_max: 8, roof: Texel::new([grey; 3], 63), ..MapColumn::default() });
        (columns[5], columns[6]) = (roof(255), roof(188));
        // sRGB 188 is half of the light.
        assert!((mean(&columns) + 0.5).abs() < 0.02, "{}", mean(&columns));
        columns[7] = Some(tall(0, 64, None));
        assert!(mean(&columns) < -2.0, "dark walls count: {}", mean(&columns));
    }

    #[test]
    fn clipping_planes_are_packed_with_azimuths_and_before_gaps() {
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
        let clip = [30 | CLIP_CORNER | CLIP_CONCAVE | 200 << 16 | 0xfe << 24, 0xc0ffee];
        assert_eq!((&at(9)[..2], &at(9)[2..4]), (&clip[..], &[100 | 200 << 16, 400 | 5 << 12][..]));
        assert_eq!(Texel(at(9)[4]).rgb(), [0, 1, 2]);
        assert_eq!(at(10)[..2], [0, 0]);
        let heights = |i: usize| packed.pages[0][i] & 0xff_ffff;
        assert_eq!([heights(9), heights(10)], [200 | 100 << 12, 400 | 5 << 12]);
    }

    #[test]
    fn relocated_strips_are_found_and_never_cross_a_page() {
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
    fn summaries_bound_slopes_and_quarters() {
        let mut columns = vec![None; COLUMNS];
        let roof_normal = octahedral::encode([0.5, 0.0, 0.866]);
        columns[8] = Some(MapColumn { z_min: 10, z_max: 20, inclined: true, roof_normal, ..MapColumn::default() });
        let map = BlockMap::from_columns(TileId::ROOT, 1.0, 0, 0, &columns).unwrap();
        let packed = PackedNode::new(&map);
        assert_eq!(packed.summary[..4], [0xff << 24, 0xff << 24, 0, 0], "an empty block");
        assert_eq!(packed.z_range[0], 10.0);
        assert_eq!(packed.below, [0, 255, 255, 255], "all but the south-west quarter are empty");
        // MapColumn 8 is in the first quad of the second block, and its highest.
        assert_eq!(packed.summary[4], 63 | 10 << 24);
        assert!((25..=26).contains(&(packed.summary[6] >> 24)), "{}", packed.summary[6] >> 24);
        assert_eq!([packed.summary[5], packed.summary[6] & 0xff_ffff, packed.summary[7]], [0, 0, 0]);
    }
}
