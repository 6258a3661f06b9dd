//! GeoJSON and JSON-FG: a collection whose features are read one at a time, a single feature or geometry, or one feature per line.

mod features;
mod geometry;
mod schema;
mod stream;

use super::feature::FeatureWriter;
use features::FeatureReader;
pub(super) use features::is_of_lines;
pub(super) use geometry::{looks_like_geometry, parse_geometry};
use insula_source::error::InputError;
use insula_source::input::{Input, OpenInput};
use insula_source::object::ObjectSink;
use insula_source::source::{SourceKind, kind_by_name};
use std::io::{BufRead, Cursor, Read};
pub use stream::{is_type, read_type};

/// Bytes in which the end of the first line is looked for.
const HEAD_BYTES: u64 = 1 << 20;

/// Reads a source. Fails if the text is damaged, not GeoJSON, or in an unsupported coordinate system.
pub fn read(input: &Input<'_>, sink: &mut dyn ObjectSink) -> Result<(), InputError> {
    // The limits below name what is too large.
    let OpenInput { mut reader, bytes_read } = Input { max_bytes: u64::MAX, ..*input }.open()?;
    let mut head = Vec::new();
    reader.by_ref().take(HEAD_BYTES).read_to_end(&mut head).map_err(|cause| InputError::io(input.label, cause))?;
    let is_in_lines = kind_by_name(input.name) == Some(SourceKind::GeoJsonLines) || is_of_lines(&head);
    let whole: Box<dyn BufRead + '_> = Box::new(Cursor::new(head).chain(reader));
    let later_system = || stream::find_place_system(input);
    let later_system = (!is_in_lines).then_some(&later_system as &dyn Fn() -> Option<_>);
    let mut features = FeatureReader::new(FeatureWriter::new(input, sink), input.label, later_system);
    let bytes_read = || bytes_read.get();
    if is_in_lines {
        features.read_lines(whole, input.max_line_bytes, &bytes_read)?;
    } else {
        stream::read(whole, &mut features, input, &bytes_read)?;
    }
    features.writer.finish()
}
