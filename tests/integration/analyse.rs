//! `analyse` of a baked house: what it writes, and what it says of wrong options.

use crate::command_line::call;
use insula_test_support::map_files::house_and_sheds;
use insula_test_support::programs;
use insula_tests::tests;
use insula_tests::trials::Trials;
use serde_json::Value;
use std::ffi::OsStr;
use std::fs;
use std::path::Path;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![
        a_house_has_sun_and_shade_where_it_should,
        weather_takes_the_place_of_a_clear_sky,
        shadows_and_views_are_areas_on_the_map,
        shadows_of_a_day_are_a_file_for_each_time,
        lines_of_sight_say_what_stands_in_the_way,
        vistas_say_which_buildings_break_into_them,
        points_have_pictures_as_evidence,
        proposals_say_what_they_change,
        gardens_have_values_of_their_own,
        large_areas_are_computed_in_tiles,
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

/// A proposal to remove the house.
const GONE: &str = "[[remove]]\nids = [\"feature 1\"]\n";

/// A folder with the city of the house, and of two sheds so far away that there is ground around it.
fn baked_city() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("houses.geojson"), house_and_sheds()).unwrap();
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

    // Of the year's probable sunlight the roof has nearly all; a share of the year has no day.
    assert_eq!(analyse(folder, "sun --rule uk-br209-apsh --points points.csv --out share.csv"), ok());
    let shares = rows(&folder.join("share.csv"));
    let share = |row: usize| shares[row][4].parse::<f64>().unwrap();
    assert!((95.0..102.0).contains(&share(0)) && share(2) < 25.0 && share(1) > 50.0, "{shares:?}");
    assert_eq!([&shares[0][5], &shares[0][6]], ["25", ""]);

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
    assert_eq!(analyse(folder, "solar --out solar.tif --buildings solar.csv"), ok());
    let solar = of_house("solar.csv");
    // A level roof of 20 x 12 m with all of the sun.
    assert!((1500.0..1900.0).contains(&value(&solar, 3)) && value(&solar, 7) < 400.0, "{solar:?}");
    assert!((200.0..280.0).contains(&value(&solar, 10)), "{solar:?}");
    assert!((value(&solar, 11) - value(&solar, 4) * value(&solar, 10)).abs() < 200.0, "{solar:?}");
    assert_eq!(analyse(folder, "sun --rule rule.toml --out sun.tif --buildings houses.fgb"), ok());
    let table = fs::read(folder.join("houses.fgb")).unwrap();
    let has = |text: &str| table.windows(text.len()).any(|bytes| bytes == text.as_bytes());
    assert!(table.starts_with(b"fgb") && has("wall_hours_least") && has("feature 1"));
    assert_eq!(analyse(folder, "sun --rule rule.toml --out sun.tif --pdf sun.pdf"), ok());
    let sheet = fs::read(folder.join("sun.pdf")).unwrap();
    let has = |text: &str| sheet.windows(text.len()).any(|bytes| bytes == text.as_bytes());
    assert!(sheet.starts_with(b"%PDF") && has("/SMask") && has("(values)"));
    for name in ["sun.tif", "sky.tif", "solar.tif"] {
        assert_eq!(fs::read(folder.join(name)).unwrap()[..4], *b"II*\0", "{name}");
    }
}

/// On each day five hours around noon have 400 Wh/m2 of the sun and 100 of the sky. Without shade that is 404 and 182 kWh/m2 a year on level
/// ground.
fn weather_takes_the_place_of_a_clear_sky() {
    let folder = baked_city();
    let folder = folder.path();
    let mut text =
        "LOCATION,Delft,-,NLD,made,1,52.0,4.36,1.0,0.0\r\nDATA PERIODS,1,1,Data,Sunday,1/1,12/31\r\n".to_owned();
    for (month, days) in (1..).zip([31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31]) {
        for (day, hour) in (1..=days).flat_map(|day| (1..=24).map(move |hour| (day, hour))) {
            let values = if (11..=15).contains(&hour) { "400,100" } else { "0,0" };
            text += &format!("1999,{month},{day},{hour},60,?9,1,1,50,101325,0,0,300,0,{values},0\r\n");
        }
    }
    fs::write(folder.join("delft.epw"), &text).unwrap();
    assert_eq!(analyse(folder, "solar --weather delft.epw --out solar.tif --buildings solar.csv"), ok());
    let rows = rows(&folder.join("solar.csv"));
    let house = rows.iter().find(|row| row[1] == "feature 1").unwrap();
    let value = |column: usize| house[column].parse::<f64>().unwrap();
    // Walls that look north have half of the sky.
    assert!((560.0..610.0).contains(&value(4)) && (75.0..110.0).contains(&value(7)), "{house:?}");
    fs::write(folder.join("cut.epw"), &text[..text.len() / 2]).unwrap();
    let (code, error) = analyse(folder, "solar --weather cut.epw --out cut.tif");
    assert!(code == Some(2) && error.contains("cut.epw: ") && error.contains("lines of hours"), "{code:?} {error}");
    assert!(!folder.join("cut.tif").exists());
}

