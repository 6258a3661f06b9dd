//! A small city made by hand, and a server that can be ill.

#![allow(dead_code, unreachable_pub, missing_docs, clippy::unwrap_used)]

use glam::DVec3;
use insula_client::{
    args::Global,
    commands::connect::connect,
    render::{Adapter, AdapterChoice},
    session::Session,
    stream::{BackgroundFetcher, fetch::Http},
};
use insula_protocol::{
    BlockMap, Manifest, Subtree, Texel, TileId,
    blockmap::{COLUMNS, Column, NODE_CELLS, Strip, strip_rows},
    manifest::{Attribution, Counts},
    mesh_tile::{self, Texture},
    octahedral,
    route::{self, Layer},
    subtree::{MeshLod, NodeInfo, NodeMesh},
};
use insula_viewer::{camera::Camera, scene::SceneTree, streamer::FrameRequest};
use std::{
    collections::HashMap,
    io::{BufRead, BufReader, Write},
    net::{TcpListener, TcpStream},
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, AtomicU32, Ordering},
    },
    time::{Duration, Instant},
};

pub const DEPTH: u8 = 3;
pub const ORIGIN: [f64; 3] = [84_000.0, 447_000.0, 0.0];
pub const ROOF_M: f64 = 20.0;
pub const GROUND_M: f64 = 1.0;

/// Houses of 24 m on a 40 m grid, 20 m high, on ground 1 m thick.
fn is_house(x: f64, y: f64) -> bool {
    x.rem_euclid(40.0) < 24.0 && y.rem_euclid(40.0) < 24.0
}

pub fn manifest(name: &str) -> Manifest {
    let side = 64.0 * f64::from(1u32 << DEPTH);
    Manifest {
        format_version: 1,
        name: name.into(),
        title: "Test city".into(),
        version: "0123456789abcdef".into(),
        crs: Some("EPSG:7415".into()),
        origin: ORIGIN,
        root_side_m: side,
        depth: DEPTH,
        node_cells: 64,
        cell_m: 1.0,
        bounds: [ORIGIN, [ORIGIN[0] + side, ORIGIN[1] + side, ROOF_M]],
        ground_z_m: 0.0,
        focus: [[0.0; 2], [1.0; 2]],
        has_terrain: true,
        counts: Counts::default(),
        attribution: vec![Attribution { text: "The testers".into(), licence: Some("CC0".into()), url: None }],
        tile_version: 1,
        settings: "0".into(),
    }
}

fn block_map(manifest: &Manifest, id: TileId) -> BlockMap {
    let (cell, corner) = (manifest.cell_m_at(id.level()), manifest.node_corner(id));
    // Heights in whole cells would be too coarse at the root: codes of cell / 16.
    let code = |z_m: f64| (z_m / cell * 16.0).round() as u16;
    let columns: Vec<Option<Column>> = (0..COLUMNS)
        .map(|i| {
            let x = corner[0] - ORIGIN[0] + ((i % NODE_CELLS) as f64 + 0.5) * cell;
            let y = corner[1] - ORIGIN[1] + ((i / NODE_CELLS) as f64 + 0.5) * cell;
            let house = is_house(x, y);
            let z_max = code(if house { ROOF_M } else { GROUND_M }).max(1);
            let rows = usize::from(strip_rows(0, z_max, 0).1);
            let texels = (0..rows).map(|r| Texel::new([200, 120 + (r * 8 % 100) as u8, 90], 50, 3)).collect();
            let roof = if house { Texel::new([170, 60, 40], 63, 3) } else { Texel::new([90, 130, 80], 45, 3) };
            let strip = house.then_some(Strip { texels, azimuth: 0 });
            let roof_normal = octahedral::encode([0.0, 0.0, 1.0]);
            Some(Column { z_min: 0, z_max, roof, roof_normal, strip, ..Column::default() })
        })
        .collect();
    BlockMap::from_columns(id, cell as f32, 0, 0, &columns).unwrap()
}

