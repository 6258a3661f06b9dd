//! EXT_meshopt_compression and KHR_meshopt_compression.

use super::fault::{Budget, Fault};
use super::schema::Meshopt;
use meshoptimizer_rs::codec::{
    decode_filter_color, decode_filter_exp, decode_filter_oct, decode_filter_quat, decode_index_buffer,
    decode_index_sequence, decode_vertex_buffer,
};
use meshoptimizer_rs::{Error, Workspace};

/// Decompresses a buffer view.
pub(super) fn decode(compressed: &Meshopt, source: &[u8], budget: &Budget) -> Result<Vec<u8>, Fault> {
    let fault = |what: &str| Fault::new("meshopt data cannot be read", what);
    let (Ok(count), Ok(stride)) = (usize::try_from(compressed.count), usize::try_from(compressed.byte_stride)) else {
        return Err(fault("the number of elements is too large"));
    };
    if count == 0 || stride == 0 {
        return Ok(Vec::new());
    }
    // The decoder's own checks need the size to be computable.
    let bytes = compressed.count.checked_mul(compressed.byte_stride).ok_or_else(|| fault("the size is too large"))?;
    budget.take_bytes(bytes)?;
    let mut workspace = Workspace::default();
    let workspace = &mut workspace;
    let failed = |error: Error| fault(&error.to_string());
    let mut decoded = match compressed.mode.as_str() {
        "ATTRIBUTES" => decode_vertex_buffer(count, stride, source, workspace),
        "TRIANGLES" => decode_index_buffer(count, stride, source, workspace),
        "INDICES" => decode_index_sequence(count, stride, source, workspace),
        mode => return Err(fault(&format!("unknown mode {}", &mode[..mode.floor_char_boundary(40)]))),
    }
    .map_err(failed)?;
    match compressed.filter.as_deref() {
        None | Some("NONE") => Ok(()),
        Some("OCTAHEDRAL") => decode_filter_oct(&mut decoded, count, stride, workspace),
        Some("QUATERNION") => decode_filter_quat(&mut decoded, count, stride, workspace),
        Some("EXPONENTIAL") => decode_filter_exp(&mut decoded, count, stride, workspace),
        Some("COLOR") => decode_filter_color(&mut decoded, count, stride, workspace),
        Some(filter) => return Err(fault(&format!("unknown filter {}", &filter[..filter.floor_char_boundary(40)]))),
    }
    .map_err(failed)?;
    Ok(decoded)
}
