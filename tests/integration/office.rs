//! What an office sees of one city: one number of buildings everywhere, tables with a row for each, numbers as the source has them, a title
//! that is the place, areas in degrees, and plans in metres of the city.

use anyhow::{Context, Result, ensure};
use insula_test_support::http;
use insula_test_support::programs::{ServerProcess, call, program, run};
use insula_tests::tests;
use insula_tests::trials::Trials;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![buildings_have_one_number_and_plans_lie_in_the_city, labels_are_what_people_read]);
}

/// Buildings along a side of the town. Each has two parts.
const SIDE: usize = 7;
const BUILDINGS: usize = SIDE * SIDE;
/// South-west corner in the Dutch grid, in metres.
const CORNER: [f64; 2] = [84_500.0, 447_500.0];
/// Metres between buildings.
const SPACING_M: f64 = 40.0;
/// Bytes of a drawing in DXF, at most, as a multiple of its SVG.
const MOST_BYTES: f64 = 1.5;

/// A town as CityJSON: the building has name and year, its parts have a shape and a height.
fn town() -> String {
    let (mut objects, mut vertices) = (BTreeMap::new(), Vec::new());
    for building in 0..BUILDINGS {
        let middle = [building % SIDE, building / SIDE].map(|at| at as f64 * SPACING_M + 20.0);
        let angle = building as f64 * 0.37;
        let parts = [0, 1].map(|part| format!("b{building}-{part}"));
        for (part, id) in parts.iter().enumerate() {
            let first = vertices.len();
            let (x0, height) = (part as f64 * 8.0 - 8.0, if part == 0 { 8.63 } else { 5.1 });
            for z in [0.0, height] {
                for [x, y] in [[x0, -5.0], [x0 + 8.0, -5.0], [x0 + 8.0, 5.0], [x0, 5.0]] {
                    let world = [
                        CORNER[0] + middle[0] + x * f64::cos(angle) - y * f64::sin(angle),
                        CORNER[1] + middle[1] + x * f64::sin(angle) + y * f64::cos(angle),
                        z,
                    ];
                    vertices.push(world.map(|v| (v * 1000.0).round() as i64));
                }
            }
            let face = |corners: [usize; 4]| json!([corners.map(|corner| first + corner)]);
            let faces = [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]].map(face);
            let object = json!({
                "type": "BuildingPart", "parents": [format!("b{building}")], "attributes": {"dak": height},
                "geometry": [{"type": "Solid", "lod": "2.2", "boundaries": [faces]}]
            });
            objects.insert(id.clone(), object);
        }
        let attributes = format!(
            r#"{{"status": "in gebruik", "bouwjaar": {}, "afwijking": -0.0, "naam": "Huis {building}"}}"#,
            1900 + building
        );
        let object = json!({ "type": "Building", "children": parts, "attributes": "ATTRIBUTES" });
        // As a text, so that the attributes keep their order.
        objects.insert(format!("b{building}"), json!(object.to_string().replace("\"ATTRIBUTES\"", &attributes)));
    }
    let objects: Vec<String> = objects
        .into_iter()
        .map(|(id, object)| {
            format!("{}:{}", json!(id), object.as_str().map_or_else(|| object.to_string(), str::to_owned))
        })
        .collect();
    let metadata = r#"{"referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/28992"}"#;
    format!(
        r#"{{"type": "CityJSON", "version": "2.0", "metadata": {metadata}, "transform": {{"scale": [0.001, 0.001, 0.001],
        "translate": [0, 0, 0]}}, "vertices": {}, "CityObjects": {{{}}}}}"#,
        json!(vertices),
        objects.join(",")
    )
}

/// A row of a table, by the names of its columns.
type Row = BTreeMap<String, String>;

/// Header and rows of a CSV file without quoted cells.
fn table(path: &Path) -> Result<(Vec<String>, Vec<Row>)> {
    let text = fs::read_to_string(path)?;
    let cells = |line: &str| -> Vec<String> {
        // The last column is the footprint, in quotes.
        let plain = line.split_once(",\"").map_or(line, |(plain, _)| plain);
        plain.split(',').map(str::to_owned).collect()
    };
    let mut lines = text.lines();
    let names = cells(lines.next().context("no header")?);
    let rows = lines.map(|line| names.iter().cloned().zip(cells(line)).collect()).collect();
    Ok((names, rows))
}

