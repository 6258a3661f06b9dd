//! Archives that are made to exhaust the server are refused, and the city that is served stays.

use insula_server::store::{RetentionPolicy, Store};
use insula_test_support::small_city;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

/// Writes something hostile at a path.
type Attack = fn(&Path);

const RETENTION: RetentionPolicy = RetentionPolicy { time: Duration::from_secs(60), versions: 2 };

/// An archive of 15 kB: each of 1,000 pointers of its leaf directory leads to that directory again.
fn nested_pointers() -> Vec<u8> {
    const POINTERS: u64 = 1000;
    let mut leaf = Vec::new();
    let mut varint = |value: u64| match value {
        0..0x80 => leaf.push(value as u8),
        _ => leaf.extend([value as u8 | 0x80, (value >> 7) as u8]),
    };
    // Steps of the numbers, run lengths (0 for pointers), lengths, and offsets plus one.
    varint(POINTERS);
    for field in [1, 0, 2 + 5 * POINTERS, 1] {
        (0..POINTERS).for_each(|_| varint(field));
    }
    let mut file = b"PMTiles\x03".to_vec();
    file.resize(127, 0);
    let length = leaf.len() as u64;
    for (at, offset) in [(8, 127), (40, 127 + length), (56, 127 + 2 * length)] {
        file[at..at + 8].copy_from_slice(&u64::to_le_bytes(offset));
        file[at + 8..at + 16].copy_from_slice(&length.to_le_bytes());
    }
    (file[97], file[98]) = (1, 1);
    [&file, &leaf[..], &leaf, &vec![7; leaf.len()]].concat()
}

fn replace_by_nested_pointers(archive: &Path) {
    let file = nested_pointers();
    assert!(file.len() < 16_000, "{}", file.len());
    fs::write(archive, file).unwrap();
}

fn replace_by_pipe(archive: &Path) {
    assert!(Command::new("mkfifo").arg(archive).status().unwrap().success());
}

fn replace_by_huge_entry(archive: &Path) {
    // One tile of 4 GiB, less a byte, in a sparse file of that length.
    let mut file = nested_pointers()[..127].to_vec();
    let root = [1, 0, 1, 0xff, 0xff, 0xff, 0xff, 0x0f, 1];
    for (at, value) in
        [(8, 127), (16, root.len() as u64), (48, 0), (56, 127 + root.len() as u64), (64, u64::from(u32::MAX))]
    {
        file[at..at + 8].copy_from_slice(&u64::to_le_bytes(value));
    }
    file.extend(root);
    let length = file.len() as u64 + u64::from(u32::MAX);
    fs::write(archive, file).unwrap();
    fs::File::options().write(true).open(archive).unwrap().set_len(length).unwrap();
}

#[tokio::test]
async fn hostile_archives_do_not_replace_the_city_that_is_served() {
    let attacks: [(&str, Attack); 3] = [
        ("twice", replace_by_nested_pointers),
        ("regular file", replace_by_pipe),
        ("longer than any tile", replace_by_huge_entry),
    ];
    for (reason, attack) in attacks {
        let folder = tempfile::tempdir().unwrap();
        let city = folder.path().join("two");
        small_city::write_city(&city, "two");
        let store = Store::open(&[folder.path()]).unwrap();
        let archive = city.join("blockmaps.pmtiles");
        // Replaced, as `bake` does, and not changed in place.
        fs::remove_file(&archive).unwrap();
        attack(&archive);
        let reload = store.reload(RETENTION, false).await;
        let failure = reload.failures.first().unwrap().to_string();
        assert!(failure.contains(reason), "{failure}");
        assert!(reload.changed.is_empty());
        let served = reload.store.city("two").unwrap();
        assert!(served.blockmaps().tile(small_city::child()).is_ok(), "the open files stay readable");
        assert!(Store::open(&[folder.path()]).is_err());
        fs::remove_file(archive).unwrap();
        small_city::write_city(&city, "two");
        let repaired = reload.store.reload(RETENTION, false).await;
        assert!(repaired.failures.is_empty(), "{:?}", repaired.failures);
    }
}
