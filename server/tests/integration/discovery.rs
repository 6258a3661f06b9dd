//! The documents of a published site for catalogues and GIS, and its tilesets.

use crate::web_pages::viewer;
use insula_archive::owned::FileMark;
use insula_server::args::PublishArgs;
use insula_server::commands::publish_site;
use insula_test_support::small_city;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

fn publish(cities: &[PathBuf], out: &Path, tileset: bool) -> Result<(), String> {
    let (cities, out) = (cities.to_vec(), out.to_owned());
    let args = PublishArgs { cities, out, tileset, ..PublishArgs::default() };
    publish_site(&args, &viewer()).map_err(|error| error.to_string())
}

fn read(path: &Path) -> Value {
    let text = fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_slice(&text).unwrap()
}

/// The `href` of everything in a document, with their places.
fn addresses(document: &Value, found: &mut Vec<String>) {
    match document {
        Value::Array(values) => values.iter().for_each(|value| addresses(value, found)),
        Value::Object(members) => {
            found.extend(members.get("href").and_then(Value::as_str).map(str::to_owned));
            members.values().for_each(|value| addresses(value, found));
        }
        _ => {}
    }
}

#[test]
fn documents_of_a_site_lead_to_its_files() {
    let folder = tempfile::tempdir().unwrap();
    let cities = ["two", "three"].map(|name| folder.path().join(name));
    small_city::write_city_with_meshes(&cities[0], "two");
    small_city::write_city(&cities[1], "three");
    fs::write(cities[1].join("thumbnail.jpg"), b"\xff\xd8\xff and so on").unwrap();
    let site = folder.path().join("site");
    publish(&cities, &site, true).unwrap();
    for name in
        ["catalog.json", "collections.json", "collections/two.json", "cities/two/item.json", "cities/three/item.json"]
    {
        let path = site.join(name);
        let mut found = Vec::new();
        addresses(&read(&path), &mut found);
        assert!(found.len() > 3, "{name}: {found:?}");
        for address in found.iter().filter(|address| !address.starts_with("https://example.org/")) {
            assert!(path.parent().unwrap().join(address).is_file(), "{name}: {address}");
        }
    }
    let item = read(&site.join("cities/three/item.json"));
    let bbox: Vec<f64> = item["bbox"].as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect();
    // Nobody knows from what its heights are measured.
    let &[west, south, east, north] = &bbox[..] else { panic!("{bbox:?}") };
    assert!(west < east && south < north, "{bbox:?}");
    assert!((4.3..4.4).contains(&west) && (51.9..52.1).contains(&south), "{bbox:?}");
    for asset in item["assets"].as_object().unwrap().values() {
        let file = site.join("cities/three").join(asset["href"].as_str().unwrap());
        let mark = FileMark::of_file(&file).unwrap();
        assert_eq!(asset["file:size"], mark.bytes, "{}", file.display());
        assert_eq!(asset["file:checksum"], format!("1e20{}", mark.hash.to_hex()), "{}", file.display());
    }
    let tileset = read(&site.join("cities/two/3dtiles/tileset.json"));
    assert_eq!(tileset["asset"]["version"], "1.1");
    assert!(site.join("cities/two/3dtiles/content/1/1/1.glb").is_file());
    assert!(tileset["root"]["children"].is_array(), "all tiles are listed: {tileset}");
    // Again without tilesets: those of before are gone, and no document names them.
    publish(&cities, &site, false).unwrap();
    assert!(!site.join("cities/two/3dtiles").exists());
    assert_eq!(read(&site.join("collections/two.json"))["content"][0]["href"], "../cities/two/city.json");
}

#[test]
fn documents_are_the_same_again_and_those_of_others_stay() {
    let folder = tempfile::tempdir().unwrap();
    let (city, site) = ([folder.path().join("two")], folder.path().join("site"));
    small_city::write_city(&city[0], "two");
    publish(&city, &site, false).unwrap();
    let names = ["catalog.json", "collections.json", "collections/two.json", "cities/two/item.json"];
    let texts = || names.map(|name| fs::read_to_string(site.join(name)).unwrap());
    let before = texts();
    publish(&city, &site, false).unwrap();
    assert_eq!(texts(), before);
    for (name, own) in names.iter().zip(&before) {
        let path = site.join(name);
        fs::write(&path, "mine").unwrap();
        assert!(publish(&city, &site, false).unwrap_err().contains("would remove it"), "{name}");
        assert_eq!(fs::read_to_string(&path).unwrap(), "mine");
        fs::write(&path, own).unwrap();
    }
    let foreign = site.join("collections/other.json");
    fs::write(&foreign, "mine").unwrap();
    assert!(publish(&city, &site, true).unwrap_err().contains("would remove it"));
    assert_eq!(fs::read_to_string(&foreign).unwrap(), "mine");
}
