//! Walks through the nodes of a layer and passes on the objects of the finest ones.

use super::attributes::NodeAttributes;
use super::geometry::Layout;
use super::layer::{GeometryDefinitionJson, LayerJson};
use super::mesh::NodeMesh;
use super::nodes::{GeometrySource, Node, NodeId, NodeResources, Nodes};
use super::place::LayerPlace;
use super::resources::{Resource, Resources};
use super::{Objects, atlas, draco, materials};
use crate::tiles3d::kind;
use insula_source::attributes::Attributes;
use insula_source::error::InputError;
use insula_source::object::{ObjectSink, Shape, SourceObject, TriangleMesh, Wrap};
use insula_source::problems::{RELATIVE_HEIGHTS, UNIT_GUESSED};
use std::collections::HashSet;
use std::hash::{DefaultHasher, Hash, Hasher};

/// Layers with more nodes are refused.
const MAX_NODES: usize = 1 << 24;
/// Nodes are nested at most this deep.
const MAX_DEPTH: u32 = 256;
/// Layers of which more nodes cannot be read, and ten times more than can, are given up.
const MAX_FAULTS: u64 = 10_000;
/// Nodes may have the geometry of others this often. Each costs the work of a whole one, and a small file can name it without end.
const MAX_REPEATS: u64 = 1000;
/// Metres of a degree of latitude, rather too few.
const METRES_PER_DEGREE: f64 = 110_000.0;

pub(super) struct LayerReader<'r, 'f, 'a> {
    resources: Resources<'f, 'a>,
    layer: &'r LayerJson,
    objects: Objects<'r>,
    sink: &'r mut dyn ObjectSink,
    place: LayerPlace,
    visited: HashSet<NodeId>,
    /// Hashes of the paths of geometries, and how often one was read again.
    geometries: HashSet<u64>,
    repeats: u64,
    meshes: u64,
    faults: u64,
}

impl<'r, 'f, 'a> LayerReader<'r, 'f, 'a> {
    pub(super) fn new(
        resources: Resources<'f, 'a>,
        layer: &'r LayerJson,
        objects: Objects<'r>,
        sink: &'r mut dyn ObjectSink,
    ) -> Self {
        Self {
            resources,
            layer,
            objects,
            sink,
            place: LayerPlace::new(layer),
            visited: HashSet::new(),
            geometries: HashSet::new(),
            repeats: 0,
            meshes: 0,
            faults: 0,
        }
    }

    /// Passes on the objects of all finest nodes. Fails if there is no node at all, or if the run must end.
    pub(super) fn read(mut self) -> Result<(), InputError> {
        if let Some(crs) = &self.place.crs {
            self.sink.set_crs(crs)?;
        }
        if let Some(unit) = &self.place.unknown_unit {
            self.sink.problem(UNIT_GUESSED, format!("heights in {unit}, which is not known, taken as metres"));
        }
        if self.place.is_relative {
            let name = self.layer.name.as_deref().unwrap_or("layer");
            self.sink.problem(RELATIVE_HEIGHTS, name.to_owned());
        }
        let mut nodes = Nodes::new(self.layer);
        let mut first_error = None;
        for root in nodes.roots() {
            match nodes.get(&self.resources, &root) {
                Ok(node) => return self.visit(&mut nodes, &root, node, 0).map(|_| ()),
                Err(what) => {
                    first_error.get_or_insert(what);
                }
            }
        }
        let what = first_error.unwrap_or_else(|| "it has no nodes".to_owned());
        Err(InputError::damaged(self.resources.files.input.label, "root node", what))
    }

