//! Colours for texels that no triangle shows (pull-push, Gortler et al. 1996, "The Lumigraph", 3.3.2).
//!
//! A pyramid of means is built from the known texels. Unknown texels are then filled from the coarsest level down, each
//! between its four nearest texels of the next coarser level. The result is smooth and takes few bytes in a file.

/// Sets the texels that are not known to colours between those of the nearest known ones. Without any known texel, all
/// become black. `rgb` has three bytes per texel, row by row.
pub(super) fn fill_unknown_texels(rgb: &mut [u8], [width, height]: [u32; 2], is_known: &[bool]) {
    let texels = rgb.as_chunks::<3>().0.iter().zip(is_known);
    let first = PyramidLevel {
        size: [width as usize, height as usize],
        texels: texels
            .map(|([r, g, b], is_known)| if *is_known { [*r, *g, *b].map(f32::from) } else { [0.0; 3] })
            .collect(),
        is_known: is_known.to_vec(),
    };
    let mut levels = vec![first];
    while let Some(last) = levels.last().filter(|last| last.size != [1, 1]) {
        let next = last.halved();
        levels.push(next);
    }
    let Some(mut coarse) = levels.pop() else { return };
    while let Some(mut level) = levels.pop() {
        level.fill_from(&coarse);
        coarse = level;
    }
    for (rgb, [r, g, b]) in rgb.as_chunks_mut::<3>().0.iter_mut().zip(&coarse.texels) {
        *rgb = [(r + 0.5) as u8, (g + 0.5) as u8, (b + 0.5) as u8];
    }
}

/// One level of the pyramid. Each texel of a texture passes through it, so its loops make no iterators of a few numbers.
struct PyramidLevel {
    size: [usize; 2],
    /// Zero where no texel below is known.
    texels: Vec<[f32; 3]>,
    is_known: Vec<bool>,
}

impl PyramidLevel {
    /// The next coarser level: means of the known ones of four texels.
    fn halved(&self) -> Self {
        let [width, height] = self.size;
        let size = self.size.map(|side| side.div_ceil(2));
        let (mut texels, mut is_known) = (Vec::with_capacity(size[0] * size[1]), Vec::with_capacity(size[0] * size[1]));
        for y in 0..size[1] {
            for x in 0..size[0] {
                let (mut sum, mut count) = ([0.0; 3], 0.0);
                for row in 2 * y..(2 * y + 2).min(height) {
                    for i in row * width + 2 * x..row * width + (2 * x + 2).min(width) {
                        if self.is_known[i] {
                            let [r, g, b] = self.texels[i];
                            sum = [sum[0] + r, sum[1] + g, sum[2] + b];
                            count += 1.0;
                        }
                    }
                }
                is_known.push(count > 0.0);
                texels.push(if count > 0.0 { [sum[0] / count, sum[1] / count, sum[2] / count] } else { [0.0; 3] });
            }
        }
        Self { size, texels, is_known }
    }

    /// Sets unknown texels by bilinear interpolation in the next coarser level, which must be complete.
    fn fill_from(&mut self, coarse: &Self) {
        let width = self.size[0];
        let [last_column, last_row] = coarse.size.map(|side| side - 1);
        // The coarse texel over this one, and its neighbour on the nearer side.
        let nearest_two = |v: usize, last: usize| {
            [((v / 2).min(last), 0.75), ((v / 2 + v % 2 * 2).saturating_sub(1).min(last), 0.25)]
        };
        for y in 0..self.size[1] {
            for x in 0..width {
                let i = y * width + x;
                if self.is_known[i] {
                    continue;
                }
                let mut sum = [0.0; 3];
                for (column, u) in nearest_two(x, last_column) {
                    for (row, v) in nearest_two(y, last_row) {
                        let [r, g, b] = coarse.texels[row * coarse.size[0] + column];
                        sum = [sum[0] + r * u * v, sum[1] + g * u * v, sum[2] + b * u * v];
                    }
                }
                self.texels[i] = sum;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_texels_stay_and_unknown_ones_spread_from_them() {
        let texels: Vec<u8> = (0..105).collect();
        let mut rgb = texels.clone();
        let every_third: Vec<bool> = (0..35).map(|i| i % 3 == 0).collect();
        fill_unknown_texels(&mut rgb, [7, 5], &every_third);
        for i in (0..35).filter(|i| every_third[*i]) {
            assert_eq!(rgb[3 * i..3 * i + 3], texels[3 * i..3 * i + 3]);
        }
        let mut rgb = texels;
        let one: Vec<bool> = (0..35).map(|i| i == 12).collect();
        fill_unknown_texels(&mut rgb, [7, 5], &one);
        assert!(rgb.as_chunks::<3>().0.iter().all(|texel| *texel == [36, 37, 38]));
        fill_unknown_texels(&mut rgb, [7, 5], &[false; 35]);
        assert!(rgb.iter().all(|v| *v == 0), "black without any known texel");
    }
}
