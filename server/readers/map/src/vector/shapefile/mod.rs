//! Shapefile: shapes in `.shp`, attributes in `.dbf`, their long texts in `.dbt` or `.fpt`, the coordinate system in `.prj`, the encoding of
//! texts in `.cpg` or `.cst`.
//!
//! The `.shp` and `.dbf` files are read side by side, without the index `.shx`.

mod attributes;
mod encoding;
mod memo;
mod multipatch;
mod shapes;

use super::feature::FeatureWriter;
use super::layer::Layer;
use super::local;
use attributes::{AttributeReader, Row};
use insula_source::attributes::Attributes;
use insula_source::error::InputError;
use insula_source::input::{Input, OpenInput};
use insula_source::object::ObjectSink;
use insula_source::problems::{
    DAMAGED_ATTRIBUTES, ENCODING_GUESSED, FEWER_ATTRIBUTES, MARK_GUESSED, NO_ATTRIBUTES, NO_MEMOS,
};
use memo::MemoFile;
use std::io::{BufRead, Read};

const HEADER_BYTES: usize = 100;
const FILE_CODE: u32 = 9994;
/// Shapes between two progress reports.
const TICK_SHAPES: u64 = 256;

/// Reads a source. Fails if it is no shapefile, is cut short, or is in a system that cannot be placed.
pub fn read(input: &Input<'_>, sink: &mut dyn ObjectSink) -> Result<(), InputError> {
    let OpenInput { mut reader, bytes_read } = input.open()?;
    read_header(input, &mut reader)?;
    let mut writer = FeatureWriter::new(input, sink);
    let dbf_name = local::sibling(input, "dbf");
    let dbf_input = dbf_name.as_deref().map(|name| Input { name, ..*input });
    let mut table = match &dbf_input {
        Some(dbf_input) => open_attributes(input, dbf_input, &mut writer)?,
        None => {
            writer.sink.problem(NO_ATTRIBUTES, format!("{}: no .dbf file beside it", input.name));
            None
        }
    };
    let names = table.iter().flat_map(AttributeReader::names);
    writer.begin(Layer::of_file(input.name, names), local::system_beside(input))?;
    let mut content = Vec::new();
    let mut number = 0;
    while read_record(input, &mut reader, number + 1, &mut content)? {
        number += 1;
        read_shape(&content, number, &mut table, &mut writer)?;
        if number % TICK_SHAPES == 0 {
            writer.sink.tick(bytes_read.get());
        }
    }
    writer.sink.tick(bytes_read.get());
    writer.finish()
}

/// Opens the attributes; damaged ones are reported and left out.
fn open_attributes<'a>(
    input: &Input<'_>,
    dbf_input: &Input<'a>,
    writer: &mut FeatureWriter<'_>,
) -> Result<Option<AttributeReader<'a>>, InputError> {
    // GeoServer and GeoNode write another name.
    let code_page = local::sibling_text(input, "cpg").or_else(|| local::sibling_text(input, "cst"));
    match AttributeReader::open(dbf_input.open()?.reader, code_page.as_deref()) {
        Ok(mut reader) => {
            for guess in reader.take_guesses() {
                writer.sink.problem(MARK_GUESSED, format!("{}: {guess}", dbf_input.name));
            }
            let memo_names = reader.memo_names().join(", ");
            if !memo_names.is_empty() {
                match MemoFile::open(dbf_input, reader.version) {
                    Ok(memos) => reader.memos = Some(memos),
                    Err(what) => writer.sink.problem(NO_MEMOS, format!("{}: {memo_names}: {what}", dbf_input.name)),
                }
            }
            Ok(Some(reader))
        }
        Err(fault) => {
            writer.sink.problem(DAMAGED_ATTRIBUTES, format!("{}: {fault}", dbf_input.name));
            Ok(None)
        }
    }
}

fn read_header(input: &Input<'_>, reader: &mut Box<dyn BufRead + '_>) -> Result<(), InputError> {
    let mut header = [0; HEADER_BYTES];
    reader.read_exact(&mut header).map_err(|cause| InputError::io(input.label, cause))?;
    let code = u32::from_be_bytes([header[0], header[1], header[2], header[3]]);
    if code != FILE_CODE {
        return Err(InputError::damaged(input.label, "header", "it does not begin as a shapefile does"));
    }
    Ok(())
}

/// Reads the content of the next record. Returns false at the end of the file.
fn read_record(
    input: &Input<'_>,
    reader: &mut Box<dyn BufRead + '_>,
    number: u64,
    content: &mut Vec<u8>,
) -> Result<bool, InputError> {
    let io_error = |cause| InputError::io(input.label, cause);
    let cut_short = || InputError::damaged(input.label, format!("shape {number}"), "the file ends within it");
    content.clear();
    reader.by_ref().take(8).read_to_end(content).map_err(io_error)?;
    let words = match content.as_slice() {
        // Some files are padded.
        [] | [0, 0, 0, 0, 0, 0, 0, 0] => return Ok(false),
        [_, _, _, _, length @ ..] => u32::from_be_bytes(length.try_into().map_err(|_| cut_short())?),
        _ => return Err(cut_short()),
    };
    let bytes = u64::from(words) * 2;
    if bytes > input.max_bytes {
        let what = format!("the size of shape {number}");
        return Err(InputError::TooLarge { path: input.label.to_owned(), what, limit: input.max_bytes });
    }
    content.clear();
    let read = reader.by_ref().take(bytes).read_to_end(content).map_err(io_error)?;
    if (read as u64) < bytes {
        return Err(cut_short());
    }
    Ok(true)
}

fn read_shape(
    content: &[u8],
    number: u64,
    table: &mut Option<AttributeReader<'_>>,
    writer: &mut FeatureWriter<'_>,
) -> Result<(), InputError> {
    let name = format!("feature {number}");
    let mut attributes = Attributes::default();
    if let Some(reader) = table {
        let row = reader.next(&mut attributes);
        if let Some(warning) = reader.take_warning() {
            writer.sink.problem(ENCODING_GUESSED, format!("{name}: {warning}"));
        }
        for column in reader.take_lost() {
            writer.sink.problem(NO_MEMOS, format!("{name}: {column}"));
        }
        match row {
            Row::Read => {}
            Row::Deleted => return writer.add(Some(name), attributes, Err("deleted feature")),
            Row::Missing => {
                writer.sink.problem(FEWER_ATTRIBUTES, name.clone());
                *table = None;
            }
        }
    }
    let mut problems = Vec::new();
    let geometry = shapes::read(content, &mut problems);
    problems.into_iter().for_each(|problem| writer.sink.problem(problem, name.clone()));
    writer.add(Some(name), attributes, geometry)
}
