//! glTF 2.0 and GLB: scenes of triangles with materials, metadata and feature identifiers. Also a source of its own.

mod accessor;
mod buffers;
mod container;
mod document;
#[cfg(feature = "draco")]
mod draco;
mod extras;
mod fault;
mod features;
mod images;
mod ktx2;
mod materials;
#[cfg(feature = "meshopt")]
mod meshopt;
mod metadata;
mod metadata_schema;
mod metadata_values;
mod primitive;
mod scene;
mod schema;
mod source;
#[cfg(test)]
pub(crate) mod tests;
mod triangles;
mod unread;
mod uri;
mod version1;

use buffers::Buffers;
use fault::Budget;
use images::Images;
use insula_source::attributes::Attributes;
use insula_source::error::InputError;
use insula_source::object::{SourceImage, SourceMaterial, TriangleMesh};
use insula_source::problems::{ENCODING_GUESSED, PART_NOT_READ};
pub(crate) use metadata::PropertyTable;
use primitive::PrimitiveContext;
use scene::SceneBuilder;
pub use source::read;
use std::io;
use std::rc::Rc;

#[cfg(not(feature = "draco"))]
mod draco {
    use super::accessor::Column;
    use super::fault::{Budget, Fault};

    pub(super) struct DracoMesh {
        pub(super) triangles: Vec<[u32; 3]>,
    }

    pub(super) fn decode(_: &[u8], _: &Budget) -> Result<DracoMesh, Fault> {
        Err(Fault::left_out("draco"))
    }

    impl DracoMesh {
        pub(super) fn column(&self, _: u32, _: bool, _: &Budget) -> Result<Column<'static>, Fault> {
            Err(Fault::left_out("draco"))
        }
    }
}

#[cfg(not(feature = "meshopt"))]
mod meshopt {
    use super::fault::{Budget, Fault};
    use super::schema::Meshopt;

    pub(super) fn decode(_: &Meshopt, _: &[u8], _: &Budget) -> Result<Vec<u8>, Fault> {
        Err(Fault::left_out("meshopt"))
    }
}

/// What a scene may cost, and what happens to images beside it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GltfOptions {
    /// Files, decompressed buffers and images may not be larger, nor all of a scene together.
    pub(crate) max_bytes: u64,
    /// Vertices of all primitives, with instances, may not be more.
    pub(crate) max_vertices: u64,
    /// Whether images in files of their own are loaded with `resources` into [`insula_source::object::SourceImage::Encoded`];
    /// otherwise they become [`insula_source::object::SourceImage::File`] with the path as the glTF has it (percent-decoded).
    /// KTX2 images are always loaded.
    pub(crate) loads_images: bool,
}

/// Opens a file by its URI relative to the glTF, percent-decoded, with `/`. Never called for `data:` URIs.
pub(crate) type Resources<'a> = &'a dyn Fn(&str) -> io::Result<Vec<u8>>;

/// A decoded scene: metres, y up.
#[derive(Debug, Default)]
pub(crate) struct GltfScene {
    /// In the order of the nodes, depth first.
    pub(crate) primitives: Vec<GltfPrimitive>,
    /// `GltfPrimitive::material` are indices into these. Images of one file are shared.
    pub(crate) materials: Vec<SourceMaterial>,
    /// The visible nodes that have a mesh, in the order of `primitives`.
    pub(crate) mesh_nodes: Vec<MeshNode>,
    /// CESIUM_RTC: to be added to all positions *after* they are turned to z up.
    pub(crate) rtc_center: Option<[f64; 3]>,
    /// EXT_structural_metadata, for [`Self::attributes_of`].
    pub(crate) tables: Vec<PropertyTable>,
    /// `asset.copyright`.
    pub(crate) copyright: Option<String>,
    /// `asset.extras` and `scene.extras`.
    pub(crate) attributes: Attributes,
    /// Faults that cost a part: a fixed kind and a detail that starts with the place, such as `mesh 3, primitive 0`.
    pub(crate) problems: Vec<(&'static str, String)>,
}

/// An image by its content: KTX2 is decoded to at most about `max_bytes`, others stay encoded. Fails with what is wrong.
pub(crate) fn source_image(name: String, bytes: Vec<u8>, max_bytes: u64) -> Result<SourceImage, String> {
    if !ktx2::is_ktx2(&bytes) {
        return Ok(SourceImage::Encoded { name, bytes: Rc::from(bytes) });
    }
    let texels = ktx2::decode(&bytes, &Budget::new(max_bytes, 0)).map_err(|fault| fault.what)?;
    Ok(SourceImage::Texels { name, width: texels.width, height: texels.height, rgba: texels.rgba.into() })
}

/// Triangles with one material, in the space of the scene.
#[derive(Debug, Clone, Default)]
pub(crate) struct GltfPrimitive {
    /// Index of the node that has the mesh.
    pub(crate) node: usize,
    /// Number of the instance (EXT_mesh_gpu_instancing) if the node has instances.
    pub(crate) instance: Option<u32>,
    /// `extras` of the node, then of the mesh and the primitive.
    pub(crate) attributes: Rc<Attributes>,
    /// Finite, with the transforms of the nodes.
    pub(crate) positions: Vec<[f64; 3]>,
    /// v up, with KHR_texture_transform; one for each position, or empty.
    pub(crate) uv: Vec<[f32; 2]>,
    /// 8-bit sRGB; one for each position, or empty.
    pub(crate) colours: Vec<[u8; 3]>,
    /// Below `positions.len()`; counter-clockwise seen from outside, also under mirroring transforms.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Index into `GltfScene::materials`.
    pub(crate) material: Option<usize>,
    /// EXT_mesh_features, then EXT_instance_features, then `_BATCHID` of b3dm with the label `_BATCHID`.
    pub(crate) feature_ids: Vec<FeatureIds>,
}

/// Identifiers of features.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FeatureIds {
    pub(crate) label: Option<String>,
    /// Index into `GltfScene::tables`; always valid.
    pub(crate) table: Option<usize>,
    /// Identifier that stands for no feature.
    pub(crate) null: Option<u32>,
    pub(crate) values: FeatureIdValues,
}

