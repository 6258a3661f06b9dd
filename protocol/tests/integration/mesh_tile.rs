//! Mesh tiles: round trips, truncation and damage.

use insula_protocol::mesh::{Attribute, AttributeKind};
use insula_protocol::mesh_tile::{
    self, LandmarkObject, MAX_LODS, MAX_TEXTURE_SIDE_PX, NO_OBJECT, OCCLUSION_BITS, TileTexture,
};
use insula_protocol::tile::{TileReader, TileWriter};
use insula_protocol::{DecodeError, MeshTile, TileId, TileKind};
use insula_test_support::tier;
use proptest::prelude::*;

fn leaf() -> TileId {
    TileId::new(7, 100, 3).unwrap()
}

fn texture() -> TileTexture {
    TileTexture { size_px: [640, 20], bytes: [&b"RIFF\x10\0\0\0WEBPVP8L"[..], &[7; 200]].concat() }
}

fn plain() -> MeshTile {
    mesh_tile::cuboid([1.0, 2.0, -3.0], [9.0, 14.5, 21.0], [200, 90, 60], None)
}

fn textured() -> MeshTile {
    mesh_tile::cuboid([1.0, 2.0, -3.0], [9.0, 14.5, 21.0], [0; 3], Some(texture()))
}

/// Four houses on a ground, as triangles of five objects.
#[test]
fn triangles_keep_their_objects() {
    let mut tile = plain();
    let grid = tile.mesh.grid;
    for k in 0..4 {
        let other = mesh_tile::cuboid([f64::from(k), 2.0, -3.0], [9.0, 14.5, 21.0 + f64::from(k)], [1; 3], None);
        let first = tile.mesh.positions.len() as u32;
        tile.mesh.positions.extend(other.mesh.positions.iter().map(|p| [p[0] + 40 * k as u32, p[1], p[2]]));
        tile.mesh.triangles.extend(other.mesh.triangles.iter().map(|t| t.map(|vertex| vertex + first)));
        let attribute = &mut tile.mesh.attributes[0];
        attribute.corners.extend(&other.mesh.attributes[0].corners);
    }
    tile.mesh.grid = grid;
    tile.objects =
        (0..tile.mesh.triangles.len() as u32).map(|t| [7, 9, 1_000_000, NO_OBJECT, 8][t as usize / 12]).collect();
    let by_corners = |tile: &MeshTile| {
        let corners = |t: &[u32; 3]| {
            let mut corners = t.map(|vertex| tile.mesh.positions[vertex as usize]);
            corners.sort();
            corners
        };
        let mut all: Vec<_> = tile.mesh.triangles.iter().map(corners).zip(tile.objects.iter().copied()).collect();
        all.sort();
        all
    };
    let decoded = MeshTile::decode(leaf(), 0, &tile.encode(leaf(), 0).unwrap()).unwrap();
    assert_eq!(by_corners(&decoded), by_corners(&tile));
    let bytes = |objects: Vec<u32>| MeshTile { objects, ..tile.clone() }.encode(leaf(), 0).unwrap().len();
    assert!(bytes(tile.objects.clone()) < bytes(Vec::new()) + 40);
    assert_eq!(bytes(vec![NO_OBJECT; 60]), bytes(Vec::new()));
    assert!(MeshTile { objects: vec![1], ..tile }.encode(leaf(), 0).is_err());
}

#[test]
fn tiles_round_trip() {
    let tile = MeshTile::decode(leaf(), 2, &plain().encode(leaf(), 2).unwrap()).unwrap();
    assert_eq!((tile.mesh.triangles.len(), tile.mesh.positions.len()), (12, 8));
    assert_eq!((tile.mesh.grid, &tile.texture), (plain().mesh.grid, &None));
    assert!((0..36).all(|corner| tile.rgb(corner) == [200, 90, 60]));
    let tile = MeshTile::decode(leaf(), 0, &textured().encode(leaf(), 0).unwrap()).unwrap();
    assert_eq!(tile.texture, Some(texture()));
    let mut uvs: Vec<[u8; 2]> = (0..36).map(|corner| tile.uv(corner).map(|v| v as u8)).collect();
    uvs.sort();
    uvs.dedup();
    assert_eq!(uvs, [[0, 0], [0, 1], [1, 0], [1, 1]]);
}

