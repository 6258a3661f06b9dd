//! Which columns have numbers with a comma before their decimals, and which have one between groups of digits.

use super::Columns;
use super::place::Place;
use ::csv::{ByteRecord, Reader};
use insula_source::decimal_mark::{ColumnMark, DecimalMark, NumberColumn, guessed_mark};
use std::io::Read;

/// Coordinates that are at most as large may be degrees.
const MAX_DEGREES: f64 = 180.0;

/// The whole lines at the beginning of a table.
pub(super) fn whole_lines(head: &[u8], is_whole: bool) -> &[u8] {
    let end = head.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
    if is_whole { head } else { &head[..end] }
}

impl Columns {
    /// Settles the marks before decimals by the first lines of the table. Returns what to tell of those that are guessed.
    pub(super) fn settle_marks<R: Read>(&mut self, lines: &mut Reader<R>, has_names: bool) -> Vec<String> {
        let mut columns = vec![NumberColumn::default(); self.names.len()];
        let mut record = ByteRecord::new();
        let mut is_name = has_names;
        while lines.read_byte_record(&mut record).unwrap_or(false) {
            if !std::mem::replace(&mut is_name, false) {
                for (column, field) in columns.iter_mut().zip(&record) {
                    // Others are no numbers.
                    column.add(std::str::from_utf8(field).unwrap_or("?"));
                }
            }
        }
        let certain = columns.iter().find_map(NumberColumn::certain);
        // A comma between values is no mark before decimals where people write tables so.
        let by_delimiter = if self.delimiter == b',' { DecimalMark::Point } else { DecimalMark::Comma };
        let likely = certain.unwrap_or(by_delimiter);
        let mut guesses = Vec::new();
        let mut settle = |name: &str, found: Option<ColumnMark>| {
            let ColumnMark { mark, guessed_by } = found?;
            guesses.extend(guessed_by.map(|number| guessed_mark(name, &number, mark)));
            Some(mark)
        };
        self.marks = columns
            .iter()
            .zip(&self.names)
            .enumerate()
            .map(
                |(index, (column, name))| {
                    if self.place.is_of(index) { None } else { settle(name, column.mark(likely)) }
                },
            )
            .collect();
        if let Place::Map { x, y } = self.place
            && let [Some(first), Some(second)] = [columns.get(x), columns.get(y)]
        {
            let mut both = first.clone();
            both.join(second);
            let is_in_degrees = [first, second].into_iter().filter_map(NumberColumn::either).all(may_be_degrees);
            let likely = if is_in_degrees { DecimalMark::Comma } else { DecimalMark::Point };
            let name = format!("{}, {}", self.names[x], self.names[y]);
            let found = both.mark(likely);
            // Whole numbers among them tell nothing of coordinates.
            let guess = |found: ColumnMark| {
                if found.guessed_by.is_some() { ColumnMark { mark: likely, ..found } } else { found }
            };
            self.marks[x] = settle(&name, found.map(guess));
        }
        guesses
    }
}

fn may_be_degrees(number: &str) -> bool {
    DecimalMark::Comma.number(number).is_some_and(|number| number.abs() <= MAX_DEGREES)
}
