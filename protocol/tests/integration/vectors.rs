//! Frozen bytes of format version 4: every later program must decode them, and this encoder must still write
//! them, except for the lossy one: which levels an encoder chooses is not part of the format.
//!
//! `write_vectors` (ignored) made the files. They never change. A new format version gets new files.

use insula_protocol::blockmap::objects::lower_tops;
use insula_protocol::blockmap::{
    COLUMNS, ColumnClip, ColumnObjects, CornerWall, MapColumn, NO_OBJECT, OuterTop, Quality, WallStrip, flag,
    strip_rows,
};
use insula_protocol::codec::checksum;
use insula_protocol::mesh::{Attribute, AttributeKind, Mesh, PositionGrid};
use insula_protocol::mesh_tile::{self, LandmarkObject, OCCLUSION_BITS, TileTexture};
use insula_protocol::subtree::{MeshLod, NodeDeviation, NodeInfo, NodeMesh};
use insula_protocol::{BlockMap, MeshTile, Subtree, Texel, TileId, object_tile, octahedral};

macro_rules! vector {
    ($name:literal) => {
        include_bytes!(concat!("../vectors/v4_", $name, ".bin"))
    };
}

const BLOCKMAP: &[u8] = vector!("blockmap");
const LOSSY_BLOCKMAP: &[u8] = vector!("lossy_blockmap");
const TOWN_BLOCKMAP: &[u8] = vector!("town_blockmap");
const TOWN_WITH_OBJECTS: &[u8] = vector!("town_with_objects");
const SUBTREE: &[u8] = vector!("subtree");
const SUBTREE_WITH_MESHES: &[u8] = vector!("subtree_with_meshes");
const SUBTREE_WITH_DEVIATIONS: &[u8] = vector!("subtree_with_deviations");
const PLAIN_TILE: &[u8] = vector!("plain_mesh_tile");
const TEXTURED_TILE: &[u8] = vector!("textured_mesh_tile");
const TILE_WITH_OBJECTS: &[u8] = vector!("mesh_tile_with_objects");
const TILE_WITH_LANDMARKS: &[u8] = vector!("mesh_tile_with_landmarks");
const OBJECT_SCHEMA: &[u8] = vector!("object_schema");
const OBJECT_BLOCK: &[u8] = vector!("object_block");
const SCAN: &[u8] = vector!("scan_mesh");
const ARCHITECTURAL: &[u8] = vector!("architectural_mesh");
/// Written by [`by_hand`]: our encoder would never write these.
const SUBTREE_BY_HAND: &[u8] = vector!("subtree_by_hand");
const BLOCKMAP_BY_HAND: &[u8] = vector!("blockmap_by_hand");

/// The peak signal-to-noise ratio of the lossy map.
const DB: f32 = 36.0;

fn node_id() -> TileId {
    TileId::new(3, 5, 2).unwrap()
}

fn leaf() -> TileId {
    TileId::new(7, 100, 3).unwrap()
}

/// A map with every kind of column, at the corners of the node.
fn blockmap() -> BlockMap {
    let strip = |z_min, z_max, holes: bool| {
        let rows = strip_rows(z_min, z_max, 1).1;
        let opaque = |row| Texel::new([row as u8, 100, 255 - row as u8], 40);
        let texels = (0..rows).map(|row| if holes && row == 1 { Texel::OPEN } else { opaque(row) }).collect();
        Some(WallStrip { texels, azimuth: 64 })
    };
    let up = octahedral::encode([0.0, 0.0, 1.0]);
    let slope = octahedral::encode([0.6, 0.0, 0.8]);
    let roof = Texel::new([200, 90, 60], 63);
    let plain = MapColumn { z_min: 5, z_max: 90, roof, roof_normal: up, ..MapColumn::default() };
    let mut columns = vec![None; COLUMNS];
    columns[0] = Some(plain.clone());
    columns[1] = Some(MapColumn { inclined: true, roof_normal: slope, ..plain.clone() });
    columns[63] = Some(MapColumn { strip: strip(5, 90, false), ..plain.clone() });
    columns[COLUMNS - 64] = Some(MapColumn { suspended: true, strip: strip(5, 90, true), ..plain.clone() });
    let corner = Some(CornerWall { azimuth: 3, offset: 40, concave: true });
    let outer = Some(OuterTop { z: 12, roof: Texel::new([10, 20, 30], 50) });
    let clip = Some(ColumnClip { offset: -20, corner, outer });
    columns[COLUMNS - 63] = Some(MapColumn { clip, strip: strip(5, 90, false), ..plain.clone() });
    columns[COLUMNS - 1] = Some(MapColumn { gap: Some([20, 60]), strip: strip(5, 90, false), ..plain });
    BlockMap::from_columns(node_id(), 0.5, -7, 1, &columns).unwrap()
}