fn shadows_and_views_are_areas_on_the_map() {
    let folder = baked_city();
    let folder = folder.path();
    // Shortly before noon: the shadow falls to the north.
    assert_eq!(analyse(folder, "shadow --time 2025-03-21T12:00 --out shadow.geojson"), ok());
    let polygons = polygons(&folder.join("shadow.geojson"));
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

/// Polygons of a GeoJSON file.
fn polygons(path: &Path) -> Vec<Vec<Vec<[f64; 2]>>> {
    let of_feature = |feature: &Value| -> Vec<Vec<Vec<[f64; 2]>>> {
        serde_json::from_value(feature["geometry"]["coordinates"].clone()).unwrap()
    };
    features(path).iter().flat_map(of_feature).collect()
}

fn features(path: &Path) -> Vec<Value> {
    let file: Value = serde_json::from_slice(&fs::read(path).unwrap()).unwrap();
    file["features"].as_array().unwrap().clone()
}

/// What the features say of changes.
fn changes(path: &Path) -> Vec<i64> {
    features(path).iter().map(|feature| feature["properties"]["change"].as_i64().unwrap()).collect()
}

/// The clocks of the Netherlands are 1.7 hours ahead of the sun there in summer, and one less in winter.
fn shadows_of_a_day_are_a_file_for_each_time() {
    let folder = baked_city();
    let folder = folder.path();
    let times = "shadow --times 2025-06-21T09:00/2025-06-21T17:00/4h --time-zone Europe/Amsterdam --out day.geojson";
    assert_eq!(analyse(folder, times), ok());
    assert_eq!(analyse(folder, "shadow --time 2025-06-21T09:00+02:00 --out offset.geojson"), ok());
    let at = |name: &str| polygons(&folder.join(name));
    assert_eq!(at("day-2025-06-21T0900.geojson"), at("offset.geojson"));
    // That of the house is the widest one.
    let ends = |rings: &Vec<Vec<[f64; 2]>>| {
        rings[0].iter().fold([f64::MAX, f64::MIN], |[low, high], [lon, _]| [low.min(*lon), high.max(*lon)])
    };
    let east = |name: &str| {
        let all: Vec<[f64; 2]> = at(name).iter().map(ends).collect();
        all.into_iter().max_by(|a, b| (a[1] - a[0]).total_cmp(&(b[1] - b[0]))).unwrap()[1]
    };
    let [morning, evening] = ["day-2025-06-21T0900.geojson", "day-2025-06-21T1700.geojson"].map(east);
    assert!(evening > morning, "shadows wander to the east: {morning} {evening}");
    assert!(!folder.join("day.geojson").exists() && folder.join("day-2025-06-21T1300.geojson").exists());
    assert_eq!(
        analyse(folder, "shadow --time 2025-06-21T09:00 --time 2025-12-21T09:00 --out two.tif --pdf two.pdf"),
        ok()
    );
    assert!(folder.join("two-2025-06-21T0900.tif").exists() && folder.join("two-2025-12-21T0900.tif").exists());
    assert!(folder.join("two-2025-06-21T0900.pdf").exists() && folder.join("two-2025-12-21T0900.pdf").exists());
    // Both together.
    assert!(fs::read(folder.join("two.pdf")).unwrap().starts_with(b"%PDF"));
}

/// The house of 9 m stands between the points at its south and at its north; two masts of 15 m look over it.
fn lines_of_sight_say_what_stands_in_the_way() {
    let folder = baked_city();
    let folder = folder.path();
    fs::write(folder.join("from.csv"), "id,x,y,height\nlow,85010,446980,2\nmast,85010,446980,15\n").unwrap();
    fs::write(folder.join("to.csv"), "id,x,y,height\nnorth,85010,447030,2\nmast,85010,447030,15\n").unwrap();
    assert_eq!(analyse(folder, "view --between from.csv to.csv --out lines.csv"), ok());
    let lines = rows(&folder.join("lines.csv"));
    let visible: Vec<[&str; 3]> = lines.iter().map(|row| [&row[0], &row[1], &row[3]].map(String::as_str)).collect();
    assert_eq!(
        visible,
        [["low", "north", "no"], ["low", "mast", "no"], ["mast", "north", "no"], ["mast", "mast", "yes"]]
    );
    let number = |row: usize, column: usize| lines[row][column].parse::<f64>().unwrap();
    // The southern wall, 2 m above the ground; the roof is 7 m higher.
    assert!((number(0, 5) - 447_000.0).abs() < 0.1 && lines[0][8] == "feature 1", "{:?}", lines[0]);
    assert!((number(0, 9) + 7.0).abs() < 0.3 && (number(3, 9) - 6.0).abs() < 0.3, "{lines:?}");
}

/// A plane from 2 m at the south over the house to 12 m: the roof's northern edge is at 32 of 60 m, where the plane is at 7.3 m.
fn vistas_say_which_buildings_break_into_them() {
    let folder = baked_city();
    let folder = folder.path();
    let line = "[[85010, 446980, 2], [85010, 447040, 12]]";
    let vista = format!(
        r#"{{"type":"Feature","properties":{{"name":"hill","width_m":20}},"geometry":{{"type":"LineString","coordinates":{line}}}}}"#
    );
    fs::write(folder.join("vista.geojson"), vista).unwrap();
    assert_eq!(analyse(folder, "view --vista vista.geojson --out vista.tif --buildings vista.csv"), ok());
    let rows = rows(&folder.join("vista.csv"));
    let [row] = &rows[..] else { panic!("{rows:?}") };
    assert_eq!([&row[0], &row[2]], ["hill", "feature 1"]);
    let above: f64 = row[3].parse().unwrap();
    // Its southern edge is at 20 m, where the plane is at 5.3 m.
    assert!((3.2..4.0).contains(&above), "{row:?}");
    assert_eq!(analyse(folder, "view --vista vista.geojson --out vista.geojson.geojson"), ok());
    assert!(!polygons(&folder.join("vista.geojson.geojson")).is_empty());
}

fn points_have_pictures_as_evidence() {
    let folder = baked_city();
    let folder = folder.path();
    fs::write(folder.join("rule.toml"), RULE).unwrap();
    fs::write(folder.join("points.csv"), POINTS.replace("behind", "../behind")).unwrap();
    let run = "sun --rule rule.toml --points points.csv --out sun.csv --evidence pictures";
    assert_eq!([analyse(folder, run), analyse(folder, run)], [ok(), ok()]);
    let mut names: Vec<String> = fs::read_dir(folder.join("pictures"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    let wanted = ["0001-roof.png", "0002-south_wall.png", "0003-north_wall.png", "0004-___behind.png", "0005-far.png"];
    assert_eq!(names, wanted);
    let picture = image::open(folder.join("pictures/0004-___behind.png")).unwrap().to_rgb8();
    let share = |color: [u8; 3]| picture.pixels().filter(|pixel| pixel.0 == color).count();
    // Sky, the house, and the sun's path in sun and in shade.
    assert!([[205, 226, 245], [120, 116, 112], [255, 205, 40], [40, 30, 80]].map(share).iter().all(|n| *n > 500));
    fs::write(folder.join("pictures/mine.txt"), "dear").unwrap();
    let (code, error) = analyse(folder, run);
    assert!(matches!(code, Some(1 | 2)) && error.contains("did not write"), "{error}");
}

/// A garden behind the house has less sun than one that lies in the open, and only the rectangle around them is computed.
fn gardens_have_values_of_their_own() {
    let folder = baked_city();
    let folder = folder.path();
    fs::write(folder.join("rule.toml"), RULE).unwrap();
    let garden = |x: u32, y: u32| {
        let ring = [[x, y], [x + 10, y], [x + 10, y + 8], [x, y + 8], [x, y]];
        serde_json::json!({ "type": "Polygon", "coordinates": [ring] })
    };
    // The last one has the northern wall of the house in its middle.
    let all = [garden(85_005, 447_012), garden(85_005, 447_060), garden(85_005, 447_008)];
    let all = serde_json::json!({ "type": "GeometryCollection", "geometries": all });
    fs::write(folder.join("gardens.geojson"), all.to_string()).unwrap();
    let run = |line: &str| {
        let line = format!("analyse city {line} --gardens gardens.geojson --out a.tif --json");
        serde_json::from_str::<Value>(&programs::call(folder, "insula-server", &line).unwrap()).unwrap()
    };
    let sun = run("sun --rule rule.toml");
    let number = |index: usize, name: &str| sun["gardens"][index][name].as_f64().unwrap();
    // Cells are counted from the corner of the city.
    let counts = [0, 1, 2].map(|index| number(index, "count"));
    assert!(
        (70.0..=80.0).contains(&counts[0]) && counts[1] == 80.0 && (30.0..=45.0).contains(&counts[2]),
        "{counts:?}"
    );
    assert!(number(0, "mean") + 2.0 < number(1, "mean"), "{sun}");
    assert!(number(0, "share_reaching") < 0.9 && number(1, "share_reaching") == 1.0, "{sun}");
    assert!(sun["ground"]["count"].as_f64().unwrap() < 700.0, "{sun}");
    fs::write(folder.join("gone.toml"), GONE).unwrap();
    let gained = run("sun --rule rule.toml --proposal gone.toml --overwrite");
    assert!(gained["gardens"][0]["mean"].as_f64().unwrap() > 1.0, "{gained}");
    fs::write(folder.join("far.geojson"), garden(95_005, 447_012).to_string()).unwrap();
    for (arguments, words) in [
        ("sky --gardens far.geojson --out b.tif", "--gardens far.geojson: beyond the city"),
        ("sky --gardens rule.toml --out b.tif", "--gardens rule.toml"),
        ("view --from 4.37,52,2 --gardens far.geojson --out b.tif", "--gardens is an option of sun"),
        ("sun --rule rule.toml --points houses.geojson --gardens far.geojson --out b.csv", "--gardens has no use"),
    ] {
        let (code, error) = analyse(folder, arguments);
        assert!(matches!(code, Some(1 | 2)) && error.contains(words), "{arguments}: {code:?} {error}");
    }
}

/// The city has more than 20,000 cells, so that it takes several tiles. Shares of them and a run that was ended are gone on with.
fn large_areas_are_computed_in_tiles() {
    let folder = baked_city();
    let folder = folder.path();
    let sky = "sky --reach 40";
    assert_eq!(analyse(folder, &format!("{sky} --out whole.tif --buildings whole.csv")), ok());
    let tiled = format!("{sky} --cells-at-once 20000");
    assert_eq!(analyse(folder, &format!("{tiled} --out tiled.tif --buildings tiled.csv")), ok());
    assert!(!folder.join("tiled.tif.tiles").exists());
    let [whole, parts] = ["whole.csv", "tiled.csv"].map(|name| rows(&folder.join(name)));
    assert_eq!((whole.len(), parts.len()), (3, 3));
    for (whole, part) in whole.iter().zip(&parts) {
        // Number, identifier, cells of the roof and points on walls are the same; values are but for what stands further away.
        assert_eq!([0, 1, 2, 6].map(|column| &whole[column]), [0, 1, 2, 6].map(|column| &part[column]));
        let mean = |row: &[String], column: usize| row[column].parse::<f64>().unwrap();
        assert!((mean(whole, 4) - mean(part, 4)).abs() < 0.01, "{whole:?} {part:?}");
        assert!((mean(whole, 8) - mean(part, 8)).abs() < 0.5, "{whole:?} {part:?}");
    }
    assert_eq!(analyse(folder, &format!("{tiled} --tiles 1/2 --out shared.tif")), ok());
    assert!(!folder.join("shared.tif").exists());
    let kept: Vec<_> =
        fs::read_dir(folder.join("shared.tif.tiles")).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert!(kept.len() >= 2, "{kept:?}");
    fs::write(&kept[0], &fs::read(&kept[0]).unwrap()[..99]).unwrap();
    let (code, text) = analyse(folder, &format!("{tiled} --out shared.tif"));
    let expected = format!("note: {} of ", kept.len() - 1);
    assert!(code == Some(0) && text.starts_with(&expected) && text.contains("of an earlier run"), "{code:?} {text}");
    let [tiled_bytes, shared] = ["tiled.tif", "shared.tif"].map(|name| fs::read(folder.join(name)).unwrap());
    assert!(tiled_bytes == shared && !folder.join("shared.tif.tiles").exists());
    // Files of others stay, and so do their folders.
    fs::create_dir(folder.join("mine.tif.tiles")).unwrap();
    fs::write(folder.join("mine.tif.tiles/letter.txt"), "dear").unwrap();
    for (arguments, words) in [
        (format!("{tiled} --out mine.tif"), "did not write"),
        (format!("{tiled} --out b.tif --pdf b.pdf"), "all cells in memory"),
        (format!("{sky} --tiles 1/2 --out b.tif"), "--tiles has no use"),
        (format!("{tiled} --tiles 3/2 --out b.tif"), "as in 2/8"),
        ("sky --cells-at-once 20000 --out b.tif".to_owned(), "a smaller --reach"),
    ] {
        let (code, text) = analyse(folder, &arguments);
        assert!(matches!(code, Some(1 | 2)) && text.contains(words), "{arguments}: {code:?} {text}");
    }
    assert!(folder.join("mine.tif.tiles/letter.txt").exists() && !folder.join("b.tif").exists());
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
        ("shadow --time noon --out a.tif", "2025-12-21T10:00+01:00"),
        ("shadow --time 2025-03-30T02:30 --time-zone Europe/Amsterdam --out a.tif", "summer time"),
        ("shadow --time 2025-03-30T02:30 --time-zone Delft --out a.tif", "Europe/Amsterdam"),
        ("shadow --times 2025-03-30T02:30 --out a.tif", "the step"),
        ("shadow --time 2025-03-30T02:30 --time 2025-03-30T02:30Z --out a.tif", "two outputs"),
        ("sky --time-zone Europe/Amsterdam --out a.tif", "--time-zone is an option of shadow"),
        ("view --out a.tif", "--from"),
        ("view --from 5,5,5 --out a.tif", "which lies in"),
        ("view --vista houses.geojson --out a.tif", "LineString"),
        ("view --vista houses.geojson --bbox 4,52,5,53 --out a.tif", "--bbox has no use"),
        ("view --between houses.geojson houses.geojson --out a.csv", "header"),
        ("view --between houses.geojson houses.geojson --out a.tif", ".csv"),
        ("view --between houses.geojson --out a.csv", "2 values"),
        ("sun --rule en-17037 --evidence b --out a.tif", "--points"),
        ("sky --weather houses.geojson --out a.tif", "--weather is an option of solar"),
        ("solar --weather houses.geojson --out a.tif", "LOCATION"),
        ("solar --weather none.epw --out a.tif", "--weather none.epw: "),
        ("solar --weather houses.geojson --turbidity 3 --out a.tif", "--turbidity"),
        ("view --of houses.geojson --out a.tif", "--height"),
        ("sun --rule en-17037 --points houses.geojson --out a.csv", "header"),
        ("sun --rule en-17037 --points houses.geojson --buildings b.csv --out a.csv", "--buildings has no use"),
        ("sun --rule en-17037 --points houses.geojson --wall-heights 2 --out a.csv", "--wall-heights has no use"),
        ("sun --rule en-17037 --points houses.geojson --bbox 4,52,5,53 --out a.csv", "--bbox has no use"),
        ("sun --rule en-17037 --points houses.geojson --out a.tif", ".csv"),
        ("sun --rule en-17037 --out a.csv", ".tif"),
        ("sky --bbox-metres 0,0,9,9 --out a.tif", "--bbox-metres 0,0,9,9: beyond the city, which lies in"),
    ] {
        let (code, error) = analyse(folder, arguments);
        assert!(matches!(code, Some(1 | 2)) && error.contains(word), "{arguments}: {code:?} {error}");
        assert_eq!(error.lines().count(), 1, "{error}");
    }
    assert!(!folder.join("a.tif").exists() && !folder.join("a.csv").exists());
}

/// The tower of 60 m breaks into a corridor above the house; without the house, a planned building is seen from elsewhere.
fn views_take_proposals(folder: &Path) {
    let vista = r#"{"type":"Feature","properties":{"name":"hill","width_m":40},"geometry":{"type":"LineString",
        "coordinates":[[85010, 446950, 30], [85010, 447050, 30]]}}"#;
    fs::write(folder.join("vista.geojson"), vista).unwrap();
    let line = "view --vista vista.geojson --out";
    assert_eq!(analyse(folder, &format!("{line} open.geojson")), ok());
    assert_eq!(analyse(folder, &format!("{line} hit.geojson --buildings hit.csv --proposal tower.toml")), ok());
    let [open, hit] = ["open.geojson", "hit.geojson"].map(|name| polygons(&folder.join(name)).len());
    assert_eq!((open, hit), (0, 1));
    assert!(rows(&folder.join("hit.csv")).is_empty(), "what is added has no row");
    let of = "view --of tower.geojson --height 9 --proposal shed.toml --out share.tif";
    fs::write(folder.join("shed.toml"), GONE).unwrap();
    assert_eq!(analyse(folder, of), ok());
}

