//! Makes little-endian numbers of the unpacked bytes of tiles and strips.

use super::super::error::RasterError;
use super::layout::Layout;

const HORIZONTAL: u64 = 2;
const FLOATING_POINT: u64 = 3;

/// Makes little-endian numbers of unpacked bytes, whose rows are `layout.packed_row_bytes()` long.
pub(super) fn numbers(layout: &Layout, is_big_endian: bool, mut bytes: Vec<u8>) -> Result<Vec<u8>, RasterError> {
    let row_bytes = layout.packed_row_bytes() as usize;
    let (size, lanes) = (layout.sample.bytes(), usize::from(layout.lanes()));
    if usize::from(layout.bits) != size * 8 {
        if layout.predictor != 1 {
            return Err(RasterError::unsupported(format!("differences of numbers of {} bits", layout.bits)));
        }
        let numbers_in_row = layout.chunk.width as usize * lanes;
        return Ok(bytes.chunks_exact(row_bytes).flat_map(|row| whole_numbers(row, layout, numbers_in_row)).collect());
    }
    // Floating-point differences have an order of bytes of their own.
    if is_big_endian && layout.predictor != FLOATING_POINT {
        bytes.chunks_exact_mut(size).for_each(<[u8]>::reverse);
    }
    match layout.predictor {
        1 => {}
        HORIZONTAL => bytes.chunks_exact_mut(row_bytes).for_each(|row| add_differences(row, size, lanes)),
        FLOATING_POINT if size > 1 => {
            bytes.chunks_exact_mut(row_bytes).for_each(|row| add_float_differences(row, size, lanes));
        }
        predictor => return Err(RasterError::unsupported(format!("predictor {predictor}"))),
    }
    Ok(bytes)
}

/// Makes numbers of 8, 16 or 32 bits of numbers of fewer bits.
fn whole_numbers<'r>(row: &'r [u8], layout: &'r Layout, count: usize) -> impl Iterator<Item = u8> + 'r {
    let (bits, size) = (usize::from(layout.bits), layout.sample.bytes());
    (0..count).flat_map(move |index| {
        let bit =
            |position: usize| u32::from(row.get(position / 8).is_some_and(|byte| byte << (position % 8) & 0x80 != 0));
        let number = (index * bits..(index + 1) * bits).fold(0, |number, position| number << 1 | bit(position));
        number.to_le_bytes().into_iter().take(size)
    })
}

/// Each number is stored as the difference to that of the pixel before it.
fn add_differences(row: &mut [u8], size: usize, lanes: usize) {
    match size {
        1 => add_each(row, lanes, |[a], [b]| [a.wrapping_add(b)]),
        2 => add_each(row, lanes, |a, b| u16::from_le_bytes(a).wrapping_add(u16::from_le_bytes(b)).to_le_bytes()),
        4 => add_each(row, lanes, |a, b| u32::from_le_bytes(a).wrapping_add(u32::from_le_bytes(b)).to_le_bytes()),
        _ => add_each(row, lanes, |a, b| u64::from_le_bytes(a).wrapping_add(u64::from_le_bytes(b)).to_le_bytes()),
    }
}

fn add_each<const N: usize>(row: &mut [u8], lanes: usize, add: impl Fn([u8; N], [u8; N]) -> [u8; N]) {
    let numbers = row.as_chunks_mut::<N>().0;
    for index in lanes..numbers.len() {
        numbers[index] = add(numbers[index], numbers[index - lanes]);
    }
}

/// The bytes of a row are differences; the highest bytes of all its numbers come first.
fn add_float_differences(row: &mut [u8], size: usize, lanes: usize) {
    add_differences(row, 1, lanes);
    let (sorted, count) = (row.to_vec(), row.len() / size);
    for (index, number) in row.chunks_exact_mut(size).enumerate() {
        for (place, byte) in number.iter_mut().rev().enumerate() {
            *byte = sorted[place * count + index];
        }
    }
}
