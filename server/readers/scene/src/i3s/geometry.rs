//! Geometry buffers that are not compressed: attributes one after the other, triangles by threes of vertices.

use super::attributes::NUMBERS;
use super::layer::{BufferJson, FormatJson, SchemaJson};
use super::mesh::{NO_FEATURE, NodeMesh};
use crate::bytes::{NumberType, array_at, f32_at, f64_at, part, u16_at, u32_at, u64_at};
use serde_json::{Map, Value};

/// Which attribute of vertices or features a part of a buffer has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Meaning {
    Position,
    Uv,
    Colour,
    Region,
    FeatureId,
    FaceRange,
    /// Normals and what else is not read.
    Other,
}

/// The type of a number. Those with a sign are read without, as no attribute has one.
fn number_by_name(name: &str) -> Option<NumberType> {
    let unsigned = name.strip_prefix("Int").map(|bits| format!("UInt{bits}"));
    NumberType::by_name(NUMBERS, unsigned.as_deref().unwrap_or(name))
}

/// One attribute of a layout.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Field {
    meaning: Meaning,
    number: NumberType,
    components: u32,
    is_per_feature: bool,
}

/// How a buffer is laid out.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Layout {
    /// Where the numbers of vertices and features are, with their types.
    vertex_count: Option<(u64, NumberType)>,
    feature_count: Option<(u64, NumberType)>,
    /// Where the attributes start.
    offset: u64,
    fields: Vec<Field>,
    /// Whether texture coordinates and their regions may be missing: the schema of a store is that of all nodes.
    is_loose: bool,
}

impl Layout {
    /// The layout that a geometry definition describes. Fails if a type is not known.
    pub(super) fn of_definition(json: &BufferJson) -> Result<Self, String> {
        let attributes: [(Option<&FormatJson>, Meaning); 8] = [
            (json.position.as_ref(), Meaning::Position),
            (json.normal.as_ref(), Meaning::Other),
            (json.uv0.as_ref(), Meaning::Uv),
            (json.uv1.as_ref(), Meaning::Other),
            (json.color.as_ref(), Meaning::Colour),
            (json.uv_region.as_ref(), Meaning::Region),
            (json.feature_id.as_ref(), Meaning::FeatureId),
            (json.face_range.as_ref(), Meaning::FaceRange),
        ];
        let mut fields = Vec::new();
        for (format, meaning) in attributes {
            let Some(format) = format else { continue };
            let name = format.r#type.as_deref().unwrap_or_default();
            let number = number_by_name(name).ok_or_else(|| format!("the type `{name}` is not known"))?;
            let is_per_feature = match format.binding.as_deref() {
                Some(binding) => binding == "per-feature",
                None => matches!(meaning, Meaning::FeatureId | Meaning::FaceRange),
            };
            fields.push(Field { meaning, number, components: format.component.unwrap_or(1), is_per_feature });
        }
        // Buffers with an offset have the header of earlier versions.
        let has_header = json.offset >= 8;
        Ok(Self {
            vertex_count: has_header.then_some((0, NumberType::U32)),
            feature_count: has_header.then_some((4, NumberType::U32)),
            offset: json.offset,
            fields,
            is_loose: false,
        })
    }

    /// The layout of the schema of a store. Fails if a type is not known or the triangles have indices.
    pub(super) fn of_schema(schema: &SchemaJson) -> Result<Self, String> {
        if schema.topology.as_deref().is_some_and(|topology| topology.eq_ignore_ascii_case("Indexed")) {
            return Err("indexed geometry is not read".to_owned());
        }
        let mut layout = Self { is_loose: true, ..Self::default() };
        for header in schema.header.iter().flatten() {
            let name = header.r#type.as_deref().unwrap_or_default();
            let number = number_by_name(name).ok_or_else(|| format!("the type `{name}` is not known"))?;
            match header.property.as_deref() {
                Some("vertexCount") => layout.vertex_count = Some((layout.offset, number)),
                Some("featureCount") => layout.feature_count = Some((layout.offset, number)),
                _ => {}
            }
            layout.offset += number.bytes() as u64;
        }
        layout.add_fields(&schema.ordering, &schema.vertex_attributes, false)?;
        layout.add_fields(&schema.feature_attribute_order, &schema.feature_attributes, true)?;
        Ok(layout)
    }

    fn add_fields(
        &mut self,
        order: &Option<Vec<String>>,
        attributes: &Option<Map<String, Value>>,
        is_per_feature: bool,
    ) -> Result<(), String> {
        for name in order.iter().flatten() {
            let Some(attribute) = attributes.as_ref().and_then(|attributes| attributes.get(name)) else { continue };
            let type_name = attribute.get("valueType").and_then(Value::as_str).unwrap_or_default();
            let number = number_by_name(type_name).ok_or_else(|| format!("the type `{type_name}` is not known"))?;
            let components = attribute.get("valuesPerElement").and_then(Value::as_u64).unwrap_or(1);
            let meaning = match name.as_str() {
                "position" => Meaning::Position,
                "uv0" => Meaning::Uv,
                "color" => Meaning::Colour,
                "region" | "uvRegion" => Meaning::Region,
                "id" | "featureId" => Meaning::FeatureId,
                "faceRange" => Meaning::FaceRange,
                _ => Meaning::Other,
            };
            let components = u32::try_from(components).map_err(|_| format!("{name} has too many components"))?;
            self.fields.push(Field { meaning, number, components, is_per_feature });
        }
        Ok(())
    }

