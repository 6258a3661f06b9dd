//! `changes` between two bakes of a street, and what it says of cities that have no map in common.

use crate::command_line::call;
use insula_tests::tests;
use insula_tests::trials::Trials;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs;
use std::path::Path;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![
        buildings_are_built_demolished_and_changed,
        edits_between_the_versions_of_a_town_are_found,
        cities_without_a_map_in_common_are_refused
    ]);
}

const DUTCH: (&str, [u32; 2]) = ("EPSG:28992", [85_000, 447_000]);
const GERMAN: (&str, [u32; 2]) = ("EPSG:25832", [691_000, 5_334_000]);
const OFF: &str = "OFF\n5 6 0\n0 0 0\n10 0 0\n10 8 0\n0 8 0\n4 3 7\n4 3 2 1 0\n3 0 1 4\n3 1 2 4\n3 2 3 4\n3 3 0 4\n";

/// A building: its identifier, west, south, east and north in metres from the corner of the street, and its height.
type House<'a> = (&'a str, [u32; 4], u32);
type NamedHouse = (String, [u32; 4], u32);

/// Bakes a city of boxes.
fn bake(folder: &Path, name: &str, boxes: &[House<'_>], map: (&str, [u32; 2])) {
    bake_with(folder, name, boxes, map, "--cell 1");
}

/// The same with further options.
fn bake_with(folder: &Path, name: &str, boxes: &[House<'_>], (crs, corner): (&str, [u32; 2]), options: &str) {
    let feature = |(id, [west, south, east, north], height): &House<'_>| {
        let ring = [[west, south], [east, south], [east, north], [west, north], [west, south]]
            .map(|[x, y]| [corner[0] + x, corner[1] + y]);
        let geometry = json!({ "type": "Polygon", "coordinates": [ring] });
        json!({ "type": "Feature", "id": id, "properties": { "height": height }, "geometry": geometry })
    };
    let crs = json!({ "type": "name", "properties": { "name": crs } });
    let features: Vec<Value> = boxes.iter().map(feature).collect();
    let street = json!({ "type": "FeatureCollection", "crs": crs, "features": features });
    fs::write(folder.join(format!("{name}.geojson")), street.to_string()).unwrap();
    let line = format!("bake {name}.geojson {options} --no-street-sets --no-picture --out {name}");
    let (code, errors) = run(folder, &line);
    assert_eq!(code, Some(0), "{errors}");
}

fn run(folder: &Path, line: &str) -> (Option<i32>, String) {
    call("insula-server", folder, &line.split(' ').map(OsStr::new).collect::<Vec<_>>())
}

/// The rows of the table `changes.geojson`.
fn rows(folder: &Path) -> Vec<Value> {
    let table: Value = serde_json::from_slice(&fs::read(folder.join("changes.geojson")).unwrap()).unwrap();
    table["features"].as_array().unwrap().clone()
}

/// The text of a column; empty if there is none.
fn text(row: &Value, name: &str) -> String {
    row["properties"][name].as_str().unwrap_or_default().to_owned()
}

fn buildings_are_built_demolished_and_changed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let before = [
        ("same", [0, 0, 20, 12], 9),
        ("higher", [40, 0, 60, 12], 9),
        ("extended", [80, 0, 100, 12], 9),
        ("gone", [120, 0, 140, 12], 9),
        ("west", [160, 0, 170, 12], 9),
        ("east", [170, 0, 180, 12], 9),
    ];
    let after = [
        ("9", [0, 0, 20, 12], 9),
        ("8", [40, 0, 60, 12], 12),
        ("7", [80, 0, 100, 20], 9),
        ("6", [160, 0, 180, 12], 9),
        ("5", [0, 40, 20, 52], 6),
    ];
    bake(folder, "before", &before, DUTCH);
    bake(folder, "after", &after, DUTCH);
    let (code, errors) = run(folder, "changes before after --out changes.geojson");
    assert_eq!(code, Some(0), "{errors}");
    let rows = rows(folder);
    let names = ["change", "what", "identifier_before", "identifier_after"];
    let mut found: Vec<[String; 4]> = rows.iter().map(|row| names.map(|name| text(row, name))).collect();
    found.sort();
    let expected = [
        ["built", "", "", "5"],
        ["changed", "footprint", "extended", "7"],
        ["changed", "higher", "higher", "8"],
        ["changed", "merged", "east; west", "6"],
        ["demolished", "", "gone", ""],
    ];
    assert_eq!(found, expected.map(|row| row.map(str::to_owned)));
    let higher = &rows.iter().find(|row| text(row, "what") == "higher").unwrap()["properties"];
    let metres = ["height_m", "height_before_m", "height_after_m"].map(|name| higher[name].as_f64().unwrap().round());
    assert_eq!(metres, [12.0, 9.0, 12.0]);
    assert!(rows.iter().all(|row| row["geometry"]["coordinates"].is_array()));

    // The table is a source of its own: a city with the changes as colours.
    let bake = "bake changes.geojson --cell 1 --no-street-sets --no-picture --out colours";
    assert_eq!(run(folder, bake).0, Some(0));
    // Larger steps and other areas have fewer rows.
    for (options, lines) in [
        ("--height-step 4", 1 + 4),
        ("--same-footprint 0.55", 1 + 4),
        ("--all", 1 + 6),
        ("--bbox-metres 85000,447030,85100,447100", 1 + 1),
    ] {
        let (code, errors) = run(folder, &format!("changes before after --out changes.csv {options}"));
        assert_eq!(code, Some(0), "{options}: {errors}");
        let table = fs::read_to_string(folder.join("changes.csv")).unwrap();
        assert_eq!(table.lines().count(), lines, "{options}: {table}");
    }
    for (options, words) in [
        ("--bbox 8,44,8.1,44.1", "--bbox 8,44,8.1,44.1: beyond the city, which lies in 4.3"),
        ("--bbox-metres 0,0,9,9", "beyond the city, which lies in 8"),
    ] {
        let (code, error) = run(folder, &format!("changes before after --out beyond.csv {options}"));
        assert!(code == Some(2) && error.contains(words), "{error}");
    }
    assert!(!folder.join("beyond.csv").exists());
    let (code, errors) = run(folder, "changes before after --attribute height --out heights.csv");
    assert_eq!(code, Some(0), "{errors}");
    let table = fs::read_to_string(folder.join("heights.csv")).unwrap();
    assert!(table.contains("height: 9 to 12") && table.contains("\"higher, attributes\""), "{table}");
    let (code, error) = run(folder, "changes before after --attribute colour --out heights.csv");
    assert!(code == Some(2) && error.contains("--attribute colour"), "{error}");
    let (code, error) = run(folder, "changes before after --out changes.tif");
    assert!(code == Some(2) && error.contains(".fgb"), "{error}");
}

