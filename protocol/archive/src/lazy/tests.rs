//! Archives whose directories are fetched as needed: what is read, and how often.

use super::*;
use crate::ReadError;
use crate::test_support::{MemorySource, archive, archive_with_leaves, directory, id, raw_archive};
use futures_util::future::join_all;
use std::sync::atomic::Ordering;

fn open(file: Vec<u8>) -> (Arc<MemorySource>, LazyArchive) {
    let source = Arc::new(MemorySource::remote(file));
    (source.clone(), LazyArchive::new(source, 1 << 20))
}

#[tokio::test]
async fn one_read_opens_an_archive_and_one_reads_a_tile() {
    let (source, lazy) = open(archive(&[(TileId::ROOT, vec![1; 400]), (id(1, 1, 0), vec![2; 90])]));
    assert!(source.take_reads().is_empty());
    assert_eq!(lazy.tile(TileId::ROOT).await.unwrap().unwrap(), vec![1; 400]);
    let reads = source.take_reads();
    assert_eq!((reads.len(), &reads[0]), (2, &(0..FIRST_READ_BYTES)));
    assert_eq!(lazy.tile(id(1, 1, 0)).await.unwrap().unwrap(), vec![2; 90]);
    assert_eq!(source.take_reads().len(), 1);
    assert_eq!(lazy.tile(id(1, 0, 0)).await.unwrap(), None);
    assert!(source.take_reads().is_empty());
}

#[tokio::test]
async fn neighbouring_tiles_take_one_read() {
    let tiles: Vec<(TileId, Vec<u8>)> =
        id(1, 0, 0).children().zip(1..).map(|(id, byte)| (id, vec![byte; 300])).collect();
    let far = (id(2, 3, 0), vec![9; 90]);
    let between = (id(2, 0, 2), vec![8; 5000]);
    let all = [tiles.clone(), vec![between, far.clone()]].concat();
    let (source, lazy) = open(archive(&all));
    lazy.tile(far.0).await.unwrap();
    source.take_reads();
    let ids: Vec<TileId> = [far.0, id(2, 2, 3)].into_iter().chain(tiles.iter().map(|(id, _)| *id)).collect();
    let found = lazy.tiles(&ids).await.unwrap();
    assert_eq!(found[0].as_ref().unwrap(), &far.1);
    assert_eq!(found[1], None);
    assert!(found[2..].iter().zip(&tiles).all(|(found, (_, bytes))| found.as_ref().unwrap() == bytes));
    let reads = source.take_reads();
    assert_eq!(reads.len(), 2, "{reads:?}");
}

#[test]
fn runs_contain_all_tiles_and_are_bounded() {
    assert_eq!(runs(vec![5000..5100, 0..100, 150..300]), [0..300, 5000..5100]);
    let long = MAX_RUN_BYTES;
    assert_eq!(runs(vec![0..long, long..long + 10]), [0..long, long..long + 10]);
    assert_eq!(runs(vec![0..long + 50, 10..20, 30..long + 60]), [0..long + 50, 30..long + 60], "hostile directories");
    assert!(runs(vec![]).is_empty());
}

#[tokio::test]
async fn leaf_directories_are_read_once() {
    let (file, tiles) = archive_with_leaves();
    let source = Arc::new(MemorySource::local(file));
    let lazy = LazyArchive::new(source.clone(), 1 << 20);
    for (id, bytes) in &tiles {
        assert_eq!(lazy.tile(*id).await.unwrap().unwrap(), bytes);
    }
    let directories = source.take_reads().len() - tiles.len();
    assert!((3..=6).contains(&directories), "{directories}");
    let stray = lazy.tile(id(8, 0, 0)).await.unwrap();
    assert!(stray.is_none() && source.take_reads().is_empty());
}