/// A map with more colours than a palette holds.
fn colourful_blockmap() -> BlockMap {
    let colour = |i: usize| Texel::new([(i * 7 % 256) as u8, (i * i % 199) as u8, (i / 5 % 256) as u8], (i % 64) as u8);
    let columns: Vec<_> = (0..COLUMNS)
        .map(|i| {
            let is_building = i % 64 < 12 && i / 64 < 9;
            let (z_min, z_max) = (3, 40 + (i % 7) as u16);
            let rows = usize::from(strip_rows(z_min, z_max, 0).1);
            let strip = (i % 64 == 11)
                .then(|| WallStrip { texels: (0..rows).map(|row| colour(i * row)).collect(), azimuth: 0 });
            let roof_normal = octahedral::encode([0.0, 0.0, 1.0]);
            is_building.then(|| MapColumn { z_min, z_max, roof: colour(i), roof_normal, strip, ..MapColumn::default() })
        })
        .collect();
    BlockMap::from_columns(node_id(), 0.5, 0, 0, &columns).unwrap()
}

/// Ground on a slope with buildings, bridges and ponds: bottoms, tops and walls at many heights, so that all contexts of their
/// coding occur.
fn town_blockmap() -> BlockMap {
    let column = |i: usize| {
        let (x, y) = (i % 64, i / 64);
        let (plot, within) = (x / 10 + y / 8 * 7, [x % 10, y % 8]);
        let ground = (40 + x / 2 + y / 3) as u16;
        let up = octahedral::encode([0.0, 0.0, 1.0]);
        let roof = Texel::new([(plot * 37 % 256) as u8, 90, (plot * 11 % 200) as u8], (30 + plot % 30) as u8);
        let is_built = within[0] < 7 && within[1] < 5;
        if !is_built {
            let land = MapColumn { z_min: ground - 9, z_max: ground, roof_normal: up, ..MapColumn::default() };
            let texel = Texel::new([80, 120, 70], (50 + x % 7) as u8);
            return (plot % 9 != 8).then_some(MapColumn { roof: texel, reflective: plot % 11 == 3, ..land });
        }
        let is_bridge = plot % 5 == 4;
        let z_min = if is_bridge { ground + 30 } else { (48 + plot / 3) as u16 };
        let z_max = z_min.max(ground) + (20 + plot * 13 % 70) as u16;
        let slope = octahedral::encode([0.5, 0.25 * (plot % 3) as f32, 0.8]);
        let inclined = plot % 3 == 1;
        let is_wall = within[0] == 0 || within[0] == 6 || within[1] == 0 || within[1] == 4;
        let texels = |rows: u16| {
            let texel = |row: u16| match (plot % 7, row) {
                (6, 2) => Texel::OPEN,
                _ => Texel::new([(plot * 5 % 256) as u8, (row / 2 * 9) as u8, 60], (40 + row % 20) as u8),
            };
            (0..rows).map(texel).collect()
        };
        let strip = is_wall.then(|| WallStrip {
            texels: texels(strip_rows(z_min, z_max, 0).1),
            azimuth: if within[1] == 0 { 192 } else { (plot * 3) as u8 },
        });
        let gap = (is_wall && plot % 4 == 2 && z_max - z_min > 30).then_some([z_min + 5, z_min + 21 + (x % 4) as u16]);
        let outer = (plot % 2 == 0).then_some(OuterTop { z: z_min + 6, roof });
        let corner = (plot % 6 == 3).then_some(CornerWall { azimuth: 64, offset: -9, concave: y % 2 == 1 });
        let clip = (is_wall && plot % 3 == 0).then_some(ColumnClip { offset: (x as i8) - 30, corner, outer });
        let roof_normal = if inclined { slope } else { up };
        let suspended = is_bridge;
        Some(MapColumn {
            z_min,
            z_max,
            inclined,
            suspended,
            gap,
            roof,
            roof_normal,
            strip,
            clip,
            reflective: false,
            thin: None,
        })
    };
    let columns: Vec<_> = (0..COLUMNS).map(column).collect();
    BlockMap::from_columns(node_id(), 1.0, -3, 0, &columns).unwrap()
}

