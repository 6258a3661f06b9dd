//! Builds a GLB: collects buffer views, accessors, meshes and textures, and writes header and chunks (glTF 2.0, section 4.4).

use super::document::{
    ARRAY_BUFFER, Accessor, Asset, Attributes, Buffer, BufferView, CLAMP_TO_EDGE, Document, ELEMENT_ARRAY_BUFFER,
    FLOAT, Image, LINEAR, LINEAR_MIPMAP_LINEAR, Material, Mesh, Node, PbrMetallicRoughness, Primitive, Sampler, Scene,
    TextureInfo, UNSIGNED_BYTE, UNSIGNED_INT, UNSIGNED_SHORT,
};
use super::geometry::{Geometry, Layout, NO_FEATURE};
use super::jpeg::jpeg_of;
use super::{ExportError, compress};
use insula_protocol::Manifest;
use insula_protocol::manifest::Attribution;
use insula_protocol::mesh_tile::TileTexture;
use serde_json::{Value, json};
use std::collections::BTreeSet;

const MAGIC: &[u8; 4] = b"glTF";
const VERSION: u32 = 2;
const CHUNK_JSON: &[u8; 4] = b"JSON";
const CHUNK_BINARY: &[u8; 4] = b"BIN\0";
/// Names of the extensions that exports use.
const MESHOPT: &str = "EXT_meshopt_compression";
const QUANTIZATION: &str = "KHR_mesh_quantization";
const WEBP: &str = "EXT_texture_webp";
const MESH_FEATURES: &str = "EXT_mesh_features";
const STRUCTURAL_METADATA: &str = "EXT_structural_metadata";

/// How vertices, indices and textures are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Packing {
    /// As all readers of glTF 2.0 know them: positions as floats, textures as JPEG files.
    Plain,
    /// Positions of 16 bits and WebP files, which a reader must support.
    Quantised,
    /// As `Quantised`, compressed by `EXT_meshopt_compression`, which a reader must then support, too.
    Meshopt,
}

/// A GLB in the making.
#[derive(Debug)]
pub(crate) struct GlbBuilder {
    document: Document,
    binary: Vec<u8>,
    /// Size of the uncompressed data of compressed views, for which no bytes are stored.
    fallback_bytes: usize,
    used: BTreeSet<&'static str>,
    required: BTreeSet<&'static str>,
    packing: Packing,
}

/// What most surfaces of cities are.
const MATT: PbrMetallicRoughness =
    PbrMetallicRoughness { base_color_texture: None, metallic_factor: 0.0, roughness_factor: None };

impl GlbBuilder {
    /// An empty scene with the attribution of a city.
    pub(crate) fn new(manifest: &Manifest, packing: Packing) -> Self {
        let asset = Asset {
            version: "2.0",
            generator: concat!("Insula ", env!("CARGO_PKG_VERSION")),
            copyright: copyright(manifest),
            extras: None,
        };
        Self {
            document: Document { asset, scenes: vec![Scene::default()], ..Document::default() },
            binary: Vec::new(),
            fallback_bytes: 0,
            used: BTreeSet::new(),
            required: BTreeSet::new(),
            packing,
        }
    }

    /// Adds members to the asset for programs that know them.
    pub(crate) fn set_extras(&mut self, extras: Value) {
        self.document.asset.extras = Some(extras);
    }

    /// Adds bytes as a view at a multiple of `align` bytes.
    pub(super) fn add_bytes(&mut self, bytes: &[u8], align: usize) -> usize {
        let byte_offset = self.append(bytes, align);
        self.push_view(BufferView { byte_offset, byte_length: bytes.len(), ..BufferView::default() })
    }

    /// Adds the property table, to which feature ids refer.
    pub(super) fn set_metadata(&mut self, metadata: Value) {
        self.used.insert(STRUCTURAL_METADATA);
        self.document.extensions = Some(json!({ STRUCTURAL_METADATA: metadata }));
    }

