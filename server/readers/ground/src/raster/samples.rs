//! Numbers of pixels in little-endian bytes.

use super::facts::SampleKind;

/// Larger numbers are no heights in any unit.
const HUGE: f64 = 3.4e38;

impl SampleKind {
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

    /// Whether a number is the mark of missing values, as GDAL compares them: texts of floating-point marks are rounded, and
    /// all numbers near the largest are one mark.
    pub(super) fn is_mark(self, number: f64, mark: f64) -> bool {
        let tolerance = match self {
            Self::F16 | Self::F32 => 2.0 * f64::from(f32::EPSILON),
            Self::F64 => 2.0 * f64::EPSILON,
            _ => 0.0,
        };
        let is_huge = number.abs() > HUGE && mark.abs() > HUGE && number.is_sign_negative() == mark.is_sign_negative();
        number == mark || tolerance > 0.0 && is_huge || (number - mark).abs() < tolerance * (number + mark).abs()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_of_missing_values_are_compared_as_they_are_written() {
        let float = SampleKind::F32;
        for (text, stored) in [
            ("-3.40282306e38", f32::MIN),
            ("-3.4028235e+38", f32::MIN),
            ("-3.40282346638529e+38", f32::MIN),
            ("-9999.9", -9999.9),
            ("1.70141e38", 1.701_41e38),
            ("-32767", -32767.0),
        ] {
            let mark = float.rounded(text.parse().unwrap());
            assert!(float.is_mark(f64::from(stored), mark), "{text}");
        }
        assert!(float.is_mark(f64::from((-9999.0_f32).next_up()), -9999.0), "one step beside it");
        assert!(!float.is_mark(-9998.5, -9999.0) && !float.is_mark(0.001, 0.0) && !float.is_mark(1.0, f64::NAN));
        assert!(!float.is_mark(f64::from(f32::MAX), f64::from(f32::MIN)));
        assert!(SampleKind::I16.is_mark(-32768.0, -32768.0) && !SampleKind::I16.is_mark(-32767.0, -32768.0));
    }
}
