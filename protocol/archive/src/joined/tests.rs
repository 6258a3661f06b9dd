//! Archives of releases, in memory and on a host.

use super::*;
use crate::directory::tile_number;
use crate::directory_writer::{DATA_AT, DirectoryWriter};
use crate::mark::mark_of;
use crate::test_support::{MemorySource, archive, archive_with_leaves, id};
use crate::{Archive, ArchiveError, LazyArchive};
use futures_util::FutureExt as _;
use insula_protocol::TileId;

type Tiles = Vec<(TileId, Vec<u8>)>;

/// The file of a release of `base` with these tiles in the order of their numbers, and how many bytes of tiles are in it.
fn release(base: &Archive, tiles: &[(TileId, Vec<u8>)]) -> (Vec<u8>, usize) {
    let (mut data, mut directories) = (Vec::new(), DirectoryWriter::default());
    for (id, bytes) in tiles {
        let known = base.find(*id).now_or_never().unwrap().unwrap();
        let known = known.filter(|range| base.read(range.clone()).ready().unwrap() == bytes);
        let at = known.map_or(DATA_AT + data.len() as u64, |range| SHARED_AT + range.start);
        if at < SHARED_AT {
            data.extend_from_slice(bytes);
        }
        directories.add(*id, at, bytes.len() as u32).unwrap();
    }
    let frame = directories.finish(DATA_AT + data.len() as u64, SHARED_AT + base.end()).unwrap();
    ([&frame.head[..], &data, &frame.tail].concat(), data.len())
}

fn marked(mut file: Vec<u8>, version: &str) -> Vec<u8> {
    file[MARK_AT].copy_from_slice(&mark_of(version));
    file
}

fn load(source: SharedSource) -> Result<Archive, ArchiveError> {
    Archive::load(source, None).now_or_never().unwrap()
}

fn source(file: &[u8], is_remote: bool) -> SharedSource {
    let file = file.to_vec();
    Arc::new(if is_remote { MemorySource::remote(file) } else { MemorySource::local(file) })
}

/// Three releases, of which each changes, adds and removes a few of many tiles.
fn chain() -> (Vec<Vec<u8>>, Vec<Tiles>) {
    let (first, tiles) = archive_with_leaves();
    let (mut files, mut all) = (vec![marked(first, "0")], vec![tiles]);
    for round in 1..3_usize {
        let mut tiles: Tiles = all[round - 1].clone();
        tiles.iter_mut().skip(round).step_by(1000).for_each(|(id, bytes)| *bytes = format!("{round} {id}").into());
        tiles.remove(50 * round);
        tiles.push((id(8, round as u32, 0), vec![round as u8; 77]));
        tiles.sort_by_key(|(id, _)| tile_number(*id));
        let mut shared = (0..round - 1).rev().map(|i| (source(&files[i], false), mark_of(&i.to_string())));
        let base = load(joined(source(&files[round - 1], false), &mut shared)).unwrap();
        let (file, own) = release(&base, &tiles);
        assert!(own > 0 && file.len() < DATA_AT as usize + own + 65_536, "{} {own}", file.len());
        files.push(marked(file, &round.to_string()));
        all.push(tiles);
    }
    (files, all)
}

fn last_of(files: &[Vec<u8>], is_remote: bool) -> SharedSource {
    let mut shared = [1, 0].into_iter().map(|i: usize| (source(&files[i], is_remote), mark_of(&i.to_string())));
    joined(source(&files[2], is_remote), &mut shared)
}

#[test]
fn a_release_has_all_its_tiles_and_few_bytes() {
    let (files, all) = chain();
    let archive = load(last_of(&files, false)).unwrap();
    assert_eq!(archive.file_bytes(), files[2].len() as u64);
    let found: Tiles = archive.tiles().map(|(id, bytes)| (id, bytes.unwrap().to_vec())).collect();
    assert!(found == all[2]);
    assert!(archive.tile(id(8, 2, 0)).unwrap().is_some());
    assert!(archive.tile(all[1][100].0).unwrap().is_none(), "it was removed");
    // Only its own tiles, which the version of the city covers.
    let own: u64 = archive.distinct_tiles().map(|range| range.unwrap()).map(|range| range.end - range.start).sum();
    let data = archive.data();
    assert_eq!((data.start, own), (DATA_AT, data.end - data.start));
}

#[tokio::test]
async fn a_release_on_a_host_is_read_as_needed() {
    let (files, all) = chain();
    let archive = LazyArchive::new(last_of(&files, true), 1 << 20);
    for (id, bytes) in all[2].iter().step_by(97) {
        assert_eq!(archive.tile(*id).await.unwrap().unwrap(), bytes);
    }
    assert_eq!(archive.tile(all[1][100].0).await.unwrap(), None);
}

#[tokio::test]
async fn another_archive_in_the_place_of_the_shared_one_is_refused() {
    let (mut files, all) = chain();
    files[1] = marked(files[1].clone(), "other");
    let shared = all[2].iter().find(|(id, bytes)| all[0].contains(&(*id, bytes.clone()))).unwrap().0;
    for is_remote in [false, true] {
        let archive = LazyArchive::new(last_of(&files, is_remote), 1 << 20);
        let error = archive.tile(shared).await.unwrap_err();
        assert_eq!(error, ArchiveError::Read(ReadError::Replaced));
    }
    // Alone it is cut short.
    assert!(load(source(&files[2], false)).is_err());
    let one = [(TileId::ROOT, vec![1; 400])];
    let alone = load(source(&archive(&one), false)).unwrap();
    assert_eq!(alone.data().end - alone.data().start, 400);
}
