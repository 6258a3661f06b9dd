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
use features::FeatureReader;

pub(super) use stream::read_type;

/// Reads a source. Fails if the text is damaged, not GeoJSON, or in an unsupported coordinate system.
pub(crate) fn read(
    context: &mut ReadContext<'_>,
    source: &CitySource<'_>,
    tick: ByteProgress<'_>,
) -> Result<SourceReport, InputError> {
    let opened = open(source)?;
    let bytes_read = opened.bytes_read;
    let sink = SceneSink::new(context, source, SourceFormat::GeoJson, tick)?;
    let mut features = FeatureReader::new(sink, source);
    let tick = || tick(bytes_read.get());
    if kind_by_name(&source.name) == Some(SourceKind::GeoJsonLines) {
        features.read_lines(opened.reader, &tick)?;
    } else {
        stream::read(opened.reader, &mut features, &tick)?;
    }
    Ok(features.sink.into_report())
}
