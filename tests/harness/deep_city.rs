//! A server of a city of 20 levels that is full everywhere: a client that flies through it never comes to an end.

use insula_protocol::blockmap::{COLUMNS, MapColumn};
use insula_protocol::route::{self, Route, TileRoute};
use insula_protocol::{BlockMap, Manifest, Texel, TileId, TileKind};
use insula_test_support::http::{self, Request};
use insula_test_support::rng::Rng;
use insula_test_support::small_city;
use std::io::Write;
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;

const NAME: &str = "deep";
const DEPTH: u8 = insula_protocol::tile_id::MAX_LEVEL;

#[derive(Debug)]
pub struct DeepCityServer {
    pub url: String,
    /// Number of subtree tiles that were sent.
    pub subtrees: Arc<AtomicU64>,
    pub bytes: Arc<AtomicU64>,
}

/// Side of a node's columns; those of leaves have a metre.
fn cell_m(id: TileId) -> f32 {
    (1u32 << (DEPTH - id.level())) as f32
}

fn manifest() -> Manifest {
    let Manifest { depth, origin, root_side_m, counts, .. } = small_city::empty_manifest(DEPTH);
    let bounds = [[0.0; 3], [root_side_m, root_side_m, 20.0]];
    Manifest { depth, origin, root_side_m, counts, bounds, ..small_city::manifest(NAME) }
}

/// A V-BlockMap with a tower in every column.
fn block_map(id: TileId) -> Option<Vec<u8>> {
    let mut rng = Rng::new(u64::from(id.x()) << 32 | u64::from(id.y()));
    let mut tower = || {
        let texel = Texel::new([(); 3].map(|()| rng.below(256) as u8), 40);
        Some(MapColumn { z_max: 4 + rng.below(40) as u16, roof: texel, ..MapColumn::default() })
    };
    let columns: Vec<_> = (0..COLUMNS).map(|_| tower()).collect();
    BlockMap::from_columns(id, cell_m(id), 0, 4, &columns).ok()?.encode().ok()
}

impl DeepCityServer {
    /// Serves the city on a free port until the process ends.
    pub fn start() -> Self {
        let (subtrees, bytes) = <(Arc<AtomicU64>, Arc<AtomicU64>)>::default();
        let counts = (subtrees.clone(), bytes.clone());
        let address = http::serve(move |request, out| respond(request, out, &counts.0, &counts.1));
        Self { url: format!("http://{address}{}", route::manifest(NAME)), subtrees, bytes }
    }
}

fn respond(request: &Request, out: &mut TcpStream, subtrees: &AtomicU64, bytes: &AtomicU64) -> Option<()> {
    let body = match Route::parse(request.target()) {
        Ok(Route::Manifest { city: NAME }) => serde_json::to_vec(&manifest()).ok(),
        Ok(Route::Tile(TileRoute { kind: TileKind::BlockMap, id, .. })) => block_map(id),
        Ok(Route::Tile(TileRoute { kind: TileKind::Subtree, id, .. })) => {
            subtrees.fetch_add(1, Relaxed);
            small_city::full_subtree(id, DEPTH, 16 << 10).encode().ok()
        }
        _ => None,
    };
    let (status, body) = body.map_or(("404 Not Found", Vec::new()), |body| ("200 OK", body));
    bytes.fetch_add(body.len() as u64, Relaxed);
    let head = format!("HTTP/1.1 {status}\r\ncontent-length: {}\r\n\r\n", body.len());
    out.write_all(&[head.as_bytes(), &body].concat()).ok()
}