/// Areas of what comes and of what goes are features of their own; there is none of what does not happen.
fn shadows_of_proposals_come_and_go(folder: &Path) {
    let add = "[[add]]\noutline = \"tower.geojson\"\nheight_m = 60\n";
    for (name, proposal, expected) in
        [("both", format!("{add}{GONE}"), vec![1, -1]), ("gone", GONE.to_owned(), vec![-1])]
    {
        fs::write(folder.join("plan.toml"), proposal).unwrap();
        let line = format!("shadow --time 2025-12-21T12:00+01:00 --proposal plan.toml --out {name}.geojson");
        assert_eq!(analyse(folder, &line), ok());
        assert_eq!(changes(&folder.join(format!("{name}.geojson"))), expected, "{name}");
    }
}

/// What lies below the ground or high above it has a note, which is not said where the proposal is wrong.
fn odd_heights_of_proposals_have_notes(folder: &Path) {
    let block = |base_m: i32| format!("[[add]]\noutline = \"tower.geojson\"\nheight_m = 9\nbase_m = {base_m}\n");
    let (deep, high) = (block(-500), block(500));
    fs::write(folder.join("odd.toml"), format!("{deep}{high}")).unwrap();
    let at_points = "sun --rule rule.toml --points points.csv --out odd.csv";
    for line in ["sky --out odd.tif", at_points] {
        let (code, text) = analyse(folder, &format!("{line} --proposal odd.toml"));
        let has =
            |words: &str| text.lines().any(|line| line.starts_with("note: tower.geojson") && line.contains(words));
        assert!(code == Some(0) && has("below the ground") && has("above all that is below it"), "{code:?} {text}");
    }
    fs::write(folder.join("odd.toml"), format!("{high}{GONE}[[remove]]\nids = [\"nobody\"]\n")).unwrap();
    let (code, text) = analyse(folder, "sky --out odd.tif --proposal odd.toml");
    assert!(code == Some(2) && text.lines().count() == 1, "{code:?} {text}");
}