/// The town with an object for each plot, terrain, and ground of none. Some parts show any object.
fn town_with_objects() -> BlockMap {
    let mut map = town_blockmap();
    let hash = |i: usize| (i as u32).wrapping_mul(2_654_435_761) >> 12;
    let plot = |i: usize| (i % 64 / 10 + i / 64 / 8 * 7) as u32;
    let is_built = |i: usize| i % 64 % 10 < 7 && i / 64 % 8 < 5;
    let terrain = |i: usize| if plot(i).is_multiple_of(5) { NO_OBJECT } else { 3 };
    let odd = |part: usize, i: usize| match hash(3 * i + part) {
        noise if noise % 41 == 0 => Some(noise << 12),
        noise if noise % 97 == 1 => Some(NO_OBJECT),
        noise if noise % 397 == 2 => Some(NO_OBJECT - 1),
        _ => None,
    };
    let mut objects = ColumnObjects::default();
    let lower_tops = lower_tops(&map);
    for i in 0..COLUMNS {
        let own = 1000 + 37 * plot(i) + u32::from(i % 64 % 10 > 3);
        if map.flags[i] & flag::OCCUPIED != 0 {
            objects.roof[i] = odd(0, i).unwrap_or(if is_built(i) { own } else { terrain(i) });
        }
        if map.flags[i] & flag::EXPOSED != 0 {
            objects.wall[i] = odd(1, i).unwrap_or(if plot(i) % 4 == 1 { own ^ 1 } else { objects.roof[i] });
        }
        if lower_tops[i].is_some() {
            objects.lower[i] = odd(2, i).unwrap_or(if plot(i) % 3 == 1 { own } else { terrain(i) });
        }
    }
    map.objects = Some(Box::new(objects));
    map
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
    Subtree { nodes: vec![node(root, 0b0100), node(child, 0)], ..Subtree::default() }
}

fn subtree_with_meshes() -> Subtree {
    let mut subtree = subtree();
    let lod = |k: u32| MeshLod {
        error_m: 0.125 * (1 + k) as f32,
        bytes: 100_000 >> k,
        triangles: 5000 >> k,
        texture_px: [1 << 20, 64, 0, 0][k as usize],
    };
    subtree.meshes = vec![NodeMesh { id: subtree.nodes[1].id, lods: (0..4).map(lod).collect() }];
    subtree
}

fn subtree_with_deviations() -> Subtree {
    let deviation = |k: u16| NodeDeviation {
        drawn_m: f32::from(87 + k) / 100.0,
        drawn_max_m: f32::from(u16::MAX) / 100.0,
        source_m: f32::from(3 * k) / 100.0,
        source_max_m: 12.5,
    };
    Subtree { deviations: vec![deviation(450), deviation(0)], ..subtree_with_meshes() }
}

fn plain_tile() -> MeshTile {
    mesh_tile::cuboid([1.0, 2.0, -3.0], [9.0, 14.5, 21.0], [200, 90, 60], None)
}

fn textured_tile() -> MeshTile {
    let bytes = [&b"RIFF\x10\0\0\0WEBPVP8L"[..], &[7; 40]].concat();
    mesh_tile::cuboid([1.0, 2.0, -3.0], [9.0, 14.5, 21.0], [0; 3], Some(TileTexture { size_px: [640, 20], bytes }))
}

