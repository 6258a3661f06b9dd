//! `insula snapshot --proposal`: what is added is seen and throws shadows, and what is removed is not there. `bake --proposal` gives a city
//! that shows the same.

use crate::command_line::call;
use insula_test_support::map_files::house_and_sheds;
use insula_tests::pfm::Pfm;
use insula_tests::tests;
use insula_tests::trials::Trials;
use insula_viewer::additions::FIRST_ADDED;
use serde_json::{Value, json};
use std::ffi::OsStr;
use std::fs;
use std::path::Path;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![
        blocks_are_seen_and_removed_buildings_are_not,
        models_stand_at_their_places,
        a_bake_with_a_proposal_shows_the_same,
        proposals_that_do_not_fit_are_refused
    ]);
}

/// From the south, with the house before the sheds.
const CAMERA: &str = r#"{"position":[85010,446880,70],"target":[85010,447010,10],"up":[0,0,1],"fov_y_deg":50}"#;
const TOWER: &str = "title = \"Tower\"\n[[add]]\noutline = \"tower.geojson\"\nheight_m = 40\n";

/// A folder with the city of a house and of two sheds, the outline of a tower beside the house, and a camera.
fn baked_city() -> tempfile::TempDir {
    let polygon = |[x0, y0, x1, y1]: [u32; 4]| json!({ "type": "Polygon", "coordinates": [[[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]] });
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in [
        ("houses.geojson", house_and_sheds()),
        ("tower.geojson", polygon([85_030, 446_990, 85_040, 447_000]).to_string()),
        ("site.geojson", polygon([84_995, 446_995, 85_025, 447_015]).to_string()),
        ("away.geojson", polygon([86_030, 446_990, 86_040, 447_000]).to_string()),
        ("tower.toml", TOWER.to_owned()),
        ("camera.json", CAMERA.to_owned()),
    ] {
        fs::write(folder.path().join(name), text).unwrap();
    }
    let bake = "bake houses.geojson --cell 1 --no-street-sets --no-picture --out city".split(' ').map(OsStr::new);
    assert_eq!(call("insula-server", folder.path(), &bake.collect::<Vec<_>>()), (Some(0), String::new()));
    folder
}

/// Takes a picture with further arguments, whose light, distances and objects are beside it.
fn snapshot(folder: &Path, name: &str, more: &str) -> (Option<i32>, String) {
    snapshot_of(folder, "city", name, more)
}

/// The same of any city.
fn snapshot_of(folder: &Path, city: &str, name: &str, more: &str) -> (Option<i32>, String) {
    let line = format!(
        "snapshot {city} --size 200x150 --adapter cpu --camera camera.json --sun 180,35 --out {name}.png --distance {name}.pfm \
         --radiance {name}-light.pfm --objects {name}.bin --objects-json {name}.json{more}"
    );
    call("insula", folder, &line.split(' ').map(OsStr::new).collect::<Vec<_>>())
}

/// The object of each pixel.
fn objects(folder: &Path, name: &str) -> Vec<u32> {
    let bytes = fs::read(folder.join(format!("{name}.bin"))).unwrap();
    bytes.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word)).collect()
}

/// The number of an object in a picture's list.
fn number(folder: &Path, name: &str, identifier: &str) -> Option<u32> {
    let list: Value = serde_json::from_slice(&fs::read(folder.join(format!("{name}.json"))).unwrap()).unwrap();
    let found = list.as_array().unwrap().iter().find(|object| object["identifier"] == identifier)?;
    Some(found["id"].as_u64().unwrap() as u32)
}

fn distances(folder: &Path, name: &str) -> Vec<f32> {
    Pfm::read(&folder.join(format!("{name}.pfm"))).unwrap().values
}

/// The light of each pixel, red, green and blue together, row by row from the top.
fn light(folder: &Path, name: &str) -> Vec<f32> {
    let bytes = fs::read(folder.join(format!("{name}-light.pfm"))).unwrap();
    let data = &bytes[bytes.len() - 200 * 150 * 12..];
    let words = data.as_chunks::<4>().0.iter().map(|word| f32::from_le_bytes(*word)).collect::<Vec<_>>();
    let rows = words.chunks_exact(200 * 3).rev();
    rows.flat_map(|row| row.chunks_exact(3).map(|rgb| rgb.iter().sum::<f32>())).collect()
}

