//! Cities that are written for other programs, and baked again.

use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use std::process::Command;

/// How far heights may be off: a table of undulations is read there and back.
const HEIGHT_M: f64 = 0.1;

/// A house of 20 m by 20 m from 2 to 11 m above sea level.
fn house() -> String {
    let corner = |x: f64, y: f64, z: f64| json!([85_000.0 + x, 447_000.0 + y, z]);
    let square = [(0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0)];
    let corners: Vec<_> = [2.0, 11.0].iter().flat_map(|z| square.map(|(x, y)| corner(x, y, *z))).collect();
    let faces = [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];
    let faces = faces.map(|face| json!([face]));
    json!({
        "type": "CityJSON",
        "version": "2.0",
        "metadata": { "referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/7415" },
        "CityObjects": {
            "house": { "type": "Building", "geometry": [{ "type": "Solid", "lod": "2", "boundaries": [faces] }] },
        },
        "vertices": corners,
    })
    .to_string()
}

fn succeeds(folder: &Path, line: &str) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_insula-server"));
    let output = command.args(line.split_whitespace()).current_dir(folder).env_remove("RUST_LOG").output().unwrap();
    assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn plain_tiles_are_baked_where_they_were() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("house.city.json"), house()).unwrap();
    for line in [
        "bake house.city.json --out town --cell 1 --no-street-sets --no-picture",
        "export town --format 3dtiles --plain --out tiles",
        "bake tiles/tileset.json --out again --cell 1 --crs EPSG:28992 --no-street-sets --no-picture",
        "export again --out again.csv",
    ] {
        succeeds(folder.path(), line);
    }
    let table = fs::read_to_string(folder.path().join("again.csv")).unwrap();
    let row = table.lines().find(|line| line.contains(",house,")).unwrap_or_else(|| panic!("no house in {table}"));
    let value = |name: &str| -> f64 {
        let column = table.lines().next().unwrap().split(',').position(|column| column == name).unwrap();
        row.split(',').nth(column).unwrap().parse().unwrap()
    };
    assert!((value("ground_z_m") - 2.0).abs() < HEIGHT_M, "{row}");
    assert!((value("roof_z_m") - 11.0).abs() < HEIGHT_M, "{row}");
    assert!((value("area_m2") - 400.0).abs() < 1.0, "{row}");
}

#[test]
fn sources_are_the_same_after_a_round_trip() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("house.city.json"), house()).unwrap();
    let bake = |input: &str, out: &str, options: &str| {
        succeeds(folder.path(), &format!("bake {input} --out {out} --cell 1 --no-street-sets --no-picture {options}"));
        let manifest: Value =
            serde_json::from_slice(&fs::read(folder.path().join(out).join("city.json")).unwrap()).unwrap();
        manifest["attribution"].clone()
    };
    let told =
        bake("house.city.json", "town", "--attribution Office --licence Ours --source-url https://example.org/a");
    assert_eq!(told, json!([{ "text": "Office", "licence": "Ours", "url": "https://example.org/a" }]));
    for (number, (out, input)) in [
        ("a.csv", "a.csv"),
        ("a.geojson", "a.geojson"),
        ("a.parquet", "a.parquet"),
        ("a.fgb", "a.fgb"),
        ("a.city.jsonl", "a.city.jsonl"),
        ("a.glb", "a.glb"),
        ("tiles --format 3dtiles", "tiles/tileset.json"),
    ]
    .into_iter()
    .enumerate()
    {
        succeeds(folder.path(), &format!("export town --out {out}"));
        assert_eq!(bake(input, &format!("again-{number}"), "--crs EPSG:28992"), told, "{out}");
    }
}