/// Six boxes on a line. A box is one object, or has another one on some triangles, or is two objects in halves.
fn tile_with_objects() -> MeshTile {
    let mut tile = plain_tile();
    for k in 1..6 {
        let first = tile.mesh.positions.len() as u32;
        let positions = plain_tile().mesh.positions.into_iter().map(|[x, y, z]| [x / 8 + 500 * k, y, z]);
        tile.mesh.positions.extend(positions);
        tile.mesh.triangles.extend(plain_tile().mesh.triangles.iter().map(|t| t.map(|vertex| vertex + first)));
        tile.mesh.attributes[0].corners.extend([0; 36]);
    }
    let object = |t: u32| match (t / 12, t % 12) {
        (1, 3 | 4) => 70_000,
        (2, side) if side >= 6 => NO_OBJECT,
        (4, side) => [9, 1_000_000, NO_OBJECT - 1][side as usize / 2 % 3],
        (k, _) => [7, 9, 1_000_000, 7, 0, 8][k as usize],
    };
    tile.objects = (0..72).map(object).collect();
    tile
}

/// The same boxes, two of them landmarks, with occlusion at all vertices.
fn tile_with_landmarks() -> MeshTile {
    let mut tile = tile_with_objects();
    tile.landmarks = vec![
        LandmarkObject { object: 7, stone: None, anchor_m: [0.0, -7.5, 1e5] },
        LandmarkObject { object: 1_000_000, stone: Some(15), anchor_m: [12.25, 3.0, -0.125] },
    ];
    tile.mesh.attributes.push(Attribute {
        kind: AttributeKind::Other,
        components: 1,
        bits: OCCLUSION_BITS,
        range: [0.0, 1.0 / 31.0],
        values: (0..tile.mesh.positions.len() as u32).map(|v| [v * 7 % 32, 0, 0, 0]).collect(),
        corners: tile.mesh.triangles.concat(),
    });
    tile
}

/// Block 2 of the objects of a city: five objects with an attribute of each type. `insula-objects` made it, and reads it in its tests.
const BLOCK_CONTENT: &str = "\
    494e534f01009b70ec4302000000d300000028b52ffd20d3c50500820b292c606f1a0344016a00008a0e90361013918dbe63\
    460572b1cbd1a27e6fb06788ecbd1f141c7ceaa388086d2253daf47f0219d0eddda7f45f305558d3e9d5a8f61def43c496ee\
    1eb39ee4e85988a7b9f0d47a8e228704ab58c7d77650ac60fb7dc37e77d74279e468ef7e59c3549308077e3bd9f6ad6a7fb3\
    9a513eeef44e3618b58266599615ac2259193504893e9ab01291602ce1253308b938c7632f253aef1db03f17060080538000\
    4cd085f1ea48a5ad08400f";

/// The schema of these objects.
const SCHEMA_CONTENT: &str = concat!(
    r#"{"objects":1029,"attributes":["#,
    r#"{"name":"text","type":"text","count":3,"distinct":3,"top":[["2010-10-13T12:00:00Z",1],["2010-10-13T12:23:09Z",1],["2010-10-13T12:49:14Z",1]]},"#,
    r#"{"name":"integer","type":"integer","count":3,"min":1850.0,"max":1929.0,"distinct":3,"top":[["1850",1],["1923",1],["1929",1]]},"#,
    r#"{"name":"float","type":"float","unit":"m","count":3,"min":0.0,"max":688.89,"distinct":3,"top":[["0",1],["605.63",1],["688.89",1]]},"#,
    r#"{"name":"bool","type":"bool","count":3,"distinct":2,"top":[["false",2],["true",1]]},"#,
    r#"{"name":"date","type":"date","count":3,"min":0.0,"max":8889.0,"distinct":3,"top":[["1970-01-01",1],["1971-07-18",1],["1994-05-04",1]]},"#,
    r#"{"name":"code","type":"text","count":3,"distinct":3,"top":[["NL.IMBAG.Pand.0503100000010000",1],["NL.IMBAG.Pand.0503100000010563",1],["NL.IMBAG.Pand.0503100000018889",1]]}"#,
    r#"],"searchable":["text","code"]}"#,
);

fn block_content() -> Vec<u8> {
    let digits = |at: usize| u8::from_str_radix(&BLOCK_CONTENT[2 * at..2 * at + 2], 16).unwrap();
    (0..BLOCK_CONTENT.len() / 2).map(digits).collect()
}

