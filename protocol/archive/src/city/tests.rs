//! City folders, whole and damaged.

use super::*;
use crate::file_source::FileSource;
use crate::mark::mark_file;
use crate::test_support::{MemorySource, archive, id};
use crate::{LazyArchive, RangeSource};
use futures_util::FutureExt;
use insula_protocol::manifest::{self, CityMarks};
use insula_protocol::tile::TileWriter;
use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;

fn manifest() -> Manifest {
    Manifest {
        format_version: manifest::FORMAT_VERSION,
        name: "town".into(),
        title: "Town".into(),
        version: "0123456789abcdef".into(),
        root_side_m: 128.0,
        depth: 1,
        node_cells: 64,
        cell_m: 1.0,
        bounds: [[0.0; 3], [128.0; 3]],
        focus: [[0.0; 2], [128.0; 2]],
        tile_version: tile::VERSION,
        ..Manifest::default()
    }
}

fn tile(kind: TileKind) -> Vec<u8> {
    let mut writer = TileWriter::new(kind, None);
    writer.add_raw_section(1, &[9; 500]).unwrap();
    writer.finish().unwrap()
}

fn write_manifest(folder: &Path, manifest: &Manifest) {
    fs::write(folder.join(MANIFEST_FILE), serde_json::to_vec(manifest).unwrap()).unwrap();
}

fn write_archive(folder: &Path, kind: TileKind, tiles: &[(TileId, Vec<u8>)]) {
    fs::write(folder.join(kind.file_name()), archive(tiles)).unwrap();
}

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_manifest(folder.path(), &manifest());
    write_archive(folder.path(), TileKind::Subtree, &[(TileId::ROOT, tile(TileKind::Subtree))]);
    let blockmaps = [TileId::ROOT, id(1, 1, 1)].map(|id| (id, tile(TileKind::BlockMap)));
    write_archive(folder.path(), TileKind::BlockMap, &blockmaps);
    folder
}

/// The one line that opening gives instead of a city.
fn refusal(folder: &Path) -> String {
    let text = BakedCity::open(folder).map(drop).expect_err("it was opened").to_string();
    assert!(!text.contains('\n'), "{text}");
    text
}

#[test]
fn tiles_come_back_byte_for_byte() {
    let folder = folder();
    let city = BakedCity::open(folder.path()).unwrap();
    assert_eq!((city.manifest(), city.location()), (&manifest(), folder.path().to_str().unwrap()));
    assert_eq!(city.archives().map(|(kind, _)| kind).collect::<Vec<_>>(), [TileKind::Subtree, TileKind::BlockMap]);
    // Open files outlive their folder.
    drop(folder);
    let checked = |kind, id| city.checked_tile(kind, id).now_or_never().unwrap().unwrap();
    for (kind, id, expected) in [
        (TileKind::BlockMap, id(1, 1, 1), Some(tile(TileKind::BlockMap))),
        (TileKind::Subtree, TileId::ROOT, Some(tile(TileKind::Subtree))),
        (TileKind::Subtree, id(1, 1, 1), None),
        (TileKind::BlockMap, id(20, 1, 1), None),
        (TileKind::Mesh, TileId::ROOT, None),
    ] {
        assert_eq!(city.tile(kind, id).unwrap().map(Vec::from), expected);
        assert_eq!(checked(kind, id).map(Vec::from), expected);
    }
}

#[test]
fn meshes_may_be_missing_but_not_too_deep() {
    let folder = folder();
    let mesh = |level| [(id(level, 1, 1), tile(TileKind::Mesh))];
    write_archive(folder.path(), TileKind::Mesh, &mesh(6));
    assert_eq!(BakedCity::open(folder.path()).unwrap().archive(TileKind::Mesh).unwrap().len(), 1);
    write_archive(folder.path(), TileKind::Mesh, &mesh(7));
    assert!(refusal(folder.path()).contains("below the depth"));
    fs::write(folder.path().join("meshes.pmtiles"), "PMTiles").unwrap();
    assert!(refusal(folder.path()).contains("meshes.pmtiles"));
}

#[test]
fn manifests_that_lie_are_refused() {
    let folder = folder();
    let refused = |change: &dyn Fn(&mut Manifest), file: &str| {
        let mut manifest = manifest();
        change(&mut manifest);
        write_manifest(folder.path(), &manifest);
        let text = refusal(folder.path());
        assert!(text.contains(file), "{text}");
    };
    refused(&|m| m.format_version = 9, "city.json");
    refused(&|m| m.tile_version = 9, "city.json");
    refused(&|m| m.name = "../etc".into(), "city.json");
    refused(&|m| m.version = "a b".into(), "city.json");
    refused(&|m| m.depth = 200, "city.json");
    refused(&|m| (m.depth, m.root_side_m) = (0, 64.0), "blockmaps.pmtiles");
    let path = folder.path().join(MANIFEST_FILE);
    fs::write(&path, "{").unwrap();
    refusal(folder.path());
    fs::write(&path, vec![b' '; MAX_MANIFEST_BYTES + 1]).unwrap();
    assert!(refusal(folder.path()).contains("larger than"));
    write_manifest(folder.path(), &manifest());
    fs::remove_file(folder.path().join("subtrees.pmtiles")).unwrap();
    assert!(refusal(folder.path()).contains("subtrees.pmtiles"));
}

