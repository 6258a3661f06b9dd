//! Coded meshes: any bytes decode to a valid mesh or to an error.
#![no_main]

use insula_protocol::mesh::Mesh;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Ok(mesh) = Mesh::decode(bytes) else { return };
    assert!(mesh.triangles.as_flattened().iter().all(|vertex| (*vertex as usize) < mesh.positions.len()));
    // Decoded meshes can be encoded. The order may change.
    let again = mesh.encode().map(|encoded| Mesh::decode(&encoded.bytes));
    assert!(again.is_ok_and(|mesh| mesh.is_ok()));
});