/// One attribute of each kind, with seams.
fn attributes(triangles: &[[u32; 3]]) -> Vec<Attribute> {
    let kinds = [
        (AttributeKind::Normal, 2, 8),
        (AttributeKind::Colour, 3, 8),
        (AttributeKind::TexCoord, 2, 12),
        (AttributeKind::Other, 4, 16),
    ];
    let make = |(kind, components, bits): (AttributeKind, u8, u8)| {
        let value = |i: u32| {
            std::array::from_fn(|c| if c < components.into() { i * (1 + 2 * c as u32) % (1 << bits) } else { 0 })
        };
        let corner = |(i, vertex): (usize, &u32)| if i % 31 == 0 { vertex + 1 } else { *vertex };
        Attribute {
            kind,
            components,
            bits,
            range: [0.5, 0.25],
            values: (0..300).map(value).collect(),
            corners: triangles.as_flattened().iter().enumerate().map(corner).collect(),
        }
    };
    kinds.map(make).to_vec()
}

/// A curved surface with a hole and a fin on an edge.
fn scan() -> Mesh {
    const SIDE: u32 = 16;
    let noise = |i: u32| {
        let hash = i.wrapping_mul(2_654_435_761);
        let hash = (hash ^ hash >> 15).wrapping_mul(2_246_822_519);
        (hash ^ hash >> 13) >> 29
    };
    let position = |i: u32| {
        let (x, y) = (i % SIDE, i / SIDE);
        [x * 130 + noise(3 * i), y * 130 + noise(3 * i + 1), 1000 + x * y * 3 + noise(3 * i + 2)]
    };
    let mut positions: Vec<[u32; 3]> = (0..SIDE * SIDE).map(position).collect();
    positions.push([1400, 1300, 3100]);
    let mut triangles = Vec::new();
    for (x, y) in (0..SIDE - 1).flat_map(|y| (0..SIDE - 1).map(move |x| (x, y))) {
        let a = y * SIDE + x;
        if (x, y) != (3, 3) {
            triangles.extend([[a, a + 1, a + SIDE + 1], [a, a + SIDE + 1, a + SIDE]]);
        }
    }
    triangles.push([5 * SIDE + 5, 5 * SIDE + 6, SIDE * SIDE]);
    let grid = PositionGrid { min: [84_123.456, 447_000.1, -1.2], step: 0.01, bits: 12 };
    let attributes = attributes(&triangles);
    Mesh { grid, positions, triangles, attributes }
}

