//! Builds the tree of an object from the events of its file.

use super::coordinates::{Marks, push_positions, push_tuples, with_point};
use super::curves::points_of_curves;
use super::names::{Class, NameId, Names};
use super::tree::{
    AttributeKind, Content, Face, MAX_OBJECT_BYTES, MAX_OBJECT_DEPTH, Node, Ring, Tree, TreeAttribute,
    hash_of_reference,
};
use super::xml::{Event, XmlReader, attribute_value};
use insula_source::error::InputError;
use quick_xml::events::BytesStart;
use std::ops::Range;

/// An object with a longer list of coordinates is left out: short numbers take several times their length.
const MAX_LIST_BYTES: usize = 64 << 20;
/// Memory is measured after this many elements.
const MEASURE_INTERVAL: u32 = 256;

/// Outcome of [`build`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Built {
    Complete,
    /// The element is larger than allowed: the tree has only its beginning.
    TooLarge,
    /// The element is nested deeper than allowed: the tree has only its beginning.
    TooDeep,
}

/// What the builder has to know about the file.
pub(super) struct BuildContext<'c> {
    /// Numbers of a position where nothing else tells.
    pub(super) dimension: Option<u8>,
    /// Whether a surface or ring of that hash has a colour or texture, and so must stay apart.
    pub(super) has_appearance: &'c dyn Fn(u64) -> bool,
}

/// An element whose end is not yet read.
struct OpenElement {
    node: u32,
    class: Class,
    dimension: Option<u8>,
    /// Lengths of the tree's arrays after the element's own attributes.
    text_start: usize,
    attributes_end: usize,
    has_children: bool,
    /// The child that ended last.
    last_child: Option<u32>,
}

struct Builder<'t, 'c> {
    tree: &'t mut Tree,
    context: &'c BuildContext<'c>,
    open: Vec<OpenElement>,
    open_faces: u32,
    until_measured: u32,
    outcome: Built,
}

/// Reads an element, whose start is read already, into the tree. Reads to its end also if it is too large.
///
/// `start` adds the element itself, see [`start_tree`].
pub(super) fn build(
    reader: &mut XmlReader<'_>,
    tree: &mut Tree,
    context: &BuildContext<'_>,
) -> Result<Built, InputError> {
    let end_depth = reader.depth();
    let Some(root) = tree.nodes.first().map(|node| node.name) else { return Ok(Built::Complete) };
    let class = reader.names.class(root);
    let mut builder = Builder {
        tree,
        context,
        open: Vec::new(),
        open_faces: 0,
        until_measured: MEASURE_INTERVAL,
        outcome: Built::Complete,
    };
    builder.open_node(0, class);
    while !builder.open.is_empty() && builder.outcome == Built::Complete {
        match reader.next()? {
            Event::Start { name, class, element, is_empty } => {
                let is_pruned = builder.is_pruned(class);
                builder.start(name, class, &element);
                if is_pruned && !is_empty {
                    let depth = reader.depth();
                    reader.skip_to_end_of(depth)?;
                }
                if is_empty || is_pruned {
                    builder.end(&reader.names);
                }
            }
            Event::End => builder.end(&reader.names),
            Event::Text(text) => builder.text(&text),
            Event::Other => {}
            Event::EndOfFile => break,
        }
    }
    let outcome = builder.outcome;
    if outcome != Built::Complete {
        reader.skip_to_end_of(end_depth)?;
    }
    Ok(outcome)
}

/// Clears the tree and adds its root element.
pub(super) fn start_tree(tree: &mut Tree, name: NameId, element: &BytesStart<'_>) {
    tree.clear();
    add_node(tree, name, element);
}

fn add_node(tree: &mut Tree, name: NameId, element: &BytesStart<'_>) -> u32 {
    let node = tree.nodes.len() as u32;
    let first = tree.attributes.len() as u32;
    if !element.attributes_raw().is_empty() {
        for attribute in element.attributes().with_checks(false).flatten() {
            let Some(kind) = AttributeKind::of(attribute.key.local_name().as_ref()) else { continue };
            if attribute.key.prefix().is_some_and(|prefix| prefix.is_xmlns()) {
                continue;
            }
            let start = tree.text.len() as u32;
            tree.text.push_str(&attribute_value(&attribute));
            tree.attributes.push(TreeAttribute { kind, start, end: tree.text.len() as u32 });
        }
    }
    let attributes = (first, tree.attributes.len() as u32);
    tree.nodes.push(Node { name, end: node + 1, attributes, content: Content::None });
    node
}

impl Builder<'_, '_> {
    /// Whether the descendants of an element are not read.
    fn is_pruned(&self, class: Class) -> bool {
        match class {
            Class::Appearance | Class::Room | Class::Ignored | Class::LodLines => true,
            Class::Lines => self.open_faces == 0,
            _ => false,
        }
    }

