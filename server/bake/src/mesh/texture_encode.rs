//! A texture as a WebP file.
//!
//! Lossy files are searched for the coarsest quantiser that reaches the quality asked for. The quality is the peak
//! signal-to-noise ratio (PSNR) over the texels that triangles show, and that plain surfaces keep their tint: a roof or
//! the ground goes on in the texture of the next node, and the eye sees a border between two tints where the ratio sees
//! nothing. Textures with few colours or many plain squares are also tried without loss.

use insula_protocol::blockmap::Quality;
use insula_protocol::mesh_tile::{MAX_PART_BYTES, decode_webp};
use std::collections::HashSet;
use webp::{Encoder, WebPConfig};

/// Decibels that textures may lose more than columns. Their texels are finer, and their errors are averaged on the
/// screen.
const TEXTURE_ALLOWANCE_DB: f64 = 1.5;
/// The search ends at a file that exceeds the quality by no more than this.
const SLACK_DB: f64 = 0.1;
/// Most files that are tried.
const MAX_TRIALS: usize = 6;
/// Index of libwebp's coarsest quantiser.
const MAX_QUANTISER: i32 = 127;
/// The coarsest quantiser that is tried. Coarser ones reach the quality only where there is little contrast, and show
/// patches of colour there that the texture does not have.
const COARSEST_QUANTISER: i32 = 48;
/// Index of the quantiser at which the search begins.
const FIRST_QUANTISER: i32 = 42;
/// Loss that the search expects from the next coarser quantiser.
const DB_PER_QUANTISER: f64 = 0.1;
/// Side of the squares of a texture whose tint is compared, in texels.
const SQUARE: usize = 8;
/// A square is plain if no two of its texels differ by more than this in a channel.
const PLAIN_RANGE: u8 = 6;
/// A texture is looked at for its tint if this share of its squares is plain: those of photographs are not.
const PLAIN_SHARE: f64 = 0.25;
/// Largest error of the tint of plain squares, as root of the mean square of red and blue less green.
const MAX_TINT: f64 = 1.4;
/// Textures with at most this many colours may be smaller without loss.
const FEW_COLOURS: usize = 256;

/// A texture, and which of its texels matter.
pub(super) struct MaskedTexture<'a> {
    /// Width and height.
    pub(super) size: [u32; 2],
    /// 8-bit sRGB, three bytes per texel, row by row.
    pub(super) rgb: &'a [u8],
    /// Whether a triangle shows the texel.
    pub(super) is_shown: &'a [bool],
}

/// The result of one quantiser.
#[derive(Debug, Clone, Copy)]
struct EncodingTrial {
    quantiser: i32,
    /// PSNR, or less where tints are lost.
    score_db: f64,
}

