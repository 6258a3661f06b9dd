//! Vertices that were cut apart, because triangles met there in a way that no surface does, said to be one again.
//!
//! In: for each vertex of the conquest the earlier one that it is a copy of. Out: symbols, or those. Next: `smooth`, `built`,
//! which need no second place for a copy.

use crate::{
    codec::rans::{RAW, SymbolCoder, SymbolModel},
    error::DecodeError,
};

/// DifferenceCoder to the copy before that have a symbol each: -7 to 7; the last symbol stands for others.
const NEAR: i64 = 7;

/// Writes or reads, for all vertices, which earlier vertex they are copies of: themselves if of none.
pub(super) fn code<C: SymbolCoder>(
    coder: &mut C,
    first: &mut Vec<u32>,
    vertices: usize,
    is_real: impl Fn(u32) -> bool,
) -> Result<(), DecodeError> {
    let any = C::WRITES && first.iter().zip(0..).any(|(first, vertex)| *first != vertex);
    if !coder.flag(&mut SymbolModel::new(|i| [3, 1][i]), any) {
        *first = (0..vertices as u32).collect();
        return Ok(());
    }
    first.resize(vertices, 0);
    let mut copies = [(); 4].map(|()| SymbolModel::new(|i| [9, 1][i]));
    let mut near = SymbolModel::<16>::default();
    let (mut state, mut last) = (0, 0i64);
    for vertex in 0..vertices as u32 {
        if !is_real(vertex) {
            first[vertex as usize] = vertex;
            continue;
        }
        let is_copy = coder.flag(&mut copies[state], first[vertex as usize] != vertex);
        state = state << 1 & 3 | usize::from(is_copy);
        if !is_copy {
            first[vertex as usize] = vertex;
            continue;
        }
        let away = i64::from(first[vertex as usize]) - last;
        let symbol = if away.abs() <= NEAR { (away + NEAR) as usize } else { 15 };
        let symbol = coder.symbol(&mut near, symbol);
        last = if symbol < 15 {
            last + symbol as i64 - NEAR
        } else {
            i64::from(any_below(coder, vertex, first[vertex as usize]))
        };
        let original = u32::try_from(last).ok().filter(|first| *first < vertex && is_real(*first));
        first[vertex as usize] = original.ok_or(DecodeError::Invalid("a mesh's vertex is a copy of none"))?;
    }
    Ok(())
}

/// A number below `limit`, any as likely as another.
fn any_below<C: SymbolCoder>(coder: &mut C, limit: u32, value: u32) -> u32 {
    let bits = 32 - limit.leading_zeros();
    let (high, low) = (bits.saturating_sub(RAW), bits.min(RAW));
    let upper = coder.raw(high.min(RAW), value >> low & ((1 << RAW) - 1));
    upper << low | coder.raw(low, value & ((1 << low) - 1))
}