    fn start(&mut self, name: NameId, class: Class, element: &BytesStart<'_>) {
        if self.open.len() >= MAX_OBJECT_DEPTH {
            self.outcome = Built::TooDeep;
            return;
        }
        self.until_measured -= 1;
        if self.until_measured == 0 {
            self.until_measured = MEASURE_INTERVAL;
            self.measure();
        }
        if let Some(parent) = self.open.last_mut().filter(|parent| !parent.has_children) {
            parent.has_children = true;
            self.tree.text.truncate(parent.text_start);
        }
        let node = add_node(self.tree, name, element);
        self.open_node(node, class);
    }

    fn open_node(&mut self, node: u32, class: Class) {
        let own = self.tree.attribute(node, AttributeKind::SrsDimension).and_then(|value| value.parse().ok());
        let dimension = own.or_else(|| self.open.last().and_then(|parent| parent.dimension));
        self.open_faces += u32::from(matches!(class, Class::Face | Class::Triangle));
        let (text_start, attributes_end) = (self.tree.text.len(), self.tree.attributes.len());
        let open =
            OpenElement { node, class, dimension, text_start, attributes_end, has_children: false, last_child: None };
        self.open.push(open);
    }

    fn measure(&mut self) {
        if self.tree.bytes() > MAX_OBJECT_BYTES {
            self.outcome = Built::TooLarge;
        }
    }

    fn text(&mut self, text: &str) {
        if self.open.last().is_some_and(|open| !open.has_children) {
            self.tree.text.push_str(text);
            if text.len() > MEASURE_INTERVAL as usize {
                self.measure();
            }
        }
    }

    fn end(&mut self, names: &Names) {
        let Some(open) = self.open.pop() else { return };
        let node = open.node;
        if let (Class::Envelope, Some(dimension), Some(root)) = (open.class, open.dimension, self.open.first_mut()) {
            root.dimension.get_or_insert(dimension);
        }
        if !open.has_children {
            self.end_leaf(&open);
        }
        self.tree.nodes[node as usize].end = self.tree.nodes.len() as u32;
        if open.has_children && open.class == Class::Coordinate {
            self.end_coordinate(node, names);
        }
        let is_face = matches!(open.class, Class::Face | Class::Triangle);
        if is_face {
            self.open_faces -= 1;
        }
        if is_face && self.open_faces == 0 {
            self.end_face(&open, names);
        }
        // The element is gone if its triangle was added to the one before it.
        let Some(Node { content, .. }) = self.tree.nodes.get(node as usize) else { return };
        let has_id = self.open_faces == 0 && !matches!(content, Content::Triangles { .. });
        if let Some(id) = self.tree.id_hash(node).filter(|_| has_id) {
            self.tree.ids.entry(id).or_insert(node);
        }
        if let Some(parent) = self.open.last_mut() {
            parent.last_child = Some(node);
        }
    }

    fn end_leaf(&mut self, open: &OpenElement) {
        let tree = &mut *self.tree;
        let decimal = tree.mark(open.node, AttributeKind::Decimal).unwrap_or('.');
        let marks = Marks {
            decimal,
            coordinate: tree.mark(open.node, AttributeKind::CoordinateMark).unwrap_or(','),
            tuple: tree.mark(open.node, AttributeKind::TupleMark).unwrap_or(' '),
        };
        let text = &tree.text[open.text_start..];
        let first = tree.points.len() as u32;
        let dimension = open.dimension.or(self.context.dimension);
        if text.len() > MAX_LIST_BYTES {
            self.outcome = Built::TooLarge;
            return;
        }
        match open.class {
            Class::Positions => push_positions(&with_point(text, decimal), dimension, &mut tree.points),
            Class::Position => push_positions(&with_point(text, decimal), None, &mut tree.points),
            Class::Coordinates => push_tuples(text, marks, &mut tree.points),
            _ => {
                let start = open.text_start + (text.len() - text.trim_start().len());
                let end = start + text.trim().len();
                tree.text.truncate(end);
                if end > start {
                    tree.nodes[open.node as usize].content = Content::Text { start: start as u32, end: end as u32 };
                }
                return;
            }
        }
        tree.text.truncate(open.text_start);
        tree.nodes[open.node as usize].content = Content::Points { start: first, end: tree.points.len() as u32 };
    }

    /// Reads `coord` of GML 2, whose numbers are elements.
    fn end_coordinate(&mut self, node: u32, names: &Names) {
        let tree = &mut *self.tree;
        let number = |name| {
            let text = tree.child_named(names, node, name).map(|child| tree.text_of(child).unwrap_or_default());
            text.map(|text| text.parse().unwrap_or(f64::NAN))
        };
        let point = [number("X").unwrap_or(f64::NAN), number("Y").unwrap_or(f64::NAN), number("Z").unwrap_or(0.0)];
        let start = tree.points.len() as u32;
        tree.points.push(point);
        tree.nodes[node as usize].content = Content::Points { start, end: start + 1 };
    }

