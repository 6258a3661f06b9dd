//! Analyses over HTTP: the numbers of `insula-server analyse`, areas that cover what was asked for, and the limits of the route.

use crate::test_server::{JSON, TestServer, assert_full_queue_sheds, assert_problem, assert_refused, post};
use crate::web_pages;
use insula_server::config::ServeConfig;
use insula_server::http::{AppState, HttpService};
use insula_server::store::Store;
use insula_test_support::map_files::house_and_sheds;
use insula_test_support::small_city;
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::Command;

const PATH: &str = "/v1/cities/house/analyse";
/// The house is 20 m wide, 12 m deep and 9 m high.
const AREA: [u32; 4] = [84_960, 446_970, 85_040, 447_040];

fn run(folder: &Path, arguments: &str) -> Vec<u8> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_insula-server"));
    let output = command.args(arguments.split(' ')).current_dir(folder).env_remove("RUST_LOG").output().unwrap();
    assert!(output.status.success(), "{arguments}: {}", String::from_utf8_lossy(&output.stderr));
    output.stdout
}

/// Bakes a house, and two sheds so far away that there is ground around it.
pub(crate) fn bake_house(folder: &Path) {
    fs::write(folder.join("houses.geojson"), house_and_sheds()).unwrap();
    run(folder, "bake houses.geojson --cell 1 --no-street-sets --no-picture --out house");
}

/// A server of the house, which has made no analysis yet.
async fn start(change: impl FnOnce(&mut ServeConfig)) -> TestServer {
    let server = TestServer::start(|config| {
        config.analyses.at_once = 1;
        change(config);
    })
    .await;
    bake_house(server.folder.path());
    server.reload().await;
    server
}

async fn ask(server: &TestServer, options: &str) -> Value {
    let (head, body) = post(server, PATH, JSON, options).await;
    assert!(head.starts_with("HTTP/1.1 200 "), "{head} {}", String::from_utf8_lossy(&body));
    assert!(
        head.contains("content-type: application/json\r\n") && head.contains("cache-control: no-store\r\n"),
        "{head}"
    );
    serde_json::from_slice(&body).unwrap()
}

fn options(rest: &str) -> String {
    format!(r#"{{{rest},"bbox_metres":{AREA:?}}}"#)
}

/// Square metres of the areas of a feature whose coordinates are metres: outer rings go anticlockwise, holes clockwise.
fn area_m2(feature: &Value) -> f64 {
    let of_ring = |ring: &Value| {
        let at = |point: &Value| [0, 1].map(|k| point[k].as_f64().unwrap() - f64::from(AREA[k]));
        let points: Vec<[f64; 2]> = ring.as_array().unwrap().iter().map(at).collect();
        points.windows(2).map(|pair| 0.5 * (pair[0][0] * pair[1][1] - pair[1][0] * pair[0][1])).sum::<f64>()
    };
    let polygons = feature["geometry"]["coordinates"].as_array().unwrap();
    polygons.iter().flat_map(|polygon| polygon.as_array().unwrap()).map(of_ring).sum()
}

/// Whether two values are equal but for the order in which threads add.
fn is_alike(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Object(a), Value::Object(b)) => {
            a.len() == b.len() && a.iter().all(|(key, value)| b.get(key).is_some_and(|other| is_alike(value, other)))
        }
        (Value::Number(a), Value::Number(b)) => {
            a.as_f64().zip(b.as_f64()).is_some_and(|(a, b)| (a - b).abs() <= 1e-5 * b.abs().max(1.0))
        }
        _ => a == b,
    }
}

fn count(places: &Value) -> f64 {
    places["count"].as_f64().unwrap()
}

