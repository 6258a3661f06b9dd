//! A picture as a file.
//!
//! In: texels, and which of them triangles show. Out: a WebP file. Next: `picture` has it in its dress.
//!
//! What no triangle shows goes on smoothly from what lies beside it, so that it takes next to nothing, and what is lost is
//! counted only where a triangle shows it. Lossy files are searched for the coarsest steps that lose little enough.

use std::{collections::HashSet, io::Cursor};

use image::ImageFormat;
use insula_protocol::{blockmap::Quality, mesh_tile::MAX_PART_BYTES};
use webp::{Encoder, WebPConfig};

/// Pictures may lose so many decibels more than columns: their texels are finer, and what they lose is averaged on the screen.
const LESS_DB: f64 = 1.5;
/// So much better than needed is good enough.
const SLACK_DB: f64 = 0.1;
/// Most files that are tried.
const TRIES: usize = 6;
/// The coarsest steps.
const COARSEST: i32 = 127;
/// Where the search begins, and what it thinks that the next coarser steps lose.
const FIRST: i32 = 42;
const STEP_DB: f64 = 0.1;
/// Pictures of so few colours may be smaller without loss.
const FEW_COLOURS: usize = 256;

/// Texels, row by row, and which of them triangles show.
pub(super) struct MaskedTexture<'a> {
    pub(super) size: [u32; 2],
    pub(super) rgb: &'a [u8],
    pub(super) shown: &'a [bool],
}

