//! FlatGeobuf: a header, an optional index, then features, each a FlatBuffer with its size in front.
//!
//! The framing is read here, so that one bad feature does not end the reading and no size is believed before its bytes are
//! there; tables are read by the format's own crate, which verifies each.

mod geometry;
mod index;
mod properties;
mod share;

use super::feature::FeatureWriter;
use super::geometry::{Geometry, MALFORMED};
use super::layer::Layer;
use ::flatgeobuf::{Feature, Header, size_prefixed_root_as_feature, size_prefixed_root_as_header};
use insula_source::attributes::Attributes;
use insula_source::error::InputError;
use insula_source::input::{Input, OpenInput, Share};
use insula_source::json::metadata;
use insula_source::object::{Description, ObjectSink};
use properties::Column;
use std::io::{self, BufRead, Read};

const MAX_HEADER_BYTES: u32 = 10 << 20;
/// Magic bytes: `fgb`, the major version, `fgb`, the patch version.
const MAGIC: [u8; 3] = *b"fgb";
const MAGIC_BYTES: usize = 8;
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
    /// Size of the index; `None` without one.
    index_bytes: Option<u64>,
}

/// Reads a source. Fails if it is no FlatGeobuf, is cut short, or is in a system that cannot be placed.
pub fn read(input: &Input<'_>, sink: &mut dyn ObjectSink) -> Result<(), InputError> {
    if input.share != Share::WHOLE {
        return share::read(input, sink);
    }
    let OpenInput { mut reader, bytes_read } = input.open()?;
    let mut writer = FeatureWriter::new(input, sink);
    let header = read_header(input, &mut *reader)?;
    let schema = begin(input, &header_of(input, &header)?, &mut writer)?;
    let wanted = index::read(input, &mut *reader, &schema, writer.wanted_deg())?;
    let mut frame = Vec::new();
    let mut read = 0;
    let mut position = 0;
    for (offset, number) in wanted.features() {
        if let Some(gap) = offset.and_then(|offset| offset.checked_sub(position)) {
            skip(input, &mut *reader, gap)?;
            position += gap;
        }
        let Some(bytes) = read_frame(input, &mut *reader, &mut frame, number)? else { break };
        position += bytes;
        read_feature(&frame, &schema, number, &mut writer)?;
        read += 1;
        if read % TICK_FEATURES == 0 {
            writer.sink.tick(bytes_read.get());
        }
    }
    writer.sink.tick(bytes_read.get());
    writer.finish()?;
    if wanted.is_all() && schema.features > read {
        let what = format!("{} features are announced, {read} are there", schema.features);
        return Err(InputError::damaged(input.label, format!("feature {}", read + 1), what));
    }
    Ok(())
}

/// Reads what is before the index: the magic bytes, and the header with its size in front. Returns the latter.
fn read_header(input: &Input<'_>, reader: &mut dyn BufRead) -> Result<Vec<u8>, InputError> {
    let damaged = |what: String| InputError::damaged(input.label, "header", what);
    let io_error = |cause| InputError::io(input.label, cause);
    let mut magic = [0; MAGIC_BYTES];
    reader.read_exact(&mut magic).map_err(io_error)?;
    if magic[..3] != MAGIC || magic[4..7] != MAGIC {
        return Err(damaged("it does not begin as a FlatGeobuf does".to_owned()));
    }
    if magic[3] > VERSION {
        return Err(InputError::unsupported(input.label, format!("version {} of FlatGeobuf", magic[3])));
    }
    let mut size = [0; 4];
    reader.read_exact(&mut size).map_err(io_error)?;
    let bytes = u32::from_le_bytes(size);
    if !(MIN_TABLE_BYTES..=MAX_HEADER_BYTES).contains(&bytes) {
        return Err(damaged(format!("its size of {bytes} bytes is not possible")));
    }
    let mut frame = size.to_vec();
    Read::take(reader, u64::from(bytes)).read_to_end(&mut frame).map_err(io_error)?;
    Ok(frame)
}

fn header_of<'f>(input: &Input<'_>, frame: &'f [u8]) -> Result<Header<'f>, InputError> {
    let damaged = |cause: String| InputError::damaged(input.label, "header", first_line(&cause));
    size_prefixed_root_as_header(frame).map_err(|cause| damaged(cause.to_string()))
}

