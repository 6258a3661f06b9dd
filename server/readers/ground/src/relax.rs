//! A smooth field between bounds: repeated means of neighbours, from coarse grids to the finest.

/// Sweeps over the grid at each level.
const SWEEPS: usize = 40;
/// Grids with fewer vertices along a side are not made coarser.
const MIN_SIDE: usize = 5;

/// Bounds of each vertex, row by row. A vertex without bounds has `low > high`.
#[derive(Debug, Clone)]
pub struct Bounds {
    pub size: [usize; 2],
    pub low: Vec<f32>,
    pub high: Vec<f32>,
}

impl Bounds {
    /// Bounds of vertices of which nothing is known.
    pub fn unknown(size: [usize; 2]) -> Self {
        let n = size[0] * size[1];
        Self { size, low: vec![f32::INFINITY; n], high: vec![f32::NEG_INFINITY; n] }
    }

    /// Whether vertex `i` has bounds.
    pub fn is_known(&self, i: usize) -> bool {
        self.low[i] <= self.high[i]
    }

    /// Bounds of every second vertex: the means of those around it.
    fn coarser(&self) -> Self {
        let size = self.size.map(|n| n.div_ceil(2));
        let mut coarse = Self::unknown(size);
        for y in 0..size[1] {
            for x in 0..size[0] {
                let (mut low, mut high, mut n) = (0.0, 0.0, 0.0);
                for fine_y in (2 * y).saturating_sub(1)..(2 * y + 2).min(self.size[1]) {
                    for fine_x in (2 * x).saturating_sub(1)..(2 * x + 2).min(self.size[0]) {
                        let i = fine_y * self.size[0] + fine_x;
                        if self.is_known(i) {
                            (low, high, n) = (low + self.low[i], high + self.high[i], n + 1.0);
                        }
                    }
                }
                if n > 0.0 {
                    (coarse.low[y * size[0] + x], coarse.high[y * size[0] + x]) = (low / n, high / n);
                }
            }
        }
        coarse
    }
}

/// The field within the bounds whose other heights are the means of their neighbours'. Zero if nothing is known.
pub fn smooth_field(bounds: &Bounds) -> Vec<f32> {
    let mut field = if bounds.size.iter().any(|n| *n <= MIN_SIDE) {
        vec![mean_known(bounds); bounds.low.len()]
    } else {
        let coarse = bounds.coarser();
        refine(&smooth_field(&coarse), coarse.size, bounds.size)
    };
    for _ in 0..SWEEPS {
        sweep(bounds, &mut field);
    }
    field
}

fn mean_known(bounds: &Bounds) -> f32 {
    let known = (0..bounds.low.len()).filter(|i| bounds.is_known(*i)).map(|i| f64::from(bounds.low[i]));
    let (sum, n) = known.fold((0.0, 0u32), |(sum, n), low| (sum + low, n + 1));
    if n == 0 { 0.0 } else { (sum / f64::from(n)) as f32 }
}

/// Interpolates a field between vertices at twice the distance.
fn refine(coarse: &[f32], from: [usize; 2], to: [usize; 2]) -> Vec<f32> {
    let at = |x: usize, y: usize| coarse[y.min(from[1] - 1) * from[0] + x.min(from[0] - 1)];
    let value = |i: usize| {
        let (x, y) = (i % to[0], i / to[0]);
        let [west, east, south, north] = [x / 2, x.div_ceil(2), y / 2, y.div_ceil(2)];
        0.25 * (at(west, south) + at(east, south) + at(west, north) + at(east, north))
    };
    (0..to[0] * to[1]).map(value).collect()
}

/// Replaces each height in turn by the mean of its neighbours', within its bounds.
fn sweep(bounds: &Bounds, field: &mut [f32]) {
    let [width, height] = bounds.size;
    for y in 0..height {
        let (south, north) = (y.saturating_sub(1), (y + 1).min(height - 1));
        for x in 0..width {
            let (west, east) = (x.saturating_sub(1), (x + 1).min(width - 1));
            let row = y * width;
            let sum = field[row + west] + field[row + east] + field[south * width + x] + field[north * width + x];
            let (i, mean) = (row + x, 0.25 * sum);
            field[i] = if bounds.is_known(i) { mean.max(bounds.low[i]).min(bounds.high[i]) } else { mean };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn field_stays_within_bounds_and_is_smooth_between() {
        let mut bounds = Bounds::unknown([65, 33]);
        for y in 0..33 {
            (bounds.low[y * 65], bounds.high[y * 65]) = (0.0, 0.0);
            (bounds.low[y * 65 + 64], bounds.high[y * 65 + 64]) = (8.0, 8.0);
        }
        (bounds.low[16 * 65 + 32], bounds.high[16 * 65 + 32]) = (7.0, 9.0);
        let field = smooth_field(&bounds);
        assert_eq!(field[16 * 65 + 32], 7.0);
        assert!((field[2 * 65 + 16] - 2.0).abs() < 1.0, "{}", field[2 * 65 + 16]);
        assert!(field.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 9.0));
        assert!(field[16 * 65 + 30] > field[2 * 65 + 30]);
    }

    #[test]
    fn flat_bounds_give_an_exactly_flat_field() {
        let mut bounds = Bounds::unknown([40, 70]);
        for i in [0, 777, 1500] {
            (bounds.low[i], bounds.high[i]) = (3.0, 4.0);
        }
        assert!(smooth_field(&bounds).iter().all(|z| *z == 3.0));
    }
}
