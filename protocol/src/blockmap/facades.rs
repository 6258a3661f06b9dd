//! Which columns are exposed, and the order in which their walls are coded.

use super::neighbours::{WIDTH, rim_index};
use super::{BlockMap, COLUMNS, NODE_CELLS, STEPS_PER_CELL, Z_CODE_MAX, flag};
use crate::codec::range::{BitCoder, BitModel, GroupFlag};

/// The eight neighbours of a column in the order in which a facade is followed: along the grid first.
pub(super) const AROUND: [[i32; 2]; 8] = [[1, 0], [0, 1], [-1, 0], [0, -1], [1, 1], [-1, 1], [-1, -1], [1, -1]];

/// Number of classes of [`openness`] inside the node, and as many on its rim.
const INNER_CLASSES: u8 = 10;
const CLASSES: usize = 2 * INNER_CLASSES as usize;
/// Class of an empty cell.
const EMPTY: u8 = CLASSES as u8;
/// Upper bounds of the classes of [`openness`] but the last, in height codes at shift 0, relative to one row.
const CLASS_ENDS: [i16; 9] = [-12, -6, -3, -1, 0, 2, 5, 12, 32];

/// An exposed column in facade order.
#[derive(Debug, Clone, Copy)]
pub(super) struct FacadeStep {
    pub(super) column: usize,
    /// The exposed neighbour from which the column was reached; `None` at the start of a facade.
    pub(super) predecessor: Option<usize>,
}

/// Writes or reads which columns are exposed. Nearly always these are the columns that stand free by more than a cell.
pub(super) fn code_exposed<C: BitCoder>(coder: &mut C, map: &mut BlockMap) {
    let classes = openness(map);
    let mut groups = [GroupFlag::Unset; CLASSES];
    let mut models = [[BitModel::NEW; 2]; CLASSES];
    for class in 0..CLASSES {
        let members = (0..COLUMNS).filter(|i| usize::from(classes[*i]) == class);
        let group = if C::WRITES {
            GroupFlag::of(members.map(|i| map.flags[i] & flag::EXPOSED != 0))
        } else {
            GroupFlag::Unset
        };
        groups[class] = group.code(coder, &mut models[class]);
    }
    let mut models = [BitModel::NEW; CLASSES];
    for (i, class) in classes.into_iter().enumerate().filter(|(_, class)| *class != EMPTY) {
        let class = usize::from(class);
        let is_exposed = groups[class].bit(coder, &mut models[class], map.flags[i] & flag::EXPOSED != 0);
        if is_exposed && !C::WRITES {
            map.flags[i] |= flag::EXPOSED;
        }
    }
}

/// The class of each column by how far its most open side stands free. Columns on the node's rim have their own
/// classes.
fn openness(map: &BlockMap) -> Vec<u8> {
    let open = most_open_side(map);
    let mut classes = vec![0u8; COLUMNS];
    // Bound by bound over all columns, so that compilers vectorise the loops.
    for end in CLASS_ENDS {
        let bound = (STEPS_PER_CELL >> map.z_shift) as i16 + (end >> map.z_shift);
        classes.iter_mut().zip(&open).for_each(|(class, open)| *class += u8::from(*open > bound));
    }
    for k in 0..NODE_CELLS {
        let last = NODE_CELLS - 1;
        for (x, y) in [(k, 0), (k, last), (0, k), (last, k)] {
            let class = &mut classes[y * NODE_CELLS + x];
            *class = *class % INNER_CLASSES + INNER_CLASSES;
        }
    }
    for (class, flags) in classes.iter_mut().zip(&map.flags) {
        if flags & flag::OCCUPIED == 0 {
            *class = EMPTY;
        }
    }
    classes
}

/// For each column, the number of height codes that stand free on its most open side. Everything outside the node
/// counts as full.
fn most_open_side(map: &BlockMap) -> Vec<i16> {
    // Lowest and highest code on the grid with a rim. The rim is full. Codes have 12 bits.
    let (mut low, mut high) = (vec![0i16; WIDTH * WIDTH], vec![i16::MAX; WIDTH * WIDTH]);
    let code = |z: &u16| (*z).min(Z_CODE_MAX) as i16;
    for y in 0..NODE_CELLS {
        let (row, at) = (y * NODE_CELLS..(y + 1) * NODE_CELLS, rim_index(y * NODE_CELLS));
        low[at..].iter_mut().zip(&map.z_min[row.clone()]).for_each(|(low, z)| *low = code(z));
        high[at..].iter_mut().zip(&map.z_max[row]).for_each(|(high, z)| *high = code(z));
    }
    let mut open = vec![0i16; COLUMNS];
    for (y, open) in open.chunks_exact_mut(NODE_CELLS).enumerate() {
        let at = rim_index(y * NODE_CELLS);
        let row = |from: usize| (&low[from..from + NODE_CELLS], &high[from..from + NODE_CELLS]);
        let (own_low, own_high) = row(at);
        for from in [at - 1, at + 1, at - WIDTH, at + WIDTH] {
            let (low, high) = row(from);
            for x in 0..NODE_CELLS {
                let covered = high[x].min(own_high[x]) - low[x].max(own_low[x]);
                open[x] = open[x].max(own_high[x] - own_low[x] - covered.max(0));
            }
        }
    }
    open
}

/// The exposed columns in facade order: depth first over neighbours, from each column in row-major order.
pub(super) fn facade_order(map: &BlockMap) -> Vec<FacadeStep> {
    // Exposed and not visited yet, on the grid with a rim.
    let mut unvisited = vec![false; WIDTH * WIDTH];
    for i in (0..COLUMNS).filter(|i| map.flags[*i] & flag::EXPOSED != 0) {
        unvisited[rim_index(i)] = true;
    }
    let mut steps = Vec::with_capacity(COLUMNS);
    let mut stack: Vec<FacadeStep> = Vec::with_capacity(256);
    for start in 0..COLUMNS {
        if !unvisited[rim_index(start)] {
            continue;
        }
        stack.push(FacadeStep { column: start, predecessor: None });
        while let Some(step) = stack.pop() {
            let at = rim_index(step.column);
            if !std::mem::replace(&mut unvisited[at], false) {
                continue;
            }
            steps.push(step);
            for [dx, dy] in AROUND.iter().rev() {
                if unvisited[at.wrapping_add_signed((dy * WIDTH as i32 + dx) as isize)] {
                    let column = step.column.wrapping_add_signed((dy * NODE_CELLS as i32 + dx) as isize);
                    stack.push(FacadeStep { column, predecessor: Some(step.column) });
                }
            }
        }
    }
    steps
}
