//! Codes of cells in runs of equal ones: a row of a city has few objects.

/// Codes of the cells of a raster.
#[derive(Debug, Clone, Default)]
pub(crate) struct Kinds {
    width: usize,
    /// Where the runs of each row begin; one more at the end.
    starts: Vec<u32>,
    /// First cell in the row, and code.
    runs: Vec<(u32, u32)>,
}

impl Kinds {
    pub(crate) fn new<R: AsRef<[u32]>>(width: usize, rows: impl Iterator<Item = R>) -> Self {
        let mut kinds = Self { width, starts: vec![0], runs: Vec::new() };
        for row in rows {
            let mut latest = None;
            for (x, code) in (0u32..).zip(row.as_ref()) {
                if latest != Some(*code) {
                    kinds.runs.push((x, *code));
                    latest = Some(*code);
                }
            }
            kinds.starts.push(kinds.runs.len() as u32);
        }
        kinds.runs.shrink_to_fit();
        kinds
    }

    fn runs(&self, row: usize) -> &[(u32, u32)] {
        &self.runs[self.starts[row] as usize..self.starts[row + 1] as usize]
    }

    /// The code of a cell. Requires an index of one.
    pub(crate) fn get(&self, index: usize) -> u32 {
        let (row, x) = (index / self.width, index % self.width);
        let runs = self.runs(row);
        runs[runs.partition_point(|(first, _)| *first as usize <= x) - 1].1
    }

    pub(crate) fn row(&self, row: usize) -> impl Iterator<Item = u32> + '_ {
        let runs = self.runs(row);
        let ends = runs.iter().skip(1).map(|(first, _)| *first as usize).chain([self.width]);
        runs.iter().zip(ends).flat_map(|((first, code), end)| std::iter::repeat_n(*code, end - *first as usize))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_have_the_codes_of_their_cells() {
        let rows = [[7, 7, 2, 2, 2], [2, 2, 2, 2, 2], [1, 2, 3, 4, u32::MAX]];
        let kinds = Kinds::new(5, rows.iter());
        assert_eq!(kinds.runs.len(), 2 + 1 + 5);
        for (y, row) in rows.iter().enumerate() {
            assert_eq!(kinds.row(y).collect::<Vec<_>>(), row);
            assert!((0..5).all(|x| kinds.get(y * 5 + x) == row[x]));
        }
        assert!(Kinds::new(0, std::iter::empty::<Vec<u32>>()).runs.is_empty());
    }
}