impl MaskedTexture<'_> {
    /// The smallest file found that reaches `quality`; `None` if it is too large for a tile.
    pub(super) fn encode(&self, quality: Quality) -> Option<Vec<u8>> {
        let plain = self.plain_squares();
        let lossy = match quality {
            Quality::Lossless => None,
            Quality::Decibels(db) => self.search_lossy(f64::from(db) - TEXTURE_ALLOWANCE_DB, &plain),
        };
        let best = match lossy {
            Some(lossy) if plain.is_empty() && !self.has_few_colours() => lossy,
            lossy => {
                let lossless = self.encode_with(|config| config.lossless = 1)?;
                lossy.filter(|lossy| lossy.len() <= lossless.len()).unwrap_or(lossless)
            }
        };
        (best.len() <= MAX_PART_BYTES).then_some(best)
    }

    fn has_few_colours(&self) -> bool {
        let mut colours = HashSet::new();
        self.rgb.as_chunks::<3>().0.iter().all(|rgb| {
            colours.insert(*rgb);
            colours.len() <= FEW_COLOURS
        })
    }

    /// The smallest of at most [`MAX_TRIALS`] files with a PSNR of at least `min_db`; `None` if none reaches it.
    fn search_lossy(&self, min_db: f64, plain: &[usize]) -> Option<Vec<u8>> {
        let mut best: Option<Vec<u8>> = None;
        // The coarsest quantiser that is good enough, and the finest one that is not.
        let mut good: Option<EncodingTrial> = None;
        let mut bad: Option<EncodingTrial> = None;
        let mut quantiser = FIRST_QUANTISER;
        for _ in 0..MAX_TRIALS {
            let file = self.encode_with(|config| config.quality = quality_of_quantiser(quantiser))?;
            let trial = EncodingTrial { quantiser, score_db: self.score_db(&file, min_db, plain)? };
            let is_good = trial.score_db >= min_db;
            if is_good && best.as_ref().is_none_or(|best| file.len() < best.len()) {
                best = Some(file);
            }
            let is_close = trial.score_db <= min_db + SLACK_DB;
            if is_good && (is_close || quantiser == COARSEST_QUANTISER) || !is_good && quantiser == 0 {
                break;
            }
            *(if is_good { &mut good } else { &mut bad }) = Some(trial);
            let aim_db = min_db + SLACK_DB / 2.0;
            quantiser = match (good, bad) {
                (Some(good), Some(bad)) => match interpolate_quantiser(good, bad, aim_db) {
                    Some(between) => between,
                    None => break,
                },
                _ => extrapolate_quantiser(trial, is_good, aim_db),
            };
        }
        best
    }

    fn encode_with(&self, set: impl Fn(&mut WebPConfig)) -> Option<Vec<u8>> {
        let mut config = WebPConfig::new().ok()?;
        // One quantiser for the whole texture gives the best PSNR for its bytes.
        (config.segments, config.sns_strength, config.filter_strength) = (1, 0, 20);
        set(&mut config);
        let [width, height] = self.size;
        Some(Encoder::from_rgb(self.rgb, width, height).encode_advanced(&config).ok()?.to_vec())
    }

    /// PSNR of a file, or what is left of `min_db` where plain squares have another tint.
    fn score_db(&self, file: &[u8], min_db: f64, plain: &[usize]) -> Option<f64> {
        let decoded = decode_webp(file, self.size).ok()?;
        let tint = self.tint_error(&decoded, plain);
        let kept_db = if tint > MAX_TINT { min_db - 20.0 * libm::log10(tint / MAX_TINT) } else { f64::INFINITY };
        Some(self.psnr_db(&decoded).min(kept_db))
    }

    /// The first texels of plain squares; none if few squares are plain.
    fn plain_squares(&self) -> Vec<usize> {
        let [width, height] = self.size.map(|texels| texels as usize);
        let corners = (0..height / SQUARE).flat_map(|y| (0..width / SQUARE).map(move |x| (y * width + x) * SQUARE));
        let shown: Vec<usize> =
            corners.filter(|corner| self.texels_of(*corner).all(|texel| self.is_shown[texel])).collect();
        let is_plain = |corner: &usize| {
            (0..3).all(|k| {
                let values = || self.texels_of(*corner).map(|texel| self.rgb[3 * texel + k]);
                values().max().zip(values().min()).is_some_and(|(high, low)| high - low <= PLAIN_RANGE)
            })
        };
        let plain: Vec<usize> = shown.iter().copied().filter(is_plain).collect();
        if plain.len() as f64 >= PLAIN_SHARE * shown.len() as f64 { plain } else { Vec::new() }
    }

    fn texels_of(&self, corner: usize) -> impl Iterator<Item = usize> + use<> {
        let width = self.size[0] as usize;
        (0..SQUARE * SQUARE).map(move |i| corner + i / SQUARE * width + i % SQUARE)
    }

    /// How much the tint of squares differs from that of the decoded texture, in steps of a channel.
    fn tint_error(&self, decoded: &[u8], squares: &[usize]) -> f64 {
        let square = |corner: &usize| {
            let [r, g, b] = [0, 1, 2].map(|k| {
                let of = |rgb: &[u8]| self.texels_of(*corner).map(|texel| u32::from(rgb[3 * texel + k])).sum::<u32>();
                (f64::from(of(decoded)) - f64::from(of(self.rgb))) / (SQUARE * SQUARE) as f64
            });
            0.5 * ((r - g) * (r - g) + (b - g) * (b - g))
        };
        libm::sqrt(squares.iter().map(square).sum::<f64>() / squares.len().max(1) as f64)
    }

    /// PSNR of the shown texels, decoded as the client will decode them.
    fn psnr_db(&self, decoded: &[u8]) -> f64 {
        let (mut squares, mut count) = (0u64, 0u64);
        let texels = self.rgb.as_chunks::<3>().0.iter().zip(decoded.as_chunks::<3>().0);
        for (([r, g, b], [x, y, z]), _) in texels.zip(self.is_shown).filter(|(_, is_shown)| **is_shown) {
            let [r, g, b] = [r.abs_diff(*x), g.abs_diff(*y), b.abs_diff(*z)].map(u64::from);
            squares += r * r + g * g + b * b;
            count += 3;
        }
        10.0 * libm::log10(255.0 * 255.0 * count as f64 / (squares as f64).max(1e-9))
    }
}

/// A quantiser between two tried ones, by linear interpolation; `None` if there is none between them.
fn interpolate_quantiser(good: EncodingTrial, bad: EncodingTrial, aim_db: f64) -> Option<i32> {
    let (low, high) = (good.quantiser, bad.quantiser);
    if low + 1 >= high {
        return None;
    }
    let share = (good.score_db - aim_db) / (good.score_db - bad.score_db);
    Some((low + (f64::from(high - low) * share).round() as i32).clamp(low + 1, high - 1))
}

/// The quantiser to try as long as all trials were on one side of the quality.
fn extrapolate_quantiser(trial: EncodingTrial, is_good: bool, aim_db: f64) -> i32 {
    let by = ((trial.score_db - aim_db) / DB_PER_QUANTISER).round() as i32;
    (trial.quantiser + if is_good { by.max(1) } else { by.min(-1) }).clamp(0, COARSEST_QUANTISER)
}

