//! Bytes of format version 2, frozen: what was written once can be read for ever.
//!
//! The files were made by `write_vectors` (ignored, run by hand when a version is born) and must never change; a new
//! version gets new files beside them.

#![allow(clippy::unwrap_used)] // In a test, the panic is the report.

use insula_protocol::{
    BlockMap, Subtree, Texel, TileId,
    blockmap::{COLUMNS, ColumnClip, CornerWall, MapColumn, OuterTop, WallStrip, strip_rows},
    octahedral,
    subtree::NodeInfo,
};

const BLOCKMAP: &[u8] = include_bytes!("vectors/v2_blockmap.bin");
const SUBTREE: &[u8] = include_bytes!("vectors/v2_subtree.bin");

/// Every kind of column, at the corners of a node.
fn blockmap() -> BlockMap {
    let strip = |z_min, z_max, holes: bool| {
        let rows = strip_rows(z_min, z_max, 1).1;
        let alpha = |row| if holes && row == 1 { 0 } else { 3 };
        let mut texels: Vec<Texel> =
            (0..rows).map(|row| Texel::new([row as u8, 100, 255 - row as u8], 40, alpha(row))).collect();
        texels.iter_mut().filter(|texel| texel.alpha() == 0).for_each(|texel| *texel = Texel::TRANSPARENT);
        Some(WallStrip { texels, azimuth: 64 })
    };
    let up = octahedral::encode([0.0, 0.0, 1.0]);
    let slope = octahedral::encode([0.6, 0.0, 0.8]);
    let roof = Texel::new([200, 90, 60], 63, 3);
    let plain = MapColumn { z_min: 5, z_max: 90, roof, roof_normal: up, ..MapColumn::default() };
    let mut columns = vec![None; COLUMNS];
    columns[0] = Some(plain.clone());
    columns[1] = Some(MapColumn { inclined: true, roof_normal: slope, ..plain.clone() });
    columns[63] = Some(MapColumn { strip: strip(5, 90, false), ..plain.clone() });
    columns[COLUMNS - 64] = Some(MapColumn { suspended: true, strip: strip(5, 90, true), ..plain.clone() });
    let corner = Some(CornerWall { azimuth: 3, offset: 40, concave: true });
    let clip = Some(ColumnClip {
        offset: -20,
        corner,
        outer: Some(OuterTop { z: 12, roof: Texel::new([10, 20, 30], 50, 3) }),
    });
    columns[COLUMNS - 63] = Some(MapColumn { clip, strip: strip(5, 90, false), ..plain.clone() });
    columns[COLUMNS - 1] = Some(MapColumn { gap: Some([20, 60]), strip: strip(5, 90, false), ..plain });
    BlockMap::from_columns(TileId::new(3, 5, 2).unwrap(), 0.5, -7, 1, &columns).unwrap()
}

fn subtree() -> Subtree {
    let node = |id, child_mask| NodeInfo {
        id,
        child_mask,
        z_min_m: -2.5,
        z_max_m: 71.25,
        error_m: 3.5,
        radius_m: 200.0,
        blockmap_bytes: 4321,
    };
    let root = TileId::new(5, 17, 30).unwrap();
    let child = root.child(2).unwrap();
    Subtree { nodes: vec![node(root, 0b0100), node(child, 0)], meshes: vec![] }
}

#[test]
fn version_2_block_maps_can_be_read() {
    assert_eq!(BlockMap::decode(blockmap().id, BLOCKMAP).unwrap(), blockmap());
}

#[test]
fn version_2_subtrees_can_be_read() {
    assert_eq!(Subtree::decode(SUBTREE).unwrap(), subtree());
}

#[test]
fn what_the_encoder_writes_today_is_the_same_map() {
    assert_eq!(BlockMap::decode(blockmap().id, &blockmap().encode().unwrap()).unwrap(), blockmap());
}

#[test]
#[ignore = "writes the frozen files: only when a format version is born"]
fn write_vectors() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/vectors");
    std::fs::write(format!("{folder}/v2_blockmap.bin"), blockmap().encode().unwrap()).unwrap();
    std::fs::write(format!("{folder}/v2_subtree.bin"), subtree().encode().unwrap()).unwrap();
}
