//! The rows of a PLY, as text or binary.

use super::ply_header::{PlyElement, PlyEncoding, PlyHeader, PlyNumber};

/// Why a row cannot be read.
pub type ValueFault = &'static str;

const SHORT: ValueFault = "the file ends before its declared content";

/// A row of an element.
#[derive(Debug, Default)]
pub struct PlyRow {
    /// For each property its value; for a list the range in `items`.
    values: Vec<PlyValue>,
    items: Vec<f64>,
}

#[derive(Debug, Clone, Copy)]
enum PlyValue {
    Single(f64),
    List { start: usize, end: usize },
}

impl PlyRow {
    /// A single value; 0 for a list.
    pub fn single(&self, property: usize) -> f64 {
        match self.values.get(property) {
            Some(PlyValue::Single(value)) => *value,
            _ => 0.0,
        }
    }

    /// A list; empty for a single value.
    pub fn list(&self, property: usize) -> &[f64] {
        match self.values.get(property) {
            Some(PlyValue::List { start, end }) => self.items.get(*start..*end).unwrap_or(&[]),
            _ => &[],
        }
    }
}

/// The values after the header.
pub struct PlyValues<'a> {
    rest: &'a [u8],
    total: usize,
    encoding: PlyEncoding,
    /// Whether each row of a text is a line: then further values on it are no part of the next row.
    is_by_line: bool,
}

impl<'a> PlyValues<'a> {
    /// Values of `bytes` from the end of the header on.
    pub fn new(bytes: &'a [u8], header: &PlyHeader) -> Self {
        let rest = bytes.get(header.data_start..).unwrap_or(&[]);
        let rows = header.elements.iter().fold(0, |sum: u64, element| sum.saturating_add(element.count));
        let is_text = header.encoding == PlyEncoding::Text;
        let lines = if is_text {
            rest.split(|byte| *byte == b'\n').filter(|line| !line.trim_ascii().is_empty()).count()
        } else {
            0
        };
        Self { rest, total: bytes.len(), encoding: header.encoding, is_by_line: is_text && lines as u64 >= rows }
    }

    /// Bytes of the file before the next value.
    pub fn position(&self) -> usize {
        self.total - self.rest.len()
    }

    /// Reads a row.
    pub fn row(&mut self, element: &PlyElement, row: &mut PlyRow) -> Result<(), ValueFault> {
        row.values.clear();
        row.items.clear();
        for property in &element.properties {
            let Some(length) = property.length else {
                row.values.push(PlyValue::Single(self.next(property.number)?));
                continue;
            };
            let count = self.next(length)?;
            if !(0.0..=f64::from(u32::MAX)).contains(&count) {
                return Err("the length of a list is negative or too large");
            }
            let start = row.items.len();
            // The rest of the file limits the list.
            for _ in 0..count as u64 {
                row.items.push(self.next(property.number)?);
            }
            row.values.push(PlyValue::List { start, end: row.items.len() });
        }
        if self.is_by_line {
            let end = self.rest.iter().position(|byte| *byte == b'\n').unwrap_or(self.rest.len());
            self.rest = self.rest.get(end..).unwrap_or(&[]);
        }
        Ok(())
    }

    fn next(&mut self, number: PlyNumber) -> Result<f64, ValueFault> {
        match self.encoding {
            PlyEncoding::Text => self.next_text(),
            PlyEncoding::Little => self.next_binary(number, false),
            PlyEncoding::Big => self.next_binary(number, true),
        }
    }

    fn next_text(&mut self) -> Result<f64, ValueFault> {
        let start = self.rest.iter().position(|byte| !byte.is_ascii_whitespace()).ok_or(SHORT)?;
        let word = self.rest.get(start..).unwrap_or(&[]);
        let end = word.iter().position(u8::is_ascii_whitespace).unwrap_or(word.len());
        let (word, rest) = word.split_at(end);
        self.rest = rest;
        std::str::from_utf8(word).ok().and_then(|word| word.parse().ok()).ok_or("a value is not a number")
    }

    fn next_binary(&mut self, number: PlyNumber, is_big: bool) -> Result<f64, ValueFault> {
        macro_rules! value {
            ($type:ty) => {{
                let (bytes, rest) = self.rest.split_first_chunk().ok_or(SHORT)?;
                self.rest = rest;
                if is_big { <$type>::from_be_bytes(*bytes) } else { <$type>::from_le_bytes(*bytes) }
            }};
        }
        Ok(match number {
            PlyNumber::I8 => value!(i8).into(),
            PlyNumber::U8 => value!(u8).into(),
            PlyNumber::I16 => value!(i16).into(),
            PlyNumber::U16 => value!(u16).into(),
            PlyNumber::I32 => value!(i32).into(),
            PlyNumber::U32 => value!(u32).into(),
            PlyNumber::F32 => value!(f32).into(),
            PlyNumber::F64 => value!(f64),
        })
    }
}
