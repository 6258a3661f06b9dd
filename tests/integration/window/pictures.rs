//! Compares screenshots.

use super::SAME_VIEW;
use image::imageops::crop_imm;
use image::{Rgb, RgbImage};
use std::collections::HashSet;

/// Share of pixels that differ visibly.
pub(super) fn difference(a: &RgbImage, b: &RgbImage) -> f64 {
    if a.dimensions() != b.dimensions() {
        return 1.0;
    }
    let differs = |(a, b): (&Rgb<u8>, &Rgb<u8>)| a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > 12);
    a.pixels().zip(b.pixels()).filter(|pair| differs(*pair)).count() as f64 / f64::from(a.width() * a.height())
}

/// The part of a view that no overlay covers: messages appear above, the compass and the status on the left.
fn scene(view: &RgbImage) -> RgbImage {
    let (left, top) = (view.width() * 6 / 10, view.height() / 2);
    crop_imm(view, left, top, view.width() - left, view.height() - top).to_image()
}

/// The lower half of the scene, which neither the map nor the counters reach.
pub(super) fn lowest(view: &RgbImage) -> RgbImage {
    let view = scene(view);
    crop_imm(&view, 0, view.height() / 2, view.width(), view.height() / 2).to_image()
}

/// Whether two pictures show the same view.
pub(super) fn is_same_view(a: &RgbImage, b: &RgbImage) -> bool {
    difference(&scene(a), &scene(b)) < SAME_VIEW
}

/// Number of colours in steps of 16; an empty window has one.
pub(super) fn colours(screenshot: &RgbImage) -> usize {
    screenshot.pixels().map(|p| p.0.map(|c| c / 16)).collect::<HashSet<_>>().len()
}
