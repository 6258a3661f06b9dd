//! A mesh's texture: its coarser levels, and its tiles in pages.

use super::TEXTURE_TILE_PX;
use crate::layout::PAGE_WORDS;
use insula_protocol::DecodeError;
use insula_protocol::mesh_tile::TileTexture;

/// Texels row by row, the first one in the upper left: r, g, b in 8-bit sRGB, r lowest, and 8 unused bits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MeshTexture {
    /// Texels in a row, at least 1.
    pub width_px: u32,
    /// Rows, at least 1.
    pub height_px: u32,
    /// All texels, `width_px * height_px`.
    pub texels: Vec<u32>,
}

impl MeshTexture {
    /// Decodes a mesh tile's texture. Fails as [`TileTexture::decode`] does.
    pub fn decode(texture: &TileTexture) -> Result<Self, DecodeError> {
        let rgb = texture.decode()?;
        let texels = rgb.as_chunks().0.iter().map(|[r, g, b]| u32::from_le_bytes([*r, *g, *b, 255])).collect();
        let [width_px, height_px] = texture.size_px.map(u32::from);
        Ok(Self { width_px, height_px, texels })
    }

    /// The texture and its halvings, down to one texel. The first has no side longer than `most_px`, and at most
    /// `most_px`² / 2 texels.
    pub(super) fn levels(&self, most_px: u32) -> Vec<Self> {
        let mut levels = Vec::new();
        let mut level = self.clone();
        loop {
            let longest = level.width_px.max(level.height_px);
            let next = (longest > 1).then(|| level.halved());
            let texels = u64::from(level.width_px) * u64::from(level.height_px);
            if longest <= most_px && texels <= u64::from(most_px).pow(2) / 2 {
                levels.push(level);
            }
            match next {
                Some(next) => level = next,
                None => return levels,
            }
        }
    }

    /// Half the size: each texel the mean of up to four, of their squares, as squares of sRGB values are close to
    /// linear light.
    fn halved(&self) -> Self {
        let (width_px, height_px) = ((self.width_px / 2).max(1), (self.height_px / 2).max(1));
        let texel = |x: u32, y: u32| {
            let (x, y) = (x.min(self.width_px - 1), y.min(self.height_px - 1));
            self.texels.get((y * self.width_px + x) as usize).copied().unwrap_or(0)
        };
        let mean = |x: u32, y: u32| {
            let four = [texel(x, y), texel(x + 1, y), texel(x, y + 1), texel(x + 1, y + 1)];
            let channel = |shift: u32| {
                let sum: u32 = four.iter().map(|t| (t >> shift & 255).pow(2)).sum();
                ((sum as f32 / 4.0).sqrt() + 0.5) as u32
            };
            channel(0) | channel(8) << 8 | channel(16) << 16
        };
        let texels = (0..height_px).flat_map(|y| (0..width_px).map(move |x| (x, y)));
        let texels = texels.map(|(x, y)| mean(2 * x, 2 * y)).collect();
        Self { width_px, height_px, texels }
    }

    /// Tiles along x and y.
    fn tiles_across(&self) -> [u32; 2] {
        [self.width_px.div_ceil(TEXTURE_TILE_PX), self.height_px.div_ceil(TEXTURE_TILE_PX)]
    }

    pub(super) fn tiles(&self) -> usize {
        self.tiles_across().iter().product::<u32>() as usize
    }
}

/// Adds the tiles of all levels to `words`, which end with a page, and writes their addresses from word `table` on. No
/// tile crosses a page.
pub(super) fn place(levels: &[MeshTexture], words: &mut Vec<u32>, table: usize) {
    let mut next = table;
    for level in levels {
        let stride = level.width_px.min(TEXTURE_TILE_PX);
        let rows = level.height_px.min(TEXTURE_TILE_PX);
        let [across, up] = level.tiles_across();
        for (x0, y0) in (0..up).flat_map(|y| (0..across).map(move |x| (x * TEXTURE_TILE_PX, y * TEXTURE_TILE_PX))) {
            let (left, need) = (words.len().next_multiple_of(PAGE_WORDS) - words.len(), (stride * rows) as usize);
            if left < need {
                words.resize(words.len() + left, 0);
            }
            words[next] = words.len() as u32;
            next += 1;
            for y in y0..y0 + rows {
                let row = (y.min(level.height_px - 1) * level.width_px) as usize;
                let texels = (x0..x0 + stride).map(|x| row + x.min(level.width_px - 1) as usize);
                words.extend(texels.map(|at| level.texels.get(at).copied().unwrap_or(0)));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::rng::Rng;

    fn texture(width_px: u32, height_px: u32) -> MeshTexture {
        let mut rng = Rng::new(1);
        let texels = (0..width_px * height_px).map(|_| rng.below_u32(1 << 24)).collect();
        MeshTexture { width_px, height_px, texels }
    }

    #[test]
    fn levels_halve_down_to_one_texel() {
        let levels = texture(300, 70).levels(200);
        let sizes: Vec<[u32; 2]> = levels.iter().map(|l| [l.width_px, l.height_px]).collect();
        assert_eq!(sizes, [[150, 35], [75, 17], [37, 8], [18, 4], [9, 2], [4, 1], [2, 1], [1, 1]]);
        let plain = MeshTexture { width_px: 5, height_px: 5, texels: vec![0x40_80c0; 25] };
        assert!(plain.levels(64).iter().all(|level| level.texels.iter().all(|texel| *texel == 0x40_80c0)));
    }

    #[test]
    fn table_leads_to_every_texel() {
        for (width, height) in [(1, 1), (64, 64), (130, 65), (7, 200), (33, 31)] {
            let levels = texture(width, height).levels(1 << 12);
            let tiles: usize = levels.iter().map(MeshTexture::tiles).sum();
            let mut words = vec![0; tiles.next_multiple_of(PAGE_WORDS)];
            place(&levels, &mut words, 0);
            let mut first = 0;
            for level in &levels {
                let stride = level.width_px.min(TEXTURE_TILE_PX);
                for (i, texel) in (0..).zip(&level.texels) {
                    let (x, y) = (i % level.width_px, i / level.width_px);
                    let tile = first + (y / TEXTURE_TILE_PX * level.tiles_across()[0] + x / TEXTURE_TILE_PX) as usize;
                    let at = words[tile] + y % TEXTURE_TILE_PX * stride + x % TEXTURE_TILE_PX;
                    assert_eq!(words[at as usize], *texel);
                    assert_eq!(words[tile] as usize / PAGE_WORDS, at as usize / PAGE_WORDS);
                }
                first += level.tiles();
            }
        }
    }
}
