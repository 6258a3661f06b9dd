//! Decoding: from a tile's bytes to what the cache and the scene tree hold.
//!
//! In: bytes from an untrusted source. Out: [`DecodedTile`]. Next: `cache`, `scene`.

use crate::scene::TileKey;
use insula_protocol::{
    BlockMap, DecodeError, MeshTile, Subtree,
    mesh_tile::{self, Texture},
    route::Layer,
};
use insula_shaders::{
    mesh::{PackedMesh, Picture},
    pack::PackedNode,
};
use std::io::Cursor;

/// Largest subtree tile: 1,365 nodes of 21 bytes, up to 1,024 leaves' meshes of 77 bytes, and a header.
const SUBTREE_BYTES: usize = 128 << 10;
/// Largest V-BlockMap tile: a million texels and all planes, incompressible, with a margin.
const BLOCK_MAP_BYTES: usize = 8 << 20;

/// Largest tile of any kind.
pub const MAX_TILE_BYTES: usize = mesh_tile::MAX_BYTES;
const _: () = assert!(MAX_TILE_BYTES >= BLOCK_MAP_BYTES && MAX_TILE_BYTES >= SUBTREE_BYTES);

/// The content of a tile.
#[derive(Debug)]
pub enum DecodedTile {
    /// A V-BlockMap, ready for the atlas.
    Node(Box<PackedNode>),
    /// A leaf's mesh, ready for the atlas.
    Mesh(Box<PackedMesh>),
    /// A subtree, ready for the scene tree.
    Subtree(Subtree),
}

/// Most bytes that a tile may have.
pub fn limit_bytes(key: TileKey) -> usize {
    match key.layer() {
        Layer::Subtrees => SUBTREE_BYTES,
        Layer::BlockMaps => BLOCK_MAP_BYTES,
        Layer::Meshes => mesh_tile::MAX_BYTES,
    }
}

/// Decodes a tile. Fails if the bytes do not decode, or are those of another tile than `key`.
pub fn decode(key: TileKey, bytes: &[u8]) -> Result<DecodedTile, DecodeError> {
    match key.layer() {
        Layer::Subtrees => {
            let subtree = Subtree::decode(bytes)?;
            let is_requested = subtree.nodes.first().is_some_and(|root| root.id == key.id);
            is_requested
                .then_some(DecodedTile::Subtree(subtree))
                .ok_or(DecodeError::Invalid("the subtree of another node"))
        }
        Layer::BlockMaps => {
            let map = BlockMap::decode(key.id, bytes)?;
            Ok(DecodedTile::Node(Box::new(PackedNode::new(&map))))
        }
        Layer::Meshes => {
            let MeshTile { mesh, texture } = MeshTile::decode(key.id, key.lod, bytes)?;
            let texture = texture.as_ref().map(decode_texture).transpose()?;
            let packed = PackedMesh::new(&mesh, texture.as_ref());
            packed
                .map(|mesh| DecodedTile::Mesh(Box::new(mesh)))
                .map_err(|_| DecodeError::Invalid("a mesh that cannot be drawn"))
        }
    }
}

/// Decompresses a texture. Fails if it is damaged, or has another size than the tile says; that size is within the format's limits.
fn decode_texture(texture: &Texture) -> Result<Picture, DecodeError> {
    let damaged = |_| DecodeError::Invalid("a mesh's texture is damaged");
    let [width_px, height_px] = texture.size_px.map(u32::from);
    let mut reader = image::ImageReader::new(Cursor::new(&texture.bytes));
    reader.set_format(image::ImageFormat::WebP);
    let mut limits = image::Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(width_px), Some(height_px));
    // Room for the image and for the buffers of its decoder.
    limits.max_alloc = Some(u64::from(texture.pixels()) * 16 + (1 << 20));
    reader.limits(limits);
    let rgb = reader.decode().map_err(damaged)?.into_rgb8();
    if rgb.dimensions() != (width_px, height_px) {
        return Err(DecodeError::Invalid("a mesh's texture has another size than its tile says"));
    }
    let texels = rgb.pixels().map(|p| u32::from_le_bytes([p.0[0], p.0[1], p.0[2], 255])).collect();
    Ok(Picture { width_px, height_px, texels })
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::TileId;

    #[test]
    fn decodes_a_mesh_texture_of_the_stated_size_only() {
        let id = TileId::new(9, 5, 6).unwrap();
        let mut webp = Cursor::new(Vec::new());
        let texture = image::RgbImage::from_fn(70, 30, |x, y| image::Rgb([x as u8, y as u8, 9]));
        texture.write_to(&mut webp, image::ImageFormat::WebP).unwrap();
        let tile = |size_px, bytes: Vec<u8>| {
            let texture = Some(Texture { size_px, bytes });
            mesh_tile::cuboid([0.0; 3], [9.0; 3], [0; 3], texture).encode(id, 1).unwrap()
        };
        let webp = webp.into_inner();
        let Ok(DecodedTile::Mesh(mesh)) = decode(TileKey::mesh(id, 1), &tile([70, 30], webp.clone())) else {
            panic!("the tile is valid")
        };
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
        assert!(matches!(decode(TileKey::block_map(id), &bytes), Ok(DecodedTile::Node(_))));
        assert!(decode(TileKey::subtree(TileId::ROOT), &bytes).is_err());
    }
}