/// The quality setting from which libwebp computes this quantiser: the inverse of its `QualityToCompression`.
fn quality_of_quantiser(quantiser: i32) -> f32 {
    let part = (1.0 - (f64::from(quantiser) + 0.5) / f64::from(MAX_QUANTISER)).clamp(0.0, 1.0).powi(3);
    (100.0 * if part < 0.5 { part * 1.5 } else { part.midpoint(1.0) }) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::texture_fill::fill_unknown_texels;
    use insula_test_support::rng::Rng;

    /// Waves with some noise.
    fn waves(width: u32, height: u32) -> Vec<u8> {
        let mut rng = Rng::new(1);
        let mut texel = |i: u32| {
            let (x, y) = ((i % width) as f32, (i / width) as f32);
            let light = 120.0 + 70.0 * (x / 2.0).sin() * (y / 3.0).cos() + rng.below(4) as f32;
            [light as u8, (light * 0.9) as u8, (light * 0.7) as u8]
        };
        (0..width * height).flat_map(&mut texel).collect()
    }

    #[test]
    fn lossy_files_reach_the_quality_and_hardly_exceed_it() {
        let size = [150, 90];
        let (rgb, shown) = (waves(150, 90), vec![true; 150 * 90]);
        let texture = MaskedTexture { size, rgb: &rgb, is_shown: &shown };
        let mut last = usize::MAX;
        for db in [42.0, 36.0, 33.0] {
            let file = texture.encode(Quality::Decibels(db)).unwrap();
            let reached = texture.psnr_db(&decode_webp(&file, size).unwrap());
            assert!((0.0..2.0).contains(&(reached - (f64::from(db) - TEXTURE_ALLOWANCE_DB))), "{db}: {reached}");
            assert!(file.len() < last);
            last = file.len();
        }
        let whole = texture.encode(Quality::Lossless).unwrap();
        assert!(texture.psnr_db(&decode_webp(&whole, size).unwrap()) > 100.0 && whole.len() > last);
        let plain = vec![77; 3 * 150 * 90];
        let flat = MaskedTexture { size, rgb: &plain, is_shown: &shown }.encode(Quality::Decibels(36.0)).unwrap();
        assert!(flat.len() < 100, "{}", flat.len());
    }

    #[test]
    fn plain_surfaces_keep_their_tint() {
        // A roof and a wall with windows, in a light that changes slowly: too many colours to be smaller without loss.
        let (width, height) = (256, 192);
        for warm in 0..6 {
            let texel = |i: u32| {
                let (x, y) = (i % width, i / width);
                let light = 226.0 + 4.0 * (x as f32 / 90.0).sin() + 4.0 * (y as f32 / 70.0).cos();
                let is_window = y > 128 && x % 12 < 5 && y % 16 < 9;
                let [r, g, b] = [light + warm as f32, light, light - 1.5 * warm as f32];
                if is_window { [70, 76, 90] } else { [r as u8, g as u8, b as u8] }
            };
            let rgb: Vec<u8> = (0..width * height).flat_map(texel).collect();
            let texture = MaskedTexture { size: [width, height], rgb: &rgb, is_shown: &vec![true; rgb.len() / 3] };
            let file = texture.encode(Quality::Decibels(36.0)).unwrap();
            let tint = texture.tint_error(&decode_webp(&file, [width, height]).unwrap(), &texture.plain_squares());
            assert!(tint <= MAX_TINT, "{warm}: {tint}");
        }
    }

    #[test]
    fn filled_texels_that_are_not_shown_cost_few_bytes() {
        let size = [128, 128];
        let shown: Vec<bool> = (0..128 * 128).map(|i| (i % 128 < 64) != (i / 128 < 64)).collect();
        let whole = waves(128, 128);
        let mut filled = whole.clone();
        fill_unknown_texels(&mut filled, size, &shown);
        for (i, shown) in shown.iter().enumerate().filter(|(_, shown)| **shown) {
            assert!(*shown && filled[3 * i..3 * i + 3] == whole[3 * i..3 * i + 3]);
        }
        let bytes =
            |rgb: &[u8]| MaskedTexture { size, rgb, is_shown: &shown }.encode(Quality::Decibels(36.0)).unwrap().len();
        assert!(bytes(&filled) * 4 < bytes(&whole) * 3, "{} {}", bytes(&filled), bytes(&whole));
    }

    #[test]
    fn quality_selects_the_quantiser_that_libwebp_computes_from_it() {
        for quantiser in 0..=MAX_QUANTISER {
            let c = f64::from(quality_of_quantiser(quantiser)) / 100.0;
            let part = if c < 0.75 { c * (2.0 / 3.0) } else { 2.0 * c - 1.0 };
            let found = (127.0 * (1.0 - part.cbrt())) as i32;
            assert!(found == quantiser, "{quantiser} {found}");
        }
    }
}
