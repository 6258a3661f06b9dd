//! GeoJSON and JSON-FG: a collection whose features are read one at a time, a single feature or geometry, or one feature per line.

mod features;
mod geometry;
mod schema;
mod stream;
#[cfg(test)]
mod tests;

use super::feature::FeatureWriter;
use crate::error::InputError;
use crate::read::context::{ByteProgress, ReadContext};
use crate::read::report::{SourceFormat, SourceReport};
use crate::read::sink::SceneSink;
use crate::read::source::{CitySource, SourceKind, kind_by_name, open};
use features::FeatureReader;

pub(crate) use stream::{is_type, read_type};

/// Reads a source. Fails if the text is damaged, not GeoJSON, or in an unsupported coordinate system.
pub(crate) fn read(
    context: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    tick: ByteProgress<'_>,
) -> Result<SourceReport, InputError> {
    let opened = open(source)?;
    let mut sink = SceneSink::new(context, source, SourceFormat::GeoJson, tick)?;
    let (input, options) = (sink.input(), sink.options());
    let mut features = FeatureReader::new(FeatureWriter::new(&input, &mut sink), &source.label);
    let bytes_read = || opened.bytes_read.get();
    if kind_by_name(&source.name) == Some(SourceKind::GeoJsonLines) {
        features.read_lines(opened.reader, options.max_line_bytes, &bytes_read)?;
    } else {
        stream::read(opened.reader, &mut features, options, &bytes_read)?;
    }
    features.writer.finish()?;
    Ok(sink.into_report())
}
