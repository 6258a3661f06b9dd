//! Lowest and highest values in square windows of a grid.

/// Sizes of the windows are 2, 4, 8, 16, 32 and 64 squares.
pub(crate) const SIZES: usize = 6;
/// Sides of the blocks of [`BlockTables`], in squares.
pub(crate) const BLOCK_SIDES: [usize; 3] = [8, 32, 128];

/// Squares west and south of the grid at which a window may begin.
const PADDING: usize = 64;

/// A grid's lowest or highest values in all windows of 2 to 64 squares.
#[derive(Debug)]
pub(crate) struct Windows {
    /// Size with the padding.
    width: isize,
    height: isize,
    tables: [Vec<u16>; SIZES],
}

impl Windows {
    /// Tables of a grid's values, combined by `combine`, which is `min` or `max`. Beyond the grid all values are 0.
    pub(crate) fn new(width: usize, height: usize, values: &[u16], combine: fn(u16, u16) -> u16) -> Self {
        let mut tables: [Vec<u16>; SIZES] = Default::default();
        let (inner_width, width, height) = (width, width + PADDING, height + PADDING);
        let mut last = vec![0; width * height];
        for (row, values) in last.chunks_exact_mut(width).skip(PADDING).zip(values.chunks_exact(inner_width)) {
            row[PADDING..].copy_from_slice(values);
        }
        for (k, table) in tables.iter_mut().enumerate() {
            let step = 1usize << k;
            let at =
                |x: usize, y: usize, values: &[u16]| if x < width && y < height { values[y * width + x] } else { 0 };
            let mut next = vec![0; width * height];
            for y in 0..height {
                for x in 0..width {
                    let west = combine(at(x, y, &last), at(x, y + step, &last));
                    let east = combine(at(x + step, y, &last), at(x + step, y + step, &last));
                    next[y * width + x] = combine(west, east);
                }
            }
            *table = next.clone();
            last = next;
        }
        Self { width: width as isize, height: height as isize, tables }
    }

    /// The value of the window of size number `size` (side `2 << size`) whose south-western square is `x`, `y`. 0 where all of it
    /// lies outside of the grid.
    #[inline]
    pub(crate) fn at(&self, size: usize, x: isize, y: isize) -> u16 {
        let (x, y) = (x + PADDING as isize, y + PADDING as isize);
        let is_inside = x >= 0 && y >= 0 && x < self.width && y < self.height;
        if is_inside { self.tables[size][(y * self.width + x) as usize] } else { 0 }
    }
}

/// The highest values of blocks of a grid, each together with the eight blocks around it.
#[derive(Debug)]
pub(crate) struct BlockTables {
    levels: Vec<(isize, isize, Vec<u16>)>,
}

impl BlockTables {
    /// The blocks of a grid.
    pub(crate) fn new(width: usize, height: usize, values: &[u16]) -> Self {
        let levels = BLOCK_SIDES
            .iter()
            .map(|side| {
                let (w, h) = (width.div_ceil(*side), height.div_ceil(*side));
                let mut own = vec![0u16; w * h];
                for (i, value) in values.iter().enumerate() {
                    let at = i / width / side * w + i % width / side;
                    own[at] = own[at].max(*value);
                }
                let around = (0..w * h).map(|i| {
                    let (x, y) = (i % w, i / w);
                    let rows = y.saturating_sub(1)..(y + 2).min(h);
                    let all = rows.flat_map(|y| (x.saturating_sub(1)..(x + 2).min(w)).map(move |x| y * w + x));
                    all.map(|i| own[i]).max().unwrap_or(0)
                });
                (w as isize, h as isize, around.collect())
            })
            .collect();
        Self { levels }
    }

    /// The highest value in the block of the square `x`, `y` at `level` and around it. 0 outside of the grid.
    #[inline]
    pub(crate) fn at(&self, level: usize, x: isize, y: isize) -> u16 {
        let (width, height, values) = &self.levels[level];
        let side = BLOCK_SIDES[level] as isize;
        let (x, y) = (x.div_euclid(side), y.div_euclid(side));
        if x >= 0 && y >= 0 && x < *width && y < *height { values[(y * width + x) as usize] } else { 0 }
    }
}
