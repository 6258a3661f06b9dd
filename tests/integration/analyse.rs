//! `analyse` of a baked house: what it writes, and what it says of wrong options.

use crate::command_line::call;
use insula_tests::{tests, trials::Trials};
use serde_json::Value;
use std::{ffi::OsStr, fs, path::Path};

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![
        a_house_has_sun_and_shade_where_it_should,
        shadows_and_views_are_areas_on_the_map,
        options_that_do_not_fit_are_refused
    ]);
}

const RULE: &str = r#"
title = "a day in March"
source = "a test"
days = ["03-21"]
wall_heights_m = [1]
asked_hours = 5
"#;

/// The house is 20 m wide, 12 m deep and 9 m high, and a little more than half a degree is between its north and that of the map.
const POINTS: &str = "id,x,y,height,azimuth
roof,85010,447006,0,
south wall,85010,446999.9,2,180
north wall,85010,447012.1,2,0
behind,85010,447015,0,
far,85010,447060,0,
";

/// A folder with the city of the house, and of two sheds so far away that there is ground around it.
fn baked_city() -> tempfile::TempDir {
    let building = |height: u32, [x0, y0, x1, y1]: [u32; 4]| {
        let ring = [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]];
        let geometry = serde_json::json!({ "type": "Polygon", "coordinates": [ring] });
        serde_json::json!({ "type": "Feature", "properties": { "height": height }, "geometry": geometry })
    };
    let features = [
        building(9, [85_000, 447_000, 85_020, 447_012]),
        building(3, [84_930, 446_930, 84_934, 446_934]),
        building(3, [85_080, 447_080, 85_084, 447_084]),
    ];
    let crs = serde_json::json!({ "type": "name", "properties": { "name": "EPSG:28992" } });
    let town = serde_json::json!({ "type": "FeatureCollection", "crs": crs, "features": features });
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("houses.geojson"), town.to_string()).unwrap();
    let bake = "bake houses.geojson --cell 1 --no-street-sets --no-picture --out city".split(' ').map(OsStr::new);
    assert_eq!(call("insula-server", folder.path(), &bake.collect::<Vec<_>>()), ok());
    folder
}

fn analyse(folder: &Path, arguments: &str) -> (Option<i32>, String) {
    let arguments: Vec<&OsStr> = ["analyse", "city"].into_iter().chain(arguments.split(' ')).map(OsStr::new).collect();
    call("insula-server", folder, &arguments)
}

fn ok() -> (Option<i32>, String) {
    (Some(0), String::new())
}

/// The rows of a table by its first column.
fn rows(path: &Path) -> Vec<Vec<String>> {
    let text = fs::read_to_string(path).unwrap();
    text.lines().skip(1).map(|line| line.split(',').map(str::to_owned).collect()).collect()
}

fn a_house_has_sun_and_shade_where_it_should() {
    let folder = baked_city();
    let folder = folder.path();
    fs::write(folder.join("rule.toml"), RULE).unwrap();
    fs::write(folder.join("points.csv"), POINTS).unwrap();
    assert_eq!(analyse(folder, "sun --rule rule.toml --points points.csv --out sun.csv"), ok());
    let at_points = rows(&folder.join("sun.csv"));
    let hours: Vec<f64> = at_points.iter().map(|row| row[4].parse().unwrap()).collect();
    let [roof, south, north, behind, far] = hours[..] else { panic!("{at_points:?}") };
    // An equinox has 12 hours of sun, which a southern wall has from east to west.
    assert!((11.9..=12.2).contains(&roof) && (11.0..=12.2).contains(&south), "{hours:?}");
    assert!(north < 0.6 && (2.0..8.0).contains(&behind) && far > 11.0, "{hours:?}");
    assert_eq!([&at_points[3][0], &at_points[3][6]], ["behind", "2025-03-21"]);
    assert_eq!(at_points[3][7].split(' ').count(), 2, "sun in the morning and in the evening: {}", at_points[3][7]);

    assert_eq!(analyse(folder, "sun --rule rule.toml --out sun.tif --buildings houses.csv"), ok());
    assert_eq!(analyse(folder, "sky --out sky.tif --buildings sky.csv"), ok());
    let of_house = |name: &str| {
        let rows = rows(&folder.join(name));
        assert_eq!(rows.len(), 3, "{rows:?}");
        rows.into_iter().find(|row| row[1] == "feature 1").unwrap()
    };
    let (sun, sky) = (of_house("houses.csv"), of_house("sky.csv"));
    let value = |row: &[String], column: usize| row[column].parse::<f64>().unwrap();
    assert!(value(&sun, 4) > 11.5 && value(&sun, 7) < 1.0 && value(&sun, 9) > 11.0, "{sun:?}");
    // Nothing stands before its walls.
    assert!(value(&sky, 4) > 0.99 && (value(&sky, 8) - 39.6).abs() < 1.0, "{sky:?}");
    for name in ["sun.tif", "sky.tif"] {
        assert_eq!(fs::read(folder.join(name)).unwrap()[..4], *b"II*\0", "{name}");
    }
}