    /// Adds a mesh. Fails if it is too large for glTF, or cannot be compressed.
    pub(crate) fn add_mesh(&mut self, geometry: &Geometry, material: usize) -> Result<usize, ExportError> {
        let is_plain = self.packing == Packing::Plain;
        let (bytes, layout) = geometry.interleaved(is_plain);
        let vertices = geometry.positions.len();
        let view = self.add_vertices(&bytes, layout.stride, vertices)?;
        let accessor = |byte_offset: usize, component_type: u32, normalized: bool, shape: &'static str| Accessor {
            buffer_view: view,
            byte_offset,
            component_type,
            normalized,
            count: vertices,
            shape,
            ..Accessor::default()
        };
        let [min, max] = geometry.bounds().map(Some);
        let number = if is_plain { FLOAT } else { UNSIGNED_SHORT };
        let position = Accessor { min, max, ..accessor(0, number, false, "VEC3") };
        let position = self.push_accessor(position);
        if !is_plain {
            self.required.insert(QUANTIZATION);
        }
        let colour = layout.colour.map(|at| self.push_accessor(accessor(at, UNSIGNED_BYTE, true, "VEC4")));
        let uv = layout.uv.map(|at| self.push_accessor(accessor(at, number, !is_plain, "VEC2")));
        let feature_type = if layout.wide_features { FLOAT } else { UNSIGNED_SHORT };
        let feature = layout.feature.map(|at| self.push_accessor(accessor(at, feature_type, false, "SCALAR")));
        let extensions = feature.is_some().then(|| self.feature_extension(geometry, layout));
        let indices = self.add_indices(&geometry.indices, vertices)?;
        let attributes = Attributes { position, uv, colour, feature };
        self.document.meshes.push(Mesh { primitives: vec![Primitive { attributes, indices, material, extensions }] });
        Ok(self.document.meshes.len() - 1)
    }

    /// `EXT_mesh_features` of a primitive ("Feature ID by Vertex").
    fn feature_extension(&mut self, geometry: &Geometry, layout: Layout) -> Value {
        self.used.insert(MESH_FEATURES);
        let distinct: BTreeSet<u32> = geometry.features.iter().copied().collect();
        let has_none = distinct.contains(&NO_FEATURE);
        let features = distinct.len() - usize::from(has_none);
        let mut id = json!({ "featureCount": features.max(1), "attribute": 0, "propertyTable": 0, "label": "object" });
        if has_none {
            id["nullFeatureId"] = json!(layout.null_feature());
        }
        json!({ MESH_FEATURES: { "featureIds": [id] } })
    }

    fn add_vertices(&mut self, bytes: &[u8], stride: usize, count: usize) -> Result<usize, ExportError> {
        if self.packing == Packing::Meshopt {
            let packed = compress::vertices(bytes, count, stride)?;
            if packed.len() < bytes.len() {
                return Ok(self.add_packed(&packed, bytes.len(), [stride, count], ARRAY_BUFFER));
            }
        }
        let byte_offset = self.append(bytes, 4);
        let view =
            BufferView { byte_offset, byte_length: bytes.len(), byte_stride: Some(stride), ..BufferView::default() };
        Ok(self.push_view(BufferView { target: Some(ARRAY_BUFFER), ..view }))
    }

    /// Adds indices with 16 bits where they suffice: the largest value of a type restarts primitives and is not an index.
    fn add_indices(&mut self, indices: &[u32], vertices: usize) -> Result<usize, ExportError> {
        let is_short = vertices <= usize::from(u16::MAX);
        let bytes: Vec<u8> = if is_short {
            indices.iter().flat_map(|index| (*index as u16).to_le_bytes()).collect()
        } else {
            indices.iter().flat_map(|index| index.to_le_bytes()).collect()
        };
        let component_type = if is_short { UNSIGNED_SHORT } else { UNSIGNED_INT };
        let packed = if self.packing == Packing::Meshopt { Some(compress::triangles(indices)?) } else { None };
        let buffer_view = match packed.filter(|packed| packed.len() < bytes.len()) {
            Some(packed) => {
                let stride = if is_short { 2 } else { 4 };
                self.add_packed(&packed, bytes.len(), [stride, indices.len()], ELEMENT_ARRAY_BUFFER)
            }
            None => {
                let view = self.add_bytes(&bytes, 4);
                self.document.buffer_views[view].target = Some(ELEMENT_ARRAY_BUFFER);
                view
            }
        };
        let count = indices.len();
        Ok(self.push_accessor(Accessor { buffer_view, component_type, count, shape: "SCALAR", ..Accessor::default() }))
    }

    /// Adds a compressed view. Its own range is one of the fallback buffer, which has no bytes.
    fn add_packed(&mut self, packed: &[u8], bytes: usize, [stride, count]: [usize; 2], target: u32) -> usize {
        self.required.insert(MESHOPT);
        let offset = self.append(packed, 4);
        let is_vertices = target == ARRAY_BUFFER;
        let mode = if is_vertices { "ATTRIBUTES" } else { "TRIANGLES" };
        let mut extension = json!({
            "buffer": 0, "byteLength": packed.len(), "byteStride": stride, "count": count, "mode": mode,
        });
        if offset > 0 {
            extension["byteOffset"] = json!(offset);
        }
        let byte_offset = self.fallback_bytes.next_multiple_of(4);
        self.fallback_bytes = byte_offset + bytes;
        self.push_view(BufferView {
            buffer: 1,
            byte_offset,
            byte_length: bytes,
            byte_stride: is_vertices.then_some(stride),
            target: Some(target),
            extensions: Some(json!({ MESHOPT: extension })),
        })
    }

    /// Adds a texture with a new material. Fails if it must be a JPEG file and is damaged.
    pub(crate) fn add_textured_material(&mut self, texture: &TileTexture) -> Result<usize, ExportError> {
        let is_plain = self.packing == Packing::Plain;
        let buffer_view = if is_plain {
            self.add_bytes(&jpeg_of(texture)?, 4)
        } else {
            self.required.insert(WEBP);
            self.add_bytes(&texture.bytes, 4)
        };
        let document = &mut self.document;
        if document.samplers.is_empty() {
            document.samplers.push(Sampler {
                mag_filter: LINEAR,
                min_filter: LINEAR_MIPMAP_LINEAR,
                wrap_s: CLAMP_TO_EDGE,
                wrap_t: CLAMP_TO_EDGE,
            });
        }
        document.images.push(Image { buffer_view, mime_type: if is_plain { "image/jpeg" } else { "image/webp" } });
        let source = document.images.len() - 1;
        document.textures.push(if is_plain {
            json!({ "sampler": 0, "source": source })
        } else {
            json!({ "sampler": 0, "extensions": { WEBP: { "source": source } } })
        });
        let texture = TextureInfo { index: document.textures.len() - 1 };
        Ok(self.add_material(PbrMetallicRoughness { base_color_texture: Some(texture), ..MATT }))
    }

    /// The material of meshes with colours of vertices.
    pub(crate) fn plain_material(&mut self) -> usize {
        self.add_material(MATT)
    }

    /// The number of a material; an equal one that is there already is used again. Materials are double-sided: sources have single surfaces, and where a coarser tile meets a finer one, the inside of boxes closes
    /// what would be a gap.
    pub(crate) fn add_material(&mut self, pbr_metallic_roughness: PbrMetallicRoughness) -> usize {
        let materials = &mut self.document.materials;
        let known = materials.iter().position(|material| material.pbr_metallic_roughness == pbr_metallic_roughness);
        known.unwrap_or_else(|| {
            materials.push(Material { pbr_metallic_roughness, double_sided: true });
            materials.len() - 1
        })
    }

    /// Adds a node that shows a mesh, below the scene. `matrix` is column by column.
    pub(crate) fn add_node(&mut self, name: Option<String>, matrix: [f64; 16], mesh: usize) {
        let node = self.document.nodes.len();
        self.document.nodes.push(Node { name, matrix: Some(matrix), mesh: Some(mesh), ..Node::default() });
        self.document.scenes[0].nodes.push(node);
    }

    /// Adds a perspective camera (glTF 2.0, section 3.10) with a vertical field of view in radians and width by height. `matrix` is column
    /// by column.
    pub(crate) fn add_camera(&mut self, matrix: [f64; 16], [y_fov, aspect_ratio]: [f64; 2], near_m: f64) {
        let perspective = json!({ "yfov": y_fov, "aspectRatio": aspect_ratio, "znear": near_m });
        self.document.cameras.push(json!({ "type": "perspective", "perspective": perspective }));
        let camera = Some(self.document.cameras.len() - 1);
        let node = self.document.nodes.len();
        self.document.nodes.push(Node { matrix: Some(matrix), camera, ..Node::default() });
        self.document.scenes[0].nodes.push(node);
    }

    /// Puts all nodes of the scene below a new one.
    pub(crate) fn gather_nodes(&mut self, name: String, matrix: [f64; 16]) {
        let children = std::mem::take(&mut self.document.scenes[0].nodes);
        if children.is_empty() {
            return;
        }
        let node = self.document.nodes.len();
        self.document.nodes.push(Node { name: Some(name), matrix: Some(matrix), children, ..Node::default() });
        self.document.scenes[0].nodes.push(node);
    }

    fn push_accessor(&mut self, accessor: Accessor) -> usize {
        self.document.accessors.push(accessor);
        self.document.accessors.len() - 1
    }

    fn push_view(&mut self, view: BufferView) -> usize {
        self.document.buffer_views.push(view);
        self.document.buffer_views.len() - 1
    }

    fn append(&mut self, bytes: &[u8], align: usize) -> usize {
        self.binary.resize(self.binary.len().next_multiple_of(align), 0);
        let offset = self.binary.len();
        self.binary.extend_from_slice(bytes);
        offset
    }

    /// The GLB's bytes. Fails if it has 4 GiB or more.
    pub(crate) fn finish(mut self) -> Result<Vec<u8>, ExportError> {
        let document = &mut self.document;
        if !self.binary.is_empty() {
            document.buffers.push(Buffer { byte_length: self.binary.len(), extensions: None });
        }
        if self.fallback_bytes > 0 {
            let extensions = Some(json!({ MESHOPT: { "fallback": true } }));
            document.buffers.push(Buffer { byte_length: self.fallback_bytes, extensions });
        }
        document.extensions_required = self.required.iter().copied().collect();
        document.extensions_used = self.used.union(&self.required).copied().collect();
        let mut json = serde_json::to_vec(document).map_err(|error| ExportError::Encode(error.to_string()))?;
        json.resize(json.len().next_multiple_of(4), b' ');
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let chunks = [(CHUNK_JSON, &json), (CHUNK_BINARY, &self.binary)];
        let chunks = || chunks.into_iter().filter(|(_, bytes)| !bytes.is_empty());
        let bytes = 12 + chunks().map(|(_, bytes)| 8 + bytes.len()).sum::<usize>();
        let length = u32::try_from(bytes).map_err(|_| ExportError::TooLarge { what: "a GLB".into(), bytes })?;
        let mut out = Vec::with_capacity(bytes);
        out.extend_from_slice(MAGIC);
        out.extend_from_slice(&VERSION.to_le_bytes());
        out.extend_from_slice(&length.to_le_bytes());
        for (kind, bytes) in chunks() {
            // Not above `length`.
            out.extend_from_slice(&(bytes.len() as u32).to_le_bytes());
            out.extend_from_slice(kind);
            out.extend_from_slice(bytes);
        }
        Ok(out)
    }
}

/// The sources of a city in one line, with their licences and pages. `None` if there are none.
fn copyright(manifest: &Manifest) -> Option<String> {
    (!manifest.attribution.is_empty()).then(|| Attribution::line(&manifest.attribution))
}
