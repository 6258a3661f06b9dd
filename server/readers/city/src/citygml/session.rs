//! The passes over a file.

use super::appearance::Appearances;
use super::codelists::Codelists;
use super::convert::Converter;
use super::decode::TextReader;
use super::elements::Elements;
use super::gather::{Gatherer, Scene};
use super::names::{Class, Family, Name};
use super::store::Store;
use super::tree::{AttributeKind, MAX_OBJECT_BYTES, Tree, hash_of_reference};
use super::tree_builder::{BuildContext, Built, build, start_tree};
use super::xml::{Event, XmlReader};
use encoding_rs::Encoding;
use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::object::{Description, ObjectSink, SurfaceRole};
use insula_source::unread_formats;
use std::cell::Cell;
use std::collections::HashSet;
use std::rc::Rc;

/// Further objects that refer to surfaces of later objects are read without those.
const MAX_DEFERRED: usize = 1 << 20;
/// Depth of the elements in the root element.
const MODEL_DEPTH: u32 = 2;

/// What is done with the objects of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Pass {
    /// Objects are passed on, unless they refer to surfaces of later objects.
    Main,
    /// Surfaces that other objects refer to are stored.
    Collect,
    /// The objects that the main pass left are passed on.
    Deferred,
}

/// State of reading one file.
pub(super) struct Session<'i, 's> {
    pub(super) input: &'s Input<'i>,
    pub(super) sink: &'s mut dyn ObjectSink,
    pub(super) appearances: Appearances,
    pub(super) store: Store,
    pub(super) codelists: Codelists<'i>,
    /// Coordinate system of the whole file.
    pub(super) model_srs: Option<String>,
    /// Coordinate system that the sink has; `None` if none is named.
    pub(super) current_srs: Option<String>,
    /// Numbers of a position in the whole file.
    dimension: Option<u8>,
    /// Of a file that says it is in UTF-8, and is not.
    encoding: Option<&'static Encoding>,
    /// Objects of this pass so far.
    count: u64,
    deferred: HashSet<u64>,
    /// Hashes of the identifiers that the deferred objects refer to.
    missing: HashSet<u64>,
}

impl<'i, 's> Session<'i, 's> {
    pub(super) fn new(
        input: &'s Input<'i>,
        sink: &'s mut dyn ObjectSink,
        appearances: Appearances,
        encoding: Option<&'static Encoding>,
    ) -> Self {
        Self {
            input,
            sink,
            appearances,
            store: Store::default(),
            codelists: Codelists::new(input.files, input.name),
            model_srs: None,
            current_srs: None,
            dimension: None,
            encoding,
            count: 0,
            deferred: HashSet::new(),
            missing: HashSet::new(),
        }
    }

    /// Whether the main pass left objects.
    pub(super) fn has_deferred(&self) -> bool {
        !self.deferred.is_empty()
    }

    /// Reads the whole file once.
    pub(super) fn run(&mut self, pass: Pass) -> Result<(), InputError> {
        self.count = 0;
        let open = self.input.open()?;
        let text = TextReader::new(self.input.label, open.reader, self.encoding)?;
        let mut reader = XmlReader::new(self.input.label, text);
        let mut result = self.run_reader(&mut reader, pass, &open.bytes_read);
        if pass == Pass::Main {
            if result.is_ok() && !reader.names.may_be_city_gml() {
                result = Err(unread_formats::plain_gml(self.input.label));
            }
            for (kind, detail) in std::mem::take(&mut reader.faults) {
                self.sink.problem(kind, detail);
            }
            if reader.has_invalid_bytes() {
                self.sink.problem("bytes invalid in the text encoding", "replaced".to_owned());
            }
        }
        result
    }

