//! Buffers of `EXT_meshopt_compression`: vertices by the vertex codec of version 0 and triangles by the index codec of version 1,
//! which are the versions that the extension allows (its appendix A).

use super::ExportError;
use meshoptimizer_rs::codec::{IndexEncoding, VertexEncoding, encode_index_buffer, encode_vertex_buffer};
use meshoptimizer_rs::{Error, Workspace};

/// Encodes `count` vertices of `stride` bytes, a multiple of 4 up to 256.
pub(super) fn vertices(bytes: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, ExportError> {
    let encoding = VertexEncoding::new(0, 0).map_err(failed)?;
    encode_vertex_buffer(bytes, count, stride, encoding, &mut Workspace::default()).map_err(failed)
}

/// Encodes triangles. Readers may get the corners of a triangle rotated.
pub(super) fn triangles(indices: &[u32]) -> Result<Vec<u8>, ExportError> {
    let encoding = IndexEncoding::new(1).map_err(failed)?;
    encode_index_buffer(indices, encoding, &mut Workspace::default()).map_err(failed)
}

fn failed(error: Error) -> ExportError {
    ExportError::Encode(error.to_string())
}
