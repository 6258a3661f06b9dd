//! The table of attributes, in dBASE format: columns of fixed width.

use super::encoding::{TextSample, decode, encoding_of};
use super::memo::MemoFile;
use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::code_page::CodePage;
use insula_source::decimal_mark::{ColumnMark, DecimalMark, NumberColumn, guessed_mark};
use std::io::{BufRead, Cursor, Read};

const HEADER_BYTES: usize = 32;
const COLUMN_BYTES: usize = 32;
const END_OF_COLUMNS: u8 = 0x0d;
const DELETED: u8 = b'*';
const END_OF_FILE: u8 = 0x1a;
/// Kind of a column whose texts are in another file.
const MEMO: u8 = b'M';
/// Rows of about this many bytes tell the encoding.
const SAMPLE_BYTES: usize = 1 << 16;
/// Julian day number of 1970-01-01.
const JULIAN_DAY_OF_1970: i64 = 2_440_588;

struct Column {
    name: String,
    kind: u8,
    bytes: usize,
    decimals: u8,
    /// What is before the decimals of numbers in a column of texts, if that has to be known.
    mark: Option<DecimalMark>,
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
    /// That the table tells.
    told: Option<CodePage>,
    /// `None` until a text is beyond ASCII.
    encoding: Option<CodePage>,
    /// What to warn of about the encoding, until it is reported.
    warning: Option<String>,
    /// What to warn of about numbers in columns of texts, until it is reported.
    guesses: Vec<String>,
    /// First byte of the table.
    pub(super) version: u8,
    /// Where the texts of memo columns are.
    pub(super) memos: Option<MemoFile>,
    /// Names of columns whose memo in the last row cannot be read.
    lost: Vec<String>,
    row: Vec<u8>,
}

impl<'a> AttributeReader<'a> {
    /// Reads the header. `code_page` is the text of the `.cpg` file. Fails with the reason.
    pub(super) fn open(mut reader: Box<dyn BufRead + 'a>, code_page: Option<&str>) -> Result<Self, String> {
        let mut header = [0; HEADER_BYTES];
        reader.read_exact(&mut header).map_err(|cause| cause.to_string())?;
        let header_bytes = usize::from(u16::from_le_bytes([header[8], header[9]]));
        let row_bytes = usize::from(u16::from_le_bytes([header[10], header[11]]));
        let mut rest = Vec::new();
        let wanted = header_bytes.saturating_sub(HEADER_BYTES);
        reader.by_ref().take(wanted as u64).read_to_end(&mut rest).map_err(|cause| cause.to_string())?;
        if rest.len() < wanted {
            return Err("the file ends within its header".to_owned());
        }
        let told = encoding_of(code_page, header[29]);
        let names: Vec<&[u8]> = rest.as_chunks::<COLUMN_BYTES>().0.iter().map_while(name_of).collect();
        let mut columns = Vec::new();
        // The first byte of a row tells whether it is deleted.
        let mut used = 1;
        for column in &rest.as_chunks::<COLUMN_BYTES>().0[..names.len()] {
            let kind = column[11].to_ascii_uppercase();
            // Texts may be longer than a byte can count.
            let high = if kind == b'C' { usize::from(column[17]) << 8 } else { 0 };
            let bytes = usize::from(column[16]) | high;
            used += bytes;
            columns.push(Column { name: String::new(), kind, bytes, decimals: column[17], mark: None });
        }
        if used > row_bytes {
            return Err(format!("columns of {used} bytes in rows of {row_bytes}"));
        }
        let mut head = Vec::new();
        let head_bytes = (SAMPLE_BYTES / row_bytes).max(1) * row_bytes;
        reader.by_ref().take(head_bytes as u64).read_to_end(&mut head).map_err(|cause| cause.to_string())?;
        let mut sample = TextSample::default();
        names.iter().for_each(|name| sample.add(name));
        head.chunks_exact(row_bytes).for_each(|row| add_texts(&columns, row, &mut sample));
        let numbers = numbers_of(&columns, head.chunks_exact(row_bytes));
        let reader = Box::new(Cursor::new(head).chain(reader));
        let mut table = Self {
            reader,
            columns,
            told,
            encoding: None,
            warning: None,
            guesses: Vec::new(),
            version: header[0],
            memos: None,
            lost: Vec::new(),
            row: vec![0; row_bytes],
        };
        table.settle(&sample);
        for (column, name) in table.columns.iter_mut().zip(names) {
            column.name = decode(name, table.encoding.unwrap_or(CodePage::UTF8));
        }
        table.settle_marks(&numbers);
        Ok(table)
    }

    /// Settles the marks before decimals in columns of texts.
    fn settle_marks(&mut self, numbers: &[NumberColumn]) {
        let likely = numbers.iter().find_map(NumberColumn::certain).unwrap_or(DecimalMark::Comma);
        for (column, numbers) in self.columns.iter_mut().zip(numbers) {
            let Some(ColumnMark { mark, guessed_by }) = numbers.mark(likely) else { continue };
            column.mark = Some(mark);
            self.guesses.extend(guessed_by.map(|number| guessed_mark(&column.name, &number, mark)));
        }
    }

    /// Takes the encoding of a sample, if it is beyond ASCII.
    fn settle(&mut self, sample: &TextSample) {
        if !sample.is_empty() {
            let (encoding, warning) = sample.encoding(self.told);
            (self.encoding, self.warning) = (Some(encoding), warning);
        }
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.columns.iter().map(|column| column.name.as_str())
    }

    /// What to warn of about the encoding, once.
    pub(super) fn take_warning(&mut self) -> Option<String> {
        self.warning.take()
    }

    /// What to warn of about numbers, once.
    pub(super) fn take_guesses(&mut self) -> Vec<String> {
        std::mem::take(&mut self.guesses)
    }