/// Begins the layer. Fails if positions of its system cannot be placed.
fn begin(input: &Input<'_>, header: &Header<'_>, writer: &mut FeatureWriter<'_>) -> Result<Schema, InputError> {
    describe(header, writer);
    let columns = properties::columns(header.columns());
    let names = columns.iter().map(|column| column.name.as_str());
    let layer = match header.name().filter(|name| !name.trim().is_empty()) {
        Some(name) => Layer::new(name, names),
        None => Layer::of_file(input.name, names),
    };
    writer.begin(layer, crs_of(header))?;
    let index_bytes = index::bytes(input, header)?;
    Ok(Schema { columns, geometry_type: header.geometry_type(), features: header.features_count(), index_bytes })
}

fn describe(header: &Header<'_>, writer: &mut FeatureWriter<'_>) {
    for text in [header.title(), header.description()].into_iter().flatten().filter(|text| !text.trim().is_empty()) {
        writer.sink.describe(Description::Title, text);
    }
    let metadata = header.metadata().and_then(|text| serde_json::from_str::<serde_json::Value>(text).ok());
    if let Some(metadata) = metadata {
        // The header has the system itself.
        let _ = metadata::describe(&metadata, writer.sink);
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

/// Reads the size and bytes of the next feature, and returns their number; `None` at the end of the file. `number` is for messages.
fn read_frame(
    input: &Input<'_>,
    reader: &mut dyn BufRead,
    frame: &mut Vec<u8>,
    number: u64,
) -> Result<Option<u64>, InputError> {
    let io_error = |cause| InputError::io(input.label, cause);
    let place = || format!("feature {}", number + 1);
    frame.clear();
    Read::take(&mut *reader, 4).read_to_end(frame).map_err(io_error)?;
    if frame.is_empty() {
        return Ok(None);
    }
    let cut_short = || InputError::damaged(input.label, place(), "the file ends within it");
    let size = u32::from_le_bytes(frame.as_slice().try_into().map_err(|_| cut_short())?);
    if u64::from(size) > input.max_bytes {
        let what = format!("the size of {}", place());
        return Err(InputError::TooLarge { path: input.label.to_owned(), what, limit: input.max_bytes });
    }
    let read = Read::take(&mut *reader, u64::from(size)).read_to_end(frame).map_err(io_error)?;
    if read < size as usize {
        return Err(cut_short());
    }
    Ok(Some(u64::from(size) + 4))
}

fn read_feature(frame: &[u8], schema: &Schema, number: u64, writer: &mut FeatureWriter<'_>) -> Result<(), InputError> {
    let name = format!("feature {}", number + 1);
    let Some(feature) = feature_of(frame) else {
        return writer.add(Some(name), Attributes::default(), Err("malformed feature"));
    };
    let mut attributes = Attributes::default();
    let own_columns = feature.columns().map(|columns| properties::columns(Some(columns)));
    let bytes = feature.properties().map_or(&[][..], |properties| properties.bytes());
    let columns = own_columns.as_deref().unwrap_or(&schema.columns);
    if !properties::read(bytes, columns, &mut attributes, writer.sink) {
        writer.sink.problem("malformed attributes", name.clone());
    }
    writer.add(Some(name), attributes, geometry_of(&feature, frame, schema))
}

/// The table in a frame; `None` if it is damaged.
fn feature_of(frame: &[u8]) -> Option<Feature<'_>> {
    let is_table = frame.len() >= 4 + MIN_TABLE_BYTES as usize;
    is_table.then(|| size_prefixed_root_as_feature(frame).ok()).flatten()
}

fn geometry_of(feature: &Feature<'_>, frame: &[u8], schema: &Schema) -> Result<Geometry, &'static str> {
    let table = feature.geometry().ok_or("no geometry")?;
    let mut geometry = Geometry::default();
    // Parts of a geometry may refer to the same vector. The limit keeps a small table from becoming a large geometry.
    let mut positions_left = frame.len() / 16 + 1;
    geometry::read(&table, schema.geometry_type, &mut geometry, &mut positions_left, 0)?;
    geometry.level_without_heights();
    Ok(geometry)
}

fn skip(input: &Input<'_>, reader: &mut dyn BufRead, bytes: u64) -> Result<(), InputError> {
    let skipped = io::copy(&mut reader.take(bytes), &mut io::sink());
    if skipped.map_err(|cause| InputError::io(input.label, cause))? < bytes {
        return Err(InputError::damaged(input.label, "index", "the file ends before its features"));
    }
    Ok(())
}

fn first_line(text: &str) -> String {
    text.lines().next().unwrap_or(MALFORMED).to_owned()
}
