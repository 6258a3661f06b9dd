//! A minimal city: the root and its north-eastern child, with two meshes if asked for.

use insula_protocol::blockmap::{COLUMNS, MapColumn, WallStrip};
use insula_protocol::manifest::{Attribution, CityCounts, FORMAT_VERSION};
use insula_protocol::subtree::{LEVELS, MeshLod, NodeInfo, NodeMesh};
use insula_protocol::{BlockMap, Manifest, NODE_CELLS, Subtree, Texel, TileId, TileKind, mesh_tile};
use pmtiles::{Compression, PmTilesWriter, TileCoord, TileType};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

pub const VERSION: &str = "0123456789abcdef";

/// The root's only child.
pub fn child() -> TileId {
    TileId::ROOT.child(3).unwrap()
}

/// A V-BlockMap with one exposed column and one roof.
pub fn blockmap(id: TileId) -> Vec<u8> {
    let mut columns = vec![None; COLUMNS];
    let texels = (0..3).map(|i| Texel::new([200, 50 * i, 10], 63)).collect();
    columns[65] = Some(MapColumn {
        z_min: 0,
        z_max: 48,
        roof: Texel::new([10, 20, 30], 63),
        strip: Some(WallStrip { texels, azimuth: 64 }),
        ..MapColumn::default()
    });
    columns[66] = Some(MapColumn { z_min: 16, z_max: 40, roof: Texel::new([90, 80, 70], 32), ..MapColumn::default() });
    let cell_m = 2.0 / f32::from(1u16 << id.level());
    BlockMap::from_columns(id, cell_m, 0, 0, &columns).unwrap().encode().unwrap()
}

pub fn write_archive(path: &Path, tiles: &[(TileId, Vec<u8>)]) {
    let writer = PmTilesWriter::new(TileType::Unknown).tile_compression(Compression::None);
    let mut writer = writer.create(File::create(path).unwrap()).unwrap();
    for (id, bytes) in tiles {
        writer.add_tile(TileCoord::new(id.level(), id.x(), id.y()).unwrap(), bytes).unwrap();
    }
    writer.finalize().unwrap();
}

/// The V-BlockMaps of the city.
pub fn blockmaps() -> Vec<(TileId, Vec<u8>)> {
    [TileId::ROOT, child()].map(|id| (id, blockmap(id))).to_vec()
}

/// The only subtree tile of the city.
pub fn subtree() -> Vec<u8> {
    let node = |id: TileId, child_mask| NodeInfo {
        id,
        child_mask,
        z_min_m: 0.0,
        z_max_m: 6.0,
        error_m: 2.0 / f32::from(1 + id.level()),
        radius_m: 100.0,
        blockmap_bytes: blockmap(id).len() as u32,
    };
    Subtree { nodes: vec![node(TileId::ROOT, 0b1000), node(child(), 0)], ..Subtree::default() }.encode().unwrap()
}

pub fn manifest(name: &str) -> Manifest {
    Manifest {
        format_version: FORMAT_VERSION,
        name: name.into(),
        title: "Two <b>nodes</b>".into(),
        version: VERSION.into(),
        crs: Some("EPSG:7415".into()),
        origin: [85_000.0, 446_000.0, 0.0],
        bounds: [[85_000.0, 446_000.0, 0.0], [85_128.0, 446_128.0, 6.0]],
        focus: [[0.0; 2], [1.0; 2]],
        counts: CityCounts {
            objects: 2,
            triangles: 24,
            nodes_per_level: vec![1, 1],
            bytes_per_level: blockmaps().iter().map(|(_, bytes)| bytes.len() as u64).collect(),
            buildings: Some(2),
        },
        attribution: vec![Attribution {
            text: "3D BAG".into(),
            licence: Some("CC BY 4.0".into()),
            url: Some("https://example.org/3dbag".into()),
        }],
        tile_version: insula_protocol::tile::VERSION,
        settings: "none".into(),
        ..empty_manifest(1)
    }
}

/// A city of depth `depth` without a CRS: leaves of 64 m, columns of 1 m, origin at zero.
pub fn empty_manifest(depth: u8) -> Manifest {
    let side_m = 64.0 * f64::from(1u32 << depth);
    Manifest {
        format_version: 1,
        name: "test".into(),
        title: "Test".into(),
        version: "0".into(),
        root_side_m: side_m,
        depth,
        node_cells: 64,
        cell_m: 1.0,
        bounds: [[0.0; 3], [side_m, side_m, 9.0]],
        tile_version: 1,
        ..Manifest::default()
    }
}