    /// Decodes a buffer. `counts` are the numbers of vertices and features that the node tells, for buffers without a header.
    /// Fails with what is wrong.
    pub(super) fn decode(&self, bytes: &[u8], counts: [Option<u64>; 2]) -> Result<NodeMesh, String> {
        let count = |place: Option<(u64, NumberType)>| {
            let (at, number) = place?;
            let at = usize::try_from(at).ok()?;
            if number == NumberType::U64 { u64_at(bytes, at) } else { u32_at(bytes, at).map(u64::from) }
        };
        let vertices = count(self.vertex_count).or(counts[0]).ok_or("the number of vertices is missing")?;
        let features = count(self.feature_count).or(counts[1]).unwrap_or(0);
        let fields = self.fields_within(bytes.len() as u64, vertices, features).ok_or("the geometry is cut short")?;
        let mut mesh = NodeMesh::default();
        let (mut at, mut ranges) = (self.offset, Vec::new());
        for field in fields {
            let items = if field.is_per_feature { features } else { vertices };
            let size = field.size(items).ok_or("the geometry is cut short")?;
            let data = part(bytes, at, size).ok_or("the geometry is cut short")?;
            at += size;
            field.read(data, &mut mesh, &mut ranges)?;
        }
        if mesh.offsets.iter().flatten().any(|number| !number.is_finite()) {
            return Err("a position is not a number".to_owned());
        }
        let triangles = u32::try_from(vertices / 3).map_err(|_| "it has too many vertices")?;
        mesh.triangles = (0..triangles).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        mesh.triangle_features = features_of_faces(&ranges, triangles as usize);
        if ranges.is_empty() && mesh.features.len() == 1 {
            mesh.triangle_features.fill(0);
        }
        mesh.check()?;
        Ok(mesh)
    }

    /// The fields that the buffer has. If some are missing, the layout without them fits the length better. `None` if none
    /// fits.
    fn fields_within(&self, length: u64, vertices: u64, features: u64) -> Option<Vec<Field>> {
        let without = |left_out: &[Meaning]| {
            let fields = self.fields.iter().filter(|field| !left_out.contains(&field.meaning));
            fields.copied().collect::<Vec<_>>()
        };
        let end = |fields: &[Field]| {
            fields.iter().try_fold(self.offset, |end, field| {
                let items = if field.is_per_feature { features } else { vertices };
                end.checked_add(field.size(items)?)
            })
        };
        let choices = [
            without(&[]),
            without(&[Meaning::Region]),
            without(&[Meaning::Uv]),
            without(&[Meaning::Uv, Meaning::Region]),
        ];
        let choices = if self.is_loose { &choices[..] } else { &choices[..1] };
        let exact = choices.iter().find(|fields| end(fields) == Some(length));
        let fitting = || choices.iter().find(|fields| end(fields).is_some_and(|end| end <= length));
        exact.or_else(fitting).cloned()
    }
}

impl Field {
    fn size(self, items: u64) -> Option<u64> {
        items.checked_mul(u64::from(self.components))?.checked_mul(self.number.bytes() as u64)
    }

    /// Adds the values of a part of a buffer, which has whole items only.
    fn read(self, data: &[u8], mesh: &mut NodeMesh, ranges: &mut Vec<[u32; 2]>) -> Result<(), String> {
        let width = self.number.bytes();
        let stride = width * self.components as usize;
        if stride == 0 {
            return Ok(());
        }
        let items = data.chunks_exact(stride);
        match (self.meaning, self.number, self.components) {
            (Meaning::Position, NumberType::F32, 3..) => {
                mesh.offsets =
                    items.map(|item| [0, 4, 8].map(|at| f64::from(f32_at(item, at).unwrap_or(f32::NAN)))).collect();
            }
            (Meaning::Position, NumberType::F64, 3..) => {
                mesh.offsets = items.map(|item| [0, 8, 16].map(|at| f64_at(item, at).unwrap_or(f64::NAN))).collect();
            }
            (Meaning::Uv, NumberType::F32, 2..) => {
                mesh.uv = items.map(|item| [0, 4].map(|at| f32_at(item, at).unwrap_or_default())).collect();
            }
            (Meaning::Colour, NumberType::U8, 3..) => {
                mesh.colours = items.map(|item| array_at(item, 0).unwrap_or([255; 3])).collect();
            }
            (Meaning::Region, NumberType::U16, 4..) => {
                mesh.regions = items.map(|item| [0, 2, 4, 6].map(|at| u16_at(item, at).unwrap_or_default())).collect();
            }
            (Meaning::FeatureId, NumberType::U64, _) => {
                mesh.features = items.map(|item| u64_at(item, 0).unwrap_or_default()).collect();
            }
            (Meaning::FeatureId, NumberType::U32, _) => {
                mesh.features = items.map(|item| u32_at(item, 0).map_or(0, u64::from)).collect();
            }
            (Meaning::FaceRange, NumberType::U32, 2..) => {
                ranges.extend(items.map(|item| [0, 4].map(|at| u32_at(item, at).unwrap_or_default())));
            }
            (Meaning::Other, ..) => {}
            (meaning, number, components) => {
                return Err(format!("{meaning:?} of {components} x {number:?} is not known"));
            }
        }
        Ok(())
    }
}

/// The feature of each face, from the first and last face of each feature. Of overlapping ranges the first counts.
fn features_of_faces(ranges: &[[u32; 2]], faces: usize) -> Vec<u32> {
    let mut features = vec![NO_FEATURE; faces];
    // Faces that are given again cost time, so that many long ranges must end somewhere.
    let mut affordable = 2 * faces + ranges.len();
    for (feature, [first, last]) in (0..).zip(ranges) {
        let end = (*last as usize).saturating_add(1).min(faces);
        let Some(own) = features.get_mut(*first as usize..end) else { continue };
        affordable = affordable.saturating_sub(own.len());
        if affordable == 0 {
            break;
        }
        own.iter_mut().filter(|face| **face == NO_FEATURE).for_each(|face| *face = feature);
    }
    features
}