fn shadows_and_views_are_areas_on_the_map() {
    let folder = baked_city();
    let folder = folder.path();
    // Shortly before noon: the shadow falls to the north.
    assert_eq!(analyse(folder, "shadow --time 2025-03-21T12:00 --out shadow.geojson"), ok());
    let shadow: Value = serde_json::from_slice(&fs::read(folder.join("shadow.geojson")).unwrap()).unwrap();
    let polygons: Vec<Vec<Vec<[f64; 2]>>> =
        serde_json::from_value(shadow["features"][0]["geometry"]["coordinates"].clone()).unwrap();
    let ring = &polygons.iter().max_by_key(|rings| rings[0].len()).unwrap()[0];
    let (low, high) = ring.iter().fold((f64::MAX, f64::MIN), |(low, high), [_, lat]| (low.min(*lat), high.max(*lat)));
    // 9 m of height make 11.5 m of shadow at an altitude of 38 degrees; a degree of latitude has 111.2 km.
    let metres = (high - low) * 111_200.0;
    assert!((10.0..14.0).contains(&metres), "{metres} m");

    let place = format!("{},{},1.6", ring[0][0], low - 0.0004);
    assert_eq!(analyse(folder, &format!("view --from {place} --out view.geojson")), ok());
    let view: Value = serde_json::from_slice(&fs::read(folder.join("view.geojson")).unwrap()).unwrap();
    assert!(!view["features"][0]["geometry"]["coordinates"].as_array().unwrap().is_empty());
    let outline =
        r#"{"type": "Polygon", "coordinates": [[[85005, 446960], [85015, 446960], [85015, 446970], [85005, 446960]]]}"#;
    fs::write(folder.join("tower.geojson"), outline).unwrap();
    assert_eq!(analyse(folder, "view --of tower.geojson --height 40 --out tower.tif"), ok());
}

fn options_that_do_not_fit_are_refused() {
    let folder = baked_city();
    let folder = folder.path();
    for (arguments, word) in [
        ("sun --out a.tif", "nl-tno-light"),
        ("sun --rule none --out a.tif", "built in are"),
        ("sky --rule en-17037 --out a.tif", "--rule is an option of sun"),
        ("sky --out a.geojson", "GeoJSON"),
        ("shadow --out a.tif", "--time"),
        ("shadow --time noon --out a.tif", "2024-06-21T17:00+09:00"),
        ("view --out a.tif", "--from"),
        ("view --from 5,5,5 --out a.tif", "which lies in"),
        ("view --of houses.geojson --out a.tif", "--height"),
        ("sun --rule en-17037 --points houses.geojson --out a.csv", "header"),
        ("sun --rule en-17037 --points houses.geojson --buildings b.csv --out a.csv", "--buildings has no use"),
        ("sun --rule en-17037 --points houses.geojson --wall-heights 2 --out a.csv", "--wall-heights has no use"),
        ("sun --rule en-17037 --points houses.geojson --bbox 4,52,5,53 --out a.csv", "--bbox has no use"),
        ("sun --rule en-17037 --points houses.geojson --out a.tif", ".csv"),
        ("sun --rule en-17037 --out a.csv", ".tif"),
        ("sky --bbox-metres 0,0,9,9 --out a.tif", "no part of the city"),
    ] {
        let (code, error) = analyse(folder, arguments);
        assert!(matches!(code, Some(1 | 2)) && error.contains(word), "{arguments}: {code:?} {error}");
        assert_eq!(error.lines().count(), 1, "{error}");
    }
    assert!(!folder.join("a.tif").exists() && !folder.join("a.csv").exists());
}