/// The lots of a town, each with a house of before, one of after, and what a table says of them. All identifiers are others after.
fn edited_town() -> ([Vec<NamedHouse>; 2], BTreeSet<[String; 3]>) {
    const SIDE: u32 = 12;
    let (mut before, mut after, mut expected) = (Vec::new(), Vec::new(), BTreeSet::new());
    for lot in 0..SIDE * SIDE {
        let [x, y] = [lot % SIDE * 32, lot / SIDE * 32];
        let at = |east: u32| [x + east, y, x + east + 12, y + 10];
        let [old, new] = [format!("old-{lot}"), format!("new-{}", lot * 7919 % 1000)];
        // The first and the last lot stay, so that the town has the same extent.
        let edit = if lot == 0 || lot + 1 == SIDE * SIDE { 9 } else { lot * 37 % 11 };
        let (house, changed) = match edit {
            0 => (None, Some((at(0), 9))),
            1 => (Some(at(0)), None),
            2 => (Some(at(0)), Some((at(0), 13))),
            3 => (Some(at(0)), Some((at(0), 6))),
            4 => (Some(at(0)), Some((at(3), 9))),
            5 => (Some(at(0)), Some(([x, y, x + 12, y + 15], 9))),
            6 => (Some(at(0)), Some((at(14), 9))),
            _ => (Some(at(0)), Some((at(0), 9))),
        };
        let mut expect = |change: &str, old: &str, new: &str| {
            expected.insert([change, old, new].map(str::to_owned));
        };
        match edit {
            0 => expect("built", "", &new),
            1 => expect("demolished", &old, ""),
            2..=5 => expect("changed", &old, &new),
            6 => {
                expect("demolished", &old, "");
                expect("built", "", &new);
            }
            _ => {}
        }
        before.extend(house.map(|place| (old, place, 9)));
        after.extend(changed.map(|(place, height)| (new, place, height)));
    }
    // Sources list their buildings in any order.
    after.sort();
    ([before, after], expected)
}

fn edits_between_the_versions_of_a_town_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let ([before, after], expected) = edited_town();
    for (name, houses, more) in [("town", &before, ""), ("town-2024", &after, " --version-of town")] {
        let date = if more.is_empty() { "2020-01-01" } else { "2024-01-31" };
        let houses: Vec<House<'_>> = houses.iter().map(|(id, place, height)| (id.as_str(), *place, *height)).collect();
        bake_with(folder, name, &houses, DUTCH, &format!("--cell 1 --date {date}{more}"));
    }
    let (code, errors) = run(folder, "verify town@2024-01-31");
    assert_eq!(code, Some(0), "{errors}");
    let (code, errors) = run(folder, "changes town@2020-01-01 town@2024-01-31 --out changes.geojson");
    assert_eq!(code, Some(0), "{errors}");
    let names = ["change", "identifier_before", "identifier_after"];
    let found: BTreeSet<[String; 3]> = rows(folder).iter().map(|row| names.map(|name| text(row, name))).collect();
    let right = found.intersection(&expected).count() as f64;
    let [precision, recall] = [&found, &expected].map(|all| right / all.len() as f64);
    assert!(expected.len() > 60 && precision >= 0.99 && recall >= 0.99, "{precision} {recall}: {found:?} {expected:?}");
    let (code, error) = run(folder, "changes town@2020-01-01 town@2024-02-01 --out other.csv");
    assert!(code != Some(0) && error.contains("town@2024-02-01"), "{error}");
}

fn cities_without_a_map_in_common_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let house = [("a", [0, 0, 20, 12], 9)];
    bake(folder, "dutch", &house, DUTCH);
    fs::write(folder.join("a.off"), OFF).unwrap();
    assert_eq!(run(folder, "bake a.off --no-street-sets --no-picture --out bare").0, Some(0));
    let (code, error) = run(folder, "changes dutch bare --out changes.csv");
    assert!(code == Some(2) && error.contains("28992") && error.contains("--crs"), "{error}");
    assert!(!folder.join("changes.csv").exists());
    // Cities without a coordinate system are compared as if they had one origin, with a note.
    let (code, error) = run(folder, "changes bare bare --out changes.csv");
    assert!(code == Some(0) && error.contains("both in metres of their own"), "{error}");
    fs::remove_file(folder.join("changes.csv")).unwrap();
    // Another system is another place, but a known one.
    bake(folder, "german", &house, GERMAN);
    let (code, error) = run(folder, "changes dutch german --out changes.csv");
    assert!(code == Some(0) && error.contains("25832") && error.contains("are both of one place"), "{error}");
}