    fn run_reader(
        &mut self,
        reader: &mut XmlReader<'_>,
        pass: Pass,
        bytes_read: &Rc<Cell<u64>>,
    ) -> Result<(), InputError> {
        if read_root(reader, self.input.label)? {
            return Ok(());
        }
        let mut tree = Tree::default();
        loop {
            let (class, is_title) = match reader.next()? {
                Event::Start { name, class, element, is_empty } => {
                    if is_empty {
                        continue;
                    }
                    start_tree(&mut tree, name, &element);
                    (class, element.local_name().as_ref() == "name")
                }
                Event::End => return Ok(()),
                Event::EndOfFile => return Ok(()),
                Event::Text(_) | Event::Other => continue,
            };
            match class {
                Class::Member => self.read_members(reader, &mut tree, pass, bytes_read)?,
                Class::BoundedBy | Class::Boundary => self.read_envelope(reader, &mut tree)?,
                _ if is_title && pass == Pass::Main => self.read_title(reader, &mut tree)?,
                _ => reader.skip_to_end_of(MODEL_DEPTH)?,
            }
        }
    }

    fn build(&self, reader: &mut XmlReader<'_>, tree: &mut Tree) -> Result<Built, InputError> {
        let appearances = &self.appearances;
        let has_appearance = |id| appearances.has(id);
        build(reader, tree, &BuildContext { dimension: self.dimension, has_appearance: &has_appearance })
    }

    fn read_envelope(&mut self, reader: &mut XmlReader<'_>, tree: &mut Tree) -> Result<(), InputError> {
        self.build(reader, tree)?;
        let Some(envelope) = tree.child_of_class(&reader.names, 0, Class::Envelope) else { return Ok(()) };
        let dimension = tree.attribute(envelope, AttributeKind::SrsDimension).and_then(|text| text.parse().ok());
        self.dimension = self.dimension.or(dimension);
        let srs = tree.attribute(envelope, AttributeKind::SrsName).filter(|name| !name.is_empty());
        if let (None, Some(srs)) = (&self.model_srs, srs) {
            self.model_srs = Some(srs.to_owned());
            self.store.set_srs(srs);
        }
        Ok(())
    }

    fn read_title(&mut self, reader: &mut XmlReader<'_>, tree: &mut Tree) -> Result<(), InputError> {
        self.build(reader, tree)?;
        if let Some(title) = tree.text_of(0) {
            self.sink.describe(Description::Title, title);
        }
        Ok(())
    }

    /// Reads the objects of a property of the model.
    fn read_members(
        &mut self,
        reader: &mut XmlReader<'_>,
        tree: &mut Tree,
        pass: Pass,
        bytes_read: &Rc<Cell<u64>>,
    ) -> Result<(), InputError> {
        loop {
            let is_empty = match reader.next()? {
                Event::Start { name, element, is_empty, .. } => {
                    start_tree(tree, name, &element);
                    is_empty
                }
                Event::End | Event::EndOfFile => return Ok(()),
                Event::Text(_) | Event::Other => continue,
            };
            let built = if is_empty { Built::Complete } else { self.build(reader, tree)? };
            let elements = Elements { tree, names: &reader.names };
            if elements.names.local(tree.node(0).name) != "Appearance" {
                self.count += 1;
                match pass {
                    Pass::Main => self.read_object(elements, built)?,
                    Pass::Collect => self.collect(elements),
                    Pass::Deferred if self.deferred.contains(&self.count) => {
                        self.emit(elements, self.id_of(elements))?
                    }
                    Pass::Deferred => {}
                }
            }
            if pass == Pass::Main {
                self.sink.tick(bytes_read.get());
            }
        }
    }

    fn id_of(&self, elements: Elements<'_>) -> String {
        let id = elements.tree.attribute(0, AttributeKind::Id).filter(|id| !id.is_empty());
        let local = || elements.names.local(elements.tree.node(0).name);
        id.map_or_else(|| format!("{} {}", local(), self.count), str::to_owned)
    }

    fn read_object(&mut self, elements: Elements<'_>, built: Built) -> Result<(), InputError> {
        let id = self.id_of(elements);
        let name = elements.names.get(elements.tree.node(0).name);
        match built {
            Built::TooLarge => {
                let detail = format!("{id}: more than the limit of {MAX_OBJECT_BYTES} bytes");
                self.sink.skip("object too large", detail);
                return Ok(());
            }
            Built::TooDeep => {
                self.sink.skip("elements nested too deeply", id);
                return Ok(());
            }
            Built::Complete => {}
        }
        if name.family == Family::Gml {
            self.sink.skip("no city object", format!("{id}: its type is {}", name.local));
            return Ok(());
        }
        self.store_templates(elements);
        let missing = self.missing_targets(elements);
        let has_room = self.deferred.len() < MAX_DEFERRED && self.missing.len() < MAX_DEFERRED;
        if missing.is_empty() || !has_room {
            return self.emit(elements, id);
        }
        self.deferred.insert(self.count);
        self.missing.extend(missing);
        Ok(())
    }