/// A subtree of a city of `depth` levels that is full everywhere: all nodes below `root`, each with all children. The cells of leaves have a
/// metre.
pub fn full_subtree(root: TileId, depth: u8, blockmap_bytes: u32) -> Subtree {
    let (mut ids, mut nodes) = (vec![root], Vec::new());
    while let Some(&id) = ids.get(nodes.len()) {
        let side_m = NODE_CELLS as f32 * (1u32 << (depth - id.level())) as f32;
        let child_mask = if id.level() == depth { 0 } else { 15 };
        let (error_m, radius_m) = (side_m / 64.0, side_m);
        nodes.push(NodeInfo { id, child_mask, z_min_m: 0.0, z_max_m: 20.0, error_m, radius_m, blockmap_bytes });
        if id.level() < (root.level() + LEVELS).min(depth) {
            ids.extend(id.children());
        }
    }
    Subtree { nodes, ..Subtree::default() }
}

/// The meshes that [`write_city_with_meshes`] adds to [`child`], by level of detail.
pub fn meshes() -> Vec<(u8, Vec<u8>)> {
    let tile = |lod: u8| mesh_tile::cuboid([2.0, 3.0, 0.0], [9.0, 9.0, 6.0], [200 + lod, 90, 60], None);
    (0..2).map(|lod| (lod, tile(lod).encode(child(), lod).unwrap())).collect()
}

pub fn write_city_with_meshes(folder: &Path, name: &str) {
    write_city(folder, name);
    let place = |lod| mesh_tile::archive_id(child(), lod).unwrap();
    let tiles: Vec<_> = meshes().into_iter().map(|(lod, bytes)| (place(lod), bytes)).collect();
    write_archive(&folder.join(TileKind::Mesh.file_name()), &tiles);
    let lod = |error_m, bytes: &[u8]| MeshLod { error_m, bytes: bytes.len() as u32, triangles: 12, texture_px: 0 };
    let lods = meshes().iter().zip([0.01, 0.2]).map(|((_, bytes), error_m)| lod(error_m, bytes)).collect();
    let mut subtree = Subtree::decode(&subtree()).unwrap();
    subtree.meshes.push(NodeMesh { id: child(), lods });
    write_archive(&folder.join(TileKind::Subtree.file_name()), &[(TileId::ROOT, subtree.encode().unwrap())]);
}

/// Writes the city without meshes.
pub fn write_city(folder: &Path, name: &str) {
    std::fs::create_dir_all(folder).unwrap();
    std::fs::write(folder.join("city.json"), serde_json::to_vec_pretty(&manifest(name)).unwrap()).unwrap();
    write_archive(&folder.join(TileKind::BlockMap.file_name()), &blockmaps());
    write_archive(&folder.join(TileKind::Subtree.file_name()), &[(TileId::ROOT, subtree())]);
}

/// Gives a city the version that its files have, as a bake does.
pub fn set_version(folder: &Path) {
    let path = folder.join("city.json");
    let version = insula_archive::city::content_version(folder, VERSION).unwrap();
    std::fs::write(&path, std::fs::read_to_string(&path).unwrap().replace(VERSION, &version)).unwrap();
}

/// Size of a city's archives.
pub fn archive_bytes(folder: &Path) -> u64 {
    let length = |kind: TileKind| std::fs::metadata(folder.join(kind.file_name())).map_or(0, |found| found.len());
    TileKind::ALL.into_iter().map(length).sum()
}

/// A city named "two" in a temporary folder, for a test that changes it.
pub fn temporary_city() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_city(folder.path(), "two");
    folder
}

pub fn temporary_city_with_meshes() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_city_with_meshes(folder.path(), "two");
    folder
}

/// A city named "two" that all tests share and none may change. The folder's name has the hash of the test program, which
/// determines its content, so each build writes it once.
pub fn shared_city() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let program = std::env::current_exe().unwrap();
        let root = program.with_file_name("test-cities");
        let hash = blake3::hash(&std::fs::read(program).unwrap()).to_hex();
        let folder = root.join(format!("small-{}", &hash[..16]));
        if !folder.is_dir() {
            std::fs::create_dir_all(&root).unwrap();
            let new = tempfile::tempdir_in(root).unwrap();
            write_city(new.path(), "two");
            // Fails if another process was faster; its city is the same.
            let _ = std::fs::rename(new.path(), &folder);
        }
        folder
    })
}