#[test]
fn another_leaf_or_level_of_detail_is_refused() {
    let bytes = plain().encode(leaf(), 1).unwrap();
    assert!(MeshTile::decode(leaf(), 1, &bytes).is_ok());
    assert!(MeshTile::decode(leaf(), 0, &bytes).is_err());
    assert!(MeshTile::decode(leaf().parent().unwrap(), 1, &bytes).is_err());
    assert!(plain().encode(leaf(), MAX_LODS).is_err());
    assert!(plain().encode(TileId::new(20, 0, 0).unwrap(), 1).is_err());
}

#[test]
fn truncated_flipped_and_extra_bytes_are_refused() {
    for tile in [plain(), textured()] {
        let bytes = tile.encode(leaf(), 0).unwrap();
        for len in 0..bytes.len() {
            assert!(MeshTile::decode(leaf(), 0, &bytes[..len]).is_err(), "{len} of {}", bytes.len());
        }
        for at in 0..bytes.len() {
            let mut wrong = bytes.clone();
            wrong[at] ^= 0x10;
            assert!(MeshTile::decode(leaf(), 0, &wrong).is_err(), "{at}");
        }
        let longer = [&bytes[..], &[0]].concat();
        assert_eq!(MeshTile::decode(leaf(), 0, &longer), Err(DecodeError::TrailingBytes(1)));
    }
}

fn refused(tile: MeshTile) {
    assert!(tile.encode(leaf(), 0).is_err());
}

#[test]
fn invalid_tiles_are_refused() {
    let with = |texture: TileTexture| MeshTile { texture: Some(texture), ..textured() };
    refused(MeshTile { texture: None, ..textured() });
    refused(MeshTile { texture: Some(texture()), ..plain() });
    refused(with(TileTexture { size_px: [0, 4], ..texture() }));
    refused(with(TileTexture { size_px: [MAX_TEXTURE_SIDE_PX + 1, 1], ..texture() }));
    refused(with(TileTexture { size_px: [4096, 1025], ..texture() }));
    for bytes in [&b"GIF89a"[..], &[0xff, 0xd8, 0xff, 0xe0], b"RIFF", b"RIFF\x10\0\0\0WEBPVP8X"] {
        refused(with(TileTexture { bytes: bytes.to_vec(), ..texture() }));
    }
    let mut empty = plain();
    empty.mesh.triangles.clear();
    empty.mesh.attributes[0].corners.clear();
    refused(empty);
    let mut twice = plain();
    twice.mesh.attributes.push(twice.mesh.attributes[0].clone());
    refused(twice);
    let mut outside = textured();
    outside.mesh.attributes[0].range = [0.0, 0.1];
    refused(outside);
}

#[test]
fn excessive_counts_are_refused_before_allocation() {
    let mut mesh = vec![insula_protocol::mesh::VERSION, 1, 12, 0];
    [0f32, 0.0, 0.0, 1.0].iter().for_each(|v| mesh.extend(v.to_le_bytes()));
    mesh.extend([0xff, 0xff, 0x7f, 0xff, 0xff, 0x7f]);
    assert!(matches!(decode_parts(0, &mesh), Err(DecodeError::Limit { .. })));
}

fn decode_parts(lod: u8, mesh: &[u8]) -> Result<MeshTile, DecodeError> {
    let mut writer = TileWriter::new(TileKind::Mesh, Some(leaf()));
    writer.add_raw_section(1, &[lod]).unwrap();
    writer.add_raw_section(2, mesh).unwrap();
    MeshTile::decode(leaf(), lod, &writer.finish().unwrap())
}

