//! Decoded tiles as bytes, for a browser: its workers share no memory, so one decodes tiles and passes them to another that has the
//! cache.
//!
//! Only this program writes and reads them, in one version: they are not a format.

use crate::cache::PackedTile;
use crate::decode::{DecodedTile, decode};
use crate::scene::TileKey;
use bincode::config::{Configuration, Fixint, Limit, LittleEndian, standard};
use insula_protocol::DecodeError;

/// Size of the largest tile in this form.
const MAX_BYTES: usize = 256 << 20;

fn config() -> Configuration<LittleEndian, Fixint, Limit<MAX_BYTES>> {
    standard().with_fixed_int_encoding().with_limit()
}

/// Decodes a V-BlockMap or a mesh. Fails as [`decode`] does, and for subtrees and visibility, which are small enough to be decoded
/// where they are used.
pub fn decode_to_bytes(key: TileKey, bytes: &[u8]) -> Result<Vec<u8>, DecodeError> {
    match decode(key, bytes)? {
        DecodedTile::Packed(tile) => {
            bincode::serde::encode_to_vec(&tile, config()).map_err(|_| DecodeError::Invalid("a tile that is too large"))
        }
        DecodedTile::Subtree(_) | DecodedTile::Visibility(_) => {
            Err(DecodeError::Invalid("a subtree or visibility tile where another is expected"))
        }
    }
}

/// The tile that [`decode_to_bytes`] wrote. Fails for anything else.
pub fn from_bytes(bytes: &[u8]) -> Result<PackedTile, DecodeError> {
    let invalid = DecodeError::Invalid("not a decoded tile of this version");
    match bincode::serde::borrow_decode_from_slice(bytes, config()) {
        Ok((tile, length)) if length == bytes.len() => Ok(tile),
        _ => Err(invalid),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::{BlockMap, TileId, mesh_tile};

    #[test]
    fn tiles_arrive_as_they_were_decoded() {
        let id = TileId::new(3, 1, 2).unwrap();
        let map = BlockMap::empty(id, 1.0, 0, 0).encode().unwrap();
        let mesh = mesh_tile::cuboid([0.0; 3], [9.0; 3], [0; 3], None).encode(id, 1).unwrap();
        for (key, bytes) in [(TileKey::block_map(id), map), (TileKey::mesh(id, 1), mesh)] {
            let Ok(DecodedTile::Packed(decoded)) = decode(key, &bytes) else { panic!("the tile is valid") };
            let sent = decode_to_bytes(key, &bytes).unwrap();
            assert_eq!(format!("{:?}", from_bytes(&sent).unwrap()), format!("{decoded:?}"));
            assert!(from_bytes(&sent[1..]).is_err() && from_bytes(&[&sent[..], &[0]].concat()).is_err());
            assert!((0..sent.len()).step_by(997).all(|end| from_bytes(&sent[..end]).is_err()));
            assert!(decode_to_bytes(TileKey::subtree(id), &bytes).is_err());
        }
    }
}
