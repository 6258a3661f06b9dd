//! Measures how well a frame shows the source.

use crate::rng::Rng;
use crate::truth::Truth;
use crate::view::{Camera, FrameSpec};
use anyhow::{Context, Result};
use blazediff_ssim::{Plane, SsimOptions};
use glam::DVec3;
use image::{Rgb, RgbImage};
use insula_shaders::cpu::raycast::Pixels;
use rayon::prelude::*;
use serde::Serialize;
use std::ops::Range;

/// Number of hit points whose distance to the source is measured.
pub const SAMPLES: usize = 5000;
/// Deviations above this, in cells, count as equal.
const MOST_CELLS: f64 = 64.0;

/// Length of the shorter side from which the SSIM library scales images down.
const LARGE_PX: usize = 384;
/// Fewest pixels for a measure of colours.
const LEAST_PX: usize = 1000;
/// PSNR of equal images.
const SAME_DB: f64 = 99.0;
/// Factor of colour differences in comparison images.
const BRIGHTER: i32 = 4;

/// Measures of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Score {
    /// Silhouettes: pixels hit in both over pixels hit in either.
    pub iou: f64,
    /// Median of the distances from hit points to the source, in cells.
    pub median_cells: f64,
    pub p95_cells: f64,
    /// Over pixels that hit in both.
    pub colour: Option<Colour>,
    /// Over those where the source is textured.
    pub textured: Option<Colour>,
}

/// Measures of colours over some pixels of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Colour {
    pub pixels: usize,
    /// Peak signal to noise over red, green and blue in sRGB, in dB.
    pub psnr_db: f64,
    /// Structural similarity of the luma (Wang, Bovik, Sheikh and Simoncelli 2004: Gaussian windows of 11 x 11 pixels):
    /// of the whole frames, averaged over these pixels.
    pub ssim: f64,
    /// Mean difference of the luma of neighbouring pixels, divided by the reference's: below 1 is blurred.
    pub gradient: f64,
}

/// Intersection over union of the pixels that hit something.
pub fn silhouette_iou(truth: &Pixels, drawn: &Pixels) -> f64 {
    let (mut both, mut either) = (0u64, 0u64);
    for (a, b) in truth.distance.iter().zip(&drawn.distance) {
        both += u64::from(a.is_finite() && b.is_finite());
        either += u64::from(a.is_finite() || b.is_finite());
    }
    if either == 0 { 1.0 } else { both as f64 / either as f64 }
}

/// Measures colours over the pixels that `counts` accepts; `None` if these are too few.
pub fn colour(truth: &Pixels, drawn: &Pixels, counts: impl Fn(usize) -> bool) -> Result<Option<Colour>> {
    let counted: Vec<usize> = (0..truth.colour.len()).filter(|i| counts(*i)).collect();
    if counted.len() < LEAST_PX {
        return Ok(None);
    }
    let squares = counted.iter().map(|&i| {
        let (a, b) = (truth.colour[i].to_le_bytes(), drawn.colour[i].to_le_bytes());
        (0..3).map(|k| (f64::from(a[k]) - f64::from(b[k])).powi(2)).sum::<f64>()
    });
    let mean = squares.sum::<f64>() / (3 * counted.len()) as f64;
    let psnr_db = if mean == 0.0 { SAME_DB } else { 10.0 * (255.0 * 255.0 / mean).log10() };
    let ssim = ssim(truth, drawn, &counted)?;
    let gradient = gradient(drawn, &counts) / gradient(truth, &counts);
    Ok(Some(Colour { pixels: counted.len(), psnr_db, ssim, gradient }))
}

/// Sum of the differences of the luma of horizontal and vertical neighbours that both count.
fn gradient(of: &Pixels, counts: impl Fn(usize) -> bool) -> f64 {
    let (width, luma) = (of.width_px as usize, luma(of).samples);
    let pairs = (0..luma.len()).flat_map(|i| {
        let right = (i % width + 1 < width).then_some(i + 1);
        [right, Some(i + width)].into_iter().flatten().map(move |j| (i, j))
    });
    let counted = pairs.filter(|(i, j)| *j < luma.len() && counts(*i) && counts(*j));
    counted.map(|(i, j)| f64::from((luma[i] - luma[j]).abs())).sum()
}

