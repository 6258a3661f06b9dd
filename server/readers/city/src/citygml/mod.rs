//! Reader of CityGML 1.0, 2.0 and 3.0.
//!
//! The file is streamed: one top-level object at a time is in memory, in the compact form of [`tree`]. Elements are
//! known by the family of their namespace and their local name, never by prefix, so all versions are read alike. A file
//! with appearances is read twice, because they often come after the surfaces that they colour; a file in which objects
//! refer to surfaces of later objects is read twice more.

mod appearance;
mod appearance_reader;
mod attributes;
mod codelists;
mod convert;
mod coordinates;
mod curves;
mod decode;
mod elements;
mod gather;
mod kinds;
mod names;
mod objects;
mod paths;
mod placement;
mod plan;
mod session;
mod shape;
mod store;
#[cfg(test)]
mod tests;
mod tree;
mod tree_builder;
mod xml;

use appearance::Appearances;
use appearance_reader::{Scan, read_appearances};
use decode::TextReader;
use encoding_rs::Encoding;
use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::object::ObjectSink;
use insula_source::problems::ENCODING_GUESSED;
use session::{Pass, Session};
use std::io::BufRead;
use xml::XmlReader;

/// Reads all objects of a CityGML file. Positions are in the order of axes that the registry of coordinate systems
/// defines. Fails if the file cannot be read, is not CityGML or is damaged; objects before the damage are passed on.
pub fn read(input: &Input<'_>, sink: &mut dyn ObjectSink) -> Result<(), InputError> {
    let Scanned { has_appearances, encoding } = scan(input)?;
    if let Some(encoding) = encoding {
        let detail = format!("{}: it is not in UTF-8, as it says, and taken as {}", input.name, encoding.name());
        sink.problem(ENCODING_GUESSED, detail);
    }
    let appearances = if has_appearances { appearances_of(input, encoding, sink)? } else { Appearances::default() };
    let mut session = Session::new(input, sink, appearances, encoding);
    let result = session.run(Pass::Main);
    if !session.has_deferred() {
        return result;
    }
    // Objects before a damage are passed on, also those that waited for others.
    let collected = session.run(Pass::Collect);
    let deferred = session.run(Pass::Deferred);
    result.and(collected).and(deferred)
}

/// What a look at the text of a file tells.
struct Scanned {
    has_appearances: bool,
    /// That of a file which says that it is in UTF-8, and is not, up to the first appearance.
    encoding: Option<&'static Encoding>,
}

/// Looks through a file up to its first appearance. Its faults are left to the pass that reads the objects.
fn scan(input: &Input<'_>) -> Result<Scanned, InputError> {
    let mut text = TextReader::new(input.label, input.open()?.reader, None)?;
    let mut scan = Scan::new();
    let has_appearances = loop {
        text.begin_event();
        let count = match text.fill_buf() {
            Ok([]) | Err(_) => break false,
            Ok(chunk) if scan.finds(chunk) => break true,
            Ok(chunk) => chunk.len(),
        };
        text.consume(count);
    };
    Ok(Scanned { has_appearances, encoding: text.likely_encoding() })
}

/// The appearances up to the end of the file or its first fault, which the pass that reads the objects meets again.
fn appearances_of(
    input: &Input<'_>,
    encoding: Option<&'static Encoding>,
    sink: &mut dyn ObjectSink,
) -> Result<Appearances, InputError> {
    let text = TextReader::new(input.label, input.open()?.reader, encoding)?;
    let mut appearances = Appearances::default();
    let _ = read_appearances(&mut XmlReader::new(input.label, text), sink, &mut appearances);
    appearances.finish();
    Ok(appearances)
}
