//! Mesh tiles: whatever decodes is valid and can be encoded. The input is used as a tile, and as the mesh of a tile.
#![no_main]
#![allow(clippy::unwrap_used, reason = "a finding is a panic")]

use insula_protocol::{
    MeshTile, TileId, TileKind,
    tile::{TileReader, TileWriter},
};
use libfuzzer_sys::fuzz_target;

fn check(id: TileId, lod: u8, bytes: &[u8]) {
    let Ok(tile) = MeshTile::decode(id, lod, bytes) else { return };
    let corners = 3 * tile.mesh.triangles.len();
    assert!(tile.mesh.triangles.as_flattened().iter().all(|vertex| (*vertex as usize) < tile.mesh.positions.len()));
    for corner in 0..corners {
        if tile.texture.is_some() {
            assert!(tile.uv(corner).iter().all(|v| (0.0..=1.0).contains(v)));
        } else {
            tile.rgb(corner);
        }
    }
    let Ok(again) = tile.encode(id, lod) else { return };
    assert!(MeshTile::decode(id, lod, &again).is_ok());
}

fuzz_target!(|bytes: &[u8]| {
    if let Ok(tile) = TileReader::new(bytes, TileKind::Mesh) {
        (0..4).for_each(|lod| check(tile.id.unwrap_or(TileId::ROOT), lod, bytes));
    }
    // A fuzzer cannot guess checksums. The first byte says whether there is a texture, the rest is the mesh.
    let Some((first, mesh)) = bytes.split_first() else { return };
    let mut writer = TileWriter::new(TileKind::Mesh, Some(TileId::ROOT));
    let textured = first & 1 == 1;
    let meta = if textured { vec![0, 8, 0, 8, 0] } else { vec![0] };
    writer.add_raw_section(1, &meta).unwrap();
    writer.add_raw_section(2, mesh).unwrap();
    if textured {
        writer.add_raw_section(3, b"RIFF\0\0\0\0WEBPVP8L").unwrap();
    }
    if let Ok(bytes) = writer.finish() {
        check(TileId::ROOT, 0, &bytes);
    }
});