#[tokio::test]
async fn callers_of_one_leaf_directory_share_its_read() {
    let (file, tiles) = archive_with_leaves();
    let (source, lazy) = open(file);
    let found = join_all(tiles[..100].iter().map(|(id, _)| lazy.tile(*id))).await;
    assert!(found.into_iter().zip(&tiles).all(|(found, (_, bytes))| found.unwrap().unwrap() == bytes));
    assert_eq!(source.take_reads().len(), 2 + 100);
}

#[tokio::test]
async fn failed_reads_are_shared_and_then_repeated() {
    let (file, tiles) = archive_with_leaves();
    let (source, lazy) = open(file);
    for reads in [1, 2] {
        // First the root fails, then the leaf directory.
        source.failures.store(1, Ordering::Relaxed);
        for found in join_all(tiles[..10].iter().map(|(id, _)| lazy.tile(*id))).await {
            assert!(matches!(found, Err(ArchiveError::Read(ReadError::Failed(_)))));
        }
        assert_eq!(source.take_reads().len(), 1, "{reads}");
        lazy.tile(id(8, 0, 0)).await.unwrap();
        source.take_reads();
    }
    assert!(lazy.tile(tiles[0].0).await.unwrap().is_some());
}

#[tokio::test]
async fn a_caller_that_gives_up_does_not_stop_the_others() {
    let (file, tiles) = archive_with_leaves();
    let (source, lazy) = open(file);
    let mut first = Box::pin(lazy.tile(tiles[0].0));
    assert!((&mut first).now_or_never().is_none());
    let mut second = Box::pin(lazy.tile(tiles[1].0));
    assert!((&mut second).now_or_never().is_none());
    drop(first);
    assert_eq!(second.await.unwrap().unwrap(), tiles[1].1);
    assert_eq!(source.take_reads().len(), 3);
    // With the last caller, the read ends too; the next caller starts another.
    let (source, lazy) = open(archive_with_leaves().0);
    let mut only = Box::pin(lazy.tile(tiles[0].0));
    assert!((&mut only).now_or_never().is_none());
    drop(only);
    assert_eq!(lazy.tile(tiles[0].0).await.unwrap().unwrap(), tiles[0].1);
    assert_eq!(source.take_reads().len(), 4);
}

#[tokio::test]
async fn a_root_directory_beyond_the_first_read_is_read_too() {
    let mut entries = vec![[1, 1, 1, 0]; 5000];
    entries[0] = [0, 1, 1, 1];
    let (source, lazy) = open(raw_archive(&directory(&entries), &[], &[7; 5000]));
    assert_eq!(lazy.tile(id(5, 3, 3)).await.unwrap().unwrap(), &[7][..]);
    assert_eq!(source.take_reads().len(), 3);
}

#[tokio::test]
async fn hostile_archives_are_refused() {
    // A leaf directory that lists itself.
    let root = directory(&[[1, 0, 5, 1]]);
    let (source, lazy) = open(raw_archive(&root, &directory(&[[1, 0, 5, 1]]), &[7; 10]));
    assert!(lazy.tile(id(1, 0, 0)).await.unwrap_err().to_string().contains("too deeply"));
    assert_eq!(source.take_reads().len(), 2);
    for length in [0, 100, 200] {
        let (_, lazy) = open(archive(&[(TileId::ROOT, vec![1; 400])])[..length].to_vec());
        assert!(lazy.tile(TileId::ROOT).await.is_err());
    }
}

#[tokio::test]
async fn tiles_that_are_too_long_are_refused_unread() {
    // Entries of 4 GiB, and one that is only longer than this kind of tile may be.
    let data = vec![7; (1 << 20) + 1];
    for length in [u64::from(u32::MAX), data.len() as u64] {
        let (source, lazy) = open(raw_archive(&directory(&[[0, 1, length, 1]]), &[], &data));
        let text = lazy.tile(TileId::ROOT).await.unwrap_err().to_string();
        assert!(text.contains("longer than any tile"), "{text}");
        assert_eq!(source.take_reads().len(), 1);
    }
}
