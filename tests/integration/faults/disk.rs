//! Files that are truncated, altered and removed while a server reads them.

use super::client::{CLIENTS, Connection, request_during, tile_paths};
use super::server;
use insula_test_support::faulty_host::FaultyHost;
use insula_test_support::programs::{path_text, wait_until};
use insula_test_support::{small_city, tier};
use std::fs::{self, OpenOptions};
use std::os::unix::fs::FileExt;
use std::sync::atomic::Ordering::Relaxed;

/// Alters and truncates an archive in place under load.
pub(super) fn truncated_and_altered() {
    // Nothing is cached, so each response is read from the disk.
    let (folder, mut server) = server::start_small_city(&["limits.tile_bytes=0", "reload.watch_secs=1"]);
    let path = folder.path().join("blockmaps.pmtiles");
    let intact = fs::read(&path).unwrap();
    let rounds = if tier::is_full() { 400 } else { 60 };
    let counts = request_during(server.address, |counts| {
        let file = OpenOptions::new().write(true).open(&path).unwrap();
        // After so many responses, a client has requested every tile.
        let responses = CLIENTS * (1 + tile_paths(small_city::VERSION).len() as u64);
        let meet_the_fault = || {
            let begin = counts.all();
            wait_until("responses during the fault", || counts.all() >= begin + responses);
        };
        for round in 0..rounds {
            let at = round * 7919 % intact.len() as u64;
            file.write_all_at(&[intact[at as usize] ^ (1 << (round % 8))], at).unwrap();
            meet_the_fault();
            file.write_all_at(&[intact[at as usize]], at).unwrap();
            if round % 20 == 0 {
                file.set_len(at).unwrap();
                meet_the_fault();
                file.write_all_at(&intact, 0).unwrap();
            }
        }
    });
    assert_eq!(counts.broken.load(Relaxed), 0, "responses were incomplete");
    assert!(counts.refused.load(Relaxed) > 0, "no fault was noticed: the test tests nothing");
    assert!(counts.intact.load(Relaxed) > 100);
    assert!(server.is_alive(), "reading a truncated file through a memory map would have ended it");
    // A damaged archive may have been opened meanwhile.
    wait_until("all tiles after the archive was restored", || {
        Connection::new(server.address).serves_all(small_city::VERSION)
    });
}

/// Damages the blocks of the disk cache, then removes its folder.
pub(super) fn cache_damaged_and_removed() {
    let (folder, cache) = (small_city::temporary_city(), tempfile::tempdir().unwrap());
    let host = FaultyHost::start(folder.path());
    let blocks = cache.path().join("blocks");
    let setting = format!("cache.folder={}", path_text(&blocks));
    let settings = [setting.as_str(), "cache.memory_bytes=0", "cache.block_bytes=4096", "limits.tile_bytes=0"];
    let server = server::start(&host.url(), &settings);
    let serves_all = || Connection::new(server.address).serves_all(small_city::VERSION);
    assert!(serves_all());
    // Blocks are written after the response.
    wait_until("all blocks are read from the disk", || {
        let fetches = host.range_requests();
        serves_all() && host.range_requests() == fetches
    });
    let fetches = host.range_requests();
    for entry in fs::read_dir(&blocks).unwrap() {
        let path = entry.unwrap().path();
        let mut bytes = fs::read(&path).unwrap();
        let middle = (bytes.len() - 1) / 2;
        bytes[middle] ^= 1;
        fs::write(path, bytes).unwrap();
    }
    assert!(serves_all() && host.range_requests() > fetches, "damaged blocks are fetched again");
    // Fails while the server writes a block.
    wait_until("the folder is removed", || fs::remove_dir_all(&blocks).is_ok() || !blocks.exists());
    assert!(serves_all() && serves_all());
    // A file in place of the folder: no block can be written.
    fs::write(&blocks, "").unwrap();
    assert!(serves_all());
}