/// Two boxes that share a vertex, one of them open.
fn architecture() -> Mesh {
    const SIDES: [[u32; 4]; 6] = [[0, 2, 3, 1], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6], [4, 5, 7, 6]];
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for (corner, size, sides) in [([0, 0, 0], [900, 500, 300], 6), ([900, 500, 300], [200, 350, 450], 5)] {
        let first = positions.len() as u32;
        let corners = (0..8).map(|i| std::array::from_fn(|axis| corner[axis] + size[axis] * (i >> axis & 1)));
        positions.extend(corners);
        // The last corner of the first box is the first corner of the second.
        let vertex = |i: u32| if first == 8 && i == 0 { 7 } else { first + i };
        for side in &SIDES[..sides] {
            let [a, b, c, d] = side.map(vertex);
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let grid = PositionGrid { min: [1.0, 2.0, 3.0], step: 0.5, bits: 11 };
    let attributes = attributes(&triangles);
    Mesh { grid, positions, triangles, attributes }
}

/// A tile with sections of any packing and order.
fn by_hand(kind: u8, id: Option<(u8, u8, u8)>, sections: &[(u8, bool, Vec<u8>)]) -> Vec<u8> {
    let mut header = match id {
        Some((level, x, y)) => vec![1, level, x, y],
        None => vec![0],
    };
    header.push(sections.len() as u8);
    let mut body = Vec::new();
    for (tag, is_zstd, raw) in sections {
        let packed = if *is_zstd { stored_zstd_frame(raw) } else { raw.clone() };
        header.extend([*tag, u8::from(*is_zstd)]);
        // A varint of u16, also where one byte would do.
        for length in [packed.len(), raw.len()] {
            header.push(251);
            header.extend((length as u16).to_le_bytes());
        }
        header.push(252);
        header.extend(checksum(&packed).to_le_bytes());
        body.extend(packed);
    }
    let mut tile = b"INSU\x04\0".to_vec();
    tile.extend([kind, 0]);
    tile.extend((header.len() as u32).to_le_bytes());
    tile.extend(checksum(&header).to_le_bytes());
    [tile, header, body].concat()
}

/// A zstd frame without content size, with a window of 1 KiB and one uncompressed block.
fn stored_zstd_frame(raw: &[u8]) -> Vec<u8> {
    assert!(raw.len() <= 1024);
    let block = (raw.len() as u32) << 3 | 1;
    [&[0x28, 0xb5, 0x2f, 0xfd, 0, 0][..], &block.to_le_bytes()[..3], raw].concat()
}

/// The nodes and meshes of [`subtree_with_meshes`] in reverse order, with an unknown section between them.
fn subtree_by_hand() -> Vec<u8> {
    let subtree = subtree_with_meshes();
    let mut nodes = Vec::new();
    for node in &subtree.nodes {
        nodes.push(node.child_mask);
        [node.z_min_m, node.z_max_m, node.error_m, node.radius_m].iter().for_each(|v| nodes.extend(v.to_le_bytes()));
        nodes.extend(node.blockmap_bytes.to_le_bytes());
    }
    let mut meshes = vec![0, 4];
    let lods = &subtree.meshes[0].lods;
    lods.iter().for_each(|lod| meshes.extend(lod.error_m.to_le_bytes()));
    for number in [|lod: &MeshLod| lod.bytes, |lod: &MeshLod| lod.triangles, |lod: &MeshLod| lod.texture_px] {
        for lod in lods {
            // Five bytes of LEB128, whatever the number.
            let v = number(lod);
            meshes.extend((0..5).map(|k| (v >> (7 * k)) as u8 & 0x7f | if k < 4 { 0x80 } else { 0 }));
        }
    }
    by_hand(2, Some((5, 17, 30)), &[(2, true, meshes), (15, false, b"unknown".to_vec()), (1, true, nodes)])
}

/// One level building over the whole node, with steps of colour and occlusion that the encoder never combines.
fn blockmap_by_hand() -> Vec<u8> {
    let map = one_colour_blockmap();
    let tile = insula_protocol::tile::TileReader::new(&map.encode().unwrap(), insula_protocol::TileKind::BlockMap)
        .unwrap()
        .section(2, 1 << 20)
        .unwrap();
    let meta =
        [&map.cell_m.to_le_bytes()[..], &map.z_base_cells.to_le_bytes(), &[0], &300u16.to_le_bytes(), &[63]].concat();
    by_hand(1, None, &[(2, true, tile), (1, true, meta)])
}

/// Roofs of one colour and of full occlusion or none, which any quantisation step keeps.
fn one_colour_blockmap() -> BlockMap {
    let roof_normal = octahedral::encode([0.0, 0.0, 1.0]);
    let column = MapColumn { z_max: 100, roof: Texel::new([10, 200, 30], 63), roof_normal, ..MapColumn::default() };
    BlockMap::from_columns(node_id(), 2.0, 4, 0, &vec![Some(column); COLUMNS]).unwrap()
}

#[test]
fn block_maps_are_read_and_written() {
    assert_eq!(BlockMap::decode(node_id(), BLOCKMAP).unwrap(), blockmap());
    assert_eq!(blockmap().encode().unwrap(), BLOCKMAP);
}

#[test]
fn a_town_is_read_and_written() {
    let map = BlockMap::decode(node_id(), TOWN_BLOCKMAP).unwrap();
    assert_eq!(map, town_blockmap());
    assert_eq!(town_blockmap().encode().unwrap(), TOWN_BLOCKMAP);
    // The second decoder is held to the same checksums.
    let texels: Vec<u8> = map.roof.iter().chain(&map.strips).flat_map(|texel| texel.0.to_le_bytes()).collect();
    let shapes: Vec<u8> = (0..COLUMNS)
        .flat_map(|i| [u16::from(map.flags[i]), map.z_min[i], map.z_max[i], map.roof_normal[i]])
        .flat_map(u16::to_le_bytes)
        .collect();
    assert_eq!([&texels, &shapes].map(|bytes| checksum(bytes)), [4_232_154_836, 405_737_478]);
}

#[test]
fn a_town_with_objects_is_read_and_written() {
    let map = BlockMap::decode(node_id(), TOWN_WITH_OBJECTS).unwrap();
    assert_eq!(map, town_with_objects());
    assert_eq!(town_with_objects().encode().unwrap(), TOWN_WITH_OBJECTS);
    // The second decoder is held to the same checksums.
    let objects = map.objects.unwrap();
    let bytes = |part: &[u32]| -> Vec<u8> { part.iter().flat_map(|object| object.to_le_bytes()).collect() };
    let checksums = [&objects.roof, &objects.wall, &objects.lower].map(|part| checksum(&bytes(part)));
    assert_eq!(checksums, [3_607_479_904, 2_173_267_658, 3_328_196_466]);
}

#[test]
fn lossy_block_maps_are_read() {
    let original = colourful_blockmap();
    let map = BlockMap::decode(node_id(), LOSSY_BLOCKMAP).unwrap();
    let error = original.colour_error(&map);
    assert!((1.0..=255.0 * 255.0 / 10f64.powf(f64::from(DB) / 10.0)).contains(&error), "{error}");
    let texels: Vec<u8> = map.roof.iter().chain(&map.strips).flat_map(|texel| texel.0.to_le_bytes()).collect();
    assert_eq!(checksum(&texels), 2_826_750_924);
    let shapes = BlockMap { roof: original.roof.clone(), strips: original.strips.clone(), ..map };
    assert_eq!(shapes, original);
}

#[test]
fn subtrees_are_read_and_written() {
    let all = [
        (SUBTREE, subtree()),
        (SUBTREE_WITH_MESHES, subtree_with_meshes()),
        (SUBTREE_WITH_DEVIATIONS, subtree_with_deviations()),
    ];
    for (bytes, subtree) in all {
        assert_eq!(Subtree::decode(bytes).unwrap(), subtree);
        assert_eq!(subtree.encode().unwrap(), bytes);
    }
}

#[test]
fn mesh_tiles_are_read_and_written() {
    for (bytes, tile, lod) in [(PLAIN_TILE, plain_tile(), 1), (TEXTURED_TILE, textured_tile(), 0)] {
        let found = MeshTile::decode(leaf(), lod, bytes).unwrap();
        assert_eq!(found.texture, tile.texture);
        check_mesh(&found.mesh, &tile.mesh);
        assert_eq!(tile.encode(leaf(), lod).unwrap(), bytes);
    }
}

#[test]
fn triangles_with_objects_are_read_and_written() {
    let (found, tile) = (MeshTile::decode(leaf(), 0, TILE_WITH_OBJECTS).unwrap(), tile_with_objects());
    check_mesh(&found.mesh, &tile.mesh);
    let corners = tile.mesh.encode().unwrap().corners;
    let objects = corners.iter().step_by(3).map(|corner| tile.objects[*corner as usize / 3]);
    assert!(objects.eq(found.objects));
    assert_eq!(tile.encode(leaf(), 0).unwrap(), TILE_WITH_OBJECTS);
}

#[test]
fn landmarks_are_read_and_written() {
    let (found, tile) = (MeshTile::decode(leaf(), 5, TILE_WITH_LANDMARKS).unwrap(), tile_with_landmarks());
    assert_eq!(found.landmarks, tile.landmarks);
    let corners = tile.mesh.encode().unwrap().corners;
    let expected = corners.iter().map(|corner| tile.occlusion(*corner as usize));
    assert!(expected.eq((0..corners.len()).map(|corner| found.occlusion(corner))));
    assert_eq!(tile.encode(leaf(), 5).unwrap(), TILE_WITH_LANDMARKS);
}

#[test]
fn object_tiles_are_read_and_written() {
    let block = object_tile::block_id(2).unwrap();
    assert_eq!(block, TileId::new(12, 0, 1).unwrap());
    for (id, bytes, content) in
        [(object_tile::SCHEMA_ID, OBJECT_SCHEMA, SCHEMA_CONTENT.as_bytes()), (block, OBJECT_BLOCK, &block_content())]
    {
        assert_eq!(object_tile::decode(id, bytes).unwrap(), content);
        assert_eq!(object_tile::encode(id, content).unwrap(), bytes);
    }
}

#[test]
fn meshes_of_both_position_coders_are_read_and_written() {
    for (bytes, mesh, flags) in [(SCAN, scan(), 6), (ARCHITECTURAL, architecture(), 1)] {
        assert_eq!(bytes[1], flags, "1: architectural positions, 2: f64 grid, 4: classes by edges and middle");
        check_mesh(&Mesh::decode(bytes).unwrap(), &mesh);
        assert_eq!(mesh.encode().unwrap().bytes, bytes);
    }
}

/// Compares a decoded mesh with the original, whose vertices and triangles have another order.
fn check_mesh(found: &Mesh, original: &Mesh) {
    let order = original.encode().unwrap();
    assert_eq!(found.grid, original.grid);
    let positions: Vec<_> = order.vertices.iter().map(|vertex| original.positions[*vertex as usize]).collect();
    assert_eq!(found.positions, positions);
    let given = original.triangles.as_flattened();
    let corners = found.triangles.as_flattened().iter().map(|vertex| order.vertices[*vertex as usize]);
    assert!(corners.eq(order.corners.iter().map(|corner| given[*corner as usize])));
    assert_eq!(found.triangles.len(), original.triangles.len());
    assert_eq!(found.attributes.len(), original.attributes.len());
    for (a, b) in found.attributes.iter().zip(&original.attributes) {
        assert_eq!((a.kind, a.components, a.bits, a.range), (b.kind, b.components, b.bits, b.range));
        let value = |attribute: &Attribute, corner: u32| attribute.values[attribute.corners[corner as usize] as usize];
        assert!((0..).zip(&order.corners).all(|(new, old)| value(a, new) == value(b, *old)));
    }
}

#[test]
fn unusual_but_legal_tiles_are_read() {
    assert_eq!(Subtree::decode(SUBTREE_BY_HAND).unwrap(), subtree_with_meshes());
    assert_eq!(BlockMap::decode(node_id(), BLOCKMAP_BY_HAND).unwrap(), one_colour_blockmap());
}

#[test]
#[ignore = "writes the frozen files: only for a new format version"]
fn write_vectors() {
    let write = |name: &str, bytes: Vec<u8>| {
        let path = format!("{}/tests/vectors/v4_{name}.bin", env!("CARGO_MANIFEST_DIR"));
        std::fs::write(path, bytes).unwrap();
    };
    write("blockmap", blockmap().encode().unwrap());
    write("lossy_blockmap", colourful_blockmap().encode_at(Quality::Decibels(DB)).unwrap());
    write("town_blockmap", town_blockmap().encode().unwrap());
    write("town_with_objects", town_with_objects().encode().unwrap());
    write("subtree", subtree().encode().unwrap());
    write("subtree_with_meshes", subtree_with_meshes().encode().unwrap());
    write("plain_mesh_tile", plain_tile().encode(leaf(), 1).unwrap());
    write("textured_mesh_tile", textured_tile().encode(leaf(), 0).unwrap());
    write("mesh_tile_with_objects", tile_with_objects().encode(leaf(), 0).unwrap());
    write("mesh_tile_with_landmarks", tile_with_landmarks().encode(leaf(), 5).unwrap());
    write("object_schema", object_tile::encode(object_tile::SCHEMA_ID, SCHEMA_CONTENT.as_bytes()).unwrap());
    write("object_block", object_tile::encode(object_tile::block_id(2).unwrap(), &block_content()).unwrap());
    write("scan_mesh", scan().encode().unwrap().bytes);
    write("architectural_mesh", architecture().encode().unwrap().bytes);
    write("subtree_with_deviations", subtree_with_deviations().encode().unwrap());
    write("subtree_by_hand", subtree_by_hand());
    write("blockmap_by_hand", blockmap_by_hand());
}
