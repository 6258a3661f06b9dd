//! A small synthetic city: buildings of 24 m on a 40 m grid, 20 m high, on ground 1 m thick.

use insula_protocol::blockmap::{COLUMNS, MapColumn, NODE_CELLS, WallStrip, strip_rows};
use insula_protocol::manifest::Attribution;
use insula_protocol::mesh_tile::{self, TileTexture};
use insula_protocol::subtree::{MeshLod, NodeInfo, NodeMesh};
use insula_protocol::tile::TileKind;
use insula_protocol::{BlockMap, Manifest, Subtree, Texel, TileId, octahedral, route};
use insula_test_support::small_city::empty_manifest;
use std::collections::HashMap;
use std::sync::{Arc, LazyLock};

pub(crate) const DEPTH: u8 = 3;
pub(crate) const ORIGIN: [f64; 3] = [84_000.0, 447_000.0, 0.0];
pub(crate) const ROOF_M: f64 = 20.0;
pub(crate) const GROUND_M: f64 = 1.0;
/// Top of the cuboid that is each leaf's mesh.
pub(crate) const MESH_M: f64 = 20.25;
pub(crate) const VERSION: &str = "0123456789abcdef";

/// Responses of a server by path.
pub(crate) type Files = HashMap<String, Vec<u8>>;

static CITY: LazyLock<Arc<Files>> = LazyLock::new(|| Arc::new(city_files("test")));
static CITY_WITH_MESHES: LazyLock<Arc<Files>> = LazyLock::new(|| Arc::new(with_meshes(CITY.as_ref().clone(), "test")));

/// The city without meshes, named `test`.
pub(crate) fn city() -> Arc<Files> {
    CITY.clone()
}

/// The city where each leaf has a mesh with two LODs: a cuboid, textured in LOD 0.
pub(crate) fn city_with_meshes() -> Arc<Files> {
    CITY_WITH_MESHES.clone()
}

/// Path of a V-BlockMap of the city.
pub(crate) fn block_map_path(level: u8, x: u32, y: u32) -> String {
    route::tile("test", VERSION, TileKind::BlockMap, TileId::new(level, x, y).unwrap())
}

/// The city without meshes under another name.
pub(crate) fn city_files(name: &str) -> Files {
    let manifest = manifest(name);
    let mut files = HashMap::new();
    let mut nodes = Vec::new();
    let mut ids = vec![TileId::ROOT];
    let mut next = 0;
    while let Some(&id) = ids.get(next) {
        next += 1;
        let bytes = block_map(&manifest, id).encode().unwrap();
        let side_m = manifest.node_side_m(id.level());
        let is_leaf = id.level() == DEPTH;
        nodes.push(NodeInfo {
            id,
            child_mask: if is_leaf { 0 } else { 15 },
            z_min_m: 0.0,
            z_max_m: ROOF_M as f32,
            error_m: (side_m / 64.0 * 0.9) as f32,
            radius_m: ((side_m * side_m * 0.5).sqrt() + 10.0) as f32,
            blockmap_bytes: bytes.len() as u32,
        });
        files.insert(route::tile(name, VERSION, TileKind::BlockMap, id), bytes);
        if !is_leaf {
            ids.extend(id.children());
        }
    }
    let subtree = Subtree { nodes, ..Subtree::default() }.encode().unwrap();
    files.insert(route::tile(name, VERSION, TileKind::Subtree, TileId::ROOT), subtree);
    files.insert(route::manifest(name), serde_json::to_vec(&manifest).unwrap());
    files.insert(route::CITIES.into(), serde_json::to_vec(&serde_json::json!([{ "name": name }])).unwrap());
    files
}

fn manifest(name: &str) -> Manifest {
    let empty = empty_manifest(DEPTH);
    Manifest {
        name: name.into(),
        title: "Test city".into(),
        version: VERSION.into(),
        crs: Some("EPSG:7415".into()),
        origin: ORIGIN,
        bounds: [ORIGIN, [ORIGIN[0] + empty.root_side_m, ORIGIN[1] + empty.root_side_m, ROOF_M]],
        focus: [[0.0; 2], [1.0; 2]],
        has_terrain: true,
        attribution: vec![Attribution { text: "The testers".into(), licence: Some("CC0".into()), url: None }],
        settings: "0".into(),
        ..empty
    }
}

fn is_building(x: f64, y: f64) -> bool {
    x.rem_euclid(40.0) < 24.0 && y.rem_euclid(40.0) < 24.0
}

fn block_map(manifest: &Manifest, id: TileId) -> BlockMap {
    let (cell, corner) = (manifest.cell_m_at(id.level()), manifest.node_corner(id));
    // Whole cells would be too coarse at the root, so the height codes are multiples of cell / 16.
    let code = |z_m: f64| (z_m / cell * 16.0).round() as u16;
    let columns: Vec<Option<MapColumn>> = (0..COLUMNS)
        .map(|i| {
            let x = corner[0] - ORIGIN[0] + ((i % NODE_CELLS) as f64 + 0.5) * cell;
            let y = corner[1] - ORIGIN[1] + ((i / NODE_CELLS) as f64 + 0.5) * cell;
            let is_building = is_building(x, y);
            let z_max = code(if is_building { ROOF_M } else { GROUND_M }).max(1);
            let rows = usize::from(strip_rows(0, z_max, 0).1);
            let texels = (0..rows).map(|r| Texel::new([200, 120 + (r * 8 % 100) as u8, 90], 50)).collect();
            let roof = if is_building { Texel::new([170, 60, 40], 63) } else { Texel::new([90, 130, 80], 45) };
            let strip = is_building.then_some(WallStrip { texels, azimuth: 0 });
            let roof_normal = octahedral::encode([0.0, 0.0, 1.0]);
            Some(MapColumn { z_min: 0, z_max, roof, roof_normal, strip, ..MapColumn::default() })
        })
        .collect();
    BlockMap::from_columns(id, cell as f32, 0, 0, &columns).unwrap()
}

fn with_meshes(mut files: Files, name: &str) -> Files {
    let path = route::tile(name, VERSION, TileKind::Subtree, TileId::ROOT);
    let mut subtree = Subtree::decode(&files[&path]).unwrap();
    let mut webp = std::io::Cursor::new(Vec::new());
    let red = image::RgbImage::from_pixel(48, 32, image::Rgb([200, 10, 20]));
    red.write_to(&mut webp, image::ImageFormat::WebP).unwrap();
    let texture = TileTexture { size_px: [48, 32], bytes: webp.into_inner() };
    for leaf in subtree.nodes.iter().filter(|node| node.id.level() == DEPTH).map(|node| node.id) {
        let mut lods = Vec::new();
        for (lod, texture) in [(0, Some(texture.clone())), (1, None)] {
            let tile = mesh_tile::cuboid([2.0, 2.0, 0.0], [62.0, 62.0, MESH_M], [200, 10, 20], texture);
            let bytes = tile.encode(leaf, lod).unwrap();
            let (error_m, texture_px) = ([0.01, 0.2][usize::from(lod)], [48 * 32, 0][usize::from(lod)]);
            lods.push(MeshLod { error_m, bytes: bytes.len() as u32, triangles: 12, texture_px });
            files.insert(route::mesh(name, VERSION, leaf, lod), bytes);
        }
        subtree.meshes.push(NodeMesh { id: leaf, lods });
    }
    files.insert(path, subtree.encode().unwrap());
    files
}
