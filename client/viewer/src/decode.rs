//! From a tile's bytes to what the cache and the tree hold, on worker threads.
//!
//! In: bytes that anyone may have made. Out: [`DecodedTile`]. Next: `cache`, `scene::tree`.

use crate::scene::TileKey;
use insula_protocol::{BlockMap, DecodeError, MeshTile, Subtree, TileKind};
use insula_shaders::{
    mesh::{MeshTexture, PackedMesh},
    pack::PackedNode,
};

/// A tile's content.
#[derive(Debug)]
pub enum DecodedTile {
    /// Ready for the atlas.
    Node(Box<PackedNode>),
    /// Ready for the atlas, as a leaf's mesh.
    Mesh(Box<PackedMesh>),
    /// Ready for the tree.
    Subtree(Subtree),
}

/// Decodes `bytes`, fetched as the tile of `key`.
pub fn decode(key: TileKey, bytes: &[u8]) -> Result<DecodedTile, DecodeError> {
    match key.layer() {
        TileKind::Subtree => {
            let subtree = Subtree::decode(bytes)?;
            let same = subtree.nodes.first().is_some_and(|root| root.id == key.id);
            if same {
                Ok(DecodedTile::Subtree(subtree))
            } else {
                Err(DecodeError::Invalid("the subtree of another node"))
            }
        }
        TileKind::BlockMap => {
            let map = BlockMap::decode(key.id, bytes)?;
            Ok(DecodedTile::Node(Box::new(PackedNode::new(&map))))
        }
        TileKind::Mesh => {
            let MeshTile { mesh, texture } = MeshTile::decode(key.id, key.lod, bytes)?;
            let texture = texture.as_ref().map(MeshTexture::decode).transpose()?;
            let packed = PackedMesh::new(&mesh, texture.as_ref());
            let refused = |_| DecodeError::Invalid("a mesh that cannot be drawn");
            packed.map(|mesh| DecodedTile::Mesh(Box::new(mesh))).map_err(refused)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::{
        TileId,
        mesh_tile::{self, TileTexture},
    };
    use std::io::Cursor;

    #[test]
    fn a_mesh_s_picture_is_unpacked_if_it_is_what_it_says() {
        let id = TileId::new(9, 5, 6).unwrap();
        let mut webp = Cursor::new(Vec::new());
        let picture = image::RgbImage::from_fn(70, 30, |x, y| image::Rgb([x as u8, y as u8, 9]));
        picture.write_to(&mut webp, image::ImageFormat::WebP).unwrap();
        let tile = |size_px, bytes: Vec<u8>| {
            let texture = Some(TileTexture { size_px, bytes });
            mesh_tile::cuboid([0.0; 3], [9.0; 3], [0; 3], texture).encode(id, 1).unwrap()
        };
        let webp = webp.into_inner();
        let Ok(DecodedTile::Mesh(mesh)) = decode(TileKey::mesh(id, 1), &tile([70, 30], webp.clone())) else {
            panic!("it is whole")
        };
        assert_eq!(mesh.triangles, 12);
        assert!(decode(TileKey::mesh(id, 0), &tile([70, 30], webp.clone())).is_err(), "another level of detail");
        for (size_px, bytes) in [([70, 31], webp.clone()), ([35, 15], webp.clone()), ([70, 30], webp[..60].to_vec())] {
            assert!(decode(TileKey::mesh(id, 1), &tile(size_px, bytes)).is_err());
        }
    }

    #[test]
    fn only_the_tile_that_was_asked_for() {
        let id = TileId::new(3, 1, 2).unwrap();
        let bytes = BlockMap::empty(id, 1.0, 0, 0).encode().unwrap();
        assert!(matches!(decode(TileKey::block_map(id), &bytes), Ok(DecodedTile::Node(_))));
        assert!(decode(TileKey::subtree(TileId::ROOT), &bytes).is_err());
    }
}
