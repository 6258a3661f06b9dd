//! The content of one tile: its container, its glTF and its features.

use super::batch_table::BatchTable;
use super::container::{self, Container, InstancedGltf, Tables};
use super::instances::Instances;
use super::objects::{Content, MaterialNumbers, feature_id, positions, turn_around};
use super::reader::{ContentFault, TileReader};
use super::tile::Tile;
use super::{kind, uri};
use crate::gltf;
use crate::gltf::{GltfOptions, GltfScene};
use glam::{DMat4, DVec3};
use insula_source::object::{FeatureKind, Shape, SourceObject};
use insula_source::problems::ENCODING_GUESSED;
use std::io;
use std::rc::Rc;

/// Composite tiles are nested at most this deep.
const MAX_COMPOSITE_DEPTH: u32 = 8;
/// Instances of one tile have at most this many vertices together.
const MAX_INSTANCED_VERTICES: u64 = 1 << 30;
/// A vertex of a glTF has at least this many unpacked bytes.
const VERTEX_BYTES: u64 = 12;

impl TileReader<'_, '_> {
    /// Adds the objects of a tile's content. Returns their number. Fails if the content cannot be read.
    pub(super) fn add_content(&mut self, tile: &Tile, bytes: &[u8], depth: u32) -> Result<u32, ContentFault> {
        match container::open(bytes).map_err(|what| ContentFault::tile(&tile.name, what))? {
            Container::Batched { tables, gltf } => self.add_batched(tile, &tables, gltf),
            Container::Instanced { tables, gltf } => self.add_instanced(tile, &tables, &gltf),
            Container::Composite(inner) => self.add_composite(tile, &inner, depth),
            Container::Gltf(bytes) => {
                let scene = self.decode(&tile.name, bytes)?;
                let content = Content { scene: &scene, gltf_name: &tile.name, format: "glTF tile", batch: None };
                self.add_scene(tile, &content)
            }
            Container::NotRead(format) => Err(ContentFault::unsupported(&tile.name, format)),
        }
    }

    fn add_batched(&mut self, tile: &Tile, tables: &Tables<'_>, gltf: &[u8]) -> Result<u32, ContentFault> {
        let scene = self.decode(&tile.name, gltf)?;
        let length = tables.batch_length();
        let table = self.batch_table(tile, tables, length);
        let center = tables.global_vector("RTC_CENTER").map_or(DVec3::ZERO, DVec3::from_array);
        let mut tile = tile.clone();
        tile.transform *= DMat4::from_translation(center);
        let batch = Some((&table, length));
        self.add_scene(&tile, &Content { scene: &scene, gltf_name: &tile.name, format: "b3dm feature", batch })
    }

