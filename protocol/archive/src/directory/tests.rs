//! Headers and directories, whole, damaged and hostile.

use super::*;
use crate::test_support::{MemorySource, RawEntry, archive, archive_with_leaves, directory, gzip, id, raw_archive};
use crate::{Archive, ReadError};
use futures_util::FutureExt;
use std::io::Write;
use std::sync::Arc;
use std::time::{Duration, Instant};

fn load(file: Vec<u8>) -> Result<Archive, ArchiveError> {
    Archive::load(Arc::new(MemorySource::local(file)), None).now_or_never().unwrap()
}

/// Why the archive is refused. No part of the file is read often.
fn refusal(file: Vec<u8>) -> String {
    let (length, source) = (file.len() as u64, Arc::new(MemorySource::local(file)));
    let loaded = Archive::load(source.clone(), None).now_or_never().unwrap();
    let text = loaded.map(drop).expect_err("it was accepted").to_string();
    let read: u64 = source.take_reads().iter().map(|range| range.end - range.start).sum();
    assert!(read <= 2 * length, "{read} bytes were read of {length}: {text}");
    assert!(!text.contains('\n'), "{text}");
    text
}

#[test]
fn tile_numbers_are_those_of_pmtiles() {
    let all = (0..=6).flat_map(|level| (0..1u32 << (2 * level)).map(move |i| (level, i)));
    let all = all.map(|(level, i)| id(level, i % (1 << level), i >> level));
    for id in all.chain([id(20, 0, 0), id(20, 0xfffff, 0xfffff), id(20, 0xabcde, 0x12345), id(13, 77, 8000)]) {
        let coord = pmtiles::TileCoord::new(id.level(), id.x(), id.y()).unwrap();
        assert_eq!(tile_number(id), pmtiles::TileId::from(coord).value());
        assert_eq!(tile_id(tile_number(id)), Some(id));
    }
    assert_eq!(tile_id(first_number(MAX_LEVEL + 1)), None);
    assert_eq!(tile_id(u64::MAX), None);
}

#[test]
fn archives_with_leaf_directories_are_read_whole() {
    let (file, tiles) = archive_with_leaves();
    let archive = load(file).unwrap();
    assert_eq!((archive.len(), archive.deepest_level()), (tiles.len() as u64, 7));
    assert!(archive.tiles().map(|(id, bytes)| (id, bytes.unwrap().to_vec())).eq(tiles));
    assert_eq!(archive.tile(id(6, 0, 0)).unwrap(), None);
    assert_eq!(archive.tile(id(20, 1, 1)).unwrap(), None);
}

#[test]
fn nodes_that_share_a_tile_all_have_it() {
    let bytes = |i: u32| if i % 16 < 8 { b"same".to_vec() } else { i.to_string().into_bytes() };
    let tiles: Vec<_> = (0..256).map(|i| (id(4, i % 16, i / 16), bytes(i))).collect();
    let archive = load(archive(&tiles)).unwrap();
    assert_eq!(archive.len(), 256);
    assert!(tiles.iter().all(|(id, bytes)| archive.tile(*id).unwrap().unwrap() == bytes));
    assert!(archive.tiles().all(|(id, found)| found.unwrap() == bytes(id.y() * 16 + id.x())));
    let lengths = archive.lengths().map(|(id, length)| (id, length.unwrap()));
    assert!(lengths.eq(archive.tiles().map(|(id, bytes)| (id, bytes.unwrap().len() as u32))));
}

#[test]
fn leaf_directories_are_read_again_only_if_they_are_not_resident() {
    let (file, tiles) = archive_with_leaves();
    let source = Arc::new(MemorySource::local(file));
    let archive = Archive::load(source.clone(), None).now_or_never().unwrap().unwrap();
    source.take_reads();
    for (id, bytes) in &tiles {
        assert_eq!(archive.tile(*id).unwrap().unwrap(), bytes);
    }
    let directories = source.take_reads().len() - tiles.len();
    assert!((1..tiles.len() / 100).contains(&directories), "{directories}");
    assert!(tiles.iter().all(|(id, _)| archive.tile(*id).unwrap().is_some()));
    assert_eq!(source.take_reads().len(), tiles.len());
}

#[test]
fn leaf_directories_that_fail_later_are_errors() {
    let (file, tiles) = archive_with_leaves();
    let source = Arc::new(MemorySource::local(file));
    let archive = Archive::load(source.clone(), None).now_or_never().unwrap().unwrap();
    let all = archive.tiles().count();
    source.failures.store(1, std::sync::atomic::Ordering::Relaxed);
    assert!(matches!(archive.tile(tiles[0].0), Err(ReadError::Failed(_))));
    assert!(archive.tile(tiles[0].0).unwrap().is_some());
    // Of the first directory, only its first tile is listed, with the error.
    source.failures.store(1, std::sync::atomic::Ordering::Relaxed);
    let (found, failed): (Vec<_>, Vec<_>) = archive.lengths().partition(|(_, length)| length.is_ok());
    assert!(found.len() < all && found.len() > all / 2, "{} of {all}", found.len());
    assert_eq!(failed.iter().map(|(id, _)| *id).collect::<Vec<_>>(), [tiles[0].0]);
    // The file has been replaced by another one of the same length.
    let damaged = vec![0xff; source.bytes.lock().unwrap().len()];
    *source.bytes.lock().unwrap() = damaged.into();
    assert!(matches!(archive.tile(tiles[tiles.len() - 1].0), Err(ReadError::Damaged(_))));
}