    /// Names of the columns whose texts are in another file.
    pub(super) fn memo_names(&self) -> Vec<&str> {
        self.columns.iter().filter(|column| column.kind == MEMO).map(|column| column.name.as_str()).collect()
    }

    /// Names of the columns whose memo in the last row cannot be read.
    pub(super) fn take_lost(&mut self) -> Vec<String> {
        std::mem::take(&mut self.lost)
    }

    /// The texts of the memos of the row, one for each column of them.
    fn memo_texts(&mut self) -> Vec<Vec<u8>> {
        let Some(memos) = &self.memos else { return Vec::new() };
        let mut rest = self.row.get(1..).unwrap_or_default();
        let mut texts = Vec::new();
        for column in &self.columns {
            let Some((field, after)) = rest.split_at_checked(column.bytes) else { break };
            rest = after;
            if column.kind == MEMO {
                let text = memos.text(field);
                if text.is_none() {
                    self.lost.push(column.name.clone());
                }
                texts.push(text.unwrap_or_default());
            }
        }
        texts
    }

    pub(super) fn next(&mut self, attributes: &mut Attributes) -> Row {
        if self.reader.read_exact(&mut self.row).is_err() {
            return Row::Missing;
        }
        let memos = self.memo_texts();
        if self.encoding.is_none() && !(self.row.is_ascii() && memos.iter().all(|text| text.is_ascii())) {
            let mut sample = TextSample::default();
            add_texts(&self.columns, &self.row, &mut sample);
            memos.iter().for_each(|text| sample.add(text));
            self.settle(&sample);
        }
        let Some((flag, mut rest)) = self.row.split_first() else { return Row::Missing };
        if *flag == END_OF_FILE {
            return Row::Missing;
        }
        let encoding = self.encoding.unwrap_or(CodePage::UTF8);
        let mut memos = memos.iter();
        for column in &self.columns {
            let Some((field, after)) = rest.split_at_checked(column.bytes) else { break };
            rest = after;
            let value = match column.kind {
                MEMO => memos.next().and_then(|text| text_value(text, None, encoding)),
                _ => value(column, field, encoding),
            };
            if let Some(value) = value {
                attributes.push(&column.name, value);
            }
        }
        if *flag == DELETED { Row::Deleted } else { Row::Read }
    }
}

/// The bytes of a column's name; `None` after the last one.
fn name_of(column: &[u8; COLUMN_BYTES]) -> Option<&[u8]> {
    let name = column.get(..11).filter(|name| !matches!(name, [END_OF_COLUMNS | 0, ..]))?;
    name.split(|byte| *byte == 0).next()
}

/// Adds the texts of a row to those that tell the encoding.
fn add_texts(columns: &[Column], row: &[u8], sample: &mut TextSample) {
    let mut rest = row.get(1..).unwrap_or_default();
    for column in columns {
        let Some((field, after)) = rest.split_at_checked(column.bytes) else { return };
        rest = after;
        if matches!(column.kind, b'C' | b'V') {
            sample.add(field);
        }
    }
}

/// The numbers in columns of texts.
fn numbers_of<'r>(columns: &[Column], rows: impl Iterator<Item = &'r [u8]>) -> Vec<NumberColumn> {
    let mut numbers = vec![NumberColumn::default(); columns.len()];
    for row in rows {
        let mut rest = row.get(1..).unwrap_or_default();
        for (column, numbers) in columns.iter().zip(&mut numbers) {
            let Some((field, after)) = rest.split_at_checked(column.bytes) else { break };
            rest = after;
            if column.kind == b'C' {
                // Others are no numbers.
                numbers.add(std::str::from_utf8(field).unwrap_or("?").trim_matches(['\0', ' ']));
            }
        }
    }
    numbers
}

/// The value of a field; `None` if it is empty or of a type without a meaning here.
fn value(column: &Column, field: &[u8], encoding: CodePage) -> Option<AttributeValue> {
    match column.kind {
        b'C' | b'V' => text_value(field, column.mark, encoding),
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

/// A text, or a number of a column whose numbers have such a mark before their decimals; `None` if it is empty.
fn text_value(field: &[u8], mark: Option<DecimalMark>, encoding: CodePage) -> Option<AttributeValue> {
    let text = decode(field, encoding);
    let text = text.trim_end_matches(['\0', ' ']).trim_start();
    let number = mark.and_then(|mark| mark.value(text));
    number.or_else(|| (!text.is_empty()).then(|| AttributeValue::Text(text.to_owned())))
}

/// A decimal number; `None` if the field is empty, or filled with `*` because the number did not fit.
fn number(field: &[u8], decimals: u8) -> Option<AttributeValue> {
    let text = std::str::from_utf8(field).ok()?.trim_matches(['\0', ' ']);
    if decimals == 0
        && let Ok(number) = text.parse()
    {
        return Some(AttributeValue::Integer(number));
    }
    // Some programs write decimal commas. A column without decimals has commas between groups only.
    let marks =
        if decimals == 0 { [DecimalMark::Point, DecimalMark::Comma] } else { [DecimalMark::Comma, DecimalMark::Point] };
    let number: f64 = text.parse().ok().or_else(|| marks.into_iter().find_map(|mark| mark.number(text)))?;
    number.is_finite().then_some(AttributeValue::Float(number))
}

/// A date `YYYYMMDD`.
fn date(field: &[u8]) -> Option<AttributeValue> {
    let text = std::str::from_utf8(field).ok()?;
    let part = |range: std::ops::Range<usize>| text.get(range);
    AttributeValue::date(&format!("{}-{}-{}", part(0..4)?, part(4..6)?, part(6..8)?)).filter(|_| text != "00000000")
}
