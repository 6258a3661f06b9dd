//! A `.gltf` or `.glb` file as a source of its own.

use super::{FeatureIdValues, FeatureIds, GltfOptions, GltfPrimitive, GltfScene, decode, z_up};
use insula_source::attributes::Attributes;
use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::object::{CrsReference, Description, FeatureKind, ObjectSink, Shape, SourceObject, TriangleMesh};
use std::collections::{BTreeMap, HashMap};
use std::io::{self, Read};

/// Bytes of memory of a decoded vertex, with its triangles.
const BYTES_PER_VERTEX: u64 = 64;
/// Decoded geometry is larger than in the file: 64 bits for 32, and copies of shared meshes.
const DECODED_SIZE: u64 = 4;
/// Squared semi-axes of the WGS84 ellipsoid.
const SEMI_MAJOR_M: f64 = 6_378_137.0;
const SEMI_MINOR_M: f64 = 6_356_752.314_245;

/// Reads a `.gltf` or `.glb` file. With a property table, each of its features becomes an object; otherwise each node with a
/// mesh, together with the nodes below it, or each instance. Positions are metres east, north and up of a place that the
/// caller sets, unless the file states a geocentric centre (CESIUM_RTC).
pub fn read(input: &Input<'_>, sink: &mut dyn ObjectSink) -> Result<(), InputError> {
    let bytes = input.read_all(input.max_bytes)?;
    let folder = input.name.rsplit_once('/').map_or(String::new(), |(folder, _)| format!("{folder}/"));
    let resources = |path: &str| -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let file = input.files.open(&format!("{folder}{path}"))?;
        file.take(input.max_bytes.saturating_add(1)).read_to_end(&mut bytes)?;
        if bytes.len() as u64 > input.max_bytes { Err(io::Error::other("larger than allowed")) } else { Ok(bytes) }
    };
    let max_bytes = input.max_bytes.saturating_mul(DECODED_SIZE);
    let options = GltfOptions { max_bytes, max_vertices: max_bytes / BYTES_PER_VERTEX, loads_images: false };
    let mut scene = decode(input.label, &bytes, &resources, &options)?;
    drop(bytes);
    for (kind, detail) in std::mem::take(&mut scene.problems) {
        sink.problem(kind, detail);
    }
    if let Some(copyright) = scene.copyright.as_deref().filter(|text| !text.is_empty()) {
        sink.describe(Description::Attribution, copyright);
    }
    let geocentric = scene.rtc_center.filter(|center| is_on_globe(*center));
    if geocentric.is_some() {
        sink.set_crs(&CrsReference::east_first("ECEF"))?;
    }
    let primitives = std::mem::take(&mut scene.primitives);
    let objects = ObjectBuilder::new(&scene, sink).build(primitives);
    for object in objects {
        sink.add(object)?;
    }
    sink.tick(input.files.len(input.name).unwrap_or(0));
    Ok(())
}

/// Whether a point is within 100 km of the ellipsoid.
fn is_on_globe([x, y, z]: [f64; 3]) -> bool {
    let radius = ((x * x + y * y) / (SEMI_MAJOR_M * SEMI_MAJOR_M) + z * z / (SEMI_MINOR_M * SEMI_MINOR_M)).sqrt();
    (radius - 1.0).abs() < 100_000.0 / SEMI_MAJOR_M
}

/// What an object is made of, in the order of the objects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum ObjectKey {
    Node { node: usize, instance: Option<u32> },
    Feature { table: usize, feature: u32 },
}

/// An object that is not complete yet.
#[derive(Default)]
struct OpenObject {
    meshes: Vec<TriangleMesh>,
    attributes: Attributes,
}

struct ObjectBuilder<'a> {
    scene: &'a GltfScene,
    sink: &'a mut dyn ObjectSink,
    /// Numbers of the materials that the sink knows.
    materials: HashMap<usize, u32>,
    /// By node.
    owners: HashMap<usize, usize>,
    objects: BTreeMap<ObjectKey, OpenObject>,
}

impl<'a> ObjectBuilder<'a> {
    fn new(scene: &'a GltfScene, sink: &'a mut dyn ObjectSink) -> Self {
        let owners = scene.mesh_nodes.iter().map(|node| (node.node, node.owner)).collect();
        Self { scene, sink, materials: HashMap::new(), owners, objects: BTreeMap::new() }
    }

    fn build(mut self, primitives: Vec<GltfPrimitive>) -> Vec<SourceObject> {
        for primitive in primitives {
            self.add(&primitive);
        }
        self.report_lost();
        let mut seen = HashMap::new();
        let names: HashMap<usize, &str> =
            self.scene.mesh_nodes.iter().filter_map(|node| Some((node.node, node.name.as_deref()?))).collect();
        let mut objects = Vec::with_capacity(self.objects.len());
        for (key, open) in std::mem::take(&mut self.objects) {
            let (id, source_type) = self.name(key, &names);
            objects.push(SourceObject {
                id: unique(id, &mut seen),
                parent: None,
                kind: FeatureKind::Building,
                source_type,
                lod: None,
                attributes: open.attributes,
                shape: Shape::Surfaces { polygons: Vec::new(), meshes: open.meshes },
            });
        }
        objects
    }

