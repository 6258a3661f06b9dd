//! Events of an XML file with namespaces resolved to families, and faults as errors of the input.

use super::decode::TextReader;
use super::names::{Class, Family, NameId, Names};
use insula_source::error::InputError;
use quick_xml::errors::Error as XmlError;
use quick_xml::events::attributes::Attribute;
use quick_xml::events::{BytesRef, BytesStart, Event as XmlEvent};
use quick_xml::name::{NamespaceError, NamespaceResolver, QName, ResolveResult};
use quick_xml::{Reader, XmlVersion};
use std::borrow::Cow;
use std::collections::HashMap;
use std::io;

/// Deeper files are damaged: the names of all open elements are in memory.
const MAX_DEPTH: u32 = 1024;
/// Longer buffers are given back after use.
const KEPT_BUFFER_BYTES: usize = 4 << 20;
/// Names with prefix that are remembered for each set of namespaces.
const MAX_CACHED_NAMES: usize = 512;
/// Longer names are no names of CityGML.
const MAX_NAME_BYTES: usize = 128;

/// A part of the file.
pub(super) enum Event<'b> {
    /// The start of an element, and its end if `is_empty`.
    Start {
        name: NameId,
        class: Class,
        element: BytesStart<'b>,
        is_empty: bool,
    },
    End,
    /// Text, or a part of it, with references resolved.
    Text(Cow<'b, str>),
    /// A comment, declaration or processing instruction.
    Other,
    EndOfFile,
}

/// Reads the events of a file.
pub(super) struct XmlReader<'a> {
    label: &'a str,
    reader: Reader<TextReader<'a>>,
    buffer: Vec<u8>,
    pub(super) names: Names,
    scopes: Scopes,
    /// Number of open elements.
    depth: u32,
    /// Kind and detail of faults that do not end the reading, each kind once.
    pub(super) faults: Vec<(&'static str, String)>,
}

impl<'a> XmlReader<'a> {
    /// `label` is for errors.
    pub(super) fn new(label: &'a str, text: TextReader<'a>) -> Self {
        let mut reader = Reader::from_reader(text);
        // A lone `&` in a name such as `A & B` is not worth a city.
        reader.config_mut().allow_dangling_amp = true;
        let (names, scopes) = (Names::new(), Scopes::default());
        Self { label, reader, buffer: Vec::new(), names, scopes, depth: 0, faults: Vec::new() }
    }

    /// Number of open elements.
    pub(super) fn depth(&self) -> u32 {
        self.depth
    }

    /// Bytes of decoded text so far.
    pub(super) fn position(&self) -> u64 {
        self.reader.buffer_position()
    }

    /// Whether any byte was invalid in the file's encoding.
    pub(super) fn has_invalid_bytes(&mut self) -> bool {
        self.reader.get_mut().has_invalid_bytes()
    }

    /// The next event. Fails if the file cannot be read or is not well-formed.
    pub(super) fn next(&mut self) -> Result<Event<'_>, InputError> {
        self.buffer.clear();
        if self.buffer.capacity() > KEPT_BUFFER_BYTES {
            self.buffer = Vec::new();
        }
        self.reader.get_mut().begin_event();
        let event = match self.reader.read_event_into(&mut self.buffer) {
            Ok(event) => event,
            Err(error) => return Err(input_error(self.label, &mut self.reader, error)),
        };
        match event {
            XmlEvent::Start(element) => {
                self.depth += 1;
                if self.depth > MAX_DEPTH {
                    let place = format!("byte {}", self.reader.buffer_position());
                    return Err(InputError::damaged(self.label, place, "its elements are nested too deeply"));
                }
                let resolved = self.scopes.open(&mut self.names, &element, self.depth);
                let name = resolved.finish(self.label, &self.reader, &mut self.faults)?;
                Ok(Event::Start { name, class: self.names.class(name), element, is_empty: false })
            }
            XmlEvent::Empty(element) => {
                let resolved = self.scopes.open(&mut self.names, &element, self.depth + 1);
                self.scopes.close(self.depth + 1);
                let name = resolved.finish(self.label, &self.reader, &mut self.faults)?;
                Ok(Event::Start { name, class: self.names.class(name), element, is_empty: true })
            }
            XmlEvent::End(_) => {
                self.scopes.close(self.depth);
                self.depth = self.depth.saturating_sub(1);
                Ok(Event::End)
            }
            XmlEvent::Text(text) => Ok(Event::Text(text.into_inner())),
            XmlEvent::CData(text) => Ok(Event::Text(text.into_inner())),
            XmlEvent::GeneralRef(reference) => Ok(reference_text(&reference, &mut self.faults)),
            XmlEvent::Eof if self.depth > 0 => {
                let place = format!("byte {}", self.reader.buffer_position());
                Err(InputError::damaged(self.label, place, "it ends within an element"))
            }
            XmlEvent::Eof => Ok(Event::EndOfFile),
            XmlEvent::Comment(_) | XmlEvent::Decl(_) | XmlEvent::PI(_) | XmlEvent::DocType(_) => Ok(Event::Other),
        }
    }

    /// Reads past the end of the element that is `depth` deep.
    pub(super) fn skip_to_end_of(&mut self, depth: u32) -> Result<(), InputError> {
        while self.depth >= depth {
            self.next()?;
        }
        Ok(())
    }
}