#[test]
fn every_leaf_and_level_of_detail_has_its_own_archive_id() {
    let mut ids = std::collections::HashSet::new();
    for leaf in TileId::ROOT.children().flat_map(TileId::children) {
        for lod in 0..MAX_LODS {
            let id = mesh_tile::archive_id(leaf, lod).unwrap();
            assert!(ids.insert(id));
            assert_eq!(mesh_tile::from_archive_id(id, 2), Some((leaf, lod)));
        }
    }
    assert_eq!(mesh_tile::archive_id(TileId::ROOT, MAX_LODS), None);
    assert_eq!(mesh_tile::archive_id(TileId::new(18, 0, 0).unwrap(), 3), None);
    assert_eq!(mesh_tile::from_archive_id(TileId::new(3, 1, 0).unwrap(), 2), None, "not at a leaf's corner");
    assert_eq!(mesh_tile::from_archive_id(TileId::new(1, 0, 0).unwrap(), 2), None, "above the leaves");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(tier::cases()))]

    #[test]
    fn mutated_meshes_decode_or_are_refused(changes in proptest::collection::vec((any::<usize>(), any::<u8>()), 1..6)) {
        let bytes = plain().encode(leaf(), 0).unwrap();
        let mut mesh = TileReader::new(&bytes, TileKind::Mesh).unwrap().section(2, 1 << 20).unwrap();
        for (at, value) in changes {
            let at = at % mesh.len();
            mesh[at] = value;
        }
        if let Ok(tile) = decode_parts(0, &mesh) {
            let corners = 3 * tile.mesh.triangles.len();
            prop_assert!((0..corners).all(|corner| tile.rgb(corner).len() == 3));
        }
    }

    #[test]
    fn random_bytes_are_refused(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        prop_assert!(MeshTile::decode(leaf(), 0, &bytes).is_err());
    }
}

/// A box of stone beside one of none, with occlusion at its corners.
fn statue() -> MeshTile {
    let mut tile = plain();
    tile.objects = (0..12).map(|t| if t < 6 { 4 } else { 9 }).collect();
    tile.landmarks = vec![LandmarkObject { object: 9, stone: Some(3), anchor_m: [-12.5, 700.0, 3.25] }];
    tile.mesh.attributes.push(Attribute {
        kind: AttributeKind::Other,
        components: 1,
        bits: OCCLUSION_BITS,
        range: [0.0, 1.0 / 31.0],
        values: (0..8).map(|v| [4 * v, 0, 0, 0]).collect(),
        corners: tile.mesh.triangles.concat(),
    });
    tile
}

#[test]
fn landmarks_and_occlusion_round_trip() {
    let tile = MeshTile::decode(leaf(), 0, &statue().encode(leaf(), 0).unwrap()).unwrap();
    assert_eq!(tile.landmarks, statue().landmarks);
    let shares = |tile: &MeshTile| {
        let corner = |i: usize| {
            let vertex = tile.mesh.triangles[i / 3][i % 3];
            (tile.mesh.positions[vertex as usize], tile.occlusion(i).unwrap().to_bits())
        };
        let mut all: Vec<_> = (0..36).map(corner).collect();
        all.sort();
        all.dedup();
        all
    };
    assert_eq!(shares(&tile), shares(&statue()));
    assert_eq!(shares(&tile).len(), 8);
    assert_eq!(plain().occlusion(0), None);
}

#[test]
fn invalid_landmarks_are_refused() {
    let stone = statue().landmarks[0];
    let with = |landmarks: Vec<LandmarkObject>| MeshTile { landmarks, ..statue() };
    refused(with(vec![LandmarkObject { object: 5, ..stone }]));
    refused(with(vec![stone, stone]));
    refused(with(vec![LandmarkObject { stone: Some(16), ..stone }]));
    refused(with(vec![LandmarkObject { anchor_m: [0.0, f32::NAN, 0.0], ..stone }]));
    refused(MeshTile { objects: Vec::new(), ..statue() });
    let mut tile = statue();
    tile.mesh.attributes[1].bits = 6;
    refused(tile);
    let both = MeshTile { landmarks: vec![LandmarkObject { stone: None, ..stone }], ..statue() };
    assert_eq!(MeshTile::decode(leaf(), 0, &both.encode(leaf(), 0).unwrap()).unwrap().landmarks, both.landmarks);
}