/// Mean SSIM of these pixels. Windows that reach beyond the edge are moved inside. Large frames are measured in quarters,
/// because the library would scale them down.
fn ssim(truth: &Pixels, drawn: &Pixels, counted: &[usize]) -> Result<f64> {
    let options = SsimOptions::default();
    let (width, height) = (truth.width_px as usize, truth.height_px as usize);
    if width.min(height) >= LARGE_PX {
        let (columns, rows) = ([0, width / 2, width], [0, height / 2, height]);
        let mut sum = 0.0;
        for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let (x, y) = (columns[x]..columns[x + 1], rows[y]..rows[y + 1]);
            let inside = counted.iter().filter(|i| x.contains(&(**i % width)) && y.contains(&(**i / width)));
            let counted: Vec<usize> = inside.map(|i| (i / width - y.start) * x.len() + i % width - x.start).collect();
            if !counted.is_empty() {
                sum += ssim(&part(truth, &x, &y), &part(drawn, &x, &y), &counted)? * counted.len() as f64;
            }
        }
        return Ok(sum / counted.len() as f64);
    }
    let similar = blazediff_ssim::ssim(&luma(truth), &luma(drawn), &options).context("SSIM")?;
    let margin = options.window_size / 2;
    anyhow::ensure!(
        similar.map_width + 2 * margin == width && similar.map_height + 2 * margin == height,
        "SSIM was measured in a smaller frame: {width} x {height} is too large"
    );
    let inside = |at: usize, size: usize| at.saturating_sub(margin).min(size - 1);
    let at =
        |i: &usize| inside(i / width, similar.map_height) * similar.map_width + inside(i % width, similar.map_width);
    Ok(counted.iter().map(|i| f64::from(similar.map[at(i)])).sum::<f64>() / counted.len() as f64)
}

fn part(of: &Pixels, x: &Range<usize>, y: &Range<usize>) -> Pixels {
    let row = |y: usize| of.colour[y * of.width_px as usize..][x.clone()].iter().copied();
    let (width_px, height_px) = (x.len() as u32, y.len() as u32);
    Pixels { width_px, height_px, colour: y.clone().flat_map(row).collect(), ..Pixels::default() }
}

fn luma(pixels: &Pixels) -> Plane {
    let weigh = |word: &u32| {
        let [r, g, b, _] = word.to_le_bytes().map(f32::from);
        0.299 * r + 0.587 * g + 0.114 * b
    };
    let (width, height) = (pixels.width_px as usize, pixels.height_px as usize);
    Plane { samples: pixels.colour.iter().map(weigh).collect(), width, height }
}

/// Distances from random hit points of `drawn` to the source in cells, ascending.
pub fn deviations(truth: &Truth, camera: &Camera, spec: &FrameSpec, drawn: &Pixels, cell_m: f64) -> Vec<f64> {
    let hit: Vec<u32> = (0..drawn.distance.len() as u32).filter(|i| drawn.distance[*i as usize].is_finite()).collect();
    let mut rng = Rng::new(42);
    let chosen: Vec<u32> = (0..SAMPLES.min(hit.len() * 4)).map(|_| hit[rng.below(hit.len())]).collect();
    let o = DVec3::from(camera.position) - DVec3::from(truth.scene.origin);
    let mut cells: Vec<f64> = chosen
        .par_iter()
        .map(|i| {
            let d = camera.ray(spec, i % spec.width_px, i / spec.width_px);
            let p = o + d * f64::from(drawn.distance[*i as usize]);
            truth.distance_to_surface(p, cell_m, MOST_CELLS * cell_m).min(MOST_CELLS * cell_m) / cell_m
        })
        .collect();
    cells.sort_by(f64::total_cmp);
    cells
}

/// The value below which a fraction `p` of the ascending `values` lies; infinity if there are none.
pub fn percentile(values: &[f64], p: f64) -> f64 {
    let last = values.len().saturating_sub(1);
    values.get((last as f64 * p).round() as usize).copied().unwrap_or(f64::INFINITY)
}

/// All measures of a frame, given its [`deviations`] and which pixels are `textured` in the source.
pub fn score(reference: &Pixels, drawn: &Pixels, textured: &[bool], cells: &[f64]) -> Result<Score> {
    let both = |i: usize| reference.distance[i].is_finite() && drawn.distance[i].is_finite();
    Ok(Score {
        iou: silhouette_iou(reference, drawn),
        median_cells: percentile(cells, 0.5),
        p95_cells: percentile(cells, 0.95),
        colour: colour(reference, drawn, both)?,
        textured: colour(reference, drawn, |i| textured[i] && both(i))?,
    })
}