    fn add(&mut self, primitive: &GltfPrimitive) {
        let material = self.material(primitive.material);
        let shift = self.scene.rtc_center.unwrap_or_default();
        let position = |p: [f64; 3]| {
            let [x, y, z] = z_up(p);
            [x + shift[0], y + shift[1], z + shift[2]]
        };
        let node = self.owners.get(&primitive.node).copied().unwrap_or(primitive.node);
        let of_node = ObjectKey::Node { node, instance: primitive.instance };
        let Some((ids, table)) = primitive.feature_ids.iter().find_map(|ids| Some((ids, ids.table?))) else {
            let mesh = primitive.mesh(&position, material);
            self.push(of_node, mesh, &primitive.attributes);
            return;
        };
        // Instances with one feature each stay objects of their own.
        if let (FeatureIdValues::All(_), Some(_)) = (&ids.values, primitive.instance) {
            let mut attributes = self.feature_attributes(ids, table);
            primitive.attributes.iter().for_each(|(name, value)| attributes.push(name, value.clone()));
            let mesh = primitive.mesh(&position, material);
            self.push(of_node, mesh, &attributes);
            return;
        }
        for (feature, mesh) in primitive.meshes_by_feature(ids, &position, material) {
            match feature {
                Some(feature) => {
                    let key = ObjectKey::Feature { table, feature };
                    let is_new = !self.objects.contains_key(&key);
                    let attributes =
                        if is_new { self.scene.attributes_of(table, feature) } else { Attributes::default() };
                    self.push(key, mesh, &attributes);
                }
                None => self.push(of_node, mesh, &primitive.attributes),
            }
        }
    }

    fn feature_attributes(&self, ids: &FeatureIds, table: usize) -> Attributes {
        ids.of_vertex(0).map(|feature| self.scene.attributes_of(table, feature)).unwrap_or_default()
    }

    fn push(&mut self, key: ObjectKey, mesh: TriangleMesh, attributes: &Attributes) {
        let open = self.objects.entry(key).or_default();
        open.meshes.push(mesh);
        attributes.iter().for_each(|(name, value)| open.attributes.push(name, value.clone()));
    }

    fn material(&mut self, index: Option<usize>) -> Option<u32> {
        let index = index?;
        let material = self.scene.materials.get(index)?;
        Some(*self.materials.entry(index).or_insert_with(|| self.sink.add_material(material.clone())))
    }

    /// Reports the nodes without primitives, whose owner is no object either.
    fn report_lost(&mut self) {
        let has_object = |node: usize, objects: &BTreeMap<ObjectKey, OpenObject>| {
            let first = ObjectKey::Node { node, instance: None };
            objects
                .range(first..)
                .next()
                .is_some_and(|(key, _)| matches!(key, ObjectKey::Node { node: own, .. } if *own == node))
        };
        for node in &self.scene.mesh_nodes {
            let Some((reason, what)) = &node.lost else { continue };
            let name = node.name.clone().unwrap_or_else(|| format!("node {}", node.node));
            let detail = format!("{name}: {what}");
            if node.owner != node.node || has_object(node.owner, &self.objects) {
                self.sink.problem(reason, detail);
            } else {
                self.sink.skip(reason, detail);
            }
        }
    }

    /// Identifier and type of an object.
    fn name(&self, key: ObjectKey, names: &HashMap<usize, &str>) -> (String, String) {
        match key {
            ObjectKey::Node { node, instance } => {
                let name = names.get(&node).map(|name| name.trim()).filter(|name| !name.is_empty());
                let name = name.map_or_else(|| format!("mesh {node}"), str::to_owned);
                match instance {
                    Some(instance) => (format!("{name}, instance {instance}"), "mesh".into()),
                    None => (name, "mesh".into()),
                }
            }
            ObjectKey::Feature { table, feature } => {
                let id = self.scene.id_of(table, feature).unwrap_or_else(|| format!("feature {feature}"));
                let class = self.scene.tables.get(table).map_or("", |table| &table.class);
                (id, if class.is_empty() { "feature".into() } else { class.to_owned() })
            }
        }
    }
}

/// An identifier that no object has yet: a repeated one gets a number.
fn unique(id: String, seen: &mut HashMap<String, u32>) -> String {
    let mut candidate = id.clone();
    while seen.contains_key(&candidate) {
        let count = seen.entry(id.clone()).or_insert(1);
        *count += 1;
        candidate = format!("{id} ({count})");
    }
    seen.insert(candidate.clone(), 1);
    candidate
}