fn buildings_have_one_number_and_plans_lie_in_the_city() -> Result<()> {
    let folder = tempfile::tempdir()?;
    let folder = folder.path();
    fs::write(folder.join("town.city.json"), town())?;
    let counted = format!("{BUILDINGS} buildings");
    let summary = call(folder, "insula-server", "bake town.city.json --cell 2 --report r.json --out 東京")?;
    ensure!(summary.contains(&counted), "{summary}");
    let report: Value = serde_json::from_slice(&fs::read(folder.join("r.json"))?)?;
    ensure!(report["buildings"] == BUILDINGS && report["size"] == counted.as_str(), "{report}");
    let manifest: Value = serde_json::from_slice(&fs::read(folder.join("東京/city.json"))?)?;
    ensure!(manifest["title"] == "東京" && manifest["name"] != "city", "{manifest}");
    for command in ["inspect 東京", "objects 東京"] {
        let text = call(folder, "insula-server", command)?;
        ensure!(text.contains(&counted), "{command}: {text}");
    }
    listed(folder, &counted)?;
    tables(folder)?;
    plans(folder, &manifest)
}

/// The list of the server has the same number.
fn listed(folder: &Path, counted: &str) -> Result<()> {
    let server = ServerProcess::serve(&folder.join("東京"), "127.0.0.1:0")?;
    let request = b"GET / HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n";
    let page = String::from_utf8(http::exchange(server.address, request)?)?;
    ensure!(page.contains(counted), "{page}");
    Ok(())
}

fn tables(folder: &Path) -> Result<()> {
    call(folder, "insula-server", "export 東京 --out all.csv")?;
    let (names, rows) = table(&folder.join("all.csv"))?;
    ensure!(rows.len() == BUILDINGS, "{} rows", rows.len());
    let attributes: Vec<&str> = names.iter().skip(8).map(String::as_str).collect();
    let place = |name: &str| attributes.iter().position(|known| *known == name);
    // The telling ones come first, the others as the source has them.
    ensure!(attributes[..2] == ["naam", "bouwjaar"] && place("status") < place("afwijking"), "{attributes:?}");
    let first = rows.iter().find(|row| row["naam"] == "Huis 0").context("no first house")?;
    let found = ["kind", "bouwjaar", "afwijking", "dak"].map(|name| first[name].as_str());
    ensure!(found == ["building", "1900", "0", "8.63"], "{found:?}");
    call(folder, "insula-server", "export 東京 --parts --out parts.csv")?;
    let (_, rows) = table(&folder.join("parts.csv"))?;
    ensure!(rows.len() == 3 * BUILDINGS, "{} rows with parts", rows.len());
    let part = rows.iter().find(|row| row["identifier"] == "b0-1").context("no part")?;
    let found = ["parent", "naam", "bouwjaar", "dak"].map(|name| part[name].as_str());
    ensure!(found == ["b0", "Huis 0", "1900", "5.1"], "{found:?}");
    // The south-western quarter in degrees, with its border between two rows of houses.
    call(folder, "insula-server", "export 東京 --bbox 4.355,52.008,4.36202,52.012478 --out degrees.csv")?;
    call(folder, "insula-server", "export 東京 --bbox-metres 84000,447000,84620,447620 --out metres.csv")?;
    let [degrees, metres] = ["degrees.csv", "metres.csv"].map(|name| table(&folder.join(name)));
    let (degrees, metres) = (degrees?.1.len(), metres?.1.len());
    ensure!(metres == 9 && degrees == 9, "{degrees} by degrees, {metres} by metres");
    Ok(())
}

/// A plan in DXF is in metres of the city, as small as its SVG, and sheets name date, sun and sources.
fn plans(folder: &Path, manifest: &Value) -> Result<()> {
    let draw = |name: &str, more: &str| call(folder, "insula", &format!("draw 東京 --plan --out {name} {more}"));
    draw("plan.dxf", "")?;
    draw("plan.svg", "--time 2024-06-21T12:00")?;
    draw("sheet.dxf", "--sheet")?;
    let read = |name: &str| fs::read_to_string(folder.join(name)).with_context(|| name.to_owned());
    let (dxf, svg, sheet) = (read("plan.dxf")?, read("plan.svg")?, read("sheet.dxf")?);
    ensure!(dxf.len() as f64 <= MOST_BYTES * svg.len() as f64, "{} bytes of DXF, {} of SVG", dxf.len(), svg.len());
    for name in ["from_side.dxf", "from_side.svg"] {
        call(folder, "insula", &format!("draw 東京 --axonometric 30,35 --out {name}"))?;
    }
    let [dxf_bytes, svg_bytes] = [read("from_side.dxf")?.len(), read("from_side.svg")?.len()];
    ensure!(dxf_bytes as f64 <= MOST_BYTES * svg_bytes as f64, "from the side: {dxf_bytes} of DXF, {svg_bytes} of SVG");
    ensure!(svg.contains("2024-06-21 12:00 solar time") && svg.contains("above the horizon"), "no date and sun");
    let entities = |dxf: &str| dxf.split_once("ENTITIES\n").map(|(_, text)| text.to_owned()).unwrap_or_default();
    let lines: Vec<String> = entities(&dxf).lines().map(str::to_owned).collect();
    let mut count = 0;
    for pair in lines.chunks_exact(2).filter(|pair| pair[0] == "10") {
        let x: f64 = pair[1].parse()?;
        let [low, high] = [0, 1].map(|end| manifest["bounds"][end][0].as_f64().unwrap_or(f64::NAN));
        ensure!(low - 500.0 <= x && x <= high + 500.0, "x is {x} in a city from {low} to {high}");
        count += 1;
    }
    ensure!(count >= 8 * BUILDINGS && dxf.contains("LWPOLYLINE"), "{count} corners");
    ensure!(!entities(&sheet).contains("\n845"), "a sheet has coordinates of the city");
    Ok(())
}

