//! Primitives in the space of their mesh.

use super::accessor::{self, Column};
use super::buffers::Buffers;
use super::draco::{self, DracoMesh};
use super::fault::Fault;
use super::materials::TextureUse;
use super::schema::{Primitive, PrimitiveExtensions, Root};
use super::{Attributes, FeatureIds, extras, features, triangles};
use std::rc::Rc;

/// A primitive in the space of its mesh.
#[derive(Debug, Default)]
pub(super) struct LocalPrimitive {
    pub(super) attributes: Rc<Attributes>,
    pub(super) positions: Vec<[f64; 3]>,
    pub(super) uv: Vec<[f32; 2]>,
    pub(super) colours: Vec<[u8; 3]>,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) material: Option<usize>,
    pub(super) feature_ids: Vec<FeatureIds>,
    /// Four joints of each vertex, and their weights; empty without a skin.
    pub(super) joints: Vec<[u16; 4]>,
    pub(super) weights: Vec<[f32; 4]>,
    pub(super) faults: Vec<Fault>,
}

impl LocalPrimitive {
    /// Bytes of a copy of it in the scene.
    pub(super) fn bytes(&self) -> u64 {
        let vertex = size_of::<[f64; 3]>() + 4 * self.feature_ids.len();
        let others = self.uv.len() * size_of::<[f32; 2]>() + self.colours.len() * 3;
        (self.positions.len() * vertex + others + self.triangles.len() * size_of::<[u32; 3]>()) as u64
    }
}

/// What is needed to decode primitives.
#[derive(Clone, Copy)]
pub(super) struct PrimitiveContext<'a> {
    pub(super) root: &'a Root,
    pub(super) buffers: &'a Buffers<'a>,
    /// How each material is mapped.
    pub(super) textures: &'a [Option<TextureUse>],
    /// Number of property tables.
    pub(super) tables: usize,
}

/// The attributes of a primitive, compressed or not.
struct Columns<'a> {
    context: PrimitiveContext<'a>,
    primitive: &'a Primitive,
    draco: Option<DracoMesh>,
}

impl<'a> Columns<'a> {
    fn new(context: PrimitiveContext<'a>, primitive: &'a Primitive) -> Result<Self, Fault> {
        let draco = primitive.extensions.as_deref().and_then(|e| e.draco.as_ref());
        let draco = match draco.and_then(|draco| draco.buffer_view) {
            Some(view) => Some(draco::decode(context.buffers.view(view)?, context.buffers.budget())?),
            None => None,
        };
        Ok(Self { context, primitive, draco })
    }

    fn get(&self, name: &str) -> Result<Option<Column<'a>>, Fault> {
        let PrimitiveContext { root, buffers, .. } = self.context;
        let accessor = self.primitive.attributes.get(name).copied();
        if let (Some(mesh), Some(PrimitiveExtensions { draco: Some(ids), .. })) =
            (&self.draco, self.primitive.extensions.as_deref())
            && let Some(id) = ids.attributes.get(name)
        {
            let is_normalised = accessor.and_then(|index| root.accessors.get(index)).is_some_and(|a| a.normalized);
            return mesh.column(*id, is_normalised, buffers.budget()).map(Some);
        }
        accessor.map(|index| accessor::column(root, buffers, index)).transpose()
    }

    /// An attribute that the primitive can do without: a fault of it is noted.
    fn get_or_note(&self, name: &str, count: usize, faults: &mut Vec<Fault>) -> Option<Column<'a>> {
        match self.get(name) {
            Ok(Some(column)) if column.count < count => {
                faults.push(Fault::new("attribute with too few values", name));
                None
            }
            Ok(column) => column,
            Err(fault) => {
                faults.push(fault);
                None
            }
        }
    }

    /// The triangles, and the number of vertices.
    fn triangles(&mut self, vertices: usize) -> Result<Vec<[u32; 3]>, Fault> {
        let PrimitiveContext { root, buffers, .. } = self.context;
        if let Some(draco) = &mut self.draco {
            return Ok(std::mem::take(&mut draco.triangles));
        }
        let mode = self.primitive.mode.unwrap_or(4);
        let indices = self.primitive.indices.map(|index| accessor::column(root, buffers, index)).transpose()?;
        let corners = indices.as_ref().map_or(vertices, |indices| indices.count);
        buffers.budget().take_bytes((corners as u64).saturating_mul(12))?;
        Ok(match indices {
            Some(indices) => triangles::triangles(mode, corners, |corner| indices.whole(corner)),
            None => triangles::triangles(mode, corners, |corner| u32::try_from(corner).unwrap_or(u32::MAX)),
        })
    }
}

