//! Files that are cut, altered and removed under a server that reads them.

use crate::{
    client::{Connection, addresses, is_whole, while_asking},
    common,
    origin::Origin,
    program::{Served, text, until},
};
use std::{
    fs::{self, OpenOptions},
    os::unix::fs::FileExt,
    sync::atomic::Ordering::Relaxed,
    time::Duration,
};

pub(crate) fn cut_and_altered() {
    let folder = tempfile::tempdir().unwrap();
    common::write_city(folder.path(), "two");
    // Nothing is kept at hand, so that each answer is read from the disk.
    let mut server = Served::start(text(folder.path()), &["limits.tile_bytes=0", "reload.watch_secs=1"]);
    let path = folder.path().join("blockmaps.pmtiles");
    let whole = fs::read(&path).unwrap();
    let seen = while_asking(server.address, || {
        let file = OpenOptions::new().write(true).open(&path).unwrap();
        for round in 0..400u64 {
            let at = round * 7919 % whole.len() as u64;
            file.write_all_at(&[whole[at as usize] ^ (1 << (round % 8))], at).unwrap();
            std::thread::sleep(Duration::from_millis(2));
            file.write_all_at(&[whole[at as usize]], at).unwrap();
            if round % 20 == 0 {
                file.set_len(at).unwrap();
                std::thread::sleep(Duration::from_millis(5));
                file.write_all_at(&whole, 0).unwrap();
            }
        }
    });
    assert_eq!(seen.wrong.load(Relaxed), 0, "wrong bytes were served");
    assert_eq!(seen.broken.load(Relaxed), 0, "answers were cut off");
    assert!(seen.refused.load(Relaxed) > 0, "the faults were not noticed: the test tests nothing");
    assert!(seen.whole.load(Relaxed) > 100);
    assert!(server.is_alive(), "a map of a cut file would have ended it");
    let mut connection = Connection::new(server.address);
    for (layer, path) in addresses(common::VERSION) {
        let answer = connection.get(&path).unwrap();
        assert!(answer.status == 200 && is_whole(layer, &answer.body), "{path} after all is mended");
    }
}

pub(crate) fn cache_damaged_and_gone() {
    let (folder, cache) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    common::write_city(folder.path(), "two");
    let origin = Origin::start(folder.path());
    let blocks = cache.path().join("blocks");
    let setting = format!("cache.folder={}", text(&blocks));
    let settings = [setting.as_str(), "cache.memory_bytes=0", "cache.block_bytes=4096", "limits.tile_bytes=0"];
    let server = Served::start(&origin.url(), &settings);
    let all_whole = || {
        let mut connection = Connection::new(server.address);
        addresses(common::VERSION).iter().all(|(layer, path)| {
            let answer = connection.get(path).unwrap();
            answer.status == 200 && is_whole(*layer, &answer.body)
        })
    };
    assert!(all_whole());
    // They are written after the answer.
    until("all blocks are on the disk, which is used", || {
        let fetches = origin.fetches();
        all_whole() && origin.fetches() == fetches
    });
    let fetches = origin.fetches();
    for entry in fs::read_dir(&blocks).unwrap() {
        let path = entry.unwrap().path();
        let mut bytes = fs::read(&path).unwrap();
        let last = bytes.len() - 1;
        bytes[last / 2] ^= 1;
        fs::write(path, bytes).unwrap();
    }
    assert!(all_whole() && origin.fetches() > fetches, "damaged blocks are fetched again");
    // The server may just be writing a block into it.
    until("the folder is gone", || fs::remove_dir_all(&blocks).is_ok() || !blocks.exists());
    assert!(all_whole() && all_whole());
    // Written by nobody else: a file where the folder was.
    fs::write(&blocks, "").unwrap();
    assert!(all_whole());
}