const LABELS: &str = r#"
[bouwjaar]
title = "Built in"
titles = { de = "Baujahr" }
[dak]
unit = "m"
title = "Roof"
order = 1
[status]
hidden = true
[afwijkin]
title = "Deviation"
"#;

/// Titles, units and order of a file of labels are in commands and drawings. Filters find what a building and its parts have together.
fn labels_are_what_people_read() -> Result<()> {
    let folder = tempfile::tempdir()?;
    let folder = folder.path();
    fs::write(folder.join("town.city.json"), town())?;
    fs::write(folder.join("labels.toml"), "[bouwjaar]\ntitel = 1\n")?;
    let bake = |name: &str| {
        let mut command = Command::new(program("insula-server")?);
        let line = format!("bake town.city.json --cell 2 --no-street-sets --labels {name} --out town");
        run(command.current_dir(folder).args(line.split_whitespace()).env_remove("RUST_LOG"))
    };
    let refused = bake("labels.toml")?;
    let errors = String::from_utf8_lossy(&refused.stderr).into_owned();
    ensure!(!refused.status.success() && errors.contains("labels.toml, line 2, bouwjaar.titel: "), "{errors}");
    fs::write(folder.join("labels.toml"), LABELS)?;
    let baked = bake("labels.toml")?;
    let errors = String::from_utf8_lossy(&baked.stderr).into_owned();
    ensure!(baked.status.success() && errors.contains("afwijkin: did you mean afwijking?"), "{errors}");
    let list = call(folder, "insula-server", "objects town")?;
    let line = |start: &str| list.lines().position(|line| line.starts_with(start));
    let order = ["dak (Roof)", "naam", "bouwjaar (Built in)"].map(line);
    ensure!(order.iter().all(Option::is_some) && order.is_sorted(), "{list}");
    ensure!(list.contains("5.1 to 8.63 m"), "{list}");
    let schema: Value = serde_json::from_str(&call(folder, "insula-server", "objects town --json")?)?;
    ensure!(schema["labels"]["status"]["hidden"] == true, "{schema}");
    // Years are of buildings, roofs of their parts: 1941 to 1948.
    let filtered = ["bouwjaar > 1940 && dak > 8", "bouwjaar > 1940 && height > 8"];
    for (number, filter) in filtered.iter().enumerate() {
        let name = format!("filtered-{number}.csv");
        let mut command = Command::new(program("insula-server")?);
        let output =
            run(command.current_dir(folder).args(["export", "town", "--filter", filter, "--out", name.as_str()]))?;
        ensure!(output.status.success(), "{filter}: {}", String::from_utf8_lossy(&output.stderr));
        let (names, rows) = table(&folder.join(&name))?;
        ensure!(rows.len() == 8 && names[8] == "dak", "{filter}: {} rows of {names:?}", rows.len());
        ensure!(rows.iter().all(|row| row["kind"] == "building" && row["dak"] == "8.63"), "{rows:?}");
    }
    let first =
        call(folder, "insula-server", "export town --out all.csv").and_then(|_| table(&folder.join("all.csv")))?;
    let house = first.1.iter().find(|row| row["naam"] == "Huis 3").context("no house")?;
    let shown = call(folder, "insula-server", &format!("objects town --ids {}", house["object"]))?;
    let words: Vec<&str> = shown.split_whitespace().collect();
    ensure!(words.join(" ").contains("dak (Roof) 8.63 m naam Huis 3 bouwjaar (Built in) 1903"), "{shown}");
    for (language, title) in [("de_AT.UTF-8", "Baujahr"), ("C", "Built in")] {
        let mut command = Command::new(program("insula")?);
        let line = "draw town --plan --color-by bouwjaar --overwrite --out plan.svg";
        let output = run(command.current_dir(folder).args(line.split_whitespace()).env("LC_ALL", language))?;
        ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let drawn = fs::read_to_string(folder.join("plan.svg"))?;
        ensure!(drawn.contains(&format!(">{title}<")), "the legend of {language} has no {title}");
    }
    let line = "draw town --plan --color-by naam --range 1,2 --overwrite --out plan.svg";
    let drawn = run(Command::new(program("insula")?).current_dir(folder).args(line.split_whitespace()))?;
    let errors = String::from_utf8_lossy(&drawn.stderr).into_owned();
    ensure!(drawn.status.success() && errors.contains("--range is not used: naam"), "{errors}");
    Ok(())
}
