//! Decoding: from a tile's bytes to what the cache and the scene tree hold.
//!
//! In: bytes from an untrusted source. Out: [`DecodedTile`]. Next: `cache`, `scene`.

use crate::cache::PackedTile;
use crate::scene::TileKey;
use insula_protocol::{BlockMap, DecodeError, MeshTile, Subtree, TileId, TileKind, VisibilityTile};
use insula_shaders::mesh::MeshTexture;

/// The content of a tile.
#[derive(Debug)]
pub enum DecodedTile {
    /// A V-BlockMap or a mesh, ready for the atlas.
    Packed(PackedTile),
    /// A subtree, ready for the scene tree.
    Subtree(Subtree),
    /// What can be seen from some cells, ready for the scene tree.
    Visibility(VisibilityTile),
}

/// Decodes a tile. Fails if the bytes do not decode, or are those of another tile than `key`.
pub fn decode(key: TileKey, bytes: &[u8]) -> Result<DecodedTile, DecodeError> {
    match key.kind() {
        TileKind::BlockMap => decode_block_map(key.id, bytes).map(DecodedTile::Packed),
        TileKind::Mesh => decode_mesh(key, bytes).map(DecodedTile::Packed),
        TileKind::Subtree | TileKind::Visibility | TileKind::Objects => decode_index(key, bytes),
    }
}

/// The same of a V-BlockMap.
pub fn decode_block_map(id: TileId, bytes: &[u8]) -> Result<PackedTile, DecodeError> {
    Ok(PackedTile::node(&BlockMap::decode(id, bytes)?.stand_on_ground()))
}

/// The same of a mesh. In a browser, a module of its own does it.
pub fn decode_mesh(key: TileKey, bytes: &[u8]) -> Result<PackedTile, DecodeError> {
    let MeshTile { mesh, texture, objects, landmarks } = MeshTile::decode(key.id, key.lod, bytes)?;
    let texture = texture.as_ref().map(MeshTexture::decode).transpose()?;
    let packed = PackedTile::mesh(&mesh, texture.as_ref(), &objects, &landmarks);
    packed.map_err(|_| DecodeError::Invalid("a mesh that cannot be drawn"))
}

/// The same of a tile that says what there is: a subtree or visibility. Fails for all others.
pub fn decode_index(key: TileKey, bytes: &[u8]) -> Result<DecodedTile, DecodeError> {
    match key.kind() {
        TileKind::Subtree => {
            let subtree = Subtree::decode(bytes)?;
            let is_requested = subtree.nodes.first().is_some_and(|root| root.id == key.id);
            is_requested
                .then_some(DecodedTile::Subtree(subtree))
                .ok_or(DecodeError::Invalid("the subtree of another node"))
        }
        TileKind::Visibility => VisibilityTile::decode(key.id, bytes).map(DecodedTile::Visibility),
        TileKind::BlockMap | TileKind::Mesh => Err(DecodeError::Invalid("a tile that is drawn where none is expected")),
        TileKind::Objects => Err(DecodeError::Invalid("objects are not drawn")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::mesh_tile::{self, TileTexture};
    use std::io::Cursor;

    #[test]
    fn decodes_a_mesh_texture_of_the_stated_size_only() {
        let id = TileId::new(9, 5, 6).unwrap();
        let mut webp = Cursor::new(Vec::new());
        let texture = image::RgbImage::from_fn(70, 30, |x, y| image::Rgb([x as u8, y as u8, 9]));
        texture.write_to(&mut webp, image::ImageFormat::WebP).unwrap();
        let tile = |size_px, bytes: Vec<u8>| {
            let texture = Some(TileTexture { size_px, bytes });
            mesh_tile::cuboid([0.0; 3], [9.0; 3], [0; 3], texture).encode(id, 1).unwrap()
        };
        let webp = webp.into_inner();
        let decoded = decode(TileKey::mesh(id, 1), &tile([70, 30], webp.clone()));
        let Ok(DecodedTile::Packed(PackedTile::Mesh(mesh, _))) = decoded else { panic!("the tile is valid") };
        assert_eq!(mesh.triangles, 12);
        assert!(decode(TileKey::mesh(id, 0), &tile([70, 30], webp.clone())).is_err(), "another level of detail");
        for (size_px, bytes) in [([70, 31], webp.clone()), ([35, 15], webp.clone()), ([70, 30], webp[..60].to_vec())] {
            assert!(decode(TileKey::mesh(id, 1), &tile(size_px, bytes)).is_err());
        }
    }

    #[test]
    fn refuses_a_tile_of_another_kind() {
        let id = TileId::new(3, 1, 2).unwrap();
        let bytes = BlockMap::empty(id, 1.0, 0, 0).encode().unwrap();
        assert!(matches!(decode(TileKey::block_map(id), &bytes), Ok(DecodedTile::Packed(_))));
        assert!(decode(TileKey::subtree(TileId::ROOT), &bytes).is_err());
        assert!(decode_index(TileKey::block_map(id), &bytes).is_err());
    }
}
