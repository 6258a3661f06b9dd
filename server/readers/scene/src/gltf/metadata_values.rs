//! Packed values of a property of EXT_structural_metadata.

use serde_json::Value;

use insula_source::attributes::MAX_ATTRIBUTES;

/// Type of a number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Number {
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

impl Number {
    pub(super) fn by_name(name: &str) -> Option<Self> {
        Some(match name {
            "INT8" => Self::I8,
            "UINT8" => Self::U8,
            "INT16" => Self::I16,
            "UINT16" => Self::U16,
            "INT32" => Self::I32,
            "UINT32" => Self::U32,
            "INT64" => Self::I64,
            "UINT64" => Self::U64,
            "FLOAT32" => Self::F32,
            "FLOAT64" => Self::F64,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// What a normalised value of 1 is stored as.
    pub(super) fn largest(self) -> f64 {
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

    /// A number of a list; null beyond its end or if it is not finite.
    fn value(self, bytes: &[u8], index: usize) -> Value {
        let at = |size: usize| index.checked_mul(size).and_then(|start| bytes.get(start..));
        macro_rules! number {
            ($type:ty) => {
                at(size_of::<$type>()).and_then(<[u8]>::first_chunk).map(|bytes| <$type>::from_le_bytes(*bytes))
            };
        }
        let value = match self {
            Self::I8 => number!(i8).map(Value::from),
            Self::U8 => number!(u8).map(Value::from),
            Self::I16 => number!(i16).map(Value::from),
            Self::U16 => number!(u16).map(Value::from),
            Self::I32 => number!(i32).map(Value::from),
            Self::U32 => number!(u32).map(Value::from),
            Self::I64 => number!(i64).map(Value::from),
            Self::U64 => number!(u64).map(Value::from),
            // The shortest text that gives the same 32 bits, not its long expansion.
            Self::F32 => number!(f32).map(|value| Value::from(value.to_string().parse().unwrap_or(f64::from(value)))),
            Self::F64 => number!(f64).map(Value::from),
        };
        value.unwrap_or(Value::Null)
    }

    fn offset(self, bytes: &[u8], index: usize) -> Option<usize> {
        self.value(bytes, index).as_u64().and_then(|offset| usize::try_from(offset).ok())
    }
}

/// The values of all features.
#[derive(Debug)]
pub(super) struct Values {
    pub(super) bytes: Vec<u8>,
    pub(super) component: Number,
    /// Components of a vector or matrix; 1 for others.
    pub(super) width: usize,
    pub(super) is_text: bool,
    pub(super) is_bool: bool,
    pub(super) is_array: bool,
    /// Length of arrays of equal length.
    pub(super) fixed_count: Option<u32>,
    pub(super) array_offsets: Option<(Vec<u8>, Number)>,
    pub(super) text_offsets: Option<(Vec<u8>, Number)>,
}

impl Values {
    /// Fails if there are fewer values than features.
    pub(super) fn check(&self, features: usize) -> Result<(), &'static str> {
        let entries = features.checked_add(1).ok_or("too many features")?;
        let holds =
            |offsets: &(Vec<u8>, Number)| entries.checked_mul(offsets.1.bytes()).is_some_and(|n| n <= offsets.0.len());
        if self.is_array && self.fixed_count.is_none() {
            let offsets = self.array_offsets.as_ref().ok_or("it has no array offsets")?;
            return if holds(offsets) { Ok(()) } else { Err("it has too few array offsets") };
        }
        if self.is_text {
            let offsets = self.text_offsets.as_ref().ok_or("it has no string offsets")?;
            return if self.is_array || holds(offsets) { Ok(()) } else { Err("it has too few string offsets") };
        }
        let items =
            features.checked_mul(self.fixed_count.unwrap_or(1) as usize).and_then(|n| n.checked_mul(self.width));
        let needed = items.and_then(|items| {
            if self.is_bool { Some(items.div_ceil(8)) } else { items.checked_mul(self.component.bytes()) }
        });
        if needed.is_some_and(|needed| needed <= self.bytes.len()) { Ok(()) } else { Err("it has too few values") }
    }

    /// The value of a feature, as JSON.
    pub(super) fn value(&self, feature: usize) -> Value {
        if !self.is_array {
            return self.element(feature);
        }
        let (start, end) = match (self.fixed_count, &self.array_offsets) {
            (Some(count), _) => {
                let start = feature.saturating_mul(count as usize);
                (start, start.saturating_add(count as usize))
            }
            (None, Some((bytes, number))) => {
                let offset = |index: usize| number.offset(bytes, index).unwrap_or(0);
                (offset(feature), offset(feature.saturating_add(1)))
            }
            (None, None) => (0, 0),
        };
        // More would not become attributes.
        let end = end.min(start.saturating_add(MAX_ATTRIBUTES));
        Value::Array((start..end).map(|index| self.element(index)).collect())
    }

    fn element(&self, index: usize) -> Value {
        if self.is_bool {
            return self.bytes.get(index / 8).map_or(Value::Null, |byte| Value::Bool(byte >> (index % 8) & 1 == 1));
        }
        if self.is_text {
            return self.text(index).map_or(Value::Null, Value::String);
        }
        if self.width == 1 {
            return self.component.value(&self.bytes, index);
        }
        let start = index.saturating_mul(self.width);
        Value::Array((start..start.saturating_add(self.width)).map(|k| self.component.value(&self.bytes, k)).collect())
    }

    fn text(&self, index: usize) -> Option<String> {
        let (bytes, number) = self.text_offsets.as_ref()?;
        let (start, end) = (number.offset(bytes, index)?, number.offset(bytes, index.checked_add(1)?)?);
        Some(String::from_utf8_lossy(self.bytes.get(start..end)?).into_owned())
    }
}
