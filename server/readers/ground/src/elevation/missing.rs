//! Heights of a raster that are none on land, and so mark missing ones that the file does not declare.

use std::collections::{BTreeMap, HashSet};

/// Pixels that are told apart, so that one that is read twice counts once.
const MAX_PIXELS: usize = 1 << 20;
/// Further values are counted together.
const MAX_VALUES: usize = 3;

/// Pixels by their value.
#[derive(Default)]
pub(super) struct MissingHeights {
    /// Level and number of each.
    pixels: HashSet<(usize, u64)>,
    /// Number of pixels of each level, by the bits of their value.
    counts: BTreeMap<usize, BTreeMap<u32, u64>>,
    is_full: bool,
}

impl MissingHeights {
    pub(super) fn add(&mut self, height: f32, level: usize, pixel: u64) {
        if self.pixels.len() >= MAX_PIXELS {
            self.is_full = true;
        } else if self.pixels.insert((level, pixel)) {
            *self.counts.entry(level).or_default().entry(height.to_bits()).or_default() += 1;
        }
    }

    /// A line for each of the most frequent values of the finest level that was read.
    pub(super) fn texts(&self) -> Vec<String> {
        let Some(counts) = self.counts.values().next() else { return Vec::new() };
        let more = if self.is_full { "more than " } else { "" };
        let mut all: Vec<(u64, u32)> = counts.iter().map(|(bits, count)| (*count, *bits)).collect();
        all.sort_by_key(|(count, bits)| (std::cmp::Reverse(*count), *bits));
        let (first, rest) = all.split_at(all.len().min(MAX_VALUES));
        let named = first.iter().map(|(count, bits)| {
            let plural = if *count == 1 { "" } else { "s" };
            format!("{more}{count} pixel{plural} of {} taken as missing (--nodata)", f32::from_bits(*bits))
        });
        let others: u64 = rest.iter().map(|(count, _)| count).sum();
        let others = (others > 0).then(|| format!("{more}{others} pixels of other values taken as missing (--nodata)"));
        named.chain(others).collect()
    }
}

/// Heights of exactly 0 far below all others: many programs write them where they know no height, but so is the sea.
#[derive(Default)]
pub(super) struct OddZeros {
    /// Level and number of each.
    pixels: HashSet<(usize, u64)>,
    /// Lowest and highest of the others.
    others: Option<[f32; 2]>,
}

impl OddZeros {
    /// Others nearer to 0 are the land beside a sea.
    const LOWEST_LAND: f32 = 30.0;

    pub(super) fn add(&mut self, height: f32, level: usize, pixel: u64) {
        if height != 0.0 {
            let [low, high] = self.others.unwrap_or([height; 2]);
            self.others = Some([low.min(height), high.max(height)]);
        } else if self.pixels.len() < MAX_PIXELS && !self.has_low_land() {
            self.pixels.insert((level, pixel));
        }
    }

    fn has_low_land(&self) -> bool {
        self.others.is_some_and(|[low, _]| low < Self::LOWEST_LAND)
    }

    /// What was found in the finest level that was read.
    pub(super) fn text(&self) -> Option<String> {
        let [low, high] = self.others.filter(|_| !self.has_low_land())?;
        let level = self.pixels.iter().map(|(level, _)| *level).min()?;
        let count = self.pixels.iter().filter(|(of, _)| *of == level).count();
        let more = if self.pixels.len() == MAX_PIXELS { "more than " } else { "" };
        Some(format!(
            "{more}{count} pixels of 0, others from {low} to {high}; if they mark missing heights, give --nodata 0"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_pixel_counts_once_and_values_are_named() {
        let mut missing = MissingHeights::default();
        assert!(missing.texts().is_empty());
        for _ in 0..2 {
            (0..900).for_each(|pixel| missing.add(-32768.0, 0, pixel));
            missing.add(1e9, 0, 1000);
            missing.add(-32768.0, 1, 0);
        }
        let expected =
            ["900 pixels of -32768 taken as missing (--nodata)", "1 pixel of 1000000000 taken as missing (--nodata)"];
        assert_eq!(missing.texts(), expected);
    }

    #[test]
    fn zeros_far_below_the_land_are_odd() {
        let text = |heights: &[f32]| {
            let mut zeros = OddZeros::default();
            heights
                .iter()
                .chain(heights)
                .enumerate()
                .for_each(|(at, height)| zeros.add(*height, 0, (at % heights.len()) as u64));
            zeros.text()
        };
        let expected = "2 pixels of 0, others from 500 to 506; if they mark missing heights, give --nodata 0";
        assert_eq!(text(&[0.0, 500.0, 0.0, 506.0]).as_deref(), Some(expected));
        assert_eq!(text(&[0.0, 500.0, 2.0]), None, "a coast");
        assert_eq!((text(&[0.0, 0.0]), text(&[500.0])), (None, None));
    }
}
