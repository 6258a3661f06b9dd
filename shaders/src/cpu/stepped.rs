//! A frame that all cores draw in steps, so that a caller can do something else meanwhile.
//!
//! First the rays through the centres of all pixels, which are a picture already: the sketch. Then the other rays of those pixels that
//! differ from a neighbour. No ray is cast twice.

use super::instruction_set::InstructionSet;
use super::packet::{CentreRay, CentreRows, cast_centres, finish_rows, rows_around, sketch_rows};
use super::raycast::{Pixel, Pixels, Sampling, SceneRef};
use super::render::{developed, render_band};
use crate::parallel::*;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Pixels that a thread draws at once: a few milliseconds with nine rays each.
const UNIT_PIXELS: u32 = 5120;
/// Rows that it draws at once, at most.
const MAX_UNIT_ROWS: u32 = 16;

/// A frame that is drawn in steps. The scene must be the same in each.
#[derive(Debug)]
pub struct SteppedFrame {
    set: Option<InstructionSet>,
    sampling: Sampling,
    /// The rays through the centres of the pixels, from the top.
    centres: Vec<CentreRay>,
    /// Number of those that were cast.
    cast: usize,
    pixels: Vec<Pixel>,
    /// Number of those that were drawn.
    drawn: usize,
}

/// How far a frame is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameProgress {
    Drawing,
    /// The last ray through a pixel's centre was cast in this step: [`SteppedFrame::sketch`] shows them.
    Sketched,
    Drawn,
}

impl Default for SteppedFrame {
    /// As a viewer draws it.
    fn default() -> Self {
        Self::new(InstructionSet::best(), Sampling::Adaptive)
    }
}

impl SteppedFrame {
    /// A frame before its first step, drawn with an instruction set, or ray by ray.
    pub fn new(set: Option<InstructionSet>, sampling: Sampling) -> Self {
        Self { set, sampling, centres: Vec::new(), cast: 0, pixels: Vec::new(), drawn: 0 }
    }

    /// Draws on all cores until `is_due`, which each thread asks every few milliseconds, or until the frame is sketched or drawn. Each
    /// step does some work in any case.
    pub fn step(&mut self, scene: &SceneRef<'_>, is_due: impl Fn() -> bool + Sync) -> FrameProgress {
        let (width, height) = (scene.frame.width_px.max(1), scene.frame.height_px);
        let all = (width * height) as usize;
        self.pixels.resize(all, Pixel::NOTHING);
        // An even number: packets are two rows high, or four.
        let rows = (UNIT_PIXELS / width).clamp(2, MAX_UNIT_ROWS) & !1;
        let unit = (rows * width) as usize;
        let row_of = |at: usize| at as u32 / width;
        let Some(set) = self.set else {
            let begin = self.drawn;
            self.drawn += in_units(&mut self.pixels[begin..], unit, is_due, |at, pixels| {
                render_band((None, self.sampling), scene, row_of(begin + at), pixels);
            });
            return if self.drawn < all { FrameProgress::Drawing } else { FrameProgress::Drawn };
        };
        self.centres.resize(all, CentreRay::NOTHING);
        if self.cast < all {
            let begin = self.cast;
            self.cast += in_units(&mut self.centres[begin..], unit, is_due, |at, rays| {
                cast_centres(set, scene, row_of(begin + at), rays);
            });
            return if self.cast < all { FrameProgress::Drawing } else { FrameProgress::Sketched };
        }
        let begin = self.drawn;
        self.drawn += in_units(&mut self.pixels[begin..], unit, is_due, |at, pixels| {
            let first = row_of(begin + at);
            let [top, bottom] = rows_around(scene.frame, self.sampling, [first, first + row_of(pixels.len())]);
            let rays = &self.centres[(top * width) as usize..(bottom * width) as usize];
            finish_rows(set, scene, self.sampling, CentreRows { first: top, rays }, first, pixels);
        });
        if self.drawn < all { FrameProgress::Drawing } else { FrameProgress::Drawn }
    }

    /// The picture of the rays through the pixels' centres, once all of them were cast; `None` ray by ray.
    pub fn sketch(&self, scene: &SceneRef<'_>) -> Option<Pixels> {
        let (set, width) = (self.set?, scene.frame.width_px.max(1) as usize);
        let mut pixels = vec![Pixel::NOTHING; self.centres.len()];
        let rows = width * MAX_UNIT_ROWS as usize;
        pixels.par_chunks_mut(rows).zip(self.centres.par_chunks(rows)).enumerate().for_each(
            |(band, (pixels, rays))| {
                let first = band as u32 * MAX_UNIT_ROWS;
                sketch_rows(set, scene, CentreRows { first, rays }, first, pixels);
            },
        );
        Some(developed(scene.frame, self.set, &pixels))
    }

    /// The frame's pixels, all of which were drawn.
    pub fn develop(&self, scene: &SceneRef<'_>) -> Pixels {
        developed(scene.frame, self.set, &self.pixels)
    }
}

/// Hands out `items`, `unit` at a time and in order, to all threads until `is_due`. `work` gets the number of the first one. Returns how
/// many were worked on.
fn in_units<T: Send>(
    items: &mut [T],
    unit: usize,
    is_due: impl Fn() -> bool + Sync,
    work: impl Fn(usize, &mut [T]) + Sync,
) -> usize {
    let (count, taken) = (items.len(), AtomicUsize::new(0));
    let units = Mutex::new(items.chunks_mut(unit.max(1)).enumerate());
    let take_units = || {
        loop {
            let next = units.lock().unwrap_or_else(PoisonError::into_inner).next();
            let Some((number, items)) = next else { break };
            taken.fetch_add(items.len(), Ordering::Relaxed);
            work(number * unit, items);
            if is_due() {
                break;
            }
        }
    };
    on_all_cores(take_units);
    taken.into_inner().min(count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_worked_on_once_and_in_order() {
        let mut items = vec![0u32; 103];
        let mut done = 0;
        while done < items.len() {
            let begin = done;
            let count = in_units(
                &mut items[begin..],
                10,
                || true,
                |at, items| {
                    items.iter_mut().zip(begin + at..).for_each(|(item, number)| *item += number as u32 + 1);
                },
            );
            assert!(count >= 10.min(103 - begin), "a step does nothing");
            done += count;
        }
        assert!(items.iter().zip(1..).all(|(item, number)| *item == number), "{items:?}");
    }
}
