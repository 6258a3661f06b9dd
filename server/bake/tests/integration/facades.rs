//! Generated facades in a finished city.

use super::support::files;
use insula_bake::read::{FacadeOption, ReadOptions};
use insula_bake::{BakeOptions, BakeReport, Silent, bake};
use insula_protocol::Manifest;
use insula_test_support::folder::TestFolder;
use insula_test_support::map_files::{feature_collection, rectangle};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// Writes footprints of 20 x 14 m: three houses, a factory and a shed.
fn write_city(path: &Path) {
    let mut features = Vec::new();
    for (i, (kind, height)) in
        [("house", 9.0), ("house", 12.0), ("yes", 6.0), ("industrial", 9.0), ("shed", 3.0)].into_iter().enumerate()
    {
        let [west, south] = [500_000.0 + 40.0 * i as f64, 5_000_000.0];
        let members = format!(r#""id":"b{i}","properties":{{"building":"{kind}","height":{height}}}"#);
        features.push(rectangle(&members, [west, south, west + 20.0, south + 14.0]));
    }
    fs::write(path, feature_collection("urn:ogc:def:crs:EPSG::32632", &features)).unwrap();
}

/// Bakes the city in a folder of its own.
fn bake_with(folder: &TestFolder, run: &str, options: BakeOptions) -> (BakeReport, BTreeMap<String, Vec<u8>>) {
    let input = folder.path.join("city.geojson");
    write_city(&input);
    let out = folder.path.join(run).join("city");
    fs::create_dir_all(out.parent().unwrap()).unwrap();
    let report = bake(&BakeOptions { inputs: vec![input], out: out.clone(), ..options }, &Silent).unwrap();
    (report, files(&out))
}

fn windows(threads: usize) -> BakeOptions {
    let read = ReadOptions { facades: FacadeOption::Windows, ..ReadOptions::default() };
    BakeOptions { read, threads: Some(threads), ..BakeOptions::default() }
}

#[test]
fn windows_are_labelled_and_differ_from_plain_walls() {
    let folder = TestFolder::new("facades");
    let (plain, plain_files) = bake_with(&folder, "plain", BakeOptions { threads: Some(2), ..BakeOptions::default() });
    let (report, windows_files) = bake_with(&folder, "windows", windows(2));
    let manifest =
        |files: &BTreeMap<String, Vec<u8>>| -> Manifest { serde_json::from_slice(&files["city.json"]).unwrap() };
    assert!(manifest(&windows_files).generated_facades && !manifest(&plain_files).generated_facades);
    assert_eq!(plain.read.facades, None);
    let facades = report.read.facades.unwrap();
    assert!(facades.generated);
    // Bays of about 3 m: 7 and 5. Storeys of about 2.9 m: 3, 4 and 2.
    assert_eq!((facades.objects, facades.walls, facades.windows), (3, 12, 2 * (7 + 5) * (3 + 4 + 2)));
    assert_ne!(manifest(&windows_files).settings, manifest(&plain_files).settings);
    for name in ["blockmaps.pmtiles", "meshes.pmtiles"] {
        assert!(windows_files[name] != plain_files[name], "{name}");
    }
}

#[test]
fn facades_do_not_depend_on_threads_and_update_follows_the_option() {
    let folder = TestFolder::new("facades-threads");
    let (_, one) = bake_with(&folder, "one", windows(1));
    let (_, three) = bake_with(&folder, "three", windows(3));
    assert!(one == three);
    let again = BakeOptions { update: true, ..windows(2) };
    let (unchanged, same) = bake_with(&folder, "one", again.clone());
    assert!(same == one && unchanged.blocks_baked == 0, "{} blocks", unchanged.blocks_baked);
    let (_, plain) = bake_with(&folder, "plain", BakeOptions::default());
    let (changed, now_plain) = bake_with(&folder, "one", BakeOptions { read: ReadOptions::default(), ..again });
    assert!(now_plain == plain && changed.blocks_unchanged == 0);
}