#[test]
fn subtrees_and_meshes_that_share_a_tile_are_refused() {
    let folder = folder();
    let tiles = [(0, 0), (0, 1), (1, 1)].map(|(x, y)| (id(1, x, y), tile(TileKind::BlockMap)));
    write_archive(folder.path(), TileKind::BlockMap, &tiles);
    BakedCity::open(folder.path()).unwrap();
    for kind in [TileKind::Mesh, TileKind::Subtree] {
        write_archive(folder.path(), kind, &tiles);
        let text = refusal(folder.path());
        assert!(text.contains(kind.file_name()) && text.contains("share a tile"), "{text}");
    }
}

#[test]
fn tiles_longer_than_their_kind_may_be_are_refused() {
    let folder = folder();
    let longest = max_tile_bytes(TileKind::Subtree);
    write_archive(folder.path(), TileKind::Subtree, &[(TileId::ROOT, vec![1; longest])]);
    BakedCity::open(folder.path()).unwrap();
    write_archive(folder.path(), TileKind::Subtree, &[(TileId::ROOT, vec![1; longest + 1])]);
    assert!(refusal(folder.path()).contains("longer than any tile"));
}

#[cfg(unix)]
#[test]
fn pipes_are_refused_without_blocking() {
    for name in [MANIFEST_FILE, "blockmaps.pmtiles"] {
        let folder = folder();
        let path = folder.path().join(name);
        fs::remove_file(&path).unwrap();
        assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
        assert!(refusal(folder.path()).contains(name));
    }
}

/// Gives damaged tiles until [`RangeSource::invalidate`] is called so many times.
#[derive(Debug)]
struct DamagedSource(MemorySource, u64);

impl RangeSource for DamagedSource {
    fn length(&self) -> Option<u64> {
        self.0.length()
    }

    fn read(&self, range: std::ops::Range<u64>) -> crate::RangeRead {
        let bytes = self.0.read(range.clone()).ready().map(|bytes| {
            let mut bytes = Vec::from(bytes);
            if range.start > 300 && self.0.invalidated.load(Ordering::Relaxed) < self.1 {
                bytes[30] ^= 1;
            }
            bytes.into()
        });
        crate::RangeRead::Ready(bytes)
    }

    fn invalidate(&self, range: std::ops::Range<u64>) -> crate::source::BoxFuture<'_, ()> {
        self.0.invalidate(range)
    }
}

#[test]
fn a_damaged_tile_is_invalidated_and_read_once_more() {
    let pad = (TileId::ROOT, vec![1; 400]);
    let file = archive(&[pad, (id(1, 0, 0), tile(TileKind::BlockMap))]);
    for repaired_after in [0, 1, 2] {
        let load = |file: &[u8], times| {
            let source = DamagedSource(MemorySource::local(file.to_vec()), times);
            Archive::load(Arc::new(source), None).now_or_never().unwrap().unwrap()
        };
        let archives = CityArchives {
            subtrees: load(&file, 0),
            blockmaps: load(&file, repaired_after),
            meshes: None,
            objects: None,
            visibility: None,
        };
        let city = BakedCity::new("memory".into(), manifest(), archives).unwrap();
        match city.checked_tile(TileKind::BlockMap, id(1, 0, 0)).now_or_never().unwrap() {
            Ok(found) => assert!(found.unwrap() == tile(TileKind::BlockMap) && repaired_after < 2),
            Err(error) => assert!(matches!(error, ReadError::Damaged(_)) && repaired_after == 2),
        }
    }
}

#[test]
fn archives_of_another_bake_are_refused() {
    let folder = folder();
    let version = manifest().version;
    let recomputed = || content_version(folder.path(), &version).unwrap();
    let unmarked = recomputed();
    let mark = |kind: TileKind, version: &str| mark_file(&folder.path().join(kind.file_name()), version).unwrap();
    mark(TileKind::Subtree, &version);
    mark(TileKind::BlockMap, &version);
    BakedCity::open(folder.path()).unwrap();
    assert_eq!(recomputed(), unmarked, "the version is a hash of the archives without their marks");
    mark(TileKind::BlockMap, "fedcba9876543210");
    let text = refusal(folder.path());
    assert!(text.contains("blockmaps.pmtiles") && text.contains("another version"), "{text}");
    let lazy = |version: &str| {
        let source = FileSource::open(&folder.path().join(TileKind::BlockMap.file_name())).unwrap();
        LazyArchive::new(Arc::new(source), 1 << 20).of_city(&Manifest { version: version.into(), ..manifest() })
    };
    let read = |version: &str| lazy(version).tile(TileId::ROOT).now_or_never().unwrap();
    assert_eq!(read(&version).unwrap_err(), ArchiveError::OtherVersion);
    assert!(read("fedcba9876543210").unwrap().is_some());
}

#[test]
fn archives_without_a_mark_are_of_earlier_bakes_only() {
    let folder = folder();
    let marked = Manifest { marks: Some(CityMarks { search_index: None }), ..manifest() };
    BakedCity::open(folder.path()).unwrap();
    write_manifest(folder.path(), &marked);
    assert!(refusal(folder.path()).contains("another version"));
    for kind in [TileKind::Subtree, TileKind::BlockMap] {
        mark_file(&folder.path().join(kind.file_name()), &marked.version).unwrap();
    }
    BakedCity::open(folder.path()).unwrap();
}
