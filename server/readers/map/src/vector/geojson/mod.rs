//! GeoJSON and JSON-FG: a collection whose features are read one at a time, a single feature or geometry, or one feature per line.

mod features;
mod geometry;
mod schema;
mod stream;

use super::feature::FeatureWriter;
use features::FeatureReader;
use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::object::ObjectSink;
use insula_source::source::{SourceKind, kind_by_name};

pub use stream::{is_type, read_type};

/// Reads a source. Fails if the text is damaged, not GeoJSON, or in an unsupported coordinate system.
pub fn read(input: &Input<'_>, sink: &mut dyn ObjectSink) -> Result<(), InputError> {
    // The limits below name what is too large.
    let opened = Input { max_bytes: u64::MAX, ..*input }.open()?;
    let is_in_lines = kind_by_name(input.name) == Some(SourceKind::GeoJsonLines);
    let later_system = || stream::find_place_system(input);
    let later_system = (!is_in_lines).then_some(&later_system as &dyn Fn() -> Option<_>);
    let mut features = FeatureReader::new(FeatureWriter::new(input, sink), input.label, later_system);
    let bytes_read = || opened.bytes_read.get();
    if is_in_lines {
        features.read_lines(opened.reader, input.max_line_bytes, &bytes_read)?;
    } else {
        stream::read(opened.reader, &mut features, input, &bytes_read)?;
    }
    features.writer.finish()
}
