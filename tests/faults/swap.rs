//! Versions that replace one another under load.

use crate::{
    client::Connection,
    common,
    program::{Served, text, until},
};
use insula_protocol::{BlockMap, Manifest, Texel, TileId, TileKind, blockmap::COLUMNS, blockmap::MapColumn, route};
use std::{
    fs,
    path::Path,
    sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed},
};

const VERSIONS: u32 = 200;

/// A tile that says of which version it is.
fn tile(id: TileId, version: u32) -> Vec<u8> {
    let mut columns = vec![None; COLUMNS];
    for (at, digit) in format!("{version:04}").bytes().enumerate() {
        let roof = Texel::new([digit, 1, 1], 63, 3);
        let z_max = 16 * u16::from(digit - b'0' + 1);
        columns[at] = Some(MapColumn { z_min: 0, z_max, roof, ..MapColumn::default() });
    }
    let cell_m = 2.0 / f32::from(1u16 << id.level());
    BlockMap::from_columns(id, cell_m, 0, 0, &columns).unwrap().encode().unwrap()
}

fn name(version: u32) -> String {
    format!("v{version:04}")
}

/// Writes a version beside the folder and puts it in its place, as the bake does.
fn publish(folder: &Path, version: u32) {
    let (next, old, here) = (folder.join(".next"), folder.join(".old"), folder.join("two"));
    common::write_city(&next, "two");
    let manifest = Manifest { version: name(version), ..common::manifest("two") };
    fs::write(next.join("city.json"), serde_json::to_vec(&manifest).unwrap()).unwrap();
    let tiles: Vec<_> = [TileId::ROOT, common::child()].map(|id| (id, tile(id, version))).to_vec();
    common::write_archive(&next.join("blockmaps.pmtiles"), &tiles);
    if here.exists() {
        fs::rename(&here, &old).unwrap();
    }
    fs::rename(&next, &here).unwrap();
    let _ = fs::remove_dir_all(&old);
}

pub(crate) fn two_hundred() {
    let folder = tempfile::tempdir().unwrap();
    publish(folder.path(), 0);
    let settings = ["reload.watch_secs=0", "reload.keep_versions=4", "reload.keep_secs=1"];
    let server = Served::start(text(folder.path()), &settings);
    let (asked, stop) = (AtomicU64::new(0), AtomicBool::new(false));
    // All threads have begun once one has answered.
    assert_eq!(Connection::new(server.address).get("/readyz").unwrap().status, 200);
    std::thread::sleep(std::time::Duration::from_millis(300));
    let before = server.descriptors();
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                let mut connection = Connection::new(server.address);
                while !stop.load(Relaxed) {
                    let answer = connection.get("/v1/cities/two").unwrap();
                    assert_eq!(answer.status, 200);
                    let manifest: Manifest = serde_json::from_slice(&answer.body).unwrap();
                    let version: u32 = manifest.version[1..].parse().unwrap();
                    for id in [TileId::ROOT, common::child(), TileId::ROOT] {
                        let path = route::tile("two", &manifest.version, TileKind::BlockMap, id);
                        let answer = connection.get(&path).unwrap();
                        assert_eq!(answer.status, 200, "{path}");
                        assert_eq!(answer.body, tile(id, version), "a tile of another version at {path}");
                        asked.fetch_add(1, Relaxed);
                    }
                }
            });
        }
        let mut connection = Connection::new(server.address);
        for version in 1..=VERSIONS {
            publish(folder.path(), version);
            server.signal("-HUP");
            until("the new version", || {
                let answer = connection.get("/v1/cities/two").unwrap();
                String::from_utf8(answer.body).unwrap().contains(&format!("\"{}\"", name(version)))
            });
        }
        stop.store(true, Relaxed);
    });
    println!("{VERSIONS} versions, {} tiles", asked.load(Relaxed));
    assert!(asked.load(Relaxed) > 100);
    // Old versions are closed after a second, at the next look.
    until("no file handle is leaked", || {
        server.signal("-HUP");
        server.descriptors() <= before
    });
}