fn blocks_are_seen_and_removed_buildings_are_not() {
    let folder = baked_city();
    let folder = folder.path();
    for name in ["plain", "again"] {
        assert_eq!(snapshot(folder, name, "").0, Some(0));
    }
    let bytes = |name: &str| fs::read(folder.join(name)).unwrap();
    assert_eq!(bytes("plain.png"), bytes("again.png"));
    let house = number(folder, "plain", "feature 1").unwrap();
    let plain = objects(folder, "plain");
    let count = |objects: &[u32], of: u32| objects.iter().filter(|object| **object == of).count();
    assert!(count(&plain, house) > 100);

    let (code, text) = snapshot(folder, "tower", " --proposal tower.toml");
    assert_eq!(code, Some(0), "{text}");
    assert_eq!(number(folder, "tower", "tower.geojson"), Some(FIRST_ADDED));
    let tower = objects(folder, "tower");
    let is_tower = |pixel: usize| tower[pixel] == FIRST_ADDED;
    assert!(count(&tower, FIRST_ADDED) > 100 && count(&tower, house) > 100);
    // Pixels of the tower are nearer than before. Nearly all other pixels keep their distance.
    let (before, after) = (distances(folder, "plain"), distances(folder, "tower"));
    assert!((0..plain.len()).filter(|pixel| is_tower(*pixel)).all(|pixel| after[pixel] < before[pixel]));
    let moved = (0..plain.len()).filter(|pixel| !is_tower(*pixel) && after[*pixel] != before[*pixel]).count();
    assert!(moved <= plain.len() / 100, "{moved}");
    // The ground behind it is in its shadow.
    let (lit, shaded) = (light(folder, "plain"), light(folder, "tower"));
    let is_darker = |pixel: &usize| !is_tower(*pixel) && shaded[*pixel] < 0.8 * lit[*pixel];
    assert!((0..plain.len()).filter(is_darker).count() > 10);

    for (name, remove) in [
        ("id", "ids = [\"feature 1\"]"),
        ("filter", "filter = \"height > 5\""),
        ("polygon", "polygon = \"site.geojson\""),
    ] {
        fs::write(folder.join("gone.toml"), format!("[[remove]]\n{remove}\n")).unwrap();
        let (code, text) = snapshot(folder, name, " --proposal gone.toml");
        assert_eq!(code, Some(0), "{name}: {text}");
        let (gone, after) = (objects(folder, name), distances(folder, name));
        assert_eq!(count(&gone, house), 0, "{name}");
        let is_covered = |pixel: &usize| plain[*pixel] == house && after[*pixel] <= before[*pixel];
        let covered = (0..plain.len()).filter(is_covered).count();
        assert!(covered <= plain.len() / 200, "{name}: the ground is behind the house: {covered}");
    }
}

const KIOSK: &str = "[[add]]\nfile = \"kiosk.obj\"\nplace = [4.36783, 52.00686]\n";

/// The roof of a kiosk over the middle of the house, 15 m above the ground at its place.
fn write_kiosk(folder: &Path) {
    let corners = [[-5, -5], [5, -5], [5, 5], [-5, 5]].map(|[x, y]| format!("v {x} {y} 15\n")).concat();
    fs::write(folder.join("kiosk.obj"), corners + "f 1 2 3 4\n").unwrap();
}

fn models_stand_at_their_places() {
    let folder = baked_city();
    let folder = folder.path();
    write_kiosk(folder);
    fs::write(folder.join("kiosk.toml"), KIOSK).unwrap();
    let (code, text) = snapshot(folder, "kiosk", " --proposal kiosk.toml");
    assert_eq!(code, Some(0), "{text}");
    assert_eq!(number(folder, "kiosk", "kiosk.obj"), Some(FIRST_ADDED));
}

