//! Documents by the rules of their formats.

use super::*;
use insula_protocol::manifest::HeightReference;
use insula_test_support::small_city;
use std::time::{Duration, UNIX_EPOCH};

/// 13 February 2009, 23:31:30.
const TIME_SECS: u64 = 1_234_567_890;

fn record<'a>(manifest: &'a Manifest, names: &[&str], extent: Option<[f64; 6]>) -> CityRecord<'a> {
    let files =
        city_files().filter(|file| names.contains(&file.name)).map(|file| (file, FileMark::of(b"abc"))).collect();
    let time = UNIX_EPOCH + Duration::from_secs(TIME_SECS);
    CityRecord { manifest, description: "A city.".into(), extent, time, files }
}

/// The small city with heights of a known zero.
fn measured_city(name: &str) -> Manifest {
    let heights = Some(HeightReference { datum: "EPSG:5709".into(), geoid: None });
    Manifest { heights, ..small_city::manifest(name) }
}

fn document(documents: &[(String, Value)], name: &str) -> Value {
    documents.iter().find(|(path, _)| path == name).unwrap_or_else(|| panic!("no {name}")).1.clone()
}

/// Addresses of links of a relation.
fn hrefs(document: &Value, rel: &str) -> Vec<String> {
    let links = document["links"].as_array().unwrap().iter().filter(|link| link["rel"] == rel);
    links.map(|link| link["href"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn an_item_has_what_stac_asks_for() {
    let manifest = measured_city("two");
    let city = record(
        &manifest,
        &[MANIFEST_FILE, "blockmaps.pmtiles", THUMBNAIL_FILE],
        Some([4.0, 52.0, 40.0, 4.1, 52.1, 50.0]),
    );
    let item = document(&documents("Cities", &[city], None), "cities/two/item.json");
    assert_eq!(
        (&item["type"], &item["stac_version"], &item["id"]),
        (&json!("Feature"), &json!("1.1.0"), &json!("two"))
    );
    assert_eq!(item["bbox"], json!([4.0, 52.0, 40.0, 4.1, 52.1, 50.0]));
    let ring = json!([[4.0, 52.0], [4.1, 52.0], [4.1, 52.1], [4.0, 52.1], [4.0, 52.0]]);
    assert_eq!(item["geometry"], json!({ "type": "Polygon", "coordinates": [ring] }));
    let properties = &item["properties"];
    assert_eq!(properties["datetime"], "2009-02-13T23:31:30Z");
    assert_eq!(properties["license"], "CC-BY-4.0");
    assert_eq!(properties["providers"][0]["description"], "CC BY 4.0");
    assert_eq!(properties["proj:code"], "EPSG:7415");
    assert_eq!(properties["proj:bbox"], json!([85_000.0, 446_000.0, 0.0, 85_128.0, 446_128.0, 6.0]));
    assert_eq!(hrefs(&item, "root"), ["../../catalog.json"]);
    assert_eq!(hrefs(&item, "license"), ["https://example.org/3dbag"]);
    assert!(hrefs(&item, "self").is_empty());
    let assets = item["assets"].as_object().unwrap();
    assert_eq!(assets.keys().collect::<Vec<_>>(), ["blockmaps", "manifest", "thumbnail"]);
    assert_eq!(assets["blockmaps"]["href"], "blockmaps.pmtiles");
    assert_eq!(assets["blockmaps"]["file:size"], 3);
    let checksum = assets["blockmaps"]["file:checksum"].as_str().unwrap();
    assert_eq!(checksum, format!("1e20{}", FileMark::of(b"abc").hash.to_hex()));
}

#[test]
fn a_city_whose_place_or_licence_is_unknown_is_described_all_the_same() {
    let mut manifest = small_city::manifest("two");
    manifest.crs = Some("Local grid of 1934".into());
    manifest.attribution[0].licence = Some("Ask the office".into());
    manifest.attribution[0].url = Some("javascript:alert(1)".into());
    let documents =
        documents("Cities", &[record(&manifest, &[MANIFEST_FILE], None)], Some("https://example.org/maps/"));
    let item = document(&documents, "cities/two/item.json");
    assert!(item["geometry"].is_null() && item.get("bbox").is_none(), "{item}");
    assert!(item["properties"]["proj:code"].is_null());
    assert_eq!(item["properties"]["license"], "other");
    assert!(!item.to_string().contains("javascript"), "{item}");
    assert_eq!(hrefs(&item, "self"), ["https://example.org/maps/cities/two/item.json"]);
    let catalog = document(&documents, "catalog.json");
    assert_eq!(hrefs(&catalog, "self"), ["https://example.org/maps/catalog.json"]);
    assert!(document(&documents, "collections/two.json").get("extent").is_none());
}

#[test]
fn licences_of_several_sources_are_one_only_if_they_are_the_same() {
    let licence_of = |licences: &[&str]| {
        let mut manifest = small_city::manifest("two");
        let source = manifest.attribution[0].clone();
        let of = |licence: &&str| Attribution { licence: Some((*licence).to_owned()), ..source.clone() };
        manifest.attribution = licences.iter().map(of).collect();
        stac::item(&record(&manifest, &[], None), None)["properties"]["license"].clone()
    };
    assert_eq!(licence_of(&["ODbL 1.0", "odbl  1.0"]), "ODbL-1.0");
    assert_eq!(licence_of(&["ODbL 1.0", "CC0 1.0"]), "other");
    assert_eq!(licence_of(&["ODbL 1.0", "Mine"]), "other");
    assert_eq!(licence_of(&[]), "other");
}

#[test]
fn an_area_over_the_meridian_of_180_degrees_has_two_parts() {
    let manifest = small_city::manifest("two");
    let city = record(&manifest, &[], Some([179.5, -17.0, 0.0, -179.5, -16.0, 9.0]));
    let item = stac::item(&city, None);
    assert_eq!(item["geometry"]["type"], "MultiPolygon");
    let parts = item["geometry"]["coordinates"].as_array().unwrap();
    assert_eq!((parts.len(), &parts[0][0][1][0], &parts[1][0][0][0]), (2, &json!(180.0), &json!(-180.0)));
    assert_eq!(item["bbox"][0], json!(179.5));
}

#[test]
fn collections_lead_to_the_tileset_or_else_to_the_city() {
    let [with, without] = [measured_city("with"), small_city::manifest("without")];
    let extent = Some([4.0, 52.0, 40.0, 4.1, 52.1, 50.0]);
    let cities = [record(&with, &[MANIFEST_FILE, TILESET_FILE], extent), record(&without, &[MANIFEST_FILE], extent)];
    let documents = documents("Cities", &cities, None);
    let list = document(&documents, "collections.json");
    let contents: Vec<_> = list["collections"].as_array().unwrap().iter().map(|c| c["content"][0].clone()).collect();
    assert_eq!(contents[0]["href"], "cities/with/3dtiles/tileset.json");
    assert_eq!(contents[0]["type"], "application/json+3dtiles");
    assert_eq!(contents[1]["href"], "cities/without/city.json");
    let one = document(&documents, "collections/with.json");
    assert_eq!(hrefs(&one, geovolumes_relation()), ["../cities/with/3dtiles/tileset.json"]);
    assert_eq!(hrefs(&one, "self"), ["../collections/with.json"]);
    let extent = |name: &str| document(&documents, name)["extent"]["spatial"].clone();
    assert_eq!(extent("collections/with.json")["bbox"], json!([[4.0, 52.0, 40.0, 4.1, 52.1, 50.0]]));
    assert!(extent("collections/with.json")["crs"].as_str().unwrap().ends_with("/CRS84h"));
    // Nobody knows from what the heights of this one are measured.
    assert_eq!(extent("collections/without.json")["bbox"], json!([[4.0, 52.0, 4.1, 52.1]]));
    assert!(extent("collections/without.json")["crs"].as_str().unwrap().ends_with("/CRS84"));
    assert_eq!(document(&documents, "cities/without/item.json")["bbox"], json!([4.0, 52.0, 4.1, 52.1]));
    let item = document(&documents, "cities/with/item.json");
    assert_eq!(item["assets"]["tileset"]["proj:code"], "EPSG:4978");
    assert_eq!(hrefs(&document(&documents, "catalog.json"), "item").len(), 2);
}

fn geovolumes_relation() -> &'static str {
    "http://www.opengis.net/def/rel/ogc/1.0/3d-geovolumes"
}

#[cfg(feature = "bake")]
#[test]
fn extents_are_those_of_the_city_in_degrees() {
    let [west, south, lowest, east, north, highest] = extent(&measured_city("two")).unwrap();
    // Delft, 128 m of it: 0.0019 degrees of the parallel and 0.0012 of the meridian.
    assert!((west - 4.3685).abs() < 0.01 && (0.0018..0.0021).contains(&(east - west)), "{west} {east}");
    assert!((south - 51.9985).abs() < 0.01 && (0.0011..0.0013).contains(&(north - south)), "{south} {north}");
    assert!((highest - lowest - 6.0).abs() < 0.1 && (40.0..47.0).contains(&lowest), "{lowest} {highest}");
    let nowhere = Manifest { crs: None, ..small_city::manifest("two") };
    assert_eq!(extent(&nowhere), None);
}
