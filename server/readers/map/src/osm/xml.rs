//! Files in the XML form of OpenStreetMap, `.osm` and `.osm.gz`, also those of JOSM and of the Overpass API.
//!
//! The Overpass API writes no nodes for `out geom`, but their positions where ways and relations name them. Such a position is a node of
//! its own, and a way that only relations have is read where it is a member.

use super::element::{
    Element, ElementFile, ElementId, Member, Pass, Position, Tags, UNITS_PER_DEGREE, Visit, id_of_position, of_history,
    position,
};
use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::object::ObjectSink;
use insula_source::text::in_declared_encoding;
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};
use std::cell::Cell;
use std::io::{self, BufRead, Read};
use std::ops::{ControlFlow, Range};
use std::rc::Rc;

/// Longer tags of XML are refused. Values of OpenStreetMap have at most 255 characters.
const MAX_EVENT_BYTES: u64 = 4 << 20;
/// The elements of OpenStreetMap are nested three deep.
const MAX_DEPTH: usize = 64;
/// Nodes of a way, members of a relation and bytes of tags beyond it are refused.
const MAX_PARTS: usize = 1 << 20;
const MAX_TAG_BYTES: usize = 16 << 20;
/// Identifier for nodes outside of the area that was asked for; no node has it.
const OUTSIDE_ID: i64 = i64::MAX;

pub(super) struct XmlFile<'a> {
    input: Input<'a>,
    extent: Option<[Position; 2]>,
}

impl<'a> XmlFile<'a> {
    pub(super) fn new(input: &Input<'a>) -> Self {
        Self { input: *input, extent: None }
    }
}

impl ElementFile for XmlFile<'_> {
    fn read_through(
        &mut self,
        pass: Pass<'_>,
        sink: &mut dyn ObjectSink,
        visit: &mut Visit<'_>,
    ) -> Result<(), InputError> {
        let opened = self.input.open()?;
        let event_bytes = Rc::new(Cell::new(0));
        let inner = in_declared_encoding(self.input.label, opened.reader)?;
        let limited = EventLimit { inner, event_bytes: Rc::clone(&event_bytes) };
        let mut reader = Reader::from_reader(limited);
        let (mut parser, mut buffer) = (Parser::new(&pass), Vec::new());
        loop {
            buffer.clear();
            event_bytes.set(0);
            let event = reader.read_event_into(&mut buffer);
            let step = match event {
                Ok(event) => parser.event(event),
                Err(quick_xml::Error::Io(cause)) => {
                    return Err(InputError::io(self.input.label, io::Error::new(cause.kind(), cause.to_string())));
                }
                Err(fault) => Err(fault.to_string()),
            };
            let place =
                |fault| InputError::damaged(self.input.label, format!("byte {}", reader.buffer_position()), fault);
            match step.map_err(place)? {
                Step::Nothing => {}
                Step::Extent(extent) => self.extent = Some(extent),
                Step::Element => {
                    if parser.visit(sink, visit)?.is_break() {
                        return Ok(());
                    }
                }
                Step::Foreign(root) => {
                    return Err(InputError::unsupported(
                        self.input.label,
                        format!("XML with the root {root} is no map of OpenStreetMap, whose root is osm"),
                    ));
                }
                Step::History(element) => {
                    return Err(of_history(self.input.label, &format!("{element} has several versions")));
                }
                Step::End => return Ok(()),
            }
            if matches!(pass, Pass::First) {
                sink.tick(opened.bytes_read.get() / 2);
            }
        }
    }

    fn extent(&self) -> Option<[Position; 2]> {
        self.extent
    }
}

/// Fails when an event has too many bytes.
struct EventLimit<R> {
    inner: R,
    event_bytes: Rc<Cell<u64>>,
}

impl<R: BufRead> Read for EventLimit<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(buffer)?;
        self.consume(count);
        Ok(count)
    }
}

impl<R: BufRead> BufRead for EventLimit<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.event_bytes.get() > MAX_EVENT_BYTES {
            return Err(io::Error::other("a tag of XML has too many bytes"));
        }
        self.inner.fill_buf()
    }

    fn consume(&mut self, count: usize) {
        self.event_bytes.set(self.event_bytes.get() + count as u64);
        self.inner.consume(count);
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Node,
    Way,
    Relation,
}

impl Kind {
    fn name(self) -> &'static str {
        ["node", "way", "relation"][self as usize]
    }
}

/// What an event of XML led to.
#[derive(Debug, PartialEq, Eq)]
enum Step {
    Nothing,
    /// The area that the file says it has.
    Extent([Position; 2]),
    /// An element is whole.
    Element,
    /// The root is none of a map.
    Foreign(String),
    /// An element is there in several versions.
    History(String),
    End,
}

