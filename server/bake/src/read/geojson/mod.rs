//! GeoJSON footprints, extruded to prisms: a document whose features are read one at a time, or one feature per line.

mod features;
mod schema;
mod stream;
#[cfg(test)]
mod tests;

use super::context::{ByteProgress, ReadContext};
use super::report::{SourceFormat, SourceReport};
use super::sink::SceneSink;
use super::source::{CitySource, SourceKind, kind_by_name, open};
use crate::error::InputError;
use crate::read::json::metadata;
use crate::read::vector::FeatureWriter;
use features::FeatureReader;
use serde_json::Value;

pub(super) use stream::read_type;

/// Reads a source. Fails if the text is damaged, not GeoJSON, or in an unsupported coordinate system.
pub(crate) fn read(
    context: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    tick: ByteProgress<'_>,
) -> Result<SourceReport, InputError> {
    let opened = open(source)?;
    let bytes_read = opened.bytes_read;
    let mut sink = SceneSink::new(context, source, SourceFormat::GeoJson, tick)?;
    let (options, input) = (sink.options(), sink.input());
    let is_lines = kind_by_name(&source.name) == Some(SourceKind::GeoJsonLines);
    let writer = FeatureWriter::new(&input, &mut sink);
    // A slice of a sequence does not know the features of the others.
    let writer = if is_lines { writer.without_faces() } else { writer };
    let mut features = FeatureReader::new(writer, options, &source.label);
    let tick = || tick(bytes_read.get());
    if is_lines {
        features.read_lines(opened.reader, &tick)?;
    } else {
        stream::read(opened.reader, &mut features, &tick)?;
    }
    features.writer.finish()?;
    let texts = std::mem::take(&mut features.texts);
    metadata::describe(&Value::Object(texts), sink.report_mut());
    Ok(sink.into_report())
}
