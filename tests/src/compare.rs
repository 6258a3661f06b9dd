//! How true a picture is to the source.

use crate::{
    rng::Rng,
    truth::Truth,
    view::{Camera, Picture},
};
use glam::DVec3;
use image::{Rgb, RgbImage};
use insula_shaders::cpu::raycast::Pixels;
use rayon::prelude::*;

/// Pixels whose distance to the source is measured.
pub const SAMPLES: usize = 5000;
/// Deviations beyond this many cells are all alike.
const MOST_CELLS: f64 = 64.0;

/// How one picture compares.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Score {
    /// Silhouettes: pixels hit in both over pixels hit in either.
    pub iou: f64,
    /// Median of the distances from hit points to the source, in cells.
    pub median_cells: f64,
    /// Their 95th percentile.
    pub p95_cells: f64,
    /// Colours where both were hit, in dB.
    pub psnr_db: f64,
}

/// Intersection over union of what was hit.
pub fn silhouette_iou(truth: &Pixels, drawn: &Pixels) -> f64 {
    let (mut both, mut either) = (0u64, 0u64);
    for (a, b) in truth.distance.iter().zip(&drawn.distance) {
        both += u64::from(a.is_finite() && b.is_finite());
        either += u64::from(a.is_finite() || b.is_finite());
    }
    if either == 0 { 1.0 } else { both as f64 / either as f64 }
}

/// Peak signal to noise of the colours where both pictures have the city.
pub fn psnr_db(truth: &Pixels, drawn: &Pixels) -> f64 {
    let (mut sum, mut count) = (0.0, 0u64);
    for i in 0..truth.colour.len() {
        if truth.distance[i].is_finite() && drawn.distance[i].is_finite() {
            let (a, b) = (truth.colour[i].to_le_bytes(), drawn.colour[i].to_le_bytes());
            sum += (0..3).map(|k| (f64::from(a[k]) - f64::from(b[k])).powi(2)).sum::<f64>();
            count += 3;
        }
    }
    if count == 0 || sum == 0.0 { 99.0 } else { 10.0 * (255.0 * 255.0 * count as f64 / sum).log10() }
}

/// Distances in cells from hit points of `drawn` to the source, ascending; [`SAMPLES`] of them, drawn at random.
pub fn deviations(truth: &Truth, camera: &Camera, picture: &Picture, drawn: &Pixels, cell_m: f64) -> Vec<f64> {
    let hit: Vec<u32> = (0..drawn.distance.len() as u32).filter(|i| drawn.distance[*i as usize].is_finite()).collect();
    let mut rng = Rng::new(42);
    let chosen: Vec<u32> = (0..SAMPLES.min(hit.len() * 4)).map(|_| hit[rng.below(hit.len())]).collect();
    let o = DVec3::from(camera.position) - DVec3::from(truth.scene.origin);
    let mut cells: Vec<f64> = chosen
        .par_iter()
        .map(|i| {
            let d = camera.ray(picture, i % picture.width_px, i / picture.width_px);
            let p = o + d * f64::from(drawn.distance[*i as usize]);
            truth.distance_to_surface(p, MOST_CELLS * cell_m).min(MOST_CELLS * cell_m) / cell_m
        })
        .collect();
    cells.sort_by(f64::total_cmp);
    cells
}

/// The value below which a share `p` of the ascending `values` lies; infinity of none.
pub fn percentile(values: &[f64], p: f64) -> f64 {
    let last = values.len().saturating_sub(1);
    values.get((last as f64 * p).round() as usize).copied().unwrap_or(f64::INFINITY)
}

/// All figures of one picture, given its [`deviations`].
pub fn score(meant: &Pixels, drawn: &Pixels, cells: &[f64]) -> Score {
    Score {
        iou: silhouette_iou(meant, drawn),
        median_cells: percentile(cells, 0.5),
        p95_cells: percentile(cells, 0.95),
        psnr_db: psnr_db(meant, drawn),
    }
}

/// Truth, drawn, and their difference side by side: red is lacking, blue is too much, else bright where distances differ
/// (white: by four cells).
pub fn side_by_side(meant: &Pixels, drawn: &Pixels, cell_m: f64) -> RgbImage {
    let (width, height) = (meant.width_px, meant.height_px);
    let colour = |word: u32| {
        let [r, g, b, _] = word.to_le_bytes();
        Rgb([r, g, b])
    };
    RgbImage::from_fn(width * 3, height, |x, y| {
        let i = (y * width + x % width) as usize;
        let (a, b) = (meant.distance[i], drawn.distance[i]);
        match x / width {
            0 => colour(meant.colour[i]),
            1 => colour(drawn.colour[i]),
            _ => Rgb(match (a.is_finite(), b.is_finite()) {
                (true, false) => [255, 40, 40],
                (false, true) => [60, 90, 255],
                (false, false) => [0, 0, 30],
                _ => [(f64::from((a - b).abs()) / (4.0 * cell_m) * 255.0).min(255.0) as u8; 3],
            }),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(distance: &[f32], colour: u32) -> Pixels {
        let count = distance.len();
        let (width_px, height_px) = (count as u32, 1);
        Pixels { width_px, height_px, colour: vec![colour; count], distance: distance.to_vec(), hit: vec![0; count] }
    }

    #[test]
    fn figures_are_what_they_say() {
        let inf = f32::INFINITY;
        let (a, b) = (picture(&[1.0, 1.0, inf, inf], 0xff00_0000), picture(&[1.0, inf, 1.0, inf], 0xff0a_0a0a));
        assert!((silhouette_iou(&a, &b) - 1.0 / 3.0).abs() < 1e-12);
        assert!((psnr_db(&a, &b) - 28.13).abs() < 0.01);
        let values: Vec<f64> = (0..=100).map(f64::from).collect();
        assert_eq!((percentile(&values, 0.5), percentile(&values, 0.95)), (50.0, 95.0));
        assert!(percentile(&[], 0.5).is_infinite());
    }
}