#[test]
fn every_truncation_is_refused() {
    let whole = archive(&[(TileId::ROOT, vec![1; 400]), (id(1, 0, 0), vec![2; 90])]);
    for length in 0..whole.len() {
        let text = refusal(whole[..length].to_vec());
        assert!(length < 8 || text.contains("truncated"), "{length} of {}: {text}", whole.len());
    }
    let (whole, _) = archive_with_leaves();
    for length in (0..whole.len()).step_by(10_007) {
        refusal(whole[..length].to_vec());
    }
}

#[test]
fn flipped_bits_never_panic_and_never_leave_the_file() {
    let whole = archive(&[(TileId::ROOT, vec![1; 400]), (id(1, 0, 0), vec![2; 90])]);
    let root_bytes = usize::try_from(u64::from_le_bytes(whole[16..24].try_into().unwrap())).unwrap();
    let mut refused = 0;
    for at in 0..127 + root_bytes {
        for bit in 0..8 {
            let mut wrong = whole.clone();
            wrong[at] ^= 1 << bit;
            match load(wrong) {
                Err(_) => refused += 1,
                Ok(archive) => assert!(archive.tiles().all(|(_, bytes)| !bytes.unwrap().is_empty())),
            }
        }
    }
    assert!(refused > 300, "{refused}");
}

#[test]
fn each_rule_of_directories_is_checked() {
    let data = vec![7; 100];
    let with = |entries: &[RawEntry]| raw_archive(&directory(entries), &[], &data);
    let good = [[0, 1, 10, 1], [1, 2, 10, 0], [200, 1, 80, 21]];
    assert_eq!(load(with(&good)).unwrap().len(), 4);
    let max = MAX_TILE_BYTES as u64;
    for (text, entries) in [
        ("not in order", [good[0], [0, 1, 10, 0]]),
        ("not in order", [[0, 4, 10, 1], [3, 1, 10, 0]]),
        ("a tile is empty", [good[0], [1, 1, 0, 1]]),
        ("outside the tile data", [good[0], [1, 1, 90, 12]]),
        ("outside the tile data", [good[0], [1, 1, 90, u64::MAX]]),
        ("longer than any tile", [good[0], [1, 1, max + 1, 1]]),
        ("below the deepest level", [good[0], [first_number(MAX_LEVEL + 1), 1, 10, 1]]),
        ("below the deepest level", [good[0], [u64::MAX, 1, 10, 1]]),
        ("a number is too large", [good[0], [1, 1 << 32, 10, 1]]),
        ("a number is too large", [[u64::MAX, 1, 10, 1], [1, 1, 10, 1]]),
        ("has no offset", [[0, 1, 10, 0], good[1]]),
        ("limit", [good[0], [1, MAX_TILES, 10, 1]]),
        ("outside its section", [good[0], [1, 0, 10, 1]]),
        ("leaf directory is too long", [good[0], [1, 0, MAX_PACKED_BYTES + 1, 1]]),
    ] {
        let found = refusal(with(&entries));
        assert!(found.contains(text), "{entries:?}: {found}");
    }
    let mut root = directory(&good);
    root.push(0);
    assert!(refusal(raw_archive(&root, &[], &data)).contains("goes on"));
    root.truncate(root.len() - 2);
    assert!(refusal(raw_archive(&root, &[], &data)).contains("ends too early"));
    assert!(refusal(raw_archive(&[0xff, 0xff, 0x7f, 1, 1], &[], &data)).contains("announces"));
    assert!(refusal(raw_archive(&[0xff; 11], &[], &data)).contains("too large"));
    assert!(refusal(raw_archive(&gzip(&directory(&good))[..20], &[], &data)).contains("unpacked"));
    for (at, text) in [(97, "directories use"), (98, "tiles use"), (7, "not a PMTiles")] {
        let mut file = with(&good);
        file[at] = 9;
        assert!(refusal(file).contains(text));
    }
}

/// `count` pointers to the leaf directory at `offset`, then one to that at `last`.
fn pointers(count: u64, offset: u64, last: u64, length: u64) -> Vec<u8> {
    let pointer = |offset: u64, step| [step, 0, length, offset + 1];
    let mut entries = vec![pointer(offset, 1); count as usize - 1];
    entries.push(pointer(last, 1));
    directory(&entries)
}