/// The identifiers of the vertices of a primitive.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum FeatureIdValues {
    /// One for each position.
    PerVertex(Vec<u32>),
    /// All vertices have this: the instance's.
    All(u32),
}

#[derive(Debug, Clone, Default)]
pub(crate) struct MeshNode {
    /// Its index.
    pub(crate) node: usize,
    /// The topmost of its ancestors that has a mesh, or the node itself.
    pub(crate) owner: usize,
    /// Name of the node, or else of its mesh.
    pub(crate) name: Option<String>,
    /// Why it has no primitives, if it has none: reason and detail.
    pub(crate) lost: Option<(&'static str, String)>,
}

/// Turns y up into z up: (x, y, z) becomes (x, -z, y), which are east, north and up where z points south.
pub(crate) fn z_up([x, y, z]: [f64; 3]) -> [f64; 3] {
    [x, -z, y]
}

/// Decodes a GLB or a `.gltf` (JSON) of version 2.0, or what old b3dm have of version 1.0. `label` names it in errors.
///
/// Fails if the container or the JSON is damaged, if an extension is required that is not known, or beyond the limits. Faults
/// of single meshes, textures and properties become `problems`.
pub(crate) fn decode(
    label: &str,
    bytes: &[u8],
    resources: Resources<'_>,
    options: &GltfOptions,
) -> Result<GltfScene, InputError> {
    let document = container::parse(label, bytes)?;
    let root = &document.root;
    let budget = Budget::new(options.max_bytes, options.max_vertices);
    let buffers = Buffers::new(root, document.binary, resources, &budget);
    let mut scene = GltfScene { copyright: root.asset.copyright.clone(), ..GltfScene::default() };
    scene.problems.extend(document.guessed.as_ref().map(|what| (ENCODING_GUESSED, what.clone())));
    scene.problems.extend(unread::parts_not_read(root).into_iter().map(|part| (PART_NOT_READ, part)));
    scene.attributes = extras::attributes(&root.asset.extras);
    if let Some(first) = root.scenes.get(root.scene.unwrap_or(0)) {
        extras::push(&first.extras, &mut scene.attributes);
    }
    let rtc = root.extensions.rtc.as_ref().and_then(|rtc| <[f64; 3]>::try_from(rtc.center.as_slice()).ok());
    scene.rtc_center = rtc.filter(|center| center.iter().all(|value| value.is_finite()));
    if let Some(metadata) = &root.extensions.metadata {
        scene.tables = metadata::tables(metadata, &buffers, &mut scene.problems);
    }
    let textures = materials::texture_uses(root);
    let context = PrimitiveContext { root, buffers: &buffers, textures: &textures, tables: scene.tables.len() };
    SceneBuilder::new(context, &mut scene).build();
    convert_materials(label, root, &buffers, options, &mut scene);
    match budget.exceeded() {
        Some((what, limit)) => Err(InputError::TooLarge { path: label.to_owned(), what: what.to_owned(), limit }),
        None => Ok(scene),
    }
}

/// Converts the materials that primitives use; the others stay empty.
fn convert_materials(
    label: &str,
    root: &schema::Root,
    buffers: &Buffers<'_>,
    options: &GltfOptions,
    scene: &mut GltfScene,
) {
    let mut is_used = vec![false; root.materials.len()];
    for primitive in &mut scene.primitives {
        match primitive.material.and_then(|material| is_used.get_mut(material)) {
            Some(is_used) => *is_used = true,
            None => primitive.material = None,
        }
    }
    let mut images = Images::new(root, buffers, label, options.loads_images);
    for (index, is_used) in is_used.into_iter().enumerate() {
        let mut faults = Vec::new();
        let material = match is_used {
            true => materials::convert(root, index, &mut images, &mut faults),
            false => SourceMaterial::default(),
        };
        scene.materials.push(material);
        scene.problems.extend(faults.into_iter().map(|fault| fault.at(&format!("material {index}"))));
    }
}