fn proposals_say_what_they_change() {
    let folder = baked_city();
    let folder = folder.path();
    fs::write(folder.join("rule.toml"), RULE).unwrap();
    // A tower of 60 m south of the house, whose northern shed goes.
    for (name, [x, y]) in [("tower", [85_005, 446_970]), ("away", [89_005, 446_970])] {
        let ring = [[x, y], [x + 10, y], [x + 10, y + 10], [x, y + 10], [x, y]];
        let outline = serde_json::json!({ "type": "Polygon", "coordinates": [ring] });
        fs::write(folder.join(format!("{name}.geojson")), outline.to_string()).unwrap();
    }
    let proposal =
        "title = \"Tower\"\n[[add]]\noutline = \"tower.geojson\"\nheight_m = 60\n[[remove]]\nids = [\"feature 3\"]\n";
    fs::write(folder.join("tower.toml"), proposal).unwrap();
    let asked = "sun --rule rule.toml --proposal tower.toml --out lost.tif --buildings lost.csv --pdf lost.pdf";
    assert_eq!(analyse(folder, asked), ok());
    // A title whose letters a PDF lacks.
    fs::write(folder.join("letters.toml"), format!("title = \"\u{5d0}\"\n{GONE}")).unwrap();
    let (code, text) = analyse(folder, "sky --proposal letters.toml --out letters.tif --pdf letters.pdf");
    assert!(code == Some(0) && text.contains("has ? in place of"), "{code:?} {text}");
    let lost = rows(&folder.join("lost.csv"));
    let mean = |name: &str, column: usize| -> Option<f64> {
        lost.iter().find(|row| row[1] == name).unwrap()[column].parse().ok()
    };
    let (roof, walls) = (mean("feature 1", 4).unwrap(), mean("feature 1", 8).unwrap());
    assert!((-3.0..-0.3).contains(&roof) && (-3.0..-0.1).contains(&walls), "{lost:?}");
    assert!(mean("feature 2", 4).unwrap().abs() < 0.5, "{lost:?}");
    assert!(!lost.iter().any(|row| row[1] == "feature 3"), "what is removed has no row: {lost:?}");
    // A model with a place of its own, on the ground.
    let corners = [[-5, -5], [5, -5], [5, 5], [-5, 5]].map(|[x, y]| format!("v {x} {y} 60\n")).concat();
    fs::write(folder.join("roof.obj"), corners + "f 1 2 3 4\n").unwrap();
    let model = "[[add]]\nfile = \"roof.obj\"\nplace = [4.36783, 52.00686]\nheading_deg = 30\n";
    fs::write(folder.join("model.toml"), model).unwrap();
    assert_eq!(analyse(folder, "sky --proposal model.toml --out sky.tif --buildings sky.csv"), ok());
    let sky = rows(&folder.join("sky.csv"));
    let house = sky.iter().find(|row| row[1] == "feature 1").unwrap();
    assert!(house[4].parse::<f64>().unwrap() < -0.01, "{sky:?}");
    // Rays at points meet the tower, and no longer the shed.
    fs::write(folder.join("points.csv"), "id,x,y,height\nshed,85082,447082,1\nnorth,85010,446982,1\n").unwrap();
    let at_points = "sun --rule rule.toml --points points.csv --out";
    assert_eq!(analyse(folder, &format!("{at_points} before.csv")), ok());
    assert_eq!(analyse(folder, &format!("{at_points} after.csv --proposal tower.toml")), ok());
    let [before, after] = ["before.csv", "after.csv"].map(|name| fs::read_to_string(folder.join(name)).unwrap());
    assert_ne!(before.lines().nth(1), after.lines().nth(1), "the point is on the ground where the shed was");
    assert_ne!(before.lines().nth(2), after.lines().nth(2), "the tower hides the sun");
    fs::write(folder.join("from.csv"), "id,x,y,height\neye,85010,446960,2\n").unwrap();
    fs::write(folder.join("to.csv"), "id,x,y,height\nend,85010,446990,2\n").unwrap();
    let line = "view --between from.csv to.csv --out";
    assert_eq!(analyse(folder, &format!("{line} free.csv")), ok());
    assert_eq!(analyse(folder, &format!("{line} hidden.csv --proposal tower.toml")), ok());
    let visible = ["free.csv", "hidden.csv"].map(|name| rows(&folder.join(name))[0][3].clone());
    assert_eq!(visible, ["yes", "no"]);
    views_take_proposals(folder);
    shadows_of_proposals_come_and_go(folder);
    odd_heights_of_proposals_have_notes(folder);
    for (text, expected) in [
        ("[[add]]\nfile = \"none.obj\"\n", "none.obj"),
        ("[[add]]\noutline = \"tower.geojson\"\n", "height_m"),
        ("[[add]]\noutline = \"tower.geojson\"\nheight_m = 9\nheading_deg = 3\n", "direction"),
        ("[[add]]\nfile = \"roof.obj\"\nbase_m = 3\n", "need its place"),
        ("[[add]]\nfile = \"roof.obj\"\nplace = [4.3, 52, 3]\n", "[longitude, latitude]"),
        ("[[add]]\nfile = \"houses.geojson\"\nplace = [4.4, 52.1]\n", "leave place out"),
        ("[[remove]]\nfilter = \"height > 300\"\n", "no building passes"),
        ("[[add]]\noutline = \"away.geojson\"\nheight_m = 9\n", "away.geojson lies outside of the city"),
        ("[[remove]]\npolygon = \"away.geojson\"\n", "away.geojson lies outside of the city"),
        ("[[remove]]\nids = [\"nobody\"]\n", "nobody"),
        ("[[remove]]\n", "ids, a filter or a polygon"),
        ("height = 3\n", "unknown field"),
        ("title = \"x\"\n", "neither"),
        ("[[add]]\noutline = \"tower.geojson\"\nheight_m = 1\nbase_m = -90\n", "changes nothing"),
    ] {
        fs::write(folder.join("wrong.toml"), text).unwrap();
        let (code, error) = analyse(folder, "sky --proposal wrong.toml --out sky.tif");
        assert!(code == Some(2) && error.contains(expected), "{text}: {error}");
    }
}
