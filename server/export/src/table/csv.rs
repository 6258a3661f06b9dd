//! Comma-separated values (RFC 4180, UTF-8, a header row). The last column is the footprint as well-known text in world metres.
//!
//! Attribution is in a text file beside it, because a comment line breaks readers.

use super::{
    ExportError, ExportReport, RecordWriter, TableSetup,
    output::{OutputFile, with_suffix},
    record::{Field, Record},
    wkb,
};
use std::{
    fs::File,
    io::{BufWriter, Write},
    path::{Path, PathBuf},
};

const FORMAT: &str = "CSV";

pub(super) struct Writer {
    rows: csv::Writer<BufWriter<File>>,
    fields: Vec<Field>,
    path: PathBuf,
}

impl Writer {
    pub(super) fn new(setup: &TableSetup<'_>, file: File) -> Result<Self, ExportError> {
        let mut rows = csv::Writer::from_writer(BufWriter::new(file));
        let names = setup.fields.iter().map(|field| field.name.as_str());
        rows.write_record(names.chain(["wkt"])).map_err(ExportError::encode(setup.path, FORMAT))?;
        Ok(Self { rows, fields: setup.fields.to_vec(), path: setup.path.to_owned() })
    }
}

impl RecordWriter for Writer {
    fn write(&mut self, record: &Record) -> Result<Option<&'static str>, ExportError> {
        let values = record.values(&self.fields);
        let texts = values.into_iter().map(|value| value.map(|value| value.to_string()).unwrap_or_default());
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
