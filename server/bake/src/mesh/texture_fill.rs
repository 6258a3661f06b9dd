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
        texels: texels.map(|(rgb, is_known)| is_known.then(|| rgb.map(f32::from))).collect(),
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
    for (rgb, texel) in rgb.as_chunks_mut::<3>().0.iter_mut().zip(&coarse.texels) {
        *rgb = texel.unwrap_or_default().map(|v| (v + 0.5) as u8);
    }
}

/// One level of the pyramid; `None` where no texel below is known.
struct PyramidLevel {
    size: [usize; 2],
    texels: Vec<Option<[f32; 3]>>,
}

impl PyramidLevel {
    /// The texel at a position, clamped to the level.
    fn at(&self, x: usize, y: usize) -> Option<[f32; 3]> {
        self.texels[y.min(self.size[1] - 1) * self.size[0] + x.min(self.size[0] - 1)]
    }

    /// The next coarser level: means of the known ones of four texels.
    fn halved(&self) -> Self {
        let size = self.size.map(|side| side.div_ceil(2));
        let mean = |x: usize, y: usize| {
            let positions = [0, 1, 2, 3].map(|k| [2 * x + k % 2, 2 * y + k / 2]);
            let inside = positions.into_iter().filter(|[x, y]| *x < self.size[0] && *y < self.size[1]);
            let (mut sum, mut count) = ([0.0; 3], 0.0);
            for texel in inside.filter_map(|[x, y]| self.at(x, y)) {
                sum = [0, 1, 2].map(|k| sum[k] + texel[k]);
                count += 1.0;
            }
            (count > 0.0).then(|| sum.map(|v: f32| v / count))
        };
        Self { size, texels: (0..size[0] * size[1]).map(|i| mean(i % size[0], i / size[0])).collect() }
    }

    /// Sets unknown texels by bilinear interpolation in the next coarser level, which must be complete.
    fn fill_from(&mut self, coarse: &Self) {
        let width = self.size[0];
        for (i, texel) in self.texels.iter_mut().enumerate().filter(|(_, texel)| texel.is_none()) {
            let (x, y) = (i % width, i / width);
            // The coarse texel over this one, and its neighbour on the nearer side.
            let nearest_two = |v: usize| [v / 2, (v / 2 + v % 2 * 2).saturating_sub(1)];
            let mut sum = [0.0; 3];
            for (column, u) in nearest_two(x).into_iter().zip([0.75, 0.25]) {
                for (row, v) in nearest_two(y).into_iter().zip([0.75, 0.25]) {
                    let colour = coarse.at(column, row).unwrap_or_default();
                    sum = [0, 1, 2].map(|k| sum[k] + colour[k] * u * v);
                }
            }
            *texel = Some(sum);
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
