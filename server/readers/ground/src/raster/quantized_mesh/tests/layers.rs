//! `layer.json`, names of tiles, and ranges of levels.

use super::super::template::{NamedTile, Template};
use super::writer::{LAYER, Terrain, Tile};
use super::{RasterError, RasterLimits};

#[test]
fn other_formats_projections_and_schemes_are_refused() {
    let terrain = Terrain::default().with("0/0/0.terrain", &Tile::flat(1.0));
    let open = |layer: &str| terrain.open(layer).map(|_| ());
    for layer in [
        "{}",
        "\u{feff}{}",
        r#"{"format": "quantized-mesh-1.1", "projection": "", "scheme": "", "version": 1.2}"#,
        r#"{"bounds": [1e300, -1, 0, 0], "available": null, "tiles": null, "minzoom": 3}"#,
        r#"{"available": [[{"startX": 0, "startY": 0, "endX": 1, "endY": 0}], []]}"#,
    ] {
        assert!(open(layer).is_ok(), "{layer}");
    }
    for layer in [
        r#"{"format": "heightmap-1.0"}"#, r#"{"format": "quantized-mesh-2.0"}"#, r#"{"projection": "EPSG:2056"}"#,
        r#"{"scheme": "other"}"#,
    ] {
        assert!(matches!(open(layer), Err(RasterError::Unsupported(_))), "{layer}");
    }
    for layer in [
        "",
        "[]",
        "{\"tiles\": [",
        r#"{"tiles": 5}"#,
        r#"{"available": [[{"startX": 1, "startY": 0, "endX": 0, "endY": 0}]]}"#,
        r#"{"available": [[{"startX": 0, "startY": 0, "endX": 2, "endY": 0}]]}"#,
        r#"{"available": [[{"startX": -1, "startY": 0, "endX": 0, "endY": 0}]]}"#,
        r#"{"available": [[{"startX": 0, "startY": 0.5, "endX": 1e99, "endY": 0}]]}"#,
    ] {
        assert!(matches!(open(layer), Err(RasterError::Damaged(_))), "{layer}");
    }
    let levels = |count: usize| {
        format!("{{\"available\": [{}[{}]]}}", "[],".repeat(count - 1), r#"{"startX":0,"startY":0,"endX":0,"endY":0}"#)
    };
    assert!(open(&levels(31)).is_ok());
    assert!(matches!(open(&levels(32)), Err(RasterError::Damaged(_))));
}

#[test]
fn tiles_are_found_by_the_templates() {
    let tile = NamedTile { level: 3, column: 4, row: 5 };
    for (text, name) in [
        ("{z}/{x}/{y}.terrain?v={version}", "3/4/5.terrain"),
        ("./{version}/{z}/{x}/{y}.terrain", "1.2.0/3/4/5.terrain"),
        ("20250101/{z}/{x}/{y}.terrain?v={version}", "20250101/3/4/5.terrain"),
        ("https://example.com/a/{z}/{x}/{y}.terrain#a", "3/4/5.terrain"),
        ("/terrain/t{z}-{x}-{y}.terrain", "t3-4-5.terrain"),
        ("{y}/{x}/{z}", "5/4/3"),
        ("{z}/{x}/{z}-{y}", "3/4/3-5"),
    ] {
        let template = Template::new(text, "1.2.0").unwrap();
        assert_eq!(template.name(tile), name, "{text}");
        assert_eq!(template.tile(name), Some(tile), "{text}");
    }
    for text in ["", "{z}/{x}.terrain", "{z}/{x}/{y}/{reverseY}", "{z}/{x}/{y", "{}{z}{x}{y}"] {
        assert_eq!(Template::new(text, ""), None, "{text}");
    }
    let usual = Template::new("{z}/{x}/{y}.terrain", "").unwrap();
    for name in [
        "", "layer.json", "3/4/.terrain", "03/4/5.terrain", "3/4/5.terrain.gz", "3/4/-5.terrain", "a/3/4/5.terrain",
        "3/4/99999999999.terrain", "3/4/5",
    ] {
        assert_eq!(usual.tile(name), None, "{name}");
    }
    assert_eq!(Template::new("{z}/{x}/{z}-{y}", "").unwrap().tile("3/4/2-5"), None);
}

#[test]
fn the_usual_names_count_too() {
    let layer = r#"{"tiles": ["{version}/{z}/{x}/{y}.terrain", "{nothing}"], "version": 7}"#;
    for name in ["7/2/0/0.terrain", "2/0/0.terrain"] {
        let terrain = Terrain::default().with(name, &Tile::flat(3.0));
        assert_eq!(terrain.heights(layer)[0][0], 3.0);
    }
}

#[test]
fn files_that_are_no_tiles_of_the_world_are_left_out() {
    let mut terrain = Terrain::default();
    for name in ["1/4/0.terrain", "1/0/2.terrain", "31/0/0.terrain", "300/0/0.terrain", "layer.json", "1/0/0.png"] {
        terrain = terrain.with(name, &Tile::flat(1.0));
        assert!(matches!(terrain.open(LAYER), Err(RasterError::Damaged(_))), "{name}");
    }
    assert_eq!(terrain.with("1/3/1.terrain", &Tile::flat(2.0)).heights(LAYER)[0][0], 2.0);
}

#[test]
fn levels_with_too_many_pixels_are_left_out() {
    let last = format!("30/{}/{}.terrain", (1_u32 << 31) - 1, (1_u32 << 30) - 1);
    let sparse = Terrain::default().with("30/0/0.terrain", &Tile::flat(1.0)).with(&last, &Tile::flat(2.0));
    assert!(matches!(sparse.open(LAYER), Err(RasterError::TooLarge { .. })));
    let (_, facts) = sparse.clone().with("2/0/0.terrain", &Tile::flat(3.0)).open(LAYER).unwrap();
    assert_eq!(facts.size.width, 64);
    // The finest level at the end of the world.
    let (mut mesh, facts) = Terrain::default().with(&last, &Tile::flat(2.0)).open(LAYER).unwrap();
    let corner = facts.place.unwrap().position(63.5, -0.5);
    assert_eq!(corner, [180.0, 90.0]);
    let window = super::Window::all_of(facts.size);
    assert!(mesh.read_heights(window, 64 * 64).unwrap().iter().all(|height| *height == 2.0));
}

#[test]
fn large_rasters_have_larger_pixels() {
    // 2^25 columns fit with 64 pixels each, not with 256.
    let last = format!("24/{}/0.terrain", (1_u32 << 25) - 1);
    let fine = Tile::grid(256, |_, _| 0);
    let terrain = Terrain::default().with("24/0/0.terrain", &fine).with(&last, &fine);
    let (mut mesh, facts) = terrain.open_with(LAYER, RasterLimits::default()).unwrap();
    assert_eq!([facts.size.width, facts.size.height], [1 << 31, 64]);
    let window = super::Window { x: (1 << 31) - 2, y: 0, width: 2, height: 1 };
    assert_eq!(mesh.read_heights(window, 2).unwrap(), [0.0; 2]);
}