    /// Hashes of the surfaces that the object refers to and that are not known yet.
    fn missing_targets(&self, elements: Elements<'_>) -> Vec<u64> {
        let Elements { tree, names } = elements;
        if !tree.attributes.iter().any(|attribute| attribute.kind == AttributeKind::Href) {
            return Vec::new();
        }
        let references =
            (0..tree.nodes.len() as u32).filter(|node| is_geometry_property(names.get(tree.node(*node).name)));
        let targets = references.filter_map(|node| tree.attribute(node, AttributeKind::Href)).map(hash_of_reference);
        targets.filter(|target| !tree.ids.contains_key(target) && self.store.get(*target).is_none()).collect()
    }

    /// Stores the templates of implicit geometry: later objects may refer to them.
    fn store_templates(&mut self, elements: Elements<'_>) {
        let Elements { tree, names } = elements;
        for property in 0..tree.nodes.len() as u32 {
            if tree.class(names, property) == Class::RelativeGeometry {
                for template in tree.children(property).collect::<Vec<_>>() {
                    self.store_geometry(elements, template);
                }
            }
        }
    }

    /// Stores the surfaces of the object that others refer to.
    fn collect(&mut self, elements: Elements<'_>) {
        let ids = &elements.tree.ids;
        let mut wanted: Vec<u32> =
            ids.iter().filter(|(id, _)| self.missing.contains(id)).map(|(_, node)| *node).collect();
        wanted.sort_unstable();
        for node in wanted {
            self.store_geometry(elements, node);
        }
    }

    fn store_geometry(&mut self, elements: Elements<'_>, node: u32) {
        let Elements { tree, names } = elements;
        let Some(id) = tree.id_hash(node).filter(|id| self.store.get(*id).is_none()) else { return };
        let mut pieces = Vec::new();
        let scene = Scene { tree, names, appearances: &self.appearances, store: &self.store };
        Gatherer::new(scene, &[], HashSet::new()).gather(node, SurfaceRole::Other, &mut pieces);
        let surfaces = Converter::new(tree, &mut self.appearances, self.sink).convert(&pieces);
        self.store.insert(id, surfaces.polygons, surfaces.meshes);
    }
}

/// Reads the start of the root element. Returns whether the model is empty. Fails if it is not CityGML.
fn read_root(reader: &mut XmlReader<'_>, label: &str) -> Result<bool, InputError> {
    loop {
        match reader.next()? {
            Event::Start { class, element, is_empty, .. } => {
                if matches!(class, Class::CityModel | Class::FeatureCollection) {
                    return Ok(is_empty);
                }
                let name = element.name();
                let name = name.as_ref();
                let name = &name[..name.floor_char_boundary(64)];
                let what =
                    format!("not CityGML: its root element is <{name}>, not <CityModel> of a namespace of CityGML");
                return Err(InputError::unsupported(label, what));
            }
            Event::EndOfFile => return Err(InputError::unsupported(label, "not CityGML: it has no XML element")),
            _ => {}
        }
    }
}

/// Whether an element may refer to surfaces.
fn is_geometry_property(name: &Name) -> bool {
    match name.class {
        Class::Lod(_) | Class::Footprint | Class::RoofEdge | Class::RelativeGeometry | Class::Exterior => true,
        Class::Interior => true,
        Class::Other if name.family == Family::Gml => name.local.ends_with("Member") || &*name.local == "baseSurface",
        Class::Other if name.family == Family::Unknown => {
            matches!(&*name.local, "surfaceMember" | "baseSurface" | "solidMember")
        }
        _ => false,
    }
}