    /// Visits a node and everything below, the children first. Returns whether there was a mesh. The mesh of a node is taken
    /// only if nothing below it has one: each level of detail replaces the one above.
    fn visit(&mut self, nodes: &mut Nodes, id: &NodeId, node: Node, depth: u32) -> Result<bool, InputError> {
        if self.visited.len() >= MAX_NODES {
            let path = self.resources.files.input.label.to_owned();
            return Err(InputError::TooLarge { path, what: "its number of nodes".to_owned(), limit: MAX_NODES as u64 });
        }
        self.visited.insert(id.clone());
        if self.is_outside(&node) {
            return Ok(true);
        }
        let mut has_mesh = false;
        for child in &node.children {
            if self.visited.contains(child) {
                self.sink.problem("node has two parents or contains itself", format!("node {child}: below node {id}"));
                continue;
            }
            if depth >= MAX_DEPTH {
                self.skip("nodes are nested too deeply", format!("node {child}"))?;
                continue;
            }
            match nodes.get(&self.resources, child) {
                Ok(node) => has_mesh |= self.visit(nodes, child, node, depth + 1)?,
                Err(what) => self.skip("node cannot be read", format!("node {child}: {what}"))?,
            }
        }
        if has_mesh {
            return Ok(true);
        }
        let Some(mesh) = &node.mesh else { return Ok(false) };
        self.count_geometry(&mesh.geometry)?;
        match self.geometry(mesh) {
            Ok(geometry) => has_mesh = self.add_node(id, &node, mesh, geometry)?,
            Err(what) => self.skip("node cannot be read", format!("node {id}: {what}"))?,
        }
        self.sink.tick(self.resources.files.bytes_read());
        Ok(has_mesh)
    }

    /// Counts a node that is left out. Fails if there are too many.
    fn skip(&mut self, reason: &'static str, detail: String) -> Result<(), InputError> {
        self.sink.skip(reason, detail);
        self.faults += 1;
        if self.faults > MAX_FAULTS.max(10 * self.meshes) {
            let what = format!("{} nodes cannot be read", self.faults);
            return Err(InputError::damaged(self.resources.files.input.label, "nodes", what));
        }
        Ok(())
    }

    /// Notes a geometry, which one node has. Fails if too many have that of another.
    fn count_geometry(&mut self, geometry: &GeometrySource) -> Result<(), InputError> {
        let (GeometrySource::Schema { path } | GeometrySource::Defined { folder: path, .. }) = geometry;
        let mut hasher = DefaultHasher::new();
        path.hash(&mut hasher);
        if !self.geometries.insert(hasher.finish()) {
            self.repeats += 1;
        }
        if self.repeats > MAX_REPEATS {
            let label = self.resources.files.input.label.to_owned();
            let what = format!("the number of nodes that share a geometry such as {path}");
            return Err(InputError::TooLarge { path: label, what, limit: MAX_REPEATS });
        }
        Ok(())
    }

    /// Whether a node is certainly outside of the wanted part.
    fn is_outside(&self, node: &Node) -> bool {
        let Some([west, south, east, north]) = self.resources.files.input.bbox_deg.filter(|_| self.place.is_in_degrees)
        else {
            return false;
        };
        let [lon, lat, _] = node.center;
        let reach = node.radius_m / METRES_PER_DEGREE;
        let narrow = libm::cos((lat.abs() + reach).min(89.0).to_radians());
        let is_apart = |at: f64, reach: f64, from: f64, to: f64| at + reach < from || at - reach > to;
        let east = if east < west { east + 360.0 } else { east };
        is_apart(lat, reach, south, north)
            || [-360.0, 0.0, 360.0].iter().all(|turn| is_apart(lon + turn, reach / narrow, west, east))
    }

    /// Reads the geometry of a node. Fails with what is wrong.
    fn geometry(&self, mesh: &NodeResources) -> Result<NodeMesh, String> {
        match &mesh.geometry {
            GeometrySource::Schema { path } => {
                let store = self.layer.store.as_ref();
                let schema = store.and_then(|store| store.default_geometry_schema.as_ref());
                let layout = Layout::of_schema(schema.ok_or("the layer has no geometry schema")?)?;
                self.decode(path, Some(&layout), mesh.counts)
            }
            GeometrySource::Defined { folder, definition } => {
                let definitions = self.layer.geometry_definitions.as_deref().unwrap_or_default();
                let definition = definitions.get(*definition as usize);
                self.defined_geometry(folder, definition.ok_or("its geometry definition does not exist")?, mesh.counts)
            }
        }
    }

    /// Reads the first buffer of a definition that is there; those that are not compressed first.
    fn defined_geometry(
        &self,
        folder: &str,
        definition: &GeometryDefinitionJson,
        counts: [Option<u64>; 2],
    ) -> Result<NodeMesh, String> {
        let mut buffers: Vec<_> = definition.geometry_buffers.iter().enumerate().collect();
        buffers.sort_by_key(|(_, buffer)| buffer.compressed_attributes.is_some());
        let mut first_error = None;
        for (i, buffer) in buffers {
            let layout = match &buffer.compressed_attributes {
                Some(_) => Ok(None),
                None => Layout::of_definition(buffer).map(Some),
            };
            let decoded =
                layout.and_then(|layout| self.decode(&format!("{folder}/geometries/{i}"), layout.as_ref(), counts));
            match decoded {
                Ok(geometry) => return Ok(geometry),
                Err(what) => {
                    first_error.get_or_insert(what);
                }
            }
        }
        Err(first_error.unwrap_or_else(|| "its geometry definition has no buffers".to_owned()))
    }

