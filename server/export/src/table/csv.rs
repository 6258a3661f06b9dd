//! Comma-separated values (RFC 4180, UTF-8, a header row). The last column is the footprint as well-known text in world metres.
//!
//! Attribution is in a text file beside it, because a comment line breaks readers. Spreadsheets run cells that begin with `=`, `+`, `-` or
//! `@` as formulas, so such a text gets an apostrophe before it unless formulas are kept.

use super::record::{Field, Record};
use super::{ExportError, ExportReport, OutputFile, RecordWriter, TableSetup, with_suffix, wkb};
use insula_objects::Value;
use std::borrow::Cow;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

const FORMAT: &str = "CSV";

pub(super) struct Writer {
    rows: csv::Writer<BufWriter<File>>,
    fields: Vec<Field>,
    path: PathBuf,
    keeps_formulas: bool,
}

impl Writer {
    pub(super) fn new(setup: &TableSetup<'_>, file: File) -> Result<Self, ExportError> {
        let mut rows = csv::Writer::from_writer(BufWriter::new(file));
        let keeps_formulas = setup.keeps_formulas;
        let names = setup.fields.iter().map(|field| cell(field.name.clone(), keeps_formulas));
        let names = names.chain(["wkt".to_owned()]);
        rows.write_record(names).map_err(ExportError::encode(setup.path, FORMAT))?;
        Ok(Self { rows, fields: setup.fields.to_vec(), path: setup.path.to_owned(), keeps_formulas })
    }
}

impl RecordWriter for Writer {
    fn write(&mut self, record: &Record) -> Result<Option<&'static str>, ExportError> {
        let values = record.values(&self.fields);
        let text = |value: Option<Cow<'_, Value>>| {
            value.map(|value| cell(value.to_string(), self.keeps_formulas)).unwrap_or_default()
        };
        let texts = values.into_iter().map(text);
        let wkt = wkb::well_known_text(record.polygons());
        self.rows.write_record(texts.chain([wkt])).map_err(ExportError::encode(&self.path, FORMAT))?;
        Ok(None)
    }

    fn finish(self: Box<Self>) -> Result<File, ExportError> {
        let buffered = self.rows.into_inner().map_err(|error| error.into_error());
        let file = buffered.and_then(|buffered| buffered.into_inner().map_err(|error| error.into_error()));
        file.map_err(ExportError::write(&self.path))
    }
}

/// A cell that no spreadsheet takes for a formula, unless formulas are kept. Numbers stay as they are. Some programs drop blanks and
/// characters that nobody sees at the beginning, and take the wide signs of East Asian texts for the others.
#[must_use]
pub fn cell(text: String, keeps_formulas: bool) -> String {
    let is_unseen =
        |c: char| c.is_whitespace() || c.is_control() || matches!(c, '\u{200b}'..='\u{200f}' | '\u{2060}' | '\u{feff}');
    let begin = text.trim_start_matches(is_unseen);
    let is_formula = begin.starts_with(['=', '+', '-', '@', '＝', '＋', '－', '＠']) && !is_number(begin);
    if (is_formula || text.starts_with(['\t', '\r'])) && !keeps_formulas { format!("'{text}") } else { text }
}

/// Whether a text is a decimal number. Rust also parses words such as `-inf`.
fn is_number(text: &str) -> bool {
    let has_digits_only = text.bytes().all(|byte| byte.is_ascii_digit() || b"+-.eE".contains(&byte));
    has_digits_only && text.parse::<f64>().is_ok()
}

/// Path and text of the file beside a table that has the attribution; `None` if there is none.
pub(crate) fn sidecar(out: &Path, attribution: &str) -> Option<(PathBuf, String)> {
    (!attribution.is_empty()).then(|| (with_suffix(out, ".txt"), format!("{attribution}\n")))
}

/// Writes `NAME.csv.txt` with the attribution, if there is any.
pub(super) fn write_sidecar(setup: &TableSetup<'_>, report: &mut ExportReport) -> Result<(), ExportError> {
    let Some((path, text)) = sidecar(setup.path, setup.attribution) else { return Ok(()) };
    let (output, mut file) = OutputFile::create(&path)?;
    file.write_all(text.as_bytes()).map_err(ExportError::write(output.path()))?;
    report.bytes += output.commit(file)?;
    report.files.push(path);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formulas_become_texts_and_numbers_stay() {
        for formula in [
            "=1+1", "+31 15 27", "-inf", "-A1", "@SUM(A1)", "\tx", "\r=1", "=", "--3", "-1e5e", " =1", "\n@a",
            "\u{feff}=1", "\u{a0}-a", "＝1", "＠a",
        ] {
            assert_eq!(cell(formula.to_owned(), false), format!("'{formula}"));
            assert_eq!(cell(formula.to_owned(), true), formula);
        }
        for other in ["-3.5", "+3", "-1e-5", "3", "", "a=b", "'=1", " -2", " a"] {
            assert_eq!(cell(other.to_owned(), false), other);
        }
    }
}