/// All that the server has, by path.
pub fn city(name: &str) -> HashMap<String, Vec<u8>> {
    let manifest = manifest(name);
    let mut files = HashMap::new();
    let mut nodes = Vec::new();
    let mut ids = vec![TileId::ROOT];
    let mut next = 0;
    while let Some(&id) = ids.get(next) {
        next += 1;
        let bytes = block_map(&manifest, id).encode().unwrap();
        let side = manifest.node_side_m(id.level());
        let leaf = id.level() == DEPTH;
        nodes.push(NodeInfo {
            id,
            child_mask: if leaf { 0 } else { 15 },
            z_min_m: 0.0,
            z_max_m: ROOF_M as f32,
            error_m: (side / 64.0 * 0.9) as f32,
            radius_m: ((side * side * 0.5).sqrt() + 10.0) as f32,
            blockmap_bytes: bytes.len() as u32,
        });
        files.insert(route::tile(name, &manifest.version, Layer::BlockMaps, id), bytes);
        if !leaf {
            ids.extend(id.children());
        }
    }
    let subtree = Subtree { nodes, meshes: Vec::new() }.encode().unwrap();
    files.insert(route::tile(name, &manifest.version, Layer::Subtrees, TileId::ROOT), subtree);
    files.insert(route::manifest(name), serde_json::to_vec(&manifest).unwrap());
    files.insert(route::CITIES.into(), serde_json::to_vec(&serde_json::json!([{ "name": name }])).unwrap());
    files
}

/// Top of the block that is each leaf's mesh.
pub const MESH_M: f64 = 20.25;

/// The same, where each leaf has a mesh of two levels of detail: one block, textured in the finer one.
pub fn city_with_meshes(name: &str) -> HashMap<String, Vec<u8>> {
    let (mut files, manifest) = (city(name), manifest(name));
    let path = route::tile(name, &manifest.version, Layer::Subtrees, TileId::ROOT);
    let mut subtree = Subtree::decode(&files[&path]).unwrap();
    let texture = || {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let red = image::RgbImage::from_pixel(48, 32, image::Rgb([200, 10, 20]));
        red.write_to(&mut bytes, image::ImageFormat::WebP).unwrap();
        Texture { size_px: [48, 32], bytes: bytes.into_inner() }
    };
    for leaf in subtree.nodes.iter().filter(|node| node.id.level() == DEPTH).map(|node| node.id) {
        let mut lods = Vec::new();
        for (lod, texture) in [(0, Some(texture())), (1, None)] {
            let tile = mesh_tile::cuboid([2.0, 2.0, 0.0], [62.0, 62.0, MESH_M], [200, 10, 20], texture);
            let bytes = tile.encode(leaf, lod).unwrap();
            let (error_m, texture_px) = ([0.01, 0.2][usize::from(lod)], [48 * 32, 0][usize::from(lod)]);
            lods.push(MeshLod { error_m, bytes: bytes.len() as u32, triangles: 12, texture_px });
            files.insert(route::mesh(name, &manifest.version, leaf, lod), bytes);
        }
        subtree.meshes.push(NodeMesh { id: leaf, lods });
    }
    files.insert(path, subtree.encode().unwrap());
    files
}

/// What to do with a request.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Answer {
    Well,
    Damaged,
    Status(u16),
    /// Closes the connection in the middle.
    Cut,
    /// That status, and not to ask again for so many seconds.
    Later(u16, u32),
    /// A byte a second, for as long as anybody listens.
    Trickle,
}

pub type Policy = dyn Fn(&str, u32) -> Answer + Send + Sync;

pub struct Server {
    pub url: String,
    /// While set, connections are closed at once.
    pub down: Arc<AtomicBool>,
    pub requests: Arc<AtomicU32>,
    pub log: Arc<Mutex<HashMap<String, u32>>>,
}