    fn decode(&self, path: &str, layout: Option<&Layout>, counts: [Option<u64>; 2]) -> Result<NodeMesh, String> {
        let (_, bytes) = self.resources.read(path, Resource::Binary).map_err(|error| format!("{path}: {error}"))?;
        let decoded = match layout {
            Some(layout) if !bytes.starts_with(draco::MAGIC) => layout.decode(&bytes, counts),
            _ => draco::decode(&bytes, self.resources.files.input.max_bytes),
        };
        decoded.map_err(|what| format!("{path}: {what}"))
    }

    /// Passes on the objects of a node. Returns whether there were any.
    fn add_node(
        &mut self,
        id: &NodeId,
        node: &Node,
        source: &NodeResources,
        mut geometry: NodeMesh,
    ) -> Result<bool, InputError> {
        if node.center.iter().any(|number| !number.is_finite()) {
            self.skip("node has no centre", format!("node {id}"))?;
            return Ok(false);
        }
        let Self { sink, resources, layer, .. } = &mut *self;
        let mut fault = |kind: &'static str, detail: String| sink.problem(kind, format!("node {id}: {detail}"));
        let mut material = materials::read(resources, layer, &source.material, &mut fault);
        if let Some(texture) = material.as_mut().and_then(|material| material.texture.as_mut()) {
            if atlas::has_regions(&geometry) {
                let stretched = atlas::flatten(&mut geometry);
                texture.wrap = Wrap::Clamp;
                if stretched > 0 {
                    fault("texture repeats too often", format!("{stretched} triangles"));
                }
            }
        } else {
            geometry.uv.clear();
        }
        let attributes = source.attributes.as_ref().map(|folder| {
            let storage = layer.attribute_storage_info.as_deref().unwrap_or_default();
            let fields = layer.fields.as_deref().unwrap_or_default();
            NodeAttributes::read(resources, folder, (storage, fields), &mut fault)
        });
        let material = material.map(|material| sink.add_material(material));
        let (center, unit, raised) = (node.center, self.place.height_unit_m, self.place.height_offset_m);
        let place = |[x, y, z]: [f64; 3]| [center[0] + x, center[1] + y, (center[2] + z) * unit + raised];
        let parts = geometry.by_feature(&place, material);
        let mut seen = vec![false; geometry.features.len()];
        let has_objects = !parts.is_empty();
        self.meshes += 1;
        for (feature, mesh) in parts {
            feature.and_then(|feature| seen.get_mut(feature)).into_iter().for_each(|seen| *seen = true);
            let attributes = feature.and_then(|feature| Some(attributes.as_ref()?.get(feature))).unwrap_or_default();
            let number = feature.and_then(|feature| geometry.features.get(feature)).copied();
            self.add_feature(id, number, attributes, mesh)?;
        }
        let unseen = seen.iter().zip(&geometry.features).filter(|(seen, _)| !**seen);
        for (_, feature) in unseen {
            self.sink.skip("feature has no triangles", format!("{feature}: in node {id}"));
        }
        Ok(has_objects)
    }

    fn add_feature(
        &mut self,
        node: &NodeId,
        feature: Option<u64>,
        attributes: Attributes,
        mesh: TriangleMesh,
    ) -> Result<(), InputError> {
        // An integrated mesh has one feature in each node, which is nothing but the node.
        let is_whole = self.objects.source_type == "IntegratedMesh" || feature.is_none();
        let own_id = kind::id_of(&attributes).filter(|_| !is_whole);
        let class = kind::class_of(&attributes);
        let object = SourceObject {
            id: own_id.unwrap_or_else(|| match feature {
                Some(feature) if !is_whole => feature.to_string(),
                _ => format!("node {node}"),
            }),
            parent: None,
            kind: class.and_then(kind::kind_of_name).unwrap_or(self.objects.kind),
            source_type: self.objects.source_type.to_owned(),
            lod: kind::lod_of(&attributes),
            attributes,
            shape: Shape::Surfaces { polygons: Vec::new(), meshes: vec![mesh] },
        };
        self.sink.add(object)
    }
}
