//! Versions of a city that replace one another under load.

use super::client::{CLIENTS, Connection, StopOnDrop};
use super::server;
use insula_protocol::blockmap::{COLUMNS, MapColumn};
use insula_protocol::{BlockMap, Manifest, Texel, TileId, TileKind, route};
use insula_test_support::programs::{path_text, wait_until};
use insula_test_support::{small_city, tier};
use std::fs;
use std::path::Path;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicBool, AtomicU64};

/// Replaced versions that the server keeps open, each with several files.
const KEPT: usize = 4;

/// A tile whose first columns are the digits of its version.
fn tile(id: TileId, version: u32) -> Vec<u8> {
    let mut columns = vec![None; COLUMNS];
    for (at, digit) in format!("{version:04}").bytes().enumerate() {
        let roof = Texel::new([digit, 1, 1], 63);
        let z_max = 16 * u16::from(digit - b'0' + 1);
        columns[at] = Some(MapColumn { z_min: 0, z_max, roof, ..MapColumn::default() });
    }
    let cell_m = 2.0 / f32::from(1u16 << id.level());
    BlockMap::from_columns(id, cell_m, 0, 0, &columns).unwrap().encode().unwrap()
}

fn name(version: u32) -> String {
    format!("v{version:04}")
}

/// Writes a version beside the city and renames it, as the bake does.
fn publish(folder: &Path, version: u32) {
    let (next, old, city) = (folder.join(".next"), folder.join(".old"), folder.join("two"));
    small_city::write_city(&next, "two");
    let manifest = Manifest { version: name(version), ..small_city::manifest("two") };
    fs::write(next.join("city.json"), serde_json::to_vec(&manifest).unwrap()).unwrap();
    let tiles: Vec<_> = [TileId::ROOT, small_city::child()].map(|id| (id, tile(id, version))).to_vec();
    small_city::write_archive(&next.join("blockmaps.pmtiles"), &tiles);
    if city.exists() {
        fs::rename(&city, &old).unwrap();
    }
    fs::rename(&next, &city).unwrap();
    let _ = fs::remove_dir_all(&old);
}

/// Publishes versions while clients request tiles of the newest one.
pub(super) fn replaced_under_load() {
    let folder = tempfile::tempdir().unwrap();
    publish(folder.path(), 0);
    let kept = format!("reload.keep_versions={KEPT}");
    let settings = ["reload.watch_secs=0", &kept, "reload.keep_secs=5"];
    let server = server::start(path_text(folder.path()), &settings);
    assert_eq!(Connection::new(server.address).get("/readyz").unwrap().status, 200);
    let before = server.descriptors();
    let versions = if tier::is_full() { 200 } else { 30 };
    let rounds: [AtomicU64; CLIENTS as usize] = Default::default();
    let stop = AtomicBool::new(false);
    std::thread::scope(|scope| {
        for rounds in &rounds {
            let (stop, address) = (&stop, server.address);
            scope.spawn(move || {
                let mut connection = Connection::new(address);
                while !stop.load(Relaxed) {
                    request_newest(&mut connection);
                    rounds.fetch_add(1, Relaxed);
                }
            });
        }
        let _stop = StopOnDrop(&stop);
        let mut connection = Connection::new(server.address);
        for version in 1..=versions {
            publish(folder.path(), version);
            server.signal("-HUP");
            wait_until("the new version", || {
                let response = connection.get("/v1/cities/two").unwrap();
                String::from_utf8(response.body).unwrap().contains(&format!("\"{}\"", name(version)))
            });
            // No client is so far behind that its version is closed.
            let begin = rounds.each_ref().map(|rounds| rounds.load(Relaxed));
            wait_until("a round of each client", || {
                rounds.iter().zip(begin).all(|(rounds, begin)| rounds.load(Relaxed) > begin)
            });
        }
    });
    // Old versions are closed at the first reload after five seconds.
    wait_until("no file handle is leaked", || {
        server.signal("-HUP");
        server.descriptors() < before + KEPT
    });
}

/// Requests the manifest and three tiles of its version. Panics unless all belong to that version.
fn request_newest(connection: &mut Connection) {
    let response = connection.get("/v1/cities/two").unwrap();
    assert_eq!(response.status, 200);
    let manifest: Manifest = serde_json::from_slice(&response.body).unwrap();
    let version: u32 = manifest.version[1..].parse().unwrap();
    for id in [TileId::ROOT, small_city::child(), TileId::ROOT] {
        let path = route::tile("two", &manifest.version, TileKind::BlockMap, id);
        let response = connection.get(&path).unwrap();
        assert_eq!(response.status, 200, "{path}");
        assert_eq!(response.body, tile(id, version), "a tile of another version at {path}");
    }
}
