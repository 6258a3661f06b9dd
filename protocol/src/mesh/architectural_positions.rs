//! Positions of what was built: walls stand upright, eaves are level, corners lie over corners.
//!
//! In: a [`Connectivity`] and positions, or symbols. Out: symbols, or positions. Next: a person's eye.
//!
//! Each vertex first says whether it stands exactly over or under a neighbour, then whether it is exactly as high as one.
//! Both depend on how the neighbours lie to each other: beyond the diagonal of an upright wall there is nearly always another
//! corner of the wall. What is said by neither is a difference to the parallelogram: how many binary digits it has, by
//! the size of the triangles around and by what was left at neighbours, and then those digits.

use super::{
    completed::CompletedTriangles,
    connectivity::Connectivity,
    difference::{DifferenceCoder, digits},
    points::Points,
};
use crate::{
    codec::rans::{SymbolCoder, SymbolModel},
    error::DecodeError,
};

/// Neighbours that may be met: the two at the edge, the one after the second, the one beyond the edge.
const NEIGHBOURS: usize = 4;
/// Binary digits of a triangle's size, or of what was left.
const SIZES: usize = 18; // as many as `digits` has values

struct ArchitecturalModels {
    /// Which neighbour stands over or under it; 0 for none.
    column: Vec<SymbolModel<8>>,
    /// Which one is as high.
    level: Vec<SymbolModel<8>>,
    /// What neither says: by axis and size, by axis and what was left nearby.
    differences: DifferenceCoder,
}

impl ArchitecturalModels {
    fn new() -> Self {
        Self {
            column: vec![SymbolModel::new(|i| [8, 8, 3, 3, 3, 1, 1, 1][i]); 64],
            level: vec![SymbolModel::new(|i| [8, 4, 4, 3, 3, 1, 1, 1][i]); 320],
            differences: DifferenceCoder::new([4 * SIZES; 2]),
        }
    }
}

/// Writes or reads all positions; those of copies are their originals'.
pub(super) fn code<C: SymbolCoder>(
    coder: &mut C,
    mesh: &Connectivity,
    points: &mut Points,
    first: &[u32],
) -> Result<(), DecodeError> {
    let mut models = ArchitecturalModels::new();
    let mut around = CompletedTriangles::default();
    let mut left = vec![[0u8; 2]; points.len()];
    let mut last = [points.middle(); 2];
    for vertex in 0..points.len() as u32 {
        if !points.is_real(vertex) {
            continue;
        }
        let original = first[vertex as usize];
        if original != vertex {
            let place = std::array::from_fn(|axis| points.value(original, axis));
            points.put(vertex, place)?;
            left[vertex as usize] = left[original as usize];
            last = [place, last[0]];
            continue;
        }
        around.look(mesh, vertex, |other| points.is_real(other));
        let value = |other: u32| -> [i32; 3] { std::array::from_fn(|axis| points.value(other, axis)) };
        let wings = around.wings();
        // Neighbours in the order in which they are asked.
        let (near, alone, size_left) = match wings {
            [] => ([last[0], last[1], last[0], last[0]], 1, [0, 0]),
            [wing, rest @ ..] => {
                let (a, b, x) = (value(wing.a), value(wing.b), value(wing.x));
                let n = rest.first().map_or(wing.b, |next| if next.full == next.a { next.b } else { next.a });
                let l = [wing.a, wing.b, wing.x].map(|other| left[other as usize]);
                let most = |k: usize| usize::from(l[0][k].max(l[1][k]).max(l[2][k]));
                ([b, a, value(n), x], 0, [most(0), most(1)])
            }
        };
        let [b, a, n, x] = near;
        let over = |p: [i32; 3], q: [i32; 3]| usize::from(p[..2] == q[..2]);
        let level = |p: [i32; 3], q: [i32; 3]| usize::from(p[2] == q[2]);
        let wanted: [i32; 3] = if alone == 1 { last[0] } else { std::array::from_fn(|k| a[k] + b[k] - x[k]) };
        let here: [i32; 3] = std::array::from_fn(|axis| points.value(vertex, axis));
        let span = |k: usize| digits((a[k] - b[k]).abs().max((x[k] - b[k]).abs()));

        let how = over(a, b) + 2 * over(x, a) + 4 * over(x, b) + 8 * over(n, b) + 16 * over(n, a) + 32 * alone;
        let column = near.iter().position(|p| over(*p, here) == 1).map_or(0, |i| i + 1);
        let column = coder.symbol(&mut models.column[how], column);
        let mut place = here;
        if column > NEIGHBOURS {
            return Err(DecodeError::Invalid("a mesh's vertex stands over no neighbour"));
        }
        let mut rest = [0u8; 2];
        if column > 0 {
            place[0] = near[column - 1][0];
            place[1] = near[column - 1][1];
        } else {
            let size = span(0).max(span(1));
            for k in 0..2 {
                let kind = SIZES * if alone == 1 { 2 } else { k };
                place[k] = models.differences.code(coder, [kind + size, kind + size_left[0]], here[k], wanted[k]);
                rest[0] = rest[0].max(digits(place[k] - wanted[k]) as u8);
            }
        }
        let how = (level(a, b) + 2 * level(x, a) + 4 * level(x, b) + 8 * level(n, b) + 16 * level(n, a) + 32 * alone)
            * 5
            + column;
        let height = near.iter().position(|p| level(*p, here) == 1).map_or(0, |i| i + 1);
        let height = coder.symbol(&mut models.level[how], height);
        if height > NEIGHBOURS {
            return Err(DecodeError::Invalid("a mesh's vertex is as high as no neighbour"));
        }
        if height > 0 {
            place[2] = near[height - 1][2];
        } else {
            let kind = SIZES * 3;
            place[2] = models.differences.code(coder, [kind + span(2), kind + size_left[1]], here[2], wanted[2]);
            rest[1] = digits(place[2] - wanted[2]) as u8;
        }
        points.put(vertex, place)?;
        left[vertex as usize] = rest;
        last = [place, last[0]];
        if vertex % 1024 == 0 && coder.overrun() {
            return Err(DecodeError::Invalid("a mesh's positions are cut off"));
        }
    }
    Ok(())
}
