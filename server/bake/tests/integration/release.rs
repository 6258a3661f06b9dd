//! Versions of a city: the same tiles as those of a whole bake, in few bytes.

use super::support::{city, options};
use super::update::{raised, without};
use insula_archive::BakedCity;
use insula_archive::city::content_version;
use insula_archive::directory_writer::DATA_AT;
use insula_bake::read::ReadReport;
use insula_bake::scene::Scene;
use insula_bake::{BakeError, BakeOptions, BakeReport, Silent, bake_scene};
use insula_protocol::{TileId, TileKind};
use insula_test_support::folder::TestFolder;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

type Tiles = BTreeMap<(u8, TileId), Vec<u8>>;

/// Bakes a city of a day, without the tiles of an earlier one.
fn bake(scene: Scene, out: &Path, date: &str, version_of: Option<&Path>) -> Result<BakeReport, BakeError> {
    let (date, version_of) = (Some(date.to_owned()), version_of.map(Path::to_owned));
    let options = BakeOptions { date, version_of, street_sets: true, picture: true, ..options(out, 2) };
    bake_scene(scene, ReadReport::default(), &options, &Silent)
}

/// All tiles by kind and id.
fn tiles(folder: &Path) -> Tiles {
    let city = BakedCity::open(folder).unwrap();
    let of_kind = |(number, kind): (u8, TileKind)| {
        let tiles: Vec<_> = city.archive(kind).into_iter().flat_map(|archive| archive.tiles()).collect();
        tiles.into_iter().map(move |(id, bytes)| ((number, id), bytes.unwrap().to_vec()))
    };
    (0..).zip(TileKind::ALL).flat_map(of_kind).collect()
}

/// Bytes of the archives in a folder.
fn archive_bytes(folder: &Path) -> u64 {
    let lengths = TileKind::ALL.map(|kind| fs::metadata(folder.join(kind.file_name())).map_or(0, |found| found.len()));
    lengths.iter().sum()
}

#[test]
fn a_version_has_only_what_changed_and_reads_as_a_whole_bake() {
    let folder = TestFolder::new("release");
    let [first, second, third, whole] =
        ["town", "town-2", "town-3", "whole"].map(|name| folder.path.join("cities").join(name));
    bake(city(), &first, "2020-01-01", None).unwrap();
    let scenes = [raised(city(), 2), raised(raised(city(), 2), 4)];
    let pairs = [(&first, &second, "2022-01-01"), (&second, &third, "2024-01-31")];
    for (scene, (before, after, date)) in scenes.into_iter().zip(pairs) {
        let report = bake(scene.clone(), after, date, Some(before.as_path())).unwrap();
        assert!(report.blocks_unchanged > 0 && report.blocks_baked > 0, "{report:?}");
        // Of the same objects, so that a whole bake has the same numbers.
        bake(scene, &whole, date, None).unwrap();
        let (found, known) = (tiles(after), tiles(before));
        assert!(found == tiles(&whole), "{date}: other tiles than those of a whole bake");
        let changed: usize =
            found.iter().filter(|(key, bytes)| known.get(*key) != Some(*bytes)).map(|(_, bytes)| bytes.len()).sum();
        let directories = TileKind::ALL.len() as u64 * (DATA_AT + 64) + 16 * found.len() as u64;
        let (own, all) = (archive_bytes(after), found.values().map(Vec::len).sum::<usize>());
        assert!(
            own <= changed as u64 + directories && changed < all,
            "{date}: {own} bytes, {changed} of {all} changed"
        );
        let city = BakedCity::open(after).unwrap();
        let release = city.manifest().release.clone().unwrap();
        assert_eq!((release.of.as_str(), release.date.as_str()), ("town", date));
        let stated = &city.manifest().version;
        assert_eq!(content_version(after, stated).unwrap(), *stated);
        assert!(after.join("thumbnail.jpg").is_file());
        fs::remove_dir_all(&whole).unwrap();
    }
    let shared = BakedCity::open(&third).unwrap().manifest().shared().to_vec();
    assert_eq!(shared.iter().map(|city| city.name.as_str()).collect::<Vec<_>>(), ["town-2", "town"]);
}

#[test]
fn objects_come_and_go_between_versions() {
    let folder = TestFolder::new("release-objects");
    let [first, second, third] = ["town", "town-2", "town-3"].map(|name| folder.path.join(name));
    bake(city(), &first, "2020-01-01", None).unwrap();
    bake(without(city(), 6), &second, "2022-01-01", Some(first.as_path())).unwrap();
    // What came back has a new number.
    bake(city(), &third, "2024-01-31", Some(second.as_path())).unwrap();
    let [old, between, new] = [&first, &second, &third].map(|folder| tiles(folder));
    let leaves = |tiles: &Tiles| tiles.keys().filter(|(_, id)| id.level() > 0).count();
    assert!(leaves(&between) < leaves(&old) && leaves(&new) >= leaves(&old));
    let same = |a: &Tiles, b: &Tiles| a.iter().filter(|(key, bytes)| b.get(*key) == Some(*bytes)).count();
    assert!(same(&old, &between) > 0 && same(&between, &new) > 0 && same(&old, &new) < old.len());
}

#[test]
fn a_city_with_tiles_of_others_is_kept_from_harm() {
    let folder = TestFolder::new("release-safety");
    let [first, second, away] = ["town", "town-2", "away/town-3"].map(|name| folder.path.join(name));
    bake(city(), &first, "2020-01-01", None).unwrap();
    let fails = |out: &Path, date: &str, of: &Path| bake(city(), out, date, Some(of)).unwrap_err().to_string();
    assert!(fails(&away, "2022-01-01", &first).contains("beside it"));
    assert!(fails(&second, "2022-02-30", &first).contains("--date 2022-02-30"));
    assert!(fails(&second, "2022-01-01", &folder.path.join("none")).contains("none"));
    assert!(fails(&first, "2022-01-01", &first).contains("would be replaced"));
    bake(raised(city(), 2), &second, "2022-01-01", Some(first.as_path())).unwrap();
    let error = bake(city(), &first, "2020-01-01", None).unwrap_err().to_string();
    assert!(error.contains("town-2 shares tiles"), "{error}");
    let opened = |folder: &Path| BakedCity::open(folder).map(drop).map_err(|error| error.to_string());
    // Another city in the place of the first one, and none.
    let kept = folder.path.join("kept");
    fs::rename(&first, &kept).unwrap();
    assert!(opened(&second).unwrap_err().contains("put the folder town there"));
    bake(raised(city(), 4), &first, "2020-01-01", None).unwrap();
    assert!(opened(&second).unwrap_err().contains("another version"));
    fs::remove_dir_all(&first).unwrap();
    fs::rename(&kept, &first).unwrap();
    opened(&second).unwrap();
    let renamed = folder.path.join("renamed");
    fs::rename(&second, &renamed).unwrap();
    assert!(fails(&second, "2024-01-31", &renamed).contains("rename the folder to town-2"));
}