    fn batch_table<'t>(&mut self, tile: &Tile, tables: &Tables<'t>, length: u32) -> BatchTable<'t> {
        if let Some(what) = &tables.guessed {
            self.sink.problem(ENCODING_GUESSED, format!("{}: {what}", tile.name));
        }
        let table = BatchTable::new(&tables.batch_json, tables.batch_binary, length);
        for (name, reason) in &table.faults {
            self.sink.problem("attribute of a batch table is not read", format!("{}: {name}: {reason}", tile.name));
        }
        table
    }

    fn add_composite(&mut self, tile: &Tile, inner: &[&[u8]], depth: u32) -> Result<u32, ContentFault> {
        if depth >= MAX_COMPOSITE_DEPTH {
            return Err(ContentFault::tile(&tile.name, "composite tiles are nested too deeply"));
        }
        let mut added = 0;
        for (i, bytes) in inner.iter().enumerate() {
            let part = Tile { name: format!("{}#part{i}", tile.name), ..tile.clone() };
            match self.add_content(&part, bytes, depth + 1) {
                Ok(count) => added += count,
                Err(fault) => self.skip_content(&part.name, fault)?,
            }
        }
        Ok(added)
    }

    fn add_instanced(
        &mut self,
        tile: &Tile,
        tables: &Tables<'_>,
        gltf: &InstancedGltf<'_>,
    ) -> Result<u32, ContentFault> {
        let instances = Instances::new(tables).map_err(|what| ContentFault::tile(&tile.name, what))?;
        let (scene, gltf_name) = match gltf {
            InstancedGltf::Embedded(bytes) => (Rc::new(self.decode(&tile.name, bytes)?), tile.name.clone()),
            InstancedGltf::Uri(uri) => self.shared_scene(tile, uri)?,
        };
        self.report_scene(tile, &scene);
        let table = self.batch_table(tile, tables, instances.feature_count());
        let content = Content { scene: &scene, gltf_name: &gltf_name, format: "i3dm instance", batch: None };
        let vertices: usize = scene.primitives.iter().map(|primitive| primitive.positions.len()).sum();
        let affordable = MAX_INSTANCED_VERTICES / (vertices as u64).max(1);
        let kind = tile.kind.or_else(|| kind::kind_of_name(uri::stem(&gltf_name)));
        let tile = Tile { kind, ..tile.clone() };
        let mut materials = MaterialNumbers::default();
        let mut added = 0;
        for instance in 0..instances.count {
            if u64::from(instance) >= affordable {
                let left = instances.count - instance;
                self.sink.skip("instances have too many vertices", format!("{}: the last {left} instances", tile.name));
                break;
            }
            added += self.add_instance(&tile, &content, (&instances, instance), &table, &mut materials)?;
        }
        Ok(added)
    }

    fn add_instance(
        &mut self,
        tile: &Tile,
        content: &Content<'_>,
        (instances, instance): (&Instances<'_>, u32),
        table: &BatchTable<'_>,
        materials: &mut MaterialNumbers,
    ) -> Result<u32, ContentFault> {
        let (attributes, class) = table.attributes(instances.feature(instance));
        let id = feature_id(tile, &attributes, Some(instance));
        let Some(own) = instances.transform(instance) else {
            self.sink.skip("instance has no finite place", format!("{id}: in {}", tile.name));
            return Ok(0);
        };
        let transform = tile.transform * own;
        let position = positions(tile, content.scene, &transform)?;
        let mut meshes = Vec::with_capacity(content.scene.primitives.len());
        for primitive in &content.scene.primitives {
            let material = primitive.material.and_then(|index| materials.get(self, content, index));
            let mut mesh = primitive.mesh(&position, material);
            if transform.determinant() < 0.0 {
                turn_around(&mut mesh);
            }
            meshes.push(mesh);
        }
        let class = kind::class_of(&attributes).or(class).map(str::to_owned);
        let object = SourceObject {
            id,
            parent: None,
            kind: class.as_deref().and_then(kind::kind_of_name).or(tile.kind).unwrap_or(FeatureKind::Building),
            source_type: class.filter(|class| !class.is_empty()).unwrap_or_else(|| content.format.to_owned()),
            lod: kind::lod_of(&attributes),
            attributes,
            shape: Shape::None,
        };
        self.add_meshes(object, meshes)
    }

    /// The scene that an i3dm names, and the name of its file. The last one is kept, because many tiles share one.
    fn shared_scene(&mut self, tile: &Tile, uri: &str) -> Result<(Rc<GltfScene>, String), ContentFault> {
        let fault = |what: String| ContentFault::tile(&tile.name, format!("{uri}: {what}"));
        if let Some(data) = uri::data_of(uri) {
            let bytes = data.map_err(|what| fault(what.to_owned()))?;
            return Ok((Rc::new(self.decode(&tile.name, &bytes)?), tile.name.clone()));
        }
        let name = uri::resolve(uri::folder_of(&tile.name), uri, self.files.is_remote);
        let name = name.map_err(|what| fault(what.to_owned()))?;
        if let Some((known, scene)) = &self.shared_scene
            && *known == name
        {
            return Ok((Rc::clone(scene), name));
        }
        let bytes = self.files.read(&name).map_err(|error| fault(error.to_string()))?;
        let scene = Rc::new(self.decode(&name, &bytes)?);
        self.shared_scene = Some((name.clone(), Rc::clone(&scene)));
        Ok((scene, name))
    }

    /// Decodes a glTF. `name` is that of its file.
    fn decode(&self, name: &str, bytes: &[u8]) -> Result<GltfScene, ContentFault> {
        let files = &self.files;
        let options = GltfOptions {
            max_bytes: files.input.max_bytes,
            max_vertices: files.input.max_bytes / VERTEX_BYTES,
            loads_images: false,
        };
        let resources = |path: &str| {
            let name = uri::join(uri::folder_of(name), path);
            files.read(&name.map_err(|reason| io::Error::new(io::ErrorKind::PermissionDenied, reason))?)
        };
        gltf::decode(name, bytes, &resources, &options).map_err(ContentFault::Tile)
    }
}
