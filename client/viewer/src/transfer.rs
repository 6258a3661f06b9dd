//! Decoded tiles and packed models as bytes, for a browser: its workers and modules share no memory, so one makes them and passes them
//! to another that has the cache.
//!
//! Only this program writes and reads them, in one version: they are not a format.

use bincode::config::{Configuration, Fixint, Limit, LittleEndian, standard};
use insula_protocol::DecodeError;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Size of the largest tile in this form.
const MAX_BYTES: usize = 256 << 20;

fn config() -> Configuration<LittleEndian, Fixint, Limit<MAX_BYTES>> {
    standard().with_fixed_int_encoding().with_limit()
}

/// The bytes of a [`PackedTile`](crate::cache::PackedTile) or a [`PackedAddition`](crate::additions::PackedAddition). Fails if it is too
/// large.
pub fn to_bytes(packed: &impl Serialize) -> Result<Vec<u8>, DecodeError> {
    bincode::serde::encode_to_vec(packed, config()).map_err(|_| DecodeError::Invalid("a tile that is too large"))
}

/// What [`to_bytes`] wrote. Fails for anything else.
pub fn from_bytes<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, DecodeError> {
    let invalid = DecodeError::Invalid("not a decoded tile of this version");
    match bincode::serde::decode_from_slice(bytes, config()) {
        Ok((packed, length)) if length == bytes.len() => Ok(packed),
        _ => Err(invalid),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::additions::{self, AddedObject, PackedAddition};
    use crate::cache::PackedTile;
    use crate::decode::{decode_block_map, decode_mesh};
    use crate::scene::TileKey;
    use insula_protocol::{BlockMap, TileId, mesh_tile};

    fn ensure_arrives<T: Serialize + DeserializeOwned + std::fmt::Debug>(packed: &T) {
        let sent = to_bytes(packed).unwrap();
        let received = |bytes: &[u8]| from_bytes::<T>(bytes);
        assert_eq!(format!("{:?}", received(&sent).unwrap()), format!("{packed:?}"));
        assert!(received(&sent[1..]).is_err() && received(&[&sent[..], &[0]].concat()).is_err());
        assert!((0..sent.len()).step_by(997).all(|end| received(&sent[..end]).is_err()));
    }

    #[test]
    fn tiles_arrive_as_they_were_decoded() {
        let id = TileId::new(3, 1, 2).unwrap();
        let map = BlockMap::empty(id, 1.0, 0, 0).encode().unwrap();
        let mesh = mesh_tile::cuboid([0.0; 3], [9.0; 3], [0; 3], None).encode(id, 1).unwrap();
        ensure_arrives::<PackedTile>(&decode_block_map(id, &map).unwrap());
        ensure_arrives::<PackedTile>(&decode_mesh(TileKey::mesh(id, 1), &mesh).unwrap());
        assert!(decode_mesh(TileKey::mesh(id, 1), &map).is_err() && decode_block_map(id, &mesh).is_err());
    }

    #[test]
    fn models_arrive_as_they_were_packed() {
        let triangles = vec![[[0.0; 3], [9.0, 0.0, 0.0], [0.0, 0.0, 9.0]]];
        let packed = additions::pack(&[AddedObject { name: "tower".to_owned(), triangles }]).unwrap();
        ensure_arrives::<PackedAddition>(&packed[0]);
    }
}