fn a_bake_with_a_proposal_shows_the_same() {
    let folder = baked_city();
    let folder = folder.path();
    write_kiosk(folder);
    let ring = [[86_400, 447_000], [86_410, 447_000], [86_410, 447_010], [86_400, 447_010], [86_400, 447_000]];
    let geometry = json!({ "type": "Polygon", "coordinates": [ring] });
    let far = json!({
        "type": "FeatureCollection",
        "crs": { "type": "name", "properties": { "name": "EPSG:28992" } },
        "features": [{ "type": "Feature", "id": "far", "properties": { "height": 6 }, "geometry": geometry }]
    });
    fs::write(folder.join("far.geojson"), far.to_string()).unwrap();
    let bake_of = |inputs: &str, more: &str| {
        let line = format!("bake {inputs} far.geojson --cell 1 --no-street-sets --no-picture {more}");
        call("insula-server", folder, &line.split(' ').map(OsStr::new).collect::<Vec<_>>())
    };
    let bake = |more: &str| bake_of("houses.geojson", more);
    assert_eq!(bake("--out wide"), (Some(0), String::new()));
    let shown = format!("{TOWER}{KIOSK}[[remove]]\nids = [\"feature 1\"]\n");
    fs::write(folder.join("shown.toml"), &shown).unwrap();
    fs::write(folder.join("plan.toml"), shown.replace("\"]", "\", \"nobody\"]")).unwrap();

    let (code, text) = bake("--out planned --proposal plan.toml");
    assert!(code == Some(2) && text.contains("--reuse"), "{text}");
    let (code, text) = bake("--out planned --reuse nothing --proposal plan.toml");
    assert!(code != Some(0) && text.contains("nothing"), "{text}");
    let (code, text) = bake("--out planned --reuse wide --proposal plan.toml --report planned.json");
    assert!(code == Some(0) && text.contains("there is no building nobody"), "{text}");
    let report: Value = serde_json::from_slice(&fs::read(folder.join("planned.json")).unwrap()).unwrap();
    let expected = json!({ "title": "Tower", "removed": 1, "added": 2, "missing": ["nobody"] });
    assert_eq!(report["read"]["proposal"], expected);
    assert!(report["blocks_unchanged"].as_u64() > Some(0) && report["blocks_baked"].as_u64() > Some(0), "{report}");

    // A source that has the tower in the place of the house, and the kiosk.
    let json_of = |name: &str| {
        serde_json::from_slice::<Value>(&fs::read(folder.join(format!("{name}.geojson"))).unwrap()).unwrap()
    };
    let mut merged = json_of("houses");
    merged["features"][0] = json!({ "type": "Feature", "properties": { "height": 40 }, "geometry": json_of("tower") });
    fs::write(folder.join("merged.geojson"), merged.to_string()).unwrap();
    let (code, text) = bake_of("merged.geojson kiosk.obj", "--at 4.36783,52.00686,0 --out merged");
    assert_eq!(code, Some(0), "{text}");

    let pictures = [("wide", "shown", " --proposal shown.toml"), ("planned", "baked", ""), ("merged", "merged", "")];
    for (city, name, more) in pictures {
        let (code, text) = snapshot_of(folder, city, name, more);
        assert_eq!(code, Some(0), "{text}");
    }
    assert_eq!(number(folder, "baked", "feature 1"), None);
    let tower = number(folder, "baked", "tower.geojson").unwrap();
    let (shown, baked) = (objects(folder, "shown"), objects(folder, "baked"));
    let seen = shown.iter().filter(|object| **object == FIRST_ADDED).count();
    let differ = shown.iter().zip(&baked).filter(|(shown, baked)| (**shown == FIRST_ADDED) != (**baked == tower));
    let differ = differ.count();
    assert!(seen > 100 && differ <= seen / 8, "{differ} of {seen}");
    for (other, tolerance_m, share) in [("shown", 1.0, 20), ("merged", 0.1, 100)] {
        let both = distances(folder, other).into_iter().zip(distances(folder, "baked"));
        let moved = both.filter(|(other, baked)| other != baked && (other - baked).abs() > tolerance_m).count();
        assert!(moved <= shown.len() / share, "{other}: {moved}");
    }
}

fn proposals_that_do_not_fit_are_refused() {
    let folder = baked_city();
    let folder = folder.path();
    for (text, expected) in [
        ("[[add]]\nfile = \"none.obj\"\n", "none.obj"),
        ("[[add]]\nfile = \"camera.json\"\n", "camera.json"),
        ("[[add]]\noutline = \"away.geojson\"\nheight_m = 9\n", "outside of the city"),
        ("[[add]]\noutline = \"none.geojson\"\nheight_m = 9\n", "none.geojson"),
        ("[[remove]]\nids = [\"nobody\"]\n", "nobody"),
        ("[[remove]]\nfilter = \"height > 300\"\n", "changes nothing"),
        ("height = 3\n", "unknown field"),
    ] {
        fs::write(folder.join("wrong.toml"), text).unwrap();
        let (code, error) = snapshot(folder, "wrong", " --proposal wrong.toml");
        assert!(code == Some(2) && error.contains(expected), "{text}: {code:?} {error}");
        assert!(!folder.join("wrong.png").exists());
    }
    let (code, error) = snapshot(folder, "wrong", " --proposal missing.toml");
    assert!(code == Some(2) && error.contains("missing.toml"), "{error}");
    // A window says the same before it opens.
    let line = ["view", "city", "--proposal", "missing.toml"].map(OsStr::new);
    let (code, error) = call("insula", folder, &line);
    assert!(code == Some(2) && error.contains("missing.toml"), "{error}");
}