impl MaskedTexture<'_> {
    /// The smallest file found that loses no more than `quality` allows; `None` if it is too large for a tile.
    pub(super) fn pack(&self, quality: Quality) -> Option<Vec<u8>> {
        let lossy = match quality {
            Quality::Lossless => None,
            Quality::Decibels(db) => self.search(f64::from(db) - LESS_DB),
        };
        let best = match lossy {
            Some(lossy) if !self.has_few_colours() => lossy,
            lossy => {
                let whole = self.file(|config| config.lossless = 1)?;
                lossy.filter(|lossy| lossy.len() <= whole.len()).unwrap_or(whole)
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

    /// The smallest of a few files that are at least so good, `None` if none is.
    fn search(&self, db: f64) -> Option<Vec<u8>> {
        let mut best: Option<Vec<u8>> = None;
        // Steps and decibels: the coarsest that are good enough, the finest that are not.
        let mut good: Option<(i32, f64)> = None;
        let mut bad: Option<(i32, f64)> = None;
        let mut steps = FIRST;
        for _ in 0..TRIES {
            let file = self.file(|config| config.quality = quality_of(steps))?;
            let reached = self.decibels(&file)?;
            let is_good = reached >= db;
            if is_good && best.as_ref().is_none_or(|best| file.len() < best.len()) {
                best = Some(file);
            }
            if is_good && (reached <= db + SLACK_DB || steps == COARSEST) || !is_good && steps == 0 {
                break;
            }
            *(if is_good { &mut good } else { &mut bad }) = Some((steps, reached));
            let aim = db + SLACK_DB / 2.0;
            steps = match (good, bad) {
                (Some((low, above)), Some((high, below))) if low + 1 < high => {
                    let share = (above - aim) / (above - below);
                    (low + (f64::from(high - low) * share).round() as i32).clamp(low + 1, high - 1)
                }
                (Some(_), Some(_)) => break,
                _ => {
                    let by = ((reached - aim) / STEP_DB).round() as i32;
                    (steps + if is_good { by.max(1) } else { by.min(-1) }).clamp(0, COARSEST)
                }
            };
        }
        best
    }

    fn file(&self, set: impl Fn(&mut WebPConfig)) -> Option<Vec<u8>> {
        let mut config = WebPConfig::new().ok()?;
        // The same steps everywhere lose least for their bytes, if it is squares that are counted.
        (config.segments, config.sns_strength, config.filter_strength) = (1, 0, 20);
        set(&mut config);
        let [width, height] = self.size;
        Some(Encoder::from_rgb(self.rgb, width, height).encode_advanced(&config).ok()?.to_vec())
    }

    /// Of what is shown, as the client will see it.
    fn decibels(&self, file: &[u8]) -> Option<f64> {
        let mut reader = image::ImageReader::new(Cursor::new(file));
        reader.set_format(ImageFormat::WebP);
        let back = reader.decode().ok()?.into_rgb8();
        let (mut squares, mut count) = (0u64, 0u64);
        let texels = self.rgb.as_chunks::<3>().0.iter().zip(back.as_chunks::<3>().0);
        for ((a, b), _) in texels.zip(self.shown).filter(|(_, shown)| **shown) {
            squares += (0..3).map(|k| u64::from(a[k].abs_diff(b[k])).pow(2)).sum::<u64>();
            count += 3;
        }
        Some(10.0 * (255.0 * 255.0 * count as f64 / (squares as f64).max(1e-9)).log10())
    }
}

/// The quality that libwebp makes these steps of, 0 to [`COARSEST`]; undoes its `QualityToCompression`.
fn quality_of(steps: i32) -> f32 {
    let part = (1.0 - (f64::from(steps) + 0.5) / f64::from(COARSEST)).clamp(0.0, 1.0).powi(3);
    (100.0 * if part < 0.5 { part * 1.5 } else { part.midpoint(1.0) }) as f32
}

/// Gives texels that are not `known` colours between those of the nearest that are: means of means of four, and from the
/// coarsest back again (Gortler and others 1996, "The lumigraph", 3.3.2).
pub(super) fn fill(rgb: &mut [u8], [width, height]: [u32; 2], known: &[bool]) {
    let first = PyramidLevel {
        size: [width as usize, height as usize],
        texels: rgb
            .as_chunks::<3>()
            .0
            .iter()
            .zip(known)
            .map(|(rgb, known)| known.then(|| rgb.map(f32::from)))
            .collect(),
    };
    let mut levels = vec![first];
    while let Some(last) = levels.last().filter(|last| last.size != [1, 1]) {
        let next = last.halved();
        levels.push(next);
    }
    let Some(mut coarse) = levels.pop() else { return };
    while let Some(mut level) = levels.pop() {
        level.fill(&coarse);
        coarse = level;
    }
    for (rgb, texel) in rgb.as_chunks_mut::<3>().0.iter_mut().zip(&coarse.texels) {
        *rgb = texel.unwrap_or_default().map(|v| (v + 0.5) as u8);
    }
}

struct PyramidLevel {
    size: [usize; 2],
    texels: Vec<Option<[f32; 3]>>,
}

impl PyramidLevel {
    fn at(&self, x: usize, y: usize) -> Option<[f32; 3]> {
        self.texels[y.min(self.size[1] - 1) * self.size[0] + x.min(self.size[0] - 1)]
    }

    /// Means of those of four that are known.
    fn halved(&self) -> Self {
        let size = self.size.map(|side| side.div_ceil(2));
        let mean = |x: usize, y: usize| {
            let places = [0, 1, 2, 3].map(|k| [2 * x + k % 2, 2 * y + k / 2]);
            let inside = places.into_iter().filter(|[x, y]| *x < self.size[0] && *y < self.size[1]);
            let (mut sum, mut count) = ([0.0; 3], 0.0);
            for texel in inside.filter_map(|[x, y]| self.at(x, y)) {
                sum = [0, 1, 2].map(|k| sum[k] + texel[k]);
                count += 1.0;
            }
            (count > 0.0).then(|| sum.map(|v: f32| v / count))
        };
        Self { size, texels: (0..size[0] * size[1]).map(|i| mean(i % size[0], i / size[0])).collect() }
    }

    /// From a level half as fine, all of which is known, between its nearest four.
    fn fill(&mut self, coarse: &Self) {
        let width = self.size[0];
        for (i, texel) in self.texels.iter_mut().enumerate().filter(|(_, texel)| texel.is_none()) {
            let (x, y) = (i % width, i / width);
            let near = |v: usize| [v / 2, (v / 2 + v % 2 * 2).saturating_sub(1)];
            let mut sum = [0.0; 3];
            for (column, u) in near(x).into_iter().zip([0.75, 0.25]) {
                for (row, v) in near(y).into_iter().zip([0.75, 0.25]) {
                    let there = coarse.at(column, row).unwrap_or_default();
                    sum = [0, 1, 2].map(|k| sum[k] + there[k] * u * v);
                }
            }
            *texel = Some(sum);
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::mesh::texture_encode::*;

    /// Waves, with a little that no wave has.
    fn waves(width: u32, height: u32) -> Vec<u8> {
        let mut seed = 1u32;
        let mut texel = |i: u32| {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let (x, y) = ((i % width) as f32, (i / width) as f32);
            let light = 120.0 + 70.0 * (x / 2.0).sin() * (y / 3.0).cos() + (seed >> 30) as f32;
            [light as u8, (light * 0.9) as u8, (light * 0.7) as u8]
        };
        (0..width * height).flat_map(&mut texel).collect()
    }

    #[test]
    fn files_are_as_good_as_asked_for_and_hardly_better() {
        let size = [150, 90];
        let (rgb, shown) = (waves(150, 90), vec![true; 150 * 90]);
        let picture = MaskedTexture { size, rgb: &rgb, shown: &shown };
        let mut last = usize::MAX;
        for db in [42.0, 36.0, 30.0] {
            let file = picture.pack(Quality::Decibels(db)).unwrap();
            let reached = picture.decibels(&file).unwrap();
            assert!((0.0..2.0).contains(&(reached - (f64::from(db) - LESS_DB))), "{db}: {reached}");
            assert!(file.len() < last);
            last = file.len();
        }
        let whole = picture.pack(Quality::Lossless).unwrap();
        assert!(picture.decibels(&whole).unwrap() > 100.0 && whole.len() > last);
        let plain = vec![77; 3 * 150 * 90];
        let flat = MaskedTexture { size, rgb: &plain, shown: &shown }.pack(Quality::Decibels(36.0)).unwrap();
        assert!(flat.len() < 100, "{}", flat.len());
    }

    #[test]
    fn what_is_not_shown_goes_on_and_costs_little() {
        let size = [128, 128];
        let shown: Vec<bool> = (0..128 * 128).map(|i| (i % 128 < 64) != (i / 128 < 64)).collect();
        let whole = waves(128, 128);
        let mut filled = whole.clone();
        fill(&mut filled, size, &shown);
        for (i, shown) in shown.iter().enumerate().filter(|(_, shown)| **shown) {
            assert!(*shown && filled[3 * i..3 * i + 3] == whole[3 * i..3 * i + 3]);
        }
        let bytes =
            |rgb: &[u8]| MaskedTexture { size, rgb, shown: &shown }.pack(Quality::Decibels(36.0)).unwrap().len();
        assert!(bytes(&filled) * 4 < bytes(&whole) * 3, "{} {}", bytes(&filled), bytes(&whole));
        // From one texel, all; from none, black.
        let one: Vec<bool> = (0..35).map(|i| i == 12).collect();
        let mut rgb: Vec<u8> = (0..105).collect();
        fill(&mut rgb, [7, 5], &one);
        assert!(rgb.as_chunks::<3>().0.iter().all(|texel| *texel == [36, 37, 38]));
        fill(&mut rgb, [7, 5], &[false; 35]);
        assert!(rgb.iter().all(|v| *v == 0));
    }

    #[test]
    fn steps_are_those_of_libwebp() {
        for steps in 0..=COARSEST {
            let c = f64::from(quality_of(steps)) / 100.0;
            let part = if c < 0.75 { c * (2.0 / 3.0) } else { 2.0 * c - 1.0 };
            let found = (127.0 * (1.0 - part.cbrt())) as i32;
            assert!(found == steps, "{steps} {found}");
        }
    }
}
