//! Column bottoms, lossless, row by row.
//!
//! A column on the ground ends slightly below the lowest ground around it. Any other column usually ends where its
//! neighbours end. The nearer of the two predictions is used and coded.

use super::neighbours::{WIDTH, rim_index};
use super::tops::ColumnTop;
use super::{BlockMap, COLUMNS, STEPS_PER_CELL, Z_CODE_MAX, flag};
use crate::codec::range::{BitCoder, BitModel, NumberModel};

/// Largest number of height codes by which [`BlockMap::snap_hidden_bottoms`] moves a bottom.
const SNAP_DISTANCE: i32 = 2;

#[derive(Default)]
struct BottomModels {
    /// Whether the bottom is exactly the predicted ground.
    is_ground: [BitModel; 18],
    /// Otherwise, whether it is nearer to the ground than to the neighbours' bottom.
    near_ground: [BitModel; 18],
    height: [NumberModel; 4],
}

/// The prediction that a coded bottom was nearer to.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum Nearer {
    /// The column is empty or not coded yet.
    #[default]
    Unknown = 0,
    Neighbours = 1,
    Ground = 2,
}

#[derive(Debug, Clone, Copy, Default)]
struct CodedBottom {
    nearer: Nearer,
    z: i32,
}

/// The height code of the ground below the lowest neighbouring top: a quarter of a cell lower.
fn ground_below(lowest: i32, z_shift: u8) -> i32 {
    lowest - i32::from(STEPS_PER_CELL >> z_shift) / 4
}

/// Writes or reads all bottoms. `tops` are on the grid with a rim.
pub(super) fn code<C: BitCoder>(coder: &mut C, map: &mut BlockMap, tops: &[ColumnTop]) {
    let mut models = Box::<BottomModels>::default();
    let lowest = lowest_around(tops);
    let mut coded = vec![CodedBottom::default(); WIDTH * WIDTH];
    let mut last_z = 0;
    for i in 0..COLUMNS {
        let at = rim_index(i);
        let top = &tops[at];
        if !top.is_occupied() {
            continue;
        }
        let ground = ground_below(lowest[at], map.z_shift).clamp(0, i32::from(Z_CODE_MAX));
        let (west, south) = (coded[at - 1], coded[at - WIDTH]);
        let neighbours = if west.nearer != Nearer::Unknown {
            west.z
        } else if south.nearer != Nearer::Unknown {
            south.z
        } else {
            last_z
        };
        let suspended = usize::from(top.flags & flag::SUSPENDED != 0);
        let context = (suspended * 3 + west.nearer as usize) * 3 + south.nearer as usize;
        let value = i32::from(map.z_min[i]);
        let (nearer, z) = if coder.bit(&mut models.is_ground[context], value == ground) {
            (Nearer::Ground, ground)
        } else {
            let is_nearer = (value - ground).abs() <= (value - neighbours).abs();
            let is_nearer = coder.bit(&mut models.near_ground[context], is_nearer);
            let inclined = usize::from(top.flags & flag::INCLINED != 0);
            let (nearer, expected, model) = if is_nearer {
                (Nearer::Ground, ground, 2 + inclined)
            } else {
                (Nearer::Neighbours, neighbours, suspended)
            };
            let z = expected + coder.number(&mut models.height[model], value - expected);
            (nearer, z.clamp(0, i32::from(u16::MAX)))
        };
        last_z = z;
        coded[at] = CodedBottom { nearer, z };
        if !C::WRITES {
            map.z_min[i] = z as u16;
        }
    }
}

impl BlockMap {
    /// Moves bottoms that lie hidden slightly below the ground to their prediction, by at most two height codes, so
    /// that they cost almost nothing. Columns with a wall strip are kept, because their bottoms are visible.
    pub fn snap_hidden_bottoms(&mut self) {
        let mut tops = vec![ColumnTop::default(); WIDTH * WIDTH];
        for i in (0..COLUMNS).filter(|i| self.flags[*i] & flag::OCCUPIED != 0) {
            tops[rim_index(i)] = ColumnTop::of(self, i);
        }
        let lowest = lowest_around(&tops);
        let is_hidden = |flags: u8| flags & (flag::OCCUPIED | flag::SUSPENDED | flag::EXPOSED) == flag::OCCUPIED;
        for i in (0..COLUMNS).filter(|i| is_hidden(self.flags[*i])) {
            let z = i32::from(self.z_min[i]);
            let ground = ground_below(lowest[rim_index(i)], self.z_shift).max(0);
            if (z - ground).abs() <= SNAP_DISTANCE && ground < i32::from(self.z_max[i]) {
                self.z_min[i] = ground as u16;
            }
        }
    }
}

/// For each cell, the lowest point of the tops of the 3 x 3 columns around it.
fn lowest_around(tops: &[ColumnTop]) -> Vec<i32> {
    let own: Vec<i32> = tops.iter().map(ColumnTop::lowest).collect();
    let minimum_of_three = |values: &[i32], step: usize| {
        let mut minimum = values.to_vec();
        let (before, after) = (&values[..values.len() - 2 * step], &values[2 * step..]);
        for (minimum, (before, after)) in minimum[step..].iter_mut().zip(before.iter().zip(after)) {
            *minimum = (*minimum).min(*before).min(*after);
        }
        minimum
    };
    minimum_of_three(&minimum_of_three(&own, 1), WIDTH)
}