/// Serves `files`; `policy` is asked with the path and how often it was asked for before.
pub fn serve(files: HashMap<String, Vec<u8>>, policy: Box<Policy>) -> Server {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    let down = Arc::new(AtomicBool::new(false));
    let requests = Arc::new(AtomicU32::new(0));
    let log = Arc::new(Mutex::new(HashMap::new()));
    let server = Server { url, down: down.clone(), requests: requests.clone(), log: log.clone() };
    let (files, policy): (_, Arc<Policy>) = (Arc::new(files), policy.into());
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let (files, policy, down, requests, log) =
                (files.clone(), policy.clone(), down.clone(), requests.clone(), log.clone());
            std::thread::spawn(move || connection(stream, &files, &*policy, &down, &requests, &log));
        }
    });
    server
}

fn connection(
    mut stream: TcpStream,
    files: &HashMap<String, Vec<u8>>,
    policy: &Policy,
    down: &AtomicBool,
    requests: &AtomicU32,
    log: &Mutex<HashMap<String, u32>>,
) {
    let mut reader = BufReader::new(stream.try_clone().unwrap());
    loop {
        let mut path = None;
        loop {
            let mut line = String::new();
            if reader.read_line(&mut line).unwrap_or(0) == 0 || down.load(Ordering::Relaxed) {
                return;
            }
            if line == "\r\n" {
                break;
            }
            path.get_or_insert_with(|| line.split(' ').nth(1).unwrap_or("").to_owned());
        }
        let path = path.unwrap_or_default();
        requests.fetch_add(1, Ordering::Relaxed);
        let times = {
            let mut log = log.lock().unwrap();
            let times = log.entry(path.clone()).or_insert(0);
            *times += 1;
            *times - 1
        };
        std::thread::sleep(Duration::from_millis(1));
        let (status, mut body) = match files.get(&path) {
            Some(body) => (200, body.clone()),
            None => (404, Vec::new()),
        };
        let answer = policy(&path, times);
        let (status, more) = match answer {
            Answer::Status(status) => (status, String::new()),
            Answer::Later(status, secs) => (status, format!("retry-after: {secs}\r\n")),
            _ => (status, String::new()),
        };
        if answer == Answer::Damaged {
            let at = body.len() / 2;
            body[at] ^= 0x40;
        }
        let head = format!("HTTP/1.1 {status} x\r\n{more}content-length: {}\r\n\r\n", body.len());
        if answer == Answer::Trickle {
            let mut bytes = head.bytes().chain(body.iter().copied());
            let head: Vec<u8> = bytes.by_ref().take(head.len()).collect();
            let begun = stream.write_all(&head);
            let rest = bytes.try_for_each(|byte| {
                std::thread::sleep(Duration::from_secs(1));
                stream.write_all(&[byte])
            });
            if begun.and(rest).is_err() {
                return;
            }
            continue;
        }
        let body = if answer == Answer::Cut { &body[..body.len() / 2] } else { &body[..] };
        if stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(body)).is_err() || answer == Answer::Cut {
            return;
        }
    }
}

/// A server that answers well.
pub fn well() -> Box<Policy> {
    Box::new(|_, _| Answer::Well)
}

/// What commands share: drawn by the CPU, 5 s of patience.
pub fn global() -> Global {
    Global {
        adapter: AdapterChoice::Cpu,
        cache_mib: 256,
        no_meshes: false,
        disk_cache_mib: None,
        city: None,
        tau: 1.0,
        timeout: 5,
    }
}

/// Over a server, drawn by the CPU.
pub fn session(server: &Server, cache_mib: u64) -> Session {
    let http = Arc::new(Http::new(None).unwrap());
    let city = connect(&http, &server.url, &global()).unwrap();
    let stream = BackgroundFetcher::downloads(http, city.source, 12, None);
    Session::new(
        SceneTree::new(city.manifest),
        stream,
        Adapter::headless(AdapterChoice::Cpu, cache_mib << 20).unwrap(),
        Instant::now(),
    )
}

/// From the city's corner, in metres; 160 x 90 pixels.
pub fn shot(position: [f64; 3], target: [f64; 3]) -> FrameRequest {
    let world = DVec3::from(ORIGIN);
    let camera = Camera::look_at(world + DVec3::from(position), world + DVec3::from(target), DVec3::Z, 1.0).unwrap();
    FrameRequest { camera, heading: None, size_px: [160, 90], tau_px: 1.0 }
}
