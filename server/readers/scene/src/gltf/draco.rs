//! KHR_draco_mesh_compression.

use super::accessor::Column;
use super::fault::{Budget, Fault};
use crate::bytes::NumberType;
use draco_core::decode_limits::DecodeLimits;
use draco_core::decoder_buffer::DecoderBuffer;
use draco_core::draco_types::DataType;
use draco_core::geometry_indices::{FaceIndex, PointIndex};
use draco_core::mesh::Mesh;
use draco_core::mesh_decoder::MeshDecoder;
use draco_core::status::ErrorKind;
use std::borrow::Cow;

const KIND: &str = "Draco data cannot be read";

pub(super) struct DracoMesh {
    mesh: Mesh,
    pub(super) triangles: Vec<[u32; 3]>,
}

pub(super) fn decode(bytes: &[u8], budget: &Budget) -> Result<DracoMesh, Fault> {
    let limits = DecodeLimits::default()
        .with_max_points(budget.vertices_left())
        .with_max_faces(budget.bytes_left() / 12)
        .with_max_decoded_bytes(budget.bytes_left());
    let mut buffer = DecoderBuffer::new(bytes).with_limits(limits);
    let mut mesh = Mesh::new();
    MeshDecoder::new().decode(&mut buffer, &mut mesh).map_err(|error| match error.kind() {
        ErrorKind::LimitExceeded => budget.exceed("the size of its Draco data"),
        _ => Fault::new(KIND, error.to_string()),
    })?;
    budget.take_bytes((mesh.num_faces() as u64).saturating_mul(12))?;
    let faces = u32::try_from(mesh.num_faces()).map_err(|_| Fault::new(KIND, "too many faces"))?;
    let triangles = (0..faces).map(|face| mesh.face(FaceIndex(face)).map(|point| point.0)).collect();
    Ok(DracoMesh { mesh, triangles })
}

impl DracoMesh {
    /// The values of an attribute by its unique id, one for each point. `is_normalised` is the accessor's.
    pub(super) fn column(&self, id: u32, is_normalised: bool, budget: &Budget) -> Result<Column<'static>, Fault> {
        let attribute = self.mesh.attribute_by_unique_id(id);
        let attribute = attribute.ok_or_else(|| Fault::new(KIND, format!("attribute {id} does not exist")))?;
        let component = match attribute.data_type() {
            DataType::Int8 => NumberType::I8,
            DataType::Uint8 | DataType::Bool => NumberType::U8,
            DataType::Int16 => NumberType::I16,
            DataType::Uint16 => NumberType::U16,
            DataType::Int32 => NumberType::I32,
            DataType::Uint32 => NumberType::U32,
            DataType::Float32 => NumberType::F32,
            DataType::Float64 => NumberType::F64,
            _ => return Err(Fault::new(KIND, format!("attribute {id} has an unknown type"))),
        };
        let (count, width) = (self.mesh.num_points(), usize::from(attribute.num_components()));
        let size = component.bytes() * width;
        let invalid = || Fault::new(KIND, format!("attribute {id} has too few values"));
        let total = count.checked_mul(size).ok_or_else(invalid)?;
        budget.take_bytes(total as u64)?;
        let stride = usize::try_from(attribute.byte_stride()).map_err(|_| invalid())?;
        let data = attribute.buffer().data();
        let mut bytes = Vec::with_capacity(total);
        for point in 0..count as u32 {
            let start = (attribute.mapped_index(PointIndex(point)).0 as usize).checked_mul(stride);
            let value = start.and_then(|start| data.get(start..start.checked_add(size)?));
            bytes.extend_from_slice(value.ok_or_else(invalid)?);
        }
        Ok(Column { bytes: Cow::Owned(bytes), count, stride: size, component, width, is_normalised })
    }
}