/// Puts the element together whose tags of XML are read.
#[derive(Default)]
struct Parser {
    wants: [bool; 3],
    wants_tags: bool,
    wants_members: bool,
    is_first: bool,
    /// Numbers of the ways that are visited.
    ways: Range<u64>,
    /// Number of the next way.
    way: u64,
    depth: usize,
    has_root: bool,
    is_closed: bool,
    current: Option<Kind>,
    id: Option<i64>,
    version: Option<u64>,
    /// The element before, with its version.
    before: Option<(Kind, i64, u64)>,
    position: Option<Position>,
    has_position: bool,
    is_deleted: bool,
    /// Whether the current way is a member of a relation. It has no number.
    is_member: bool,
    refs: Vec<i64>,
    /// Elements with the places of their roles in `text`.
    members: Vec<(Option<ElementId>, [u32; 2])>,
    text: Vec<u8>,
    spans: Vec<[u32; 4]>,
    /// A fault of the current element that costs a part of it.
    fault: Option<&'static str>,
}

impl Parser {
    fn new(pass: &Pass<'_>) -> Self {
        let ways = if let Pass::Ways(ways) = pass { ways.clone() } else { 0..u64::MAX };
        let wants = match pass {
            Pass::First => [true; 3],
            Pass::Ways(_) => [false, true, false],
            Pass::Nodes(_) => [true, false, false],
        };
        Self {
            wants,
            wants_tags: !matches!(pass, Pass::Nodes(_)),
            // They come after all ways.
            wants_members: matches!(pass, Pass::Ways(ways) if ways.end == u64::MAX),
            is_first: matches!(pass, Pass::First),
            ways,
            ..Self::default()
        }
    }

    /// Takes an event. Fails with the reason if the XML is damaged.
    fn event(&mut self, event: Event<'_>) -> Result<Step, String> {
        match event {
            Event::Start(tag) => {
                self.depth += 1;
                if self.depth > MAX_DEPTH {
                    return Err("tags of XML are nested too deep".to_owned());
                }
                self.open(&tag)
            }
            Event::Empty(tag) => {
                let is_root = self.depth == 0;
                let step = self.open(&tag)?;
                Ok(match step {
                    Step::Nothing if is_root => {
                        self.is_closed = true;
                        Step::Nothing
                    }
                    Step::Nothing if element_kind(&tag).is_some() => self.close(),
                    Step::Nothing if self.is_member && tag.name().as_ref() == "member" => self.close_member(),
                    step => step,
                })
            }
            Event::End(tag) => {
                self.depth = self.depth.saturating_sub(1);
                Ok(match tag.name().as_ref() {
                    "node" | "way" | "relation" => self.close(),
                    "member" if self.is_member => self.close_member(),
                    _ => {
                        self.is_closed |= self.depth == 0;
                        Step::Nothing
                    }
                })
            }
            // The packed form has a checksum after the end of the map.
            Event::Eof if self.is_closed => Ok(Step::End),
            Event::Eof if self.has_root => Err("the file ends within the map".to_owned()),
            Event::Eof => Err("no map of OpenStreetMap".to_owned()),
            _ => Ok(Step::Nothing),
        }
    }

    fn open(&mut self, tag: &BytesStart<'_>) -> Result<Step, String> {
        let name = tag.name();
        if !self.has_root {
            self.has_root = true;
            let is_map = name.as_ref() == "osm";
            return Ok(if is_map { Step::Nothing } else { Step::Foreign(name.as_ref().chars().take(64).collect()) });
        }
        if self.is_closed {
            return Ok(Step::Nothing);
        }
        if let Some(kind) = element_kind(tag) {
            self.current = self.wants[kind as usize].then_some(kind);
            if self.current.is_some() {
                self.begin(tag)?;
            }
            return Ok(self.history(kind).map_or(Step::Nothing, Step::History));
        }
        match (name.as_ref(), self.current) {
            // Ways of the Overpass API have bounds, too.
            ("bounds", None) if self.is_first => return Ok(extent(tag)?.map_or(Step::Nothing, Step::Extent)),
            ("tag", Some(_)) if self.wants_tags => self.add_tag(tag)?,
            ("nd", Some(Kind::Way)) => self.add_ref(tag)?,
            ("nd", None) if self.wants[Kind::Node as usize] => return self.node_of_way(tag),
            ("member", Some(Kind::Relation)) => self.add_member(tag)?,
            ("member", None) if self.wants_members => self.begin_member(tag)?,
            _ => {}
        }
        Ok(Step::Nothing)
    }

