//! The table of attributes, in dBASE format: columns of fixed width.

use super::encoding::{Charset, decode, encoding_of, is_odd};
use insula_source::attributes::{AttributeValue, Attributes};
use std::io::{BufRead, Read};

const HEADER_BYTES: usize = 32;
const COLUMN_BYTES: usize = 32;
const END_OF_COLUMNS: u8 = 0x0d;
const DELETED: u8 = b'*';
const END_OF_FILE: u8 = 0x1a;
/// Julian day number of 1970-01-01.
const JULIAN_DAY_OF_1970: i64 = 2_440_588;

struct Column {
    name: String,
    kind: u8,
    bytes: usize,
    decimals: u8,
}

/// What became of a row.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Row {
    Read,
    Deleted,
    /// The table has no further row.
    Missing,
}

/// Reads the rows one after the other.
pub(super) struct AttributeReader<'a> {
    reader: Box<dyn BufRead + 'a>,
    columns: Vec<Column>,
    /// `None` if the table does not tell.
    encoding: Option<Charset>,
    /// The first text that looks as if it were in another encoding, until it is reported.
    odd_text: Option<String>,
    has_odd_text: bool,
    row: Vec<u8>,
}

impl<'a> AttributeReader<'a> {
    /// Reads the header. `code_page` is the text of the `.cpg` file. Fails with the reason.
    pub(super) fn open(mut reader: Box<dyn BufRead + 'a>, code_page: Option<&str>) -> Result<Self, String> {
        let mut header = [0; HEADER_BYTES];
        reader.read_exact(&mut header).map_err(|cause| cause.to_string())?;
        let header_bytes = usize::from(u16::from_le_bytes([header[8], header[9]]));
        let row_bytes = usize::from(u16::from_le_bytes([header[10], header[11]]));
        let encoding = encoding_of(code_page, header[29]);
        let mut rest = Vec::new();
        let wanted = header_bytes.saturating_sub(HEADER_BYTES);
        reader.by_ref().take(wanted as u64).read_to_end(&mut rest).map_err(|cause| cause.to_string())?;
        if rest.len() < wanted {
            return Err("the file ends within its header".to_owned());
        }
        let mut columns = Vec::new();
        // The first byte of a row tells whether it is deleted.
        let mut used = 1;
        for column in rest.as_chunks::<COLUMN_BYTES>().0 {
            if column[0] == END_OF_COLUMNS || column[0] == 0 {
                break;
            }
            let kind = column[11].to_ascii_uppercase();
            // Texts may be longer than a byte can count.
            let high = if kind == b'C' { usize::from(column[17]) << 8 } else { 0 };
            let bytes = usize::from(column[16]) | high;
            let end = column[..11].iter().position(|byte| *byte == 0).unwrap_or(11);
            used += bytes;
            columns.push(Column { name: decode(&column[..end], encoding), kind, bytes, decimals: column[17] });
        }
        if used > row_bytes {
            return Err(format!("columns of {used} bytes in rows of {row_bytes}"));
        }
        Ok(Self { reader, columns, encoding, odd_text: None, has_odd_text: false, row: vec![0; row_bytes] })
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.columns.iter().map(|column| column.name.as_str())
    }

    /// The first text that looks as if it were in another encoding than it is read in, once.
    pub(super) fn take_odd_text(&mut self) -> Option<String> {
        self.odd_text.take()
    }

    pub(super) fn next(&mut self, attributes: &mut Attributes) -> Row {
        if self.reader.read_exact(&mut self.row).is_err() {
            return Row::Missing;
        }
        let Some((flag, mut rest)) = self.row.split_first() else { return Row::Missing };
        if *flag == END_OF_FILE {
            return Row::Missing;
        }
        for column in &self.columns {
            let Some((field, after)) = rest.split_at_checked(column.bytes) else { break };
            rest = after;
            if !self.has_odd_text && matches!(column.kind, b'C' | b'V') && is_odd(field, self.encoding) {
                self.has_odd_text = true;
                self.odd_text = Some(decode(field, self.encoding).trim_end_matches(['\0', ' ']).to_owned());
            }
            if let Some(value) = value(column, field, self.encoding) {
                attributes.push(&column.name, value);
            }
        }
        if *flag == DELETED { Row::Deleted } else { Row::Read }
    }
}

/// The value of a field; `None` if it is empty or of a type without a meaning here.
fn value(column: &Column, field: &[u8], encoding: Option<Charset>) -> Option<AttributeValue> {
    match column.kind {
        b'C' | b'V' => {
            let text = decode(field, encoding);
            let text = text.trim_end_matches(['\0', ' ']).trim_start();
            (!text.is_empty()).then(|| AttributeValue::Text(text.to_owned()))
        }
        b'N' | b'F' => number(field, column.decimals),
        b'D' => date(field),
        b'L' => match field.first()? {
            b'T' | b't' | b'Y' | b'y' | b'1' => Some(AttributeValue::Bool(true)),
            b'F' | b'f' | b'N' | b'n' | b'0' => Some(AttributeValue::Bool(false)),
            _ => None,
        },
        b'I' => Some(AttributeValue::Integer(i32::from_le_bytes(*field.first_chunk()?).into())),
        b'Y' => Some(AttributeValue::Float(i64::from_le_bytes(*field.first_chunk()?) as f64 / 10_000.0)),
        b'B' | b'O' if field.len() == 8 => Some(AttributeValue::Float(f64::from_le_bytes(*field.first_chunk()?))),
        b'T' | b'@' if field.len() == 8 => {
            let day = i64::from(u32::from_le_bytes(*field.first_chunk()?));
            if day == 0 { None } else { AttributeValue::date_of_days(day - JULIAN_DAY_OF_1970) }
        }
        _ => None,
    }
}

/// A decimal number; `None` if the field is empty, or filled with `*` because the number did not fit.
fn number(field: &[u8], decimals: u8) -> Option<AttributeValue> {
    let text = std::str::from_utf8(field).ok()?.trim_matches(['\0', ' ']);
    if decimals == 0
        && let Ok(number) = text.parse()
    {
        return Some(AttributeValue::Integer(number));
    }
    // Some programs write decimal commas.
    let number: f64 = text.parse().or_else(|_| text.replacen(',', ".", 1).parse()).ok()?;
    number.is_finite().then_some(AttributeValue::Float(number))
}

/// A date `YYYYMMDD`.
fn date(field: &[u8]) -> Option<AttributeValue> {
    let text = std::str::from_utf8(field).ok()?;
    let part = |range: std::ops::Range<usize>| text.get(range);
    AttributeValue::date(&format!("{}-{}-{}", part(0..4)?, part(4..6)?, part(6..8)?)).filter(|_| text != "00000000")
}