/// The text of a reference. Entities that a file defines itself are not expanded.
fn reference_text<'b>(reference: &BytesRef<'_>, faults: &mut Vec<(&'static str, String)>) -> Event<'b> {
    let character = match reference.resolve_char_ref() {
        Ok(Some(character)) => Some(character),
        _ => match &**reference {
            "lt" => Some('<'),
            "gt" => Some('>'),
            "amp" => Some('&'),
            "quot" => Some('"'),
            "apos" => Some('\''),
            _ => None,
        },
    };
    match character {
        Some(character) => Event::Text(Cow::Owned(character.to_string())),
        None => {
            note_fault(faults, "entity not expanded", || cut(reference).to_owned());
            Event::Other
        }
    }
}

fn note_fault(faults: &mut Vec<(&'static str, String)>, kind: &'static str, detail: impl FnOnce() -> String) {
    if !faults.iter().any(|(known, _)| *known == kind) {
        faults.push((kind, detail()));
    }
}

fn cut(text: &str) -> &str {
    &text[..text.floor_char_boundary(64)]
}

fn input_error(label: &str, reader: &mut Reader<TextReader<'_>>, error: XmlError) -> InputError {
    match error {
        XmlError::Io(_) if reader.get_mut().is_event_too_long => InputError::TooLarge {
            path: label.to_owned(),
            what: format!("a tag or text at byte {}", reader.buffer_position()),
            limit: TextReader::max_event_bytes(),
        },
        XmlError::Io(cause) => InputError::io(label, io::Error::new(cause.kind(), cause.to_string())),
        error => InputError::damaged(label, format!("byte {}", reader.error_position()), error.to_string()),
    }
}

/// The value of an attribute without entities. A value with an invalid reference is kept as it is.
pub(super) fn attribute_value<'e>(attribute: &Attribute<'e>) -> Cow<'e, str> {
    attribute.normalized_value(XmlVersion::Implicit1_0).unwrap_or_else(|_| attribute.value.clone())
}

/// Files of converters declare the namespaces of all that they know, which are more than a hundred.
const MAX_NAMESPACES: usize = 1024;

/// Namespaces that are declared, by the elements that declare them.
struct Scopes {
    resolver: NamespaceResolver,
    /// The depth of each declaring element, and the names with prefix that were resolved within it.
    open: Vec<(u32, HashMap<Box<str>, NameId>)>,
    outside: HashMap<Box<str>, NameId>,
}

/// A resolved name, or why the namespaces are invalid.
struct Resolved {
    name: Result<NameId, String>,
    undeclared: Option<String>,
}

impl Default for Scopes {
    fn default() -> Self {
        let mut resolver = NamespaceResolver::default();
        resolver.set_max_namespace_bindings(MAX_NAMESPACES);
        Self { resolver, open: Vec::new(), outside: HashMap::new() }
    }
}

impl Scopes {
    /// Resolves the name of an element, `depth` deep, with the namespaces that it declares itself.
    fn open(&mut self, names: &mut Names, element: &BytesStart<'_>, depth: u32) -> Resolved {
        if element.attributes_raw().contains("xmlns") {
            if let Err(error) = self.resolver.push(element) {
                let what = match error {
                    NamespaceError::TooManyBindings(most) => {
                        format!("more than {most} namespaces are declared at once")
                    }
                    error => error.to_string(),
                };
                return Resolved { name: Err(what), undeclared: None };
            }
            self.open.push((depth, HashMap::new()));
        }
        let name = element.name();
        let raw: &str = cut_name(name.as_ref());
        let cache = self.open.last_mut().map_or(&mut self.outside, |(_, cache)| cache);
        if let Some(id) = cache.get(raw) {
            return Resolved { name: Ok(*id), undeclared: None };
        }
        let (namespace, local) = self.resolver.resolve_element(QName(raw));
        let (family, undeclared) = match namespace {
            ResolveResult::Bound(namespace) => (Family::of(namespace.0), None),
            ResolveResult::Unbound => (Family::Unknown, None),
            ResolveResult::Unknown(prefix) => (Family::Unknown, Some(prefix)),
        };
        let id = names.id_of(family, local.as_ref());
        if cache.len() < MAX_CACHED_NAMES {
            cache.insert(raw.into(), id);
        }
        Resolved { name: Ok(id), undeclared }
    }

    /// Ends the namespaces of an element that is `depth` deep.
    fn close(&mut self, depth: u32) {
        if self.open.last().is_some_and(|(declared, _)| *declared == depth) {
            self.open.pop();
            self.resolver.pop();
        }
    }
}

fn cut_name(name: &str) -> &str {
    &name[..name.floor_char_boundary(MAX_NAME_BYTES)]
}

impl Resolved {
    fn finish(
        self,
        label: &str,
        reader: &Reader<TextReader<'_>>,
        faults: &mut Vec<(&'static str, String)>,
    ) -> Result<NameId, InputError> {
        let place = || format!("byte {}", reader.buffer_position());
        if let Some(prefix) = self.undeclared {
            note_fault(faults, "namespace prefix not declared", || format!("{}: {}", place(), cut(&prefix)));
        }
        self.name.map_err(|what| InputError::damaged(label, place(), what))
    }
}