    fn begin(&mut self, tag: &BytesStart<'_>) -> Result<(), String> {
        self.clear();
        let (mut lon, mut lat) = (None, None);
        for attribute in tag.attributes().with_checks(false) {
            let attribute = attribute.map_err(|fault| fault.to_string())?;
            let value = &*attribute.value;
            match attribute.key.as_ref() {
                "id" => self.id = value.trim().parse().ok(),
                "lon" => (lon, self.has_position) = (units(value), true),
                "lat" => (lat, self.has_position) = (units(value), true),
                "version" => self.version = value.trim().parse().ok(),
                "visible" => self.is_deleted |= value == "false",
                "action" => self.is_deleted |= value == "delete",
                _ => {}
            }
        }
        self.position = lon.zip(lat).and_then(|(lon, lat)| position(lon, lat));
        Ok(())
    }

    /// The name of the element that begins, if the one before is another version of it.
    fn history(&mut self, kind: Kind) -> Option<String> {
        let own = self.id.zip(self.version).map(|(id, version)| (kind, id, version)).filter(|_| self.is_first)?;
        let before = self.before.replace(own)?;
        let is_other_version = (before.0, before.1) == (own.0, own.1) && before.2 != own.2;
        is_other_version.then(|| format!("{}/{}", kind.name(), own.1))
    }

    fn clear(&mut self) {
        self.version = None;
        (self.id, self.position, self.has_position, self.is_deleted, self.fault) = (None, None, false, false, None);
        self.is_member = false;
        self.refs.clear();
        self.members.clear();
        self.text.clear();
        self.spans.clear();
    }

    /// Begins the way that is a member of a relation.
    fn begin_member(&mut self, tag: &BytesStart<'_>) -> Result<(), String> {
        if text(tag, "type")?.as_deref() == Some("way") {
            self.clear();
            (self.id, self.current, self.is_member) = (integer(tag, "ref")?, Some(Kind::Way), true);
        }
        Ok(())
    }

    /// Ends a member. It is a way of its own if it has nodes.
    fn close_member(&mut self) -> Step {
        if self.refs.is_empty() {
            self.current = None;
        }
        self.close()
    }

    /// The node at the position of a place in a way.
    fn node_of_way(&mut self, tag: &BytesStart<'_>) -> Result<Step, String> {
        let Some(position) = position_of(tag)? else { return Ok(Step::Nothing) };
        self.clear();
        (self.id, self.position, self.current) = (Some(id_of_position(position)), Some(position), Some(Kind::Node));
        Ok(Step::Element)
    }

    fn add_tag(&mut self, tag: &BytesStart<'_>) -> Result<(), String> {
        let (mut key, mut value) = (None, None);
        for attribute in tag.attributes().with_checks(false) {
            let attribute = attribute.map_err(|fault| fault.to_string())?;
            let place = match attribute.key.as_ref() {
                "k" => &mut key,
                "v" => &mut value,
                _ => continue,
            };
            let start = self.text.len() as u32;
            match attribute.normalized_value(XmlVersion::Implicit1_0) {
                Ok(text) if self.text.len() + text.len() <= MAX_TAG_BYTES => {
                    self.text.extend_from_slice(text.as_bytes());
                    *place = Some([start, self.text.len() as u32]);
                }
                _ => self.fault = Some("tag not understood"),
            }
        }
        match (key, value) {
            (Some([a, b]), Some([c, d])) if self.spans.len() < MAX_PARTS => self.spans.push([a, b, c, d]),
            _ => self.fault = Some("tag not understood"),
        }
        Ok(())
    }

    fn add_ref(&mut self, tag: &BytesStart<'_>) -> Result<(), String> {
        let id = match position_of(tag)? {
            Some(position) => Some(id_of_position(position)),
            None => integer(tag, "ref")?.or(self.is_member.then_some(OUTSIDE_ID)),
        };
        match id {
            Some(id) if self.refs.len() < MAX_PARTS => self.refs.push(id),
            _ => self.fault = Some("node of a way not understood"),
        }
        Ok(())
    }

    fn add_member(&mut self, tag: &BytesStart<'_>) -> Result<(), String> {
        let Some(id) = integer(tag, "ref")?.filter(|_| self.members.len() < MAX_PARTS) else {
            self.fault = Some("member of a relation not understood");
            return Ok(());
        };
        let (mut element, mut role) = (None, [0, 0]);
        for attribute in tag.attributes().with_checks(false) {
            let attribute = attribute.map_err(|fault| fault.to_string())?;
            match (attribute.key.as_ref(), &*attribute.value) {
                ("type", "way") => element = Some(ElementId::Way(id)),
                ("type", "relation") => element = Some(ElementId::Relation(id)),
                ("role", text) if self.text.len() + text.len() <= MAX_TAG_BYTES => {
                    let start = self.text.len() as u32;
                    self.text.extend_from_slice(text.as_bytes());
                    role = [start, self.text.len() as u32];
                }
                _ => {}
            }
        }
        self.members.push((element, role));
        Ok(())
    }

