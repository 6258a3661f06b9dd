//! FlatGeobuf: a header, an optional index, then features, each a FlatBuffer with its size in front.
//!
//! The framing is read here, so that one bad feature does not end the reading and no size is believed before its bytes are
//! there; tables are read by the format's own crate, which verifies each.

mod geometry;
mod index;
mod properties;

use std::io::{self, BufRead, Read};

use ::flatgeobuf::{Header, size_prefixed_root_as_feature, size_prefixed_root_as_header};

use super::feature::FeatureWriter;
use super::geometry::{Geometry, MALFORMED};
use super::layer::Layer;
use crate::error::InputError;
use crate::read::attributes::Attributes;
use crate::read::input::{Input, OpenInput};
use crate::read::object::{Description, ObjectSink};
use properties::Column;

const MAX_HEADER_BYTES: u32 = 10 << 20;
/// Magic bytes: `fgb`, the major version, `fgb`, the patch version.
const MAGIC: [u8; 3] = *b"fgb";
const VERSION: u8 = 3;
/// Smaller tables are no FlatBuffers.
const MIN_TABLE_BYTES: u32 = 8;
/// Features between two progress reports.
const TICK_FEATURES: u64 = 256;

/// What is needed of the header for all features.
struct Schema {
    columns: Vec<Column>,
    geometry_type: ::flatgeobuf::GeometryType,
    /// 0 if the file does not tell.
    features: u64,
    index_node_size: u16,
}

/// Reads a source. Fails if it is no FlatGeobuf, is cut short, or is in a system that cannot be placed.
pub(crate) fn read(input: &Input<'_>, sink: &mut dyn ObjectSink) -> Result<(), InputError> {
    let OpenInput { mut reader, bytes_read } = input.open()?;
    let mut writer = FeatureWriter::new(input, sink);
    let schema = read_header(input, &mut reader, &mut writer)?;
    let wanted = index::read(input, &mut reader, &schema, writer.wanted_deg())?;
    let mut frame = Vec::new();
    let mut number = 0;
    let mut position = 0;
    for offset in wanted.offsets() {
        if let Some(gap) = offset.and_then(|offset| offset.checked_sub(position)) {
            skip(input, &mut reader, gap)?;
            position += gap;
        }
        let place = || format!("feature {}", number + 1);
        let Some(bytes) = read_frame(input, &mut reader, &mut frame, place)? else { break };
        position += bytes;
        read_feature(&frame, &schema, number, &mut writer)?;
        number += 1;
        if number % TICK_FEATURES == 0 {
            writer.sink.tick(bytes_read.get());
        }
    }
    writer.sink.tick(bytes_read.get());
    writer.finish()?;
    if wanted.is_all() && schema.features > number {
        let what = format!("{} features are announced, {number} are there", schema.features);
        return Err(InputError::damaged(input.label, format!("feature {}", number + 1), what));
    }
    Ok(())
}

fn read_header(
    input: &Input<'_>,
    reader: &mut Box<dyn BufRead + '_>,
    writer: &mut FeatureWriter<'_>,
) -> Result<Schema, InputError> {
    let damaged = |what: String| InputError::damaged(input.label, "header", what);
    let mut magic = [0; 8];
    reader.read_exact(&mut magic).map_err(|cause| InputError::io(input.label, cause))?;
    if magic[..3] != MAGIC || magic[4..7] != MAGIC {
        return Err(damaged("it does not begin as a FlatGeobuf does".to_owned()));
    }
    if magic[3] > VERSION {
        return Err(InputError::unsupported(input.label, format!("version {} of FlatGeobuf", magic[3])));
    }
    let mut size = [0; 4];
    reader.read_exact(&mut size).map_err(|cause| InputError::io(input.label, cause))?;
    let bytes = u32::from_le_bytes(size);
    if !(MIN_TABLE_BYTES..=MAX_HEADER_BYTES).contains(&bytes) {
        return Err(damaged(format!("its size of {bytes} bytes is not possible")));
    }
    let mut frame = size.to_vec();
    let read = reader.by_ref().take(u64::from(bytes)).read_to_end(&mut frame);
    read.map_err(|cause| InputError::io(input.label, cause))?;
    let header = size_prefixed_root_as_header(&frame).map_err(|cause| damaged(first_line(&cause.to_string())))?;
    describe(&header, writer);
    let columns = properties::columns(header.columns());
    let names = columns.iter().map(|column| column.name.as_str());
    let layer = match header.name().filter(|name| !name.trim().is_empty()) {
        Some(name) => Layer::new(name, names),
        None => Layer::of_file(input.name, names),
    };
    writer.begin(layer, crs_of(&header))?;
    let node_size = header.index_node_size();
    Ok(Schema {
        columns,
        geometry_type: header.geometry_type(),
        features: header.features_count(),
        index_node_size: node_size,
    })
}