#[tokio::test]
async fn answers_are_those_of_the_command() {
    let server = start(|_| {}).await;
    let folder = server.folder.path();
    let area = AREA.map(|side| side.to_string()).join(",");
    for (asked, command) in [
        (r#""kind":"sun","rule":"en-17037""#, "sun --rule en-17037"),
        (r#""kind":"sky""#, "sky"),
        (r#""kind":"solar""#, "solar"),
        (r#""kind":"shadow","time":"2025-12-21T12:00""#, "shadow --time 2025-12-21T12:00"),
    ] {
        let answer = ask(&server, &options(asked)).await;
        let text = run(
            folder,
            &format!("analyse house {command} --bbox-metres {area} --reach 500 --out a.tif --overwrite --json"),
        );
        let expected: Value = serde_json::from_slice(&text).unwrap();
        for name in ["title", "unit", "asked", "notes", "roofs", "walls", "ground", "attribution"] {
            assert!(is_alike(&answer[name], &expected[name]), "{command}: {name}: {} {}", answer[name], expected[name]);
        }
        let features = answer["features"].as_array().unwrap();
        assert_eq!(answer["square_m"], 1.0);
        let cells = count(&answer["roofs"]) + count(&answer["ground"]);
        assert!(cells > 5000.0 && count(&answer["roofs"]) > 200.0, "{cells}");
        let covered: f64 = features.iter().map(area_m2).sum();
        if command.starts_with("shadow") {
            // What has the sun has no colour.
            let dark = |name: &str| answer[name]["mean"].as_f64().unwrap() * count(&answer[name]);
            assert!((covered - dark("roofs") - dark("ground")).abs() < 0.5 && features.len() == 1, "{covered}");
            continue;
        }
        assert!((covered - cells).abs() < 0.5, "{command}: {covered} of {cells} m2 have a class");
        assert!((3..=8).contains(&features.len()), "{} classes", features.len());
        let mut borders =
            features.windows(2).map(|pair| [&pair[0]["properties"]["to"], &pair[1]["properties"]["from"]]);
        assert!(borders.all(|[to, from]| to == from));
    }
    let metrics = server.get("/metrics", "").await;
    assert!(metrics.contains("insula_requests_total{route=\"analyse\",code=\"200\"} 4"), "{metrics}");
    server.stop().await;
}

#[tokio::test]
async fn a_border_of_the_classes_is_what_the_rule_asks_for() {
    let server = start(|_| {}).await;
    let answer = ask(&server, &options(r#""kind":"sun","rule":"en-17037""#)).await;
    assert_eq!(answer["asked"], 1.5);
    let features = answer["features"].as_array().unwrap();
    let is_enough = |feature: &&Value| feature["properties"]["from"].as_f64().unwrap() >= 1.5;
    let enough: f64 = features.iter().filter(is_enough).map(area_m2).sum();
    let reaching = |name: &str| answer[name]["share_reaching"].as_f64().unwrap() * count(&answer[name]);
    assert!((enough - reaching("roofs") - reaching("ground")).abs() < 0.5, "{enough}");
    // An area in degrees has an answer in degrees.
    let degrees = ask(&server, r#"{"kind":"sky","bbox":[4.3674,52.0067,4.3682,52.0073]}"#).await;
    let (head, body) = post(&server, PATH, JSON, r#"{"kind":"sky","bbox":[4.0,50.0,4.001,50.001]}"#).await;
    assert!(head.starts_with("HTTP/1.1 400 "), "{head} {}", String::from_utf8_lossy(&body));
    let ring = &degrees["features"][4]["geometry"]["coordinates"][0][0];
    let [lon, lat] = [0, 1].map(|k| ring[0][k].as_f64().unwrap());
    assert!((4.367..4.369).contains(&lon) && (52.006..52.008).contains(&lat), "{lon} {lat}");
    server.stop().await;
}

/// What a request is answered with, whose type is as expected.
async fn made(server: &TestServer, options: &str, content_type: &str) -> Vec<u8> {
    let (head, body) = post(server, PATH, JSON, options).await;
    assert!(head.starts_with("HTTP/1.1 200 "), "{head} {}", String::from_utf8_lossy(&body));
    assert!(head.contains(&format!("content-type: {content_type}\r\n")), "{head}");
    body
}

#[tokio::test]
async fn a_sheet_is_that_of_the_command() {
    let server = start(|_| {}).await;
    let options = options(r#""kind":"shadow","time":"2025-12-21T12:00","format":"pdf""#);
    let sheet = made(&server, &options, "application/pdf").await;
    let area = AREA.map(|side| side.to_string()).join(",");
    let folder = server.folder.path();
    let line = format!("--bbox-metres {area} --reach 500 --out a.tif --pdf a.pdf");
    run(folder, &format!("analyse house shadow --time 2025-12-21T12:00 {line}"));
    assert!(sheet.starts_with(b"%PDF-") && sheet == fs::read(folder.join("a.pdf")).unwrap());
    server.stop().await;
}

#[tokio::test]
async fn a_place_has_a_picture_of_its_sky() {
    let server = start(|_| {}).await;
    let picture = async |asked: &str, place: [u32; 2]| {
        let options = format!(r#"{{{asked},"format":"png","point_metres":{place:?}}}"#);
        image::load_from_memory(&made(&server, &options, "image/png").await).unwrap().to_rgb8()
    };
    let [sky, house, sun, shade] = [[205, 226, 245], [120, 116, 112], [255, 205, 40], [40, 30, 80]];
    for asked in [
        r#""kind":"sun","rule":"en-17037""#,
        r#""kind":"sky""#,
        r#""kind":"solar""#,
        r#""kind":"shadow","time":"2025-12-21T12:00+01:00""#,
    ] {
        let behind = picture(asked, [85_010, 447_015]).await;
        let share = |color: [u8; 3]| behind.pixels().filter(|pixel| pixel.0 == color).count();
        assert!([sky, house, shade].map(share).iter().all(|pixels| *pixels > 300), "{asked}");
    }
    let roof = picture(r#""kind":"sun","rule":"en-17037""#, [85_010, 447_006]).await;
    let share = |color: [u8; 3]| roof.pixels().filter(|pixel| pixel.0 == color).count();
    assert!(share(sun) > 500 && share(house) < 300, "nothing hides the sky of the roof");
    // The same place in degrees.
    let degrees = r#"{"kind":"sun","rule":"en-17037","format":"png","point":[4.36783,52.00701]}"#;
    assert!(image::load_from_memory(&made(&server, degrees, "image/png").await).is_ok());
    server.stop().await;
}

#[tokio::test]
async fn pages_name_the_rules_where_analyses_are_made() {
    let folder = tempfile::tempdir().unwrap();
    small_city::write_city(&folder.path().join("two"), "two");
    for at_once in [0, 1] {
        let mut config = ServeConfig::default();
        config.analyses.at_once = at_once;
        let store = Store::open(&[folder.path()]).unwrap();
        let service = HttpService::new(AppState::with_viewer(store, &config, Some(web_pages::viewer())));
        for path in ["/", "/cities/two"] {
            let page = web_pages::get(&service, path, &[]).await;
            let rules = page.text.split_once("<meta name=\"insula-analyses\" content=\"").map(|(_, rest)| rest);
            let has_rule =
                rules.is_some_and(|rest| rest.split('"').next().unwrap().split(' ').any(|rule| rule == "en-17037"));
            assert_eq!(has_rule, at_once == 1, "{path}: {}", page.text);
        }
    }
}

/// Each rule has a name in the page, and each name is one of a rule.
#[test]
fn rules_have_names_in_the_page() {
    let english = concat!(env!("CARGO_MANIFEST_DIR"), "/../client/web/page/language-en.json");
    let english: Value = serde_json::from_str(&fs::read_to_string(english).unwrap()).unwrap();
    let mut named: Vec<&str> = english["analyse"]["rules"].as_object().unwrap().keys().map(String::as_str).collect();
    named.sort_unstable();
    let mut known: Vec<&str> = insula_analysis::rule::Rule::names().collect();
    known.sort_unstable();
    assert_eq!(named, known);
}

#[tokio::test]
async fn hostile_questions_are_explained() {
    let server = start(|config| config.analyses.cells = 300_000).await;
    for (asked, words) in [
        (r#""kind":"view""#, "view"),
        (r#""kind":"sun""#, "nl-tno-light"),
        (r#""kind":"sun","rule":"/etc/passwd""#, "nl-tno-light"),
        (r#""kind":"sky","rule":"en-17037""#, "rule"),
        (r#""kind":"sky","time":"2025-12-21T12:00""#, "time"),
        (r#""kind":"shadow""#, "needs a time"),
        (r#""kind":"shadow","time":"noon""#, "write 2025"),
        (r#""kind":"shadow","time":"2025-12-21T12:00","time_zone":"Moon/Sea""#, "time_zone"),
        (r#""kind":"sky","out":"a.tif""#, "out"),
        (r#""kind":"sky","bbox":[4,52,4.01,52.01]"#, "at most one"),
        (r#""kind":"sky","format":"tif""#, "geojson"),
        (r#""kind":"sky","format":"png""#, "png has a point"),
        (r#""kind":"sky","point":[4,52]"#, "only png has one"),
    ] {
        assert_refused(&server, PATH, JSON, &options(asked), 400, words).await;
    }
    for (asked, words) in [
        ("", "EOF"),
        (r#"{"kind":"sky"}"#, "about:blank"),
        (r#"{"kind":"sky","bbox_metres":[1e300,0,2e300,1]}"#, "in metres"),
        (r#"{"kind":"sky","bbox_metres":[0,0,10,10]}"#, "#area-outside"),
        (r#"{"kind":"sky","bbox_metres":[84000,446000,86000,448000]}"#, "#area-too-large"),
        (r#"{"kind":"sky","format":"png"}"#, "either point or point_metres"),
        (r#"{"kind":"sun","format":"png","point_metres":[85010,447015]}"#, "nl-tno-light"),
        (r#"{"kind":"sky","format":"png","point":[4,52],"point_metres":[85010,447015]}"#, "either point"),
        (r#"{"kind":"sky","format":"png","point_metres":[0,0]}"#, "#area-outside"),
        (r#"{"kind":"sky","format":"png","point_metres":[1e300,0]}"#, "out of the city's"),
        (r#"{"kind":"sky","format":"png","point":[4,95]}"#, "out of the city's"),
    ] {
        assert_refused(&server, PATH, JSON, asked, 400, words).await;
    }
    let (head, _) = post(&server, PATH, "Content-Type: text/plain\r\n", &options(r#""kind":"sky""#)).await;
    assert!(head.starts_with("HTTP/1.1 415 "), "{head}");
    let get = server.get(PATH, "").await;
    assert_problem(&get, 405);
    assert!(get.contains("allow: POST,OPTIONS\r\n"), "{get}");
    // Nothing of this has taken the only place.
    ask(&server, &options(r#""kind":"sky""#)).await;
    server.stop().await;
}

#[tokio::test]
async fn limits_have_their_status() {
    let server = start(|config| (config.analyses.cells, config.analyses.waiting) = (1000, 1)).await;
    let sky = options(r#""kind":"sky""#);
    assert_refused(&server, PATH, JSON, &sky, 400, "#area-too-large").await;
    server.stop().await;
    let server = start(|config| config.analyses.waiting = 1).await;
    assert_full_queue_sheds(&server, PATH, &sky).await;
    server.stop().await;
}
