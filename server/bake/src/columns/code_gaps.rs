//! Which gaps of a column are stored, and how: one exactly, others as open rows of its wall.

use std::ops::Range;

/// A gap between two runs of a column.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CodeGap {
    /// Bottom and top as height codes.
    pub(super) codes: [u16; 2],
    /// The rows that are open unless the gap is stored exactly. Rows are counted from code 0.
    pub(super) open_rows: Range<u16>,
    /// Codes of the gap outside of these rows.
    closed: u16,
}

/// The gaps between the runs of a column, which are given in ascending codes.
///
/// A gap opens each row that lies entirely in it. If there is no such row and `leaves_runs_out` is set, the gap opens the row
/// that it overlaps most, provided that less than half of that row is full: losing a thin run is a smaller error than closing a
/// high gap. The first and the last row of a column stay closed in this case, because they show what stands on the ground and what
/// carries the roof.
pub(super) fn gaps_between(solids: &[[u16; 2]], codes_per_row: u16, leaves_runs_out: bool) -> Vec<CodeGap> {
    let [Some(first), Some(last)] = [solids.first(), solids.last()] else { return Vec::new() };
    let inner = first[0] / codes_per_row + 1..(last[1] - 1) / codes_per_row;
    let overlap = |[low, high]: [u16; 2], row: u16| {
        (high.min((row + 1) * codes_per_row)).saturating_sub(low.max(row * codes_per_row))
    };
    let is_mostly_open = |row: &u16| 2 * solids.iter().map(|run| overlap(*run, *row)).sum::<u16>() < codes_per_row;
    let gaps = solids.windows(2).map(|pair| [pair[0][1], pair[1][0]]).filter(|[low, high]| low < high);
    gaps.map(|codes| {
        let [low, high] = codes;
        let mut open_rows = low.div_ceil(codes_per_row)..high / codes_per_row;
        if open_rows.is_empty() && leaves_runs_out {
            let rows = (low / codes_per_row..=(high - 1) / codes_per_row).rev();
            let most = rows.filter(|row| inner.contains(row)).max_by_key(|row| overlap(codes, *row));
            open_rows = most.filter(is_mostly_open).map_or(0..0, |row| row..row + 1);
        }
        let open: u16 = open_rows.clone().map(|row| overlap(codes, row)).sum();
        CodeGap { codes, open_rows, closed: high - low - open }
    })
    .collect()
}

/// Index of the gap to store exactly: that of which rows show the least; of equal ones, the highest.
pub(super) fn exact_gap(gaps: &[CodeGap]) -> Option<usize> {
    (0..gaps.len()).max_by_key(|i| (gaps[*i].closed, gaps[*i].codes[1] - gaps[*i].codes[0]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Slabs of 16 codes with gaps of 128 between them.
    const SLABS: [[u16; 2]; 4] = [[0, 16], [144, 160], [288, 304], [432, 448]];

    fn open_rows(codes_per_row: u16, leaves_runs_out: bool) -> (Option<usize>, Vec<Range<u16>>) {
        let gaps = gaps_between(&SLABS, codes_per_row, leaves_runs_out);
        (exact_gap(&gaps), gaps.into_iter().map(|gap| gap.open_rows).collect())
    }

    #[test]
    fn gaps_open_the_rows_inside_them() {
        assert_eq!(open_rows(16, false), (Some(2), vec![1..9, 10..18, 19..27]));
        assert_eq!(open_rows(64, false), (Some(2), vec![1..2, 3..4, 5..6]));
        assert_eq!(open_rows(64, true), open_rows(64, false), "nothing is left out where a row lies in the gap");
        assert!(gaps_between(&[[3, 90]], 16, true).is_empty() && gaps_between(&[], 16, true).is_empty());
    }

    #[test]
    fn thin_runs_make_way_for_gaps_of_a_row() {
        assert_eq!(open_rows(128, true), (Some(0), vec![1..2, 1..2, 2..3]));
        let (_, closed) = open_rows(128, false);
        assert!(closed.iter().all(Range::is_empty), "{closed:?}");
    }

    #[test]
    fn the_gap_that_rows_show_least_is_exact() {
        let gaps = gaps_between(&[[0, 16], [24, 44], [144, 160]], 16, false);
        assert_eq!(exact_gap(&gaps), Some(0), "the other one loses half as much: {gaps:?}");
    }
}
