//! Geometry buffers that Draco compressed.

use super::mesh::{NO_FEATURE, NodeMesh};
use crate::bytes::array_at;
use draco_core::decode_limits::DecodeLimits;
use draco_core::decoder_buffer::DecoderBuffer;
use draco_core::draco_types::DataType;
use draco_core::geometry_attribute::{GeometryAttributeType, PointAttribute};
use draco_core::geometry_indices::{FaceIndex, PointIndex};
use draco_core::mesh::Mesh;
use draco_core::mesh_decoder::MeshDecoder;

/// First bytes of a compressed buffer.
pub(super) const MAGIC: &[u8; 5] = b"DRACO";
/// Metadata of an attribute: what it is, if Draco has no type for it.
const ATTRIBUTE_TYPE: &str = "i3s-attribute-type";

/// Decompresses a buffer. `max_bytes` limits what it may unpack to. Fails with what is wrong.
pub(super) fn decode(bytes: &[u8], max_bytes: u64) -> Result<NodeMesh, String> {
    let limits = DecodeLimits::default()
        .with_max_points(max_bytes / 12)
        .with_max_faces(max_bytes / 12)
        .with_max_decoded_bytes(max_bytes);
    let mut buffer = DecoderBuffer::new(bytes).with_limits(limits);
    let mut mesh = Mesh::new();
    MeshDecoder::new().decode(&mut buffer, &mut mesh).map_err(|error| format!("Draco: {error}"))?;
    let count = mesh.num_points();
    let faces = u32::try_from(mesh.num_faces()).map_err(|_| "Draco: too many faces")?;
    let mut node = NodeMesh {
        triangles: (0..faces).map(|face| mesh.face(FaceIndex(face)).map(|point| point.0)).collect(),
        ..NodeMesh::default()
    };
    let position = mesh.named_attribute(GeometryAttributeType::Position).ok_or("Draco: no positions")?;
    let metadata = mesh.attribute_metadata_by_unique_id(position.unique_id());
    // x and y were scaled to the size of z before they were quantised.
    let scale = ["i3s-scale_x", "i3s-scale_y"].map(|name| {
        let scale = metadata.and_then(|metadata| metadata.metadata().get_f64(name));
        scale.filter(|scale| scale.is_finite() && *scale != 0.0).unwrap_or(1.0)
    });
    node.offsets = position
        .read_f32s(count, 3)
        .chunks_exact(3)
        .map(|p| [f64::from(p[0]) * scale[0], f64::from(p[1]) * scale[1], f64::from(p[2])])
        .collect();
    if node.offsets.iter().flatten().any(|number| !number.is_finite()) {
        return Err("a position is not a number".to_owned());
    }
    if let Some(uv) = mesh.named_attribute(GeometryAttributeType::TexCoord) {
        node.uv = uv.read_f32s(count, 2).chunks_exact(2).map(|uv| [uv[0], uv[1]]).collect();
    }
    if let Some(colours) =
        mesh.named_attribute(GeometryAttributeType::Color).filter(|a| a.data_type() == DataType::Uint8)
    {
        node.colours = (0..count).map(|point| value_at(colours, point).unwrap_or([255; 3])).collect();
    }
    if let Some(regions) = by_type(&mesh, "uv-region").filter(|attribute| attribute.data_type() == DataType::Uint16) {
        let region = |point| value_at::<8>(regions, point).unwrap_or_default();
        node.regions = (0..count)
            .map(|point| {
                let bytes = region(point);
                [0, 2, 4, 6].map(|at| u16::from_le_bytes([bytes[at], bytes[at + 1]]))
            })
            .collect();
    }
    read_features(&mesh, &mut node);
    node.check()?;
    Ok(node)
}

/// Reads the feature of each triangle, which is that of its first vertex.
fn read_features(mesh: &Mesh, node: &mut NodeMesh) {
    node.triangle_features = vec![NO_FEATURE; node.triangles.len()];
    let Some(indices) = by_type(mesh, "feature-index") else { return };
    let metadata = mesh.attribute_metadata_by_unique_id(indices.unique_id());
    let ids = metadata.and_then(|metadata| metadata.metadata().get_i32_array("i3s-feature-ids")).unwrap_or_default();
    node.features = ids.iter().map(|id| u64::from(id.cast_unsigned())).collect();
    for (triangle, feature) in node.triangles.iter().zip(&mut node.triangle_features) {
        let point = triangle[0] as usize;
        let index = match indices.data_type() {
            DataType::Uint8 => value_at::<1>(indices, point).map(|bytes| u32::from(bytes[0])),
            DataType::Uint16 | DataType::Int16 => {
                value_at(indices, point).map(|bytes| u16::from_le_bytes(bytes).into())
            }
            DataType::Uint32 | DataType::Int32 => value_at(indices, point).map(u32::from_le_bytes),
            _ => None,
        };
        if let Some(index) = index.filter(|index| (*index as usize) < node.features.len()) {
            *feature = index;
        }
    }
}

/// The attribute that the metadata calls so.
fn by_type<'m>(mesh: &'m Mesh, name: &str) -> Option<&'m PointAttribute> {
    let metadata = mesh.attribute_metadata_by_string_entry(ATTRIBUTE_TYPE, name)?;
    mesh.attribute_by_unique_id(metadata.attribute_unique_id())
}

/// The first bytes of the value of a point.
fn value_at<const N: usize>(attribute: &PointAttribute, point: usize) -> Option<[u8; N]> {
    let index = attribute.mapped_index(PointIndex(u32::try_from(point).ok()?)).0 as usize;
    let stride = usize::try_from(attribute.byte_stride()).ok()?;
    let width = attribute.data_type().byte_length() * usize::from(attribute.num_components());
    let start = index.checked_mul(stride)?;
    if width < N {
        return None;
    }
    array_at(attribute.buffer().data(), start)
}