fn describe(header: &Header<'_>, writer: &mut FeatureWriter<'_>) {
    for text in [header.title(), header.description()].into_iter().flatten().filter(|text| !text.trim().is_empty()) {
        writer.sink.describe(Description::Title, text);
    }
}

/// Name of the coordinate system: `EPSG:n`, or its WKT.
fn crs_of(header: &Header<'_>) -> Option<String> {
    let crs = header.crs()?;
    let text = |text: Option<&str>| text.map(str::trim).filter(|text| !text.is_empty()).map(str::to_owned);
    let organisation = text(crs.org()).unwrap_or_else(|| "EPSG".to_owned());
    let code = if crs.code() > 0 { Some(crs.code().to_string()) } else { text(crs.code_string()) };
    match code {
        Some(code) if organisation.eq_ignore_ascii_case("EPSG") || crs.wkt().is_none() => {
            Some(format!("{}:{code}", organisation.to_ascii_uppercase()))
        }
        _ => text(crs.wkt()).or_else(|| text(crs.name())),
    }
}

/// Reads the size and bytes of the next feature, and returns their number; `None` at the end of the file.
fn read_frame(
    input: &Input<'_>,
    reader: &mut Box<dyn BufRead + '_>,
    frame: &mut Vec<u8>,
    place: impl Fn() -> String,
) -> Result<Option<u64>, InputError> {
    let io_error = |cause| InputError::io(input.label, cause);
    frame.clear();
    reader.by_ref().take(4).read_to_end(frame).map_err(io_error)?;
    if frame.is_empty() {
        return Ok(None);
    }
    let cut_short = || InputError::damaged(input.label, place(), "the file ends within it");
    let size = u32::from_le_bytes(frame.as_slice().try_into().map_err(|_| cut_short())?);
    if u64::from(size) > input.max_bytes {
        let what = format!("the size of {}", place());
        return Err(InputError::TooLarge { path: input.label.to_owned(), what, limit: input.max_bytes });
    }
    let read = reader.by_ref().take(u64::from(size)).read_to_end(frame).map_err(io_error)?;
    if read < size as usize {
        return Err(cut_short());
    }
    Ok(Some(u64::from(size) + 4))
}

fn read_feature(frame: &[u8], schema: &Schema, number: u64, writer: &mut FeatureWriter<'_>) -> Result<(), InputError> {
    let name = format!("feature {}", number + 1);
    let is_table = frame.len() >= 4 + MIN_TABLE_BYTES as usize;
    let feature = is_table.then(|| size_prefixed_root_as_feature(frame).ok()).flatten();
    let Some(feature) = feature else {
        return writer.add(Some(name), Attributes::default(), Err("malformed feature"));
    };
    let mut attributes = Attributes::default();
    let own_columns = feature.columns().map(|columns| properties::columns(Some(columns)));
    let bytes = feature.properties().map_or(&[][..], |properties| properties.bytes());
    if !properties::read(bytes, own_columns.as_deref().unwrap_or(&schema.columns), &mut attributes) {
        writer.sink.problem("malformed attributes", name.clone());
    }
    let geometry = match feature.geometry() {
        None => Err("no geometry"),
        Some(table) => {
            let mut geometry = Geometry::default();
            // Parts can share vectors: what comes of them must not be larger than without sharing.
            let mut positions_left = frame.len() / 16 + 1;
            let read = geometry::read(&table, schema.geometry_type, &mut geometry, &mut positions_left, 0);
            read.map(|()| geometry)
        }
    };
    writer.add(Some(name), attributes, geometry)
}

fn skip(input: &Input<'_>, reader: &mut Box<dyn BufRead + '_>, bytes: u64) -> Result<(), InputError> {
    let skipped = io::copy(&mut reader.by_ref().take(bytes), &mut io::sink());
    if skipped.map_err(|cause| InputError::io(input.label, cause))? < bytes {
        return Err(InputError::damaged(input.label, "index", "the file ends before its features"));
    }
    Ok(())
}

fn first_line(text: &str) -> String {
    text.lines().next().unwrap_or(MALFORMED).to_owned()
}