    /// Replaces the elements of a face by its rings.
    fn end_face(&mut self, open: &OpenElement, names: &Names) {
        let tree = &mut *self.tree;
        let node = open.node;
        let first_ring = tree.rings.len();
        let mut child = node + 1;
        while let Some(Node { name, end, .. }) = tree.nodes.get(child as usize).copied() {
            let class = names.class(name);
            if matches!(class, Class::Exterior | Class::Interior) {
                let ring = ring_of(tree, names, child..end, class == Class::Interior);
                tree.rings.push(ring);
            }
            child = end;
        }
        let is_mergeable = open.class == Class::Triangle && self.is_plain_triangle(node, first_ring);
        let tree = &mut *self.tree;
        let srs = srs_within(tree, node, open.attributes_end);
        tree.nodes.truncate(node as usize + 1);
        tree.attributes.truncate(open.attributes_end);
        tree.text.truncate(open.text_start);
        tree.nodes[node as usize].end = node + 1;
        if let Some(srs) = srs {
            let start = tree.text.len() as u32;
            tree.text.push_str(&srs);
            tree.attributes.push(TreeAttribute { kind: AttributeKind::SrsName, start, end: tree.text.len() as u32 });
            tree.nodes[node as usize].attributes.1 = tree.attributes.len() as u32;
        }
        if is_mergeable {
            self.end_triangle(node, first_ring);
            return;
        }
        let rings = (tree.rings.len() - first_ring) as u32;
        tree.nodes[node as usize].content = Content::Face(tree.faces.len() as u32);
        tree.faces.push(Face { first_ring: first_ring as u32, rings });
    }

    /// Whether a triangle has three corners and no looks of its own. Its rings are those from `first_ring` on.
    fn is_plain_triangle(&self, node: u32, first_ring: usize) -> bool {
        let [ring] = &self.tree.rings[first_ring..] else { return false };
        let points = self.tree.points_of(ring);
        let is_plain = match points {
            [_, _, _] => true,
            [a, _, _, d] => a == d,
            _ => false,
        };
        let has_appearance = |id: u64| id != 0 && (self.context.has_appearance)(id);
        let is_last = ring.end as usize == self.tree.points.len();
        is_plain && is_last && !has_appearance(ring.id) && !self.tree.id_hash(node).is_some_and(has_appearance)
    }

    /// Keeps only the three points of a triangle, and adds it to the triangles right before it.
    fn end_triangle(&mut self, node: u32, first_ring: usize) {
        let tree = &mut *self.tree;
        let start = tree.rings[first_ring].start;
        tree.rings.truncate(first_ring);
        tree.points.truncate(start as usize + 3);
        let before = self.open.last().and_then(|parent| parent.last_child).filter(|before| before + 1 == node);
        let run = before.and_then(|before| tree.nodes.get_mut(before as usize)).map(|before| &mut before.content);
        match run {
            Some(Content::Triangles { end, .. }) if *end == start => {
                *end = start + 3;
                let (first, _) = tree.nodes[node as usize].attributes;
                if let Some(attribute) = tree.attributes.get(first as usize) {
                    tree.text.truncate(attribute.start as usize);
                }
                tree.attributes.truncate(first as usize);
                tree.nodes.truncate(node as usize);
            }
            _ => tree.nodes[node as usize].content = Content::Triangles { start, end: start + 3 },
        }
    }
}

/// The coordinate system that only the rings or positions of a face name. The attributes of the face itself end at `attributes_end`.
fn srs_within(tree: &Tree, face: u32, attributes_end: usize) -> Option<String> {
    let within = tree.attributes.get(attributes_end..)?;
    let found = within.iter().find(|attribute| attribute.kind == AttributeKind::SrsName)?;
    let has_own = tree.attribute(face, AttributeKind::SrsName).is_some();
    tree.text.get(found.start as usize..found.end as usize).filter(|_| !has_own).map(str::to_owned)
}

/// The ring among the elements of an exterior or interior.
fn ring_of(tree: &mut Tree, names: &Names, elements: Range<u32>, is_hole: bool) -> Ring {
    let mut ring = Ring { id: 0, start: 0, end: 0, is_hole, is_unread: false };
    let mut has_curves = false;
    for node in elements.clone() {
        let (element, class) = (tree.node(node), tree.class(names, node));
        has_curves |= matches!(class, Class::Arc | Class::Circle | Class::OrientableCurve | Class::OtherCurve)
            || tree.attribute(node, AttributeKind::Href).is_some();
        if let Content::Points { start, end } = element.content {
            ring.start = if ring.end == 0 { start } else { ring.start };
            ring.end = end;
        } else if class == Class::Ring && ring.id == 0 {
            ring.id = tree.attribute(node, AttributeKind::Id).map_or(0, hash_of_reference);
        }
    }
    if has_curves {
        let points = points_of_curves(tree, names, elements);
        ring.is_unread = points.is_none();
        ring.start = tree.points.len() as u32;
        tree.points.extend(points.unwrap_or_default());
        ring.end = tree.points.len() as u32;
    }
    ring
}