    fn close(&mut self) -> Step {
        if self.current.is_some() && !self.is_deleted { Step::Element } else { Step::Nothing }
    }

    /// Visits the current element.
    fn visit(&mut self, sink: &mut dyn ObjectSink, visit: &mut Visit<'_>) -> Result<ControlFlow<()>, InputError> {
        let Some(kind) = self.current.take() else { return Ok(ControlFlow::Continue(())) };
        let name = kind.name();
        let Some(id) = self.id else {
            if self.is_first {
                sink.problem("element without a valid identifier", name.to_owned());
            }
            return Ok(ControlFlow::Continue(()));
        };
        if let Some(fault) = self.fault.filter(|_| self.is_first) {
            sink.problem(fault, format!("{name}/{id}"));
        }
        let tags = Tags { text: &self.text, spans: &self.spans };
        match (kind, self.position) {
            (Kind::Node, Some(position)) => visit(Element::Node { id, position, tags }, sink),
            (Kind::Node, None) => {
                if self.is_first && self.has_position {
                    sink.problem("node outside of the world", format!("node/{id}"));
                }
                Ok(ControlFlow::Continue(()))
            }
            (Kind::Way, _) if self.is_member => {
                visit(Element::Way { id, number: u64::MAX, refs: &self.refs, tags }, sink)
            }
            (Kind::Way, _) => {
                let number = self.way;
                self.way += 1;
                if number >= self.ways.end {
                    return Ok(ControlFlow::Break(()));
                }
                if number < self.ways.start {
                    return Ok(ControlFlow::Continue(()));
                }
                visit(Element::Way { id, number, refs: &self.refs, tags }, sink)
            }
            (Kind::Relation, _) => {
                let role = |[from, to]: [u32; 2]| self.text.get(from as usize..to as usize).unwrap_or_default();
                let members: Vec<Member<'_>> = self
                    .members
                    .iter()
                    .map(|(element, span)| Member { element: *element, role: role(*span) })
                    .collect();
                visit(Element::Relation { id, members: &members, tags }, sink)
            }
        }
    }
}

fn element_kind(tag: &BytesStart<'_>) -> Option<Kind> {
    match tag.name().as_ref() {
        "node" => Some(Kind::Node),
        "way" => Some(Kind::Way),
        "relation" => Some(Kind::Relation),
        _ => None,
    }
}

/// South-western and north-eastern corner of bounds; `None` if they are not whole or not valid.
fn extent(tag: &BytesStart<'_>) -> Result<Option<[Position; 2]>, String> {
    let mut sides = [None; 4];
    for attribute in tag.attributes().with_checks(false) {
        let attribute = attribute.map_err(|fault| fault.to_string())?;
        let names = ["minlon", "minlat", "maxlon", "maxlat"];
        if let Some(side) = names.iter().position(|name| *name == attribute.key.as_ref()) {
            sides[side] = units(&attribute.value);
        }
    }
    let [Some(west), Some(south), Some(east), Some(north)] = sides else { return Ok(None) };
    Ok(position(west, south).zip(position(east, north)).map(Into::into))
}

/// Degrees of a text in units of positions.
fn units(degrees: &str) -> Option<i64> {
    let units = (degrees.trim().parse::<f64>().ok()? * UNITS_PER_DEGREE).round();
    (units.abs() < 4e9).then_some(units as i64)
}

/// The position of a tag with `lon` and `lat`.
fn position_of(tag: &BytesStart<'_>) -> Result<Option<Position>, String> {
    let (mut lon, mut lat) = (None, None);
    for attribute in tag.attributes().with_checks(false) {
        let attribute = attribute.map_err(|fault| fault.to_string())?;
        match attribute.key.as_ref() {
            "lon" => lon = units(&attribute.value),
            "lat" => lat = units(&attribute.value),
            _ => {}
        }
    }
    Ok(lon.zip(lat).and_then(|(lon, lat)| position(lon, lat)))
}

/// The whole number of an attribute.
fn integer(tag: &BytesStart<'_>, name: &str) -> Result<Option<i64>, String> {
    Ok(text(tag, name)?.and_then(|value| value.trim().parse().ok()))
}

/// The value of an attribute as it is written.
fn text(tag: &BytesStart<'_>, name: &str) -> Result<Option<String>, String> {
    for attribute in tag.attributes().with_checks(false) {
        let attribute = attribute.map_err(|fault| fault.to_string())?;
        if attribute.key.as_ref() == name {
            return Ok(Some(attribute.value.to_string()));
        }
    }
    Ok(None)
}
