//! Lowest values in square windows of a grid.

/// Squares along a window's side, as a power of two.
const SIDE_LOG: usize = 4;
/// Squares along a window's side.
pub(crate) const WINDOW_SIDE: usize = 1 << SIDE_LOG;

/// A grid's lowest values in all square windows. Zeroes are no values.
#[derive(Debug)]
pub(crate) struct LowestWindows {
    /// Size with the windows that begin to the west and south of the grid.
    width: usize,
    height: usize,
    values: Vec<u16>,
}

impl LowestWindows {
    /// The windows of a grid of `width` squares a row.
    pub(crate) fn new(width: usize, height: usize, values: &[u16]) -> Self {
        let (inner_width, width, height) = (width, width + WINDOW_SIDE, height + WINDOW_SIDE);
        let mut all = vec![0; width * height];
        for (row, values) in all.chunks_exact_mut(width).skip(WINDOW_SIDE).zip(values.chunks_exact(inner_width)) {
            row[WINDOW_SIDE..].copy_from_slice(values);
        }
        let lower = |a: u16, b: u16| if a.min(b) == 0 { a.max(b) } else { a.min(b) };
        for k in 0..SIDE_LOG {
            // Values of windows half as wide, in place: those that are still needed lie further on.
            let step = 1 << k;
            for row in all.chunks_exact_mut(width) {
                (0..width - step).for_each(|x| row[x] = lower(row[x], row[x + step]));
            }
            for i in 0..width * (height - step) {
                all[i] = lower(all[i], all[i + width * step]);
            }
        }
        Self { width, height, values: all }
    }

    /// The lowest value of the window whose south-western square is `x`, `y`. 0 where it has none.
    pub(crate) fn at(&self, x: isize, y: isize) -> u16 {
        let [x, y] = [x, y].map(|v| usize::try_from(v + WINDOW_SIDE as isize).unwrap_or(usize::MAX));
        if x < self.width && y < self.height { self.values[y * self.width + x] } else { 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_have_the_lowest_value_that_is_not_zero() {
        let (width, height) = (23usize, 19usize);
        let values: Vec<u16> = (0..width * height).map(|i| ((i * 7919) % 97) as u16 * u16::from(i % 5 != 0)).collect();
        let windows = LowestWindows::new(width, height, &values);
        let side = WINDOW_SIDE as isize;
        for y in -side - 2..height as isize + 2 {
            for x in -side - 2..width as isize + 2 {
                let inside = |v: isize, size: usize| v.max(0) as usize..(v + side).clamp(0, size as isize) as usize;
                let all = inside(y, height).flat_map(|y| inside(x, width).map(move |x| y * width + x));
                let lowest = all.map(|i| values[i]).filter(|value| *value > 0).min().unwrap_or(0);
                assert_eq!(windows.at(x, y), lowest, "{x} {y}");
            }
        }
    }
}