/// Decodes a primitive. Fails if its positions or triangles cannot be read.
pub(super) fn decode(context: PrimitiveContext<'_>, primitive: &Primitive) -> Result<LocalPrimitive, Fault> {
    let mut columns = Columns::new(context, primitive)?;
    let positions = columns.get("POSITION")?.ok_or_else(|| Fault::new("primitive without positions", ""))?;
    if positions.width < 3 {
        return Err(Fault::new("primitive without positions", "POSITION has fewer than three components"));
    }
    let mut local = LocalPrimitive { material: primitive.material, ..LocalPrimitive::default() };
    local.attributes = Rc::new(extras::attributes(&primitive.extras));
    local.triangles = columns.triangles(positions.count)?;
    let dropped = triangles::drop_out_of_range(&mut local.triangles, positions.count);
    if dropped > 0 {
        local.faults.push(Fault::new("vertex index out of range", format!("{dropped} triangles")));
    }
    if local.triangles.is_empty() {
        local.feature_ids.clear();
        return Ok(local);
    }
    let used = triangles::compact(&mut local.triangles, positions.count);
    let used = Used { vertices: used.as_deref(), count: positions.count };
    context.buffers.budget().take_vertices(used.len() as u64)?;
    local.positions = used.map(|vertex| positions.get(vertex));
    drop_non_finite(&mut local);
    let texture = primitive.material.and_then(|material| context.textures.get(material)?.as_ref());
    if let Some(texture) = texture {
        let name = format!("TEXCOORD_{}", texture.tex_coord);
        if let Some(column) = columns.get_or_note(&name, positions.count, &mut local.faults) {
            local.uv = used.map(|vertex| texture.uv(column.get(vertex)));
        }
    }
    if let Some(column) = columns.get_or_note("COLOR_0", positions.count, &mut local.faults) {
        local.colours = used.map(|vertex| column.get(vertex).map(super::materials::linear_to_srgb));
    }
    read_skin(&columns, &used, &mut local);
    read_features(&columns, &used, &mut local);
    Ok(local)
}

/// The vertices of a primitive that are kept.
pub(super) struct Used<'a> {
    /// All if `None`.
    vertices: Option<&'a [u32]>,
    count: usize,
}

impl Used<'_> {
    fn len(&self) -> usize {
        self.vertices.map_or(self.count, <[u32]>::len)
    }

    fn map<T>(&self, value: impl Fn(usize) -> T) -> Vec<T> {
        match self.vertices {
            Some(vertices) => vertices.iter().map(|vertex| value(*vertex as usize)).collect(),
            None => (0..self.count).map(value).collect(),
        }
    }
}

fn drop_non_finite(local: &mut LocalPrimitive) {
    let is_finite = |position: &[f64; 3]| position.iter().all(|value| value.is_finite());
    if local.positions.iter().all(is_finite) {
        return;
    }
    let before = local.triangles.len();
    let (positions, triangles) = (&mut local.positions, &mut local.triangles);
    triangles.retain(|triangle| triangle.iter().all(|v| positions.get(*v as usize).is_some_and(is_finite)));
    positions.iter_mut().filter(|position| !is_finite(position)).for_each(|position| *position = [0.0; 3]);
    let dropped = before - local.triangles.len();
    local.faults.push(Fault::new("position is not a number", format!("{dropped} triangles")));
}

fn read_skin(columns: &Columns<'_>, used: &Used<'_>, local: &mut LocalPrimitive) {
    if !columns.primitive.attributes.contains_key("JOINTS_0") {
        return;
    }
    let joints = columns.get_or_note("JOINTS_0", used.count, &mut local.faults);
    let weights = columns.get_or_note("WEIGHTS_0", used.count, &mut local.faults);
    if let (Some(joints), Some(weights)) = (joints, weights) {
        local.joints = used.map(|vertex| joints.get(vertex).map(|joint: f64| joint as u16));
        local.weights = used.map(|vertex| weights.get(vertex).map(|weight: f64| weight as f32));
    }
}

fn read_features(columns: &Columns<'_>, used: &Used<'_>, local: &mut LocalPrimitive) {
    let faults = &mut local.faults;
    let sets = columns.primitive.extensions.as_deref().and_then(|e| e.features.as_ref());
    for set in sets.iter().flat_map(|sets| &sets.feature_ids) {
        if let Err(fault) = columns.context.buffers.budget().take_bytes(used.len() as u64 * 4) {
            faults.push(fault);
            return;
        }
        let values = match set.attribute {
            Some(number) => {
                let column = columns.get_or_note(&format!("_FEATURE_ID_{number}"), used.count, faults);
                let Some(column) = column else { continue };
                used.map(|vertex| column.whole(vertex))
            }
            None if set.texture.is_some() => {
                faults.push(Fault::new("feature identifiers in a texture are not read", ""));
                continue;
            }
            None => used.map(|vertex| u32::try_from(vertex).unwrap_or(u32::MAX)),
        };
        match features::per_vertex(set, values, columns.context.tables) {
            Ok(ids) => local.feature_ids.push(ids),
            Err(fault) => faults.push(fault),
        }
    }
    let batch = ["_BATCHID", "BATCHID"].into_iter().find(|name| columns.primitive.attributes.contains_key(*name));
    if let Some(column) = batch.and_then(|name| columns.get_or_note(name, used.count, faults)) {
        local.feature_ids.push(features::batch_ids(used.map(|vertex| column.whole(vertex))));
    }
}
