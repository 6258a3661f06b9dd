//! Marks vertices that were cut apart (module `manifold`) as copies of one original, so that decoding restores it and
//! its position is coded once.

use crate::codec::rans::{RAW, SymbolCoder, SymbolModel};
use crate::error::DecodeError;

/// Differences up to this have a symbol each.
const NEAR: i64 = 7;
/// Symbol of all larger differences.
const FAR: usize = 15;

/// Codes for each vertex the earlier vertex that it is a copy of, or itself. Fails if that is not an earlier real
/// vertex.
pub(super) fn code<C: SymbolCoder>(
    coder: &mut C,
    originals: &mut Vec<u32>,
    vertices: usize,
    is_real: impl Fn(u32) -> bool,
) -> Result<(), DecodeError> {
    let any = C::WRITES && originals.iter().zip(0..).any(|(original, vertex)| *original != vertex);
    if !coder.flag(&mut SymbolModel::new(|i| [3, 1][i]), any) {
        *originals = (0..vertices as u32).collect();
        return Ok(());
    }
    originals.resize(vertices, 0);
    let mut copy_models = [(); 4].map(|()| SymbolModel::new(|i| [9, 1][i]));
    let mut difference_model = SymbolModel::<16>::default();
    let (mut last_two, mut last_original) = (0, 0i64);
    for vertex in 0..vertices as u32 {
        if !is_real(vertex) {
            originals[vertex as usize] = vertex;
            continue;
        }
        let is_copy = coder.flag(&mut copy_models[last_two], originals[vertex as usize] != vertex);
        last_two = last_two << 1 & 3 | usize::from(is_copy);
        if !is_copy {
            originals[vertex as usize] = vertex;
            continue;
        }
        let difference = i64::from(originals[vertex as usize]) - last_original;
        let symbol = if difference.abs() <= NEAR { (difference + NEAR) as usize } else { FAR };
        let symbol = coder.symbol(&mut difference_model, symbol);
        last_original = if symbol < FAR {
            last_original + symbol as i64 - NEAR
        } else {
            i64::from(uniform(coder, vertex, originals[vertex as usize]))
        };
        let original = u32::try_from(last_original).ok().filter(|original| *original < vertex && is_real(*original));
        originals[vertex as usize] =
            original.ok_or(DecodeError::Invalid("a mesh's vertex copies a vertex that does not exist"))?;
    }
    Ok(())
}

/// Codes a number below `limit` as raw bits.
fn uniform<C: SymbolCoder>(coder: &mut C, limit: u32, value: u32) -> u32 {
    let bits = 32 - limit.leading_zeros();
    let (high, low) = (bits.saturating_sub(RAW), bits.min(RAW));
    let upper = coder.raw(high.min(RAW), value >> low & ((1 << RAW) - 1));
    upper << low | coder.raw(low, value & ((1 << low) - 1))
}