/// Reference and drawn frame side by side. Below: differences of distances (red: missing, blue: in excess, otherwise white at
/// four cells) and of colours, four times as bright.
pub fn side_by_side(reference: &Pixels, drawn: &Pixels, cell_m: f64) -> RgbImage {
    let (width, height) = (reference.width_px, reference.height_px);
    let colour = |word: u32| {
        let [r, g, b, _] = word.to_le_bytes();
        [r, g, b]
    };
    RgbImage::from_fn(width * 2, height * 2, |x, y| {
        let i = (y % height * width + x % width) as usize;
        let (a, b) = (reference.distance[i], drawn.distance[i]);
        let (reference, drawn) = (colour(reference.colour[i]), colour(drawn.colour[i]));
        Rgb(match (x / width, y / height) {
            (0, 0) => reference,
            (_, 0) => drawn,
            (column, _) => match (a.is_finite(), b.is_finite()) {
                (true, false) => [255, 40, 40],
                (false, true) => [60, 90, 255],
                (false, false) => [0, 0, 30],
                _ if column == 0 => [(f64::from((a - b).abs()) / (4.0 * cell_m) * 255.0).min(255.0) as u8; 3],
                _ => std::array::from_fn(|k| {
                    ((i32::from(reference[k]) - i32::from(drawn[k])).abs() * BRIGHTER).min(255) as u8
                }),
            },
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(distance: &[f32], colour: u32) -> Pixels {
        let count = distance.len();
        let (width_px, height_px) = (count as u32, 1);
        Pixels {
            width_px,
            height_px,
            colour: vec![colour; count],
            distance: distance.to_vec(),
            hit: vec![0; count],
            ..Pixels::default()
        }
    }

    #[test]
    fn known_frames_have_known_measures() {
        let inf = f32::INFINITY;
        let (a, b) = (frame(&[1.0, 1.0, inf, inf], 0), frame(&[1.0, inf, 1.0, inf], 0));
        assert!((silhouette_iou(&a, &b) - 1.0 / 3.0).abs() < 1e-12);
        let values: Vec<f64> = (0..=100).map(f64::from).collect();
        assert_eq!((percentile(&values, 0.5), percentile(&values, 0.95)), (50.0, 95.0));
        assert!(percentile(&[], 0.5).is_infinite());
    }

    fn grey(level: impl Fn(u32, u32) -> u8) -> Pixels {
        let colour = (0..64 * 64)
            .map(|i| u32::from_le_bytes([[level(i % 64, i / 64); 3].as_slice(), &[255]].concat().try_into().unwrap()));
        let (distance, hit) = (vec![1.0; 64 * 64], vec![0; 64 * 64]);
        Pixels { width_px: 64, height_px: 64, colour: colour.collect(), distance, hit, ..Pixels::default() }
    }

    #[test]
    fn colours_are_compared_where_they_count() {
        let flat = grey(|_, _| 0);
        let ten = colour(&flat, &grey(|_, _| 10), |_| true).unwrap().unwrap();
        assert!((ten.psnr_db - 28.13).abs() < 0.01, "{ten:?}");
        // Two uniform frames: only their means differ, which is the first factor of the formula.
        let c1 = (0.01f64 * 255.0).powi(2);
        assert!((ten.ssim - c1 / (100.0 + c1)).abs() < 1e-4, "{ten:?}");

        // Stripes that are missing in the left half of the drawn frame.
        let stripes = |x: u32| if x % 4 < 2 { 80 } else { 160 };
        let (reference, drawn) = (grey(|x, _| stripes(x)), grey(|x, _| if x < 32 { 120 } else { stripes(x) }));
        let part =
            |range: std::ops::Range<usize>| colour(&reference, &drawn, |i| range.contains(&(i % 64))).unwrap().unwrap();
        let (left, right) = (part(0..26), part(38..64));
        assert!((right.psnr_db, right.ssim) == (SAME_DB, 1.0) && right.pixels == 26 * 64, "{right:?}");
        assert!((left.psnr_db - 16.09).abs() < 0.01 && left.ssim < 0.1, "{left:?}");
        assert_eq!(colour(&reference, &drawn, |i| i < LEAST_PX - 1).unwrap(), None);
    }
}
