//! Little-endian numbers in bytes of unknown length.

use insula_source::attributes::AttributeValue;

/// The numbers of `N` bytes each that start at `offset`.
pub(crate) fn array_at<const N: usize>(bytes: &[u8], offset: usize) -> Option<[u8; N]> {
    bytes.get(offset..offset.checked_add(N)?)?.try_into().ok()
}

pub(crate) fn u16_at(bytes: &[u8], offset: usize) -> Option<u16> {
    array_at(bytes, offset).map(u16::from_le_bytes)
}

pub(crate) fn u32_at(bytes: &[u8], offset: usize) -> Option<u32> {
    array_at(bytes, offset).map(u32::from_le_bytes)
}

pub(crate) fn u64_at(bytes: &[u8], offset: usize) -> Option<u64> {
    array_at(bytes, offset).map(u64::from_le_bytes)
}

pub(crate) fn f32_at(bytes: &[u8], offset: usize) -> Option<f32> {
    array_at(bytes, offset).map(f32::from_le_bytes)
}

pub(crate) fn f64_at(bytes: &[u8], offset: usize) -> Option<f64> {
    array_at(bytes, offset).map(f64::from_le_bytes)
}

/// The part of `bytes` with `length` bytes from `offset`; `None` if it is not all there.
pub(crate) fn part(bytes: &[u8], offset: u64, length: u64) -> Option<&[u8]> {
    let start = usize::try_from(offset).ok()?;
    let end = usize::try_from(offset.checked_add(length)?).ok()?;
    bytes.get(start..end)
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NumberType {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl NumberType {
    const ALL: [Self; 10] =
        [Self::I8, Self::U8, Self::I16, Self::U16, Self::I32, Self::U32, Self::I64, Self::U64, Self::F32, Self::F64];

    /// The type that a format calls by a name. `names` has those of all types, from `I8` to `F64`, between blanks; `-` stands for none.
    pub(crate) fn by_name(names: &str, name: &str) -> Option<Self> {
        let place = names.split(' ').position(|known| known == name && known != "-")?;
        Self::ALL.get(place).copied()
    }

    pub(crate) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// What a normalised value of 1 is stored as.
    pub(crate) fn largest(self) -> f64 {
        match self {
            Self::I8 => i8::MAX.into(),
            Self::U8 => u8::MAX.into(),
            Self::I16 => i16::MAX.into(),
            Self::U16 => u16::MAX.into(),
            Self::I32 => i32::MAX.into(),
            Self::U32 => u32::MAX.into(),
            Self::I64 => i64::MAX as f64,
            Self::U64 => u64::MAX as f64,
            Self::F32 | Self::F64 => 1.0,
        }
    }

    /// The number at a byte; `None` if it is not all there.
    #[inline]
    pub(crate) fn read(self, bytes: &[u8], at: usize) -> Option<Number> {
        Some(match self {
            Self::I8 => Number::Signed(i8::from_le_bytes(array_at(bytes, at)?).into()),
            Self::U8 => Number::Unsigned(u8::from_le_bytes(array_at(bytes, at)?).into()),
            Self::I16 => Number::Signed(i16::from_le_bytes(array_at(bytes, at)?).into()),
            Self::U16 => Number::Unsigned(u16::from_le_bytes(array_at(bytes, at)?).into()),
            Self::I32 => Number::Signed(i32::from_le_bytes(array_at(bytes, at)?).into()),
            Self::U32 => Number::Unsigned(u32::from_le_bytes(array_at(bytes, at)?).into()),
            Self::I64 => Number::Signed(i64::from_le_bytes(array_at(bytes, at)?)),
            Self::U64 => Number::Unsigned(u64::from_le_bytes(array_at(bytes, at)?)),
            Self::F32 => Number::Single(f32::from_le_bytes(array_at(bytes, at)?)),
            Self::F64 => Number::Double(f64::from_le_bytes(array_at(bytes, at)?)),
        })
    }
}

/// A number of one of these types.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Number {
    Signed(i64),
    Unsigned(u64),
    Single(f32),
    Double(f64),
}

impl Number {
    #[inline]
    pub(crate) fn to_f64(self) -> f64 {
        match self {
            Self::Signed(value) => value as f64,
            Self::Unsigned(value) => value as f64,
            Self::Single(value) => value.into(),
            Self::Double(value) => value,
        }
    }

    /// An index or an identifier; `None` if it is negative, too large, or of a type with fractions.
    pub(crate) fn to_u32(self) -> Option<u32> {
        match self {
            Self::Signed(value) => value.try_into().ok(),
            Self::Unsigned(value) => value.try_into().ok(),
            Self::Single(_) | Self::Double(_) => None,
        }
    }

    pub(crate) fn to_attribute(self) -> AttributeValue {
        match self {
            Self::Signed(value) => AttributeValue::Integer(value),
            Self::Unsigned(value) => AttributeValue::unsigned(value),
            Self::Single(value) => AttributeValue::single(value),
            Self::Double(value) => AttributeValue::Float(value),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_by_the_names_of_their_types() {
        let of_code = |code: &str| NumberType::by_name("5120 5121 5122 5123 5124 5125 - - 5126 5130", code);
        assert_eq!(
            ["5120", "5125", "5126", "5130", "5127", "-"].map(of_code),
            [Some(NumberType::I8), Some(NumberType::U32), Some(NumberType::F32), Some(NumberType::F64), None, None]
        );
        let bytes = [0xfe, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff];
        let read = |number: NumberType| number.read(&bytes, 0).map(Number::to_f64);
        assert_eq!([NumberType::I16, NumberType::U16].map(read), [Some(-2.0), Some(65_534.0)]);
        assert_eq!(NumberType::I64.read(&bytes, 0).and_then(Number::to_u32), None);
        let text = NumberType::U64.read(&bytes, 0).map(|number| number.to_attribute().to_string());
        assert_eq!(text.as_deref(), Some("18446744073709551614"));
        assert!(NumberType::ALL.into_iter().all(|number| number.read(&bytes, 9 - number.bytes()).is_none()));
    }
}