#[test]
fn leaf_directories_that_nest_are_refused_quickly() {
    // All of 1,000 pointers of each directory lead to the same one: 10^9 directories if each was followed.
    let leaf = pointers(1000, 0, 0, 5002);
    assert_eq!(leaf.len(), 5002);
    let file = raw_archive(&pointers(1000, 0, 0, leaf.len() as u64), &leaf, &[7; 5000]);
    assert!(file.len() < 16_000, "{}", file.len());
    assert!(refusal(file).contains("twice"));
    // A lists B a thousand times, B itself.
    let [a, b] = [0u64, 4000].map(|_| gzip(&pointers(1000, 4000, 4000, 400)));
    let leaves = [&a[..], &vec![0; 4000 - a.len()], &b[..], &[0; 400]].concat();
    let root = gzip(&directory(&[[0, 0, a.len() as u64, 1]]));
    let text = refusal(raw_archive(&root, &leaves, &[7; 1000]));
    assert!(text.contains("twice") || text.contains("limit") || text.contains("order"), "{text}");
    // One below the other, each by itself.
    let chain: Vec<u8> = (1..=4u64).flat_map(|next| directory(&[[1, 0, 5, next * 5 + 1]])).collect();
    let text = refusal(raw_archive(&directory(&[[1, 0, 5, 1]]), &[&chain[..], &[0; 5]].concat(), &[7; 10]));
    assert!(text.contains("too deeply"), "{text}");
}

#[test]
fn directories_that_unpack_to_gigabytes_are_refused_quickly() {
    // Leaf directories of a few kilobytes, each of half a million tiles: 233 kB have place for many.
    let (mut leaves, mut root) = (Vec::new(), Vec::new());
    for number in 0..3u64 {
        let mut entries = vec![[1, 1, 1, 1]; 500_000];
        entries[0][0] = number * 500_000;
        let leaf = gzip(&directory(&entries));
        root.push([500_000 * number.min(1), 0, leaf.len() as u64, leaves.len() as u64 + 1]);
        leaves.extend(leaf);
    }
    leaves.resize(230_000, 0);
    assert!(refusal(raw_archive(&gzip(&directory(&root)), &leaves, &[7; 10])).contains("limit"));
    let bomb = gzip(&vec![0; 200 << 20]);
    assert!(bomb.len() < 233_000);
    assert!(refusal(raw_archive(&bomb, &[], &[7; 10])).contains("too long"));
    let root = gzip(&directory(&[[0, 0, bomb.len() as u64, 1]]));
    assert!(refusal(raw_archive(&root, &bomb, &[7; 10])).contains("too long"));
}

#[test]
fn leaf_directories_with_tiles_before_their_first_are_refused() {
    let leaf = directory(&[[3, 1, 1, 1]]);
    let of = |number| raw_archive(&directory(&[[number, 0, leaf.len() as u64, 1]]), &leaf, &[7; 1000]);
    assert!(load(of(3)).is_ok());
    assert!(refusal(of(4)).contains("before its first"));
}

#[test]
fn leaf_directories_that_overlap_are_refused_quickly() {
    // 4,000 empty directories of 21 bytes, each listed with a length of 64 kB: a section of 84 kB, 262 MB to read.
    let empty = gzip(&directory(&[]));
    let count = 4000;
    let leaves = empty.repeat(count);
    let length = 64 << 10;
    let pointer = |i: u64| [1, 0, length, i * empty.len() as u64 + 1];
    let root = gzip(&directory(&(0..800).map(pointer).collect::<Vec<_>>()));
    let text = refusal(raw_archive(&root, &leaves, &[7; 5000]));
    assert!(text.contains("overlap"), "{text}");
}

#[test]
fn leaf_directories_that_hold_one_chain_of_each_other_are_refused() {
    // The deepest directory lists the first one again.
    let leaves: Vec<u8> = [1u64, 2, 0].iter().flat_map(|next| directory(&[[1, 0, 5, next * 5 + 1]])).collect();
    let text = refusal(raw_archive(&directory(&[[1, 0, 5, 1]]), &leaves, &[7; 10]));
    assert!(text.contains("twice") || text.contains("too deeply") || text.contains("overlap"), "{text}");
}

#[test]
fn opening_ends_at_its_deadline() {
    let source = Arc::new(MemorySource::local(archive_with_leaves().0));
    let load = |deadline| Archive::load(source.clone(), Some(deadline)).now_or_never().unwrap();
    assert_eq!(load(Instant::now()).unwrap_err(), ArchiveError::TooSlow);
    assert!(load(Instant::now() + Duration::from_secs(3600)).is_ok());
}

#[test]
fn gzip_files_of_any_header_are_unpacked_and_checked() {
    let content = b"entries of a directory ".repeat(40);
    let plain = flate2::GzBuilder::new();
    let named = flate2::GzBuilder::new().filename("a").comment("b").extra(*b"xyz").mtime(7);
    for builder in [plain, named] {
        let mut encoder = builder.write(Vec::new(), flate2::Compression::best());
        encoder.write_all(&content).unwrap();
        let packed = encoder.finish().unwrap();
        assert_eq!(unpack_gzip(&packed, 10_000).as_ref(), Some(&content));
        assert_eq!(unpack_gzip(&packed, content.len() as u64), None, "too long");
        for end in 0..packed.len() {
            assert_eq!(unpack_gzip(&packed[..end], 10_000), None, "{end} bytes");
        }
        let mut damaged = packed.clone();
        *damaged.iter_mut().nth_back(5).unwrap() ^= 1;
        assert_eq!(unpack_gzip(&damaged, 10_000), None);
    }
}
