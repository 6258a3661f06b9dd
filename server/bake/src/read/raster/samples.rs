//! Numbers of pixels in little-endian bytes.

use super::facts::SampleKind;

impl SampleKind {
    /// Bytes of a number.
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 | Self::F16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }

    /// The number with an index among little-endian ones; NaN after the end.
    pub(super) fn number(self, bytes: &[u8], index: usize) -> f64 {
        match self {
            Self::U8 => take(bytes, index).map(|[byte]| f64::from(byte)),
            Self::I8 => take(bytes, index).map(|bytes| f64::from(i8::from_le_bytes(bytes))),
            Self::U16 => take(bytes, index).map(|bytes| f64::from(u16::from_le_bytes(bytes))),
            Self::I16 => take(bytes, index).map(|bytes| f64::from(i16::from_le_bytes(bytes))),
            Self::U32 => take(bytes, index).map(|bytes| f64::from(u32::from_le_bytes(bytes))),
            Self::I32 => take(bytes, index).map(|bytes| f64::from(i32::from_le_bytes(bytes))),
            Self::U64 => take(bytes, index).map(|bytes| u64::from_le_bytes(bytes) as f64),
            Self::I64 => take(bytes, index).map(|bytes| i64::from_le_bytes(bytes) as f64),
            Self::F16 => take(bytes, index).map(|bytes| half(u16::from_le_bytes(bytes))),
            Self::F32 => take(bytes, index).map(|bytes| f64::from(f32::from_le_bytes(bytes))),
            Self::F64 => take(bytes, index).map(f64::from_le_bytes),
        }
        .unwrap_or(f64::NAN)
    }

    /// A number as this type can hold it, for comparisons with numbers of this type.
    pub(super) fn rounded(self, number: f64) -> f64 {
        if self == Self::F32 { f64::from(number as f32) } else { number }
    }
}

fn take<const N: usize>(bytes: &[u8], index: usize) -> Option<[u8; N]> {
    bytes.get(index * N..)?.first_chunk().copied()
}

/// A number of 16 bits with 5 bits of exponent.
fn half(bits: u16) -> f64 {
    let sign = if bits & 0x8000 == 0 { 1.0 } else { -1.0 };
    let (exponent, fraction) = (i32::from(bits >> 10 & 0x1f), f64::from(bits & 0x3ff));
    sign * match exponent {
        0 => fraction * 2f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1.0 + fraction / 1024.0) * 2f64.powi(exponent - 15),
    }
}
