//! Vector drawings over HTTP: the bytes of `insula draw`, and the limits of the route.

use crate::test_server::{JSON, TestServer, assert_full_queue_sheds, assert_problem, assert_refused, post};
use insula_analysis::eye::lifted_camera;
use insula_draw::file::{DrawingFormat, encode};
use insula_draw::sheet::Paper;
use insula_draw::style::Stylesheet;
use insula_draw::view::DrawView;
use insula_draw::{DrawRequest, DrawnPart, draw, draw_part};
use insula_export::camera::ExportCamera;
use insula_server::config::ServeConfig;
use insula_server::store::{CityStore, StoredCity};
use insula_test_support::small_city;
use std::fs;
use tokio::io::AsyncWriteExt;

const PATH: &str = "/v1/cities/two/draw";

async fn start(change: impl FnOnce(&mut ServeConfig)) -> TestServer {
    let server = TestServer::start(|config| {
        config.drawings.at_once = 1;
        change(config);
    })
    .await;
    small_city::write_city_with_meshes(&server.folder.path().join("two"), "two");
    server.reload().await;
    server
}

fn request(view: DrawView, scale: Option<f64>, style: Stylesheet) -> DrawRequest {
    let (paper, title) = (Paper::parse("A4").unwrap(), Some("A <title>".to_owned()));
    DrawRequest { view, paper, scale, title, style, ..DrawRequest::default() }
}

#[tokio::test]
async fn drawings_are_those_of_the_command() {
    let server = start(|_| {}).await;
    let city = CityStore::open(&server.folder.path().join("two")).unwrap();
    let read = |kind, id| city.tile(kind, id);
    let source = StoredCity::open(city.manifest(), &read).unwrap();
    for (format, name, content_type) in [
        (DrawingFormat::Svg, "svg", "image/svg+xml"),
        (DrawingFormat::Pdf, "pdf", "application/pdf"),
        (DrawingFormat::Dxf, "dxf", "image/vnd.dxf"),
    ] {
        let view = DrawView::Axonometric { azimuth_deg: 30.0, elevation_deg: 35.0 };
        let style = Stylesheet { shadows: true, sun: [200.0, 40.0], ..Stylesheet::default() };
        let request = request(view, Some(2000.0), style);
        let expected = encode(&draw(&source, &request, &|_, _| true).unwrap(), format);
        let options = format!(
            r#"{{"format":"{name}","axonometric":[30,35],"paper":"A4","scale":"1:2000","title":"A <title>","shadows":true,"sun":[200,40]}}"#
        );
        let (head, body) = post(&server, PATH, JSON, &options).await;
        assert!(head.starts_with("HTTP/1.1 200 "), "{head} {}", String::from_utf8_lossy(&body));
        assert!(head.contains(&format!("content-type: {content_type}\r\n")), "{head}");
        assert!(head.contains("cache-control: no-store\r\n") && head.contains("content-security-policy: "), "{head}");
        assert!(body == expected, "{name}: {} and {} bytes", body.len(), expected.len());
    }
    let metrics = server.get("/metrics", "").await;
    assert!(metrics.contains("insula_requests_total{route=\"draw\",code=\"200\"} 3"), "{metrics}");
    // All three are of one part of the city.
    for line in ["insula_drawing_parts_total{kind=\"read\"} 1\n", "insula_drawing_parts_total{kind=\"kept\"} 2\n"] {
        assert!(metrics.contains(line), "{metrics}");
    }
    assert!(!metrics.contains("insula_cached_bytes{kind=\"computed\"} 0\n"), "{metrics}");
    server.stop().await;
}

#[test]
fn a_second_view_of_a_part_needs_no_tree() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("two");
    small_city::write_city_with_meshes(&place, "two");
    let city = CityStore::open(&place).unwrap();
    let read = |kind, id| city.tile(kind, id);
    let source = StoredCity::open(city.manifest(), &read).unwrap();
    let plan = request(DrawView::Plan, None, Stylesheet::default());
    let part = DrawnPart::read(&source, &plan, &|_, _| true).unwrap();
    let without_tree = part.byte_len();
    let first = draw_part(&source, &part, &plan, &|_, _| true).unwrap();
    assert!(first == draw(&source, &plan, &|_, _| true).unwrap());
    let bytes = part.byte_len();
    assert!(bytes > without_tree);
    let [min, max] = small_city::manifest("two").bounds;
    let target = [0, 1, 2].map(|k| 0.5 * (min[k] + max[k]));
    let position = [target[0], target[1] - 150.0, target[2] + 120.0];
    for view in [
        DrawView::Axonometric { azimuth_deg: 30.0, elevation_deg: 35.0 },
        DrawView::Axonometric { azimuth_deg: 210.0, elevation_deg: 5.0 },
        DrawView::Perspective(ExportCamera { position, target, up: [0.0, 0.0, 1.0], fov_y_deg: 60.0 }),
    ] {
        let style = Stylesheet { shadows: true, sun: [200.0, 40.0], ..Stylesheet::default() };
        let other = request(view, None, style);
        let drawn = draw_part(&source, &part, &other, &|_, _| true).unwrap();
        assert!(drawn == draw(&source, &other, &|_, _| true).unwrap(), "{view:?}: as with a tree of its own");
        assert_eq!(part.byte_len(), bytes, "{view:?}");
    }
}

#[test]
fn eyes_in_houses_and_below_the_ground_are_lifted_out() {
    let folder = tempfile::tempdir().unwrap();
    small_city::write_city_with_meshes(folder.path(), "two");
    let city = CityStore::open(folder.path()).unwrap();
    let read = |kind, id| city.tile(kind, id);
    let source = StoredCity::open(city.manifest(), &read).unwrap();
    let lifted = |eye: [f64; 3]| {
        let camera = camera_at(eye);
        let lifted = lifted_camera(&source, camera).unwrap()?;
        let steps = [camera, lifted].map(|camera| camera.target[2] - camera.position[2]);
        assert!((steps[0] - steps[1]).abs() < 1e-9, "{eye:?}: in the same direction");
        Some(lifted.position[2])
    };
    // The house of the mesh is 6 m high, and its node's corner lies at 85064, 446064.
    for (eye, expected) in [
        ([85_069.0, 446_070.0, 3.0], Some(7.7)),
        ([85_069.0, 446_070.0, -30.0], Some(7.7)),
        ([85_069.0, 446_070.0, 6.5], None),
        ([85_080.0, 446_070.0, 1.0], None),
        ([85_080.0, 446_070.0, -30.0], Some(1.7)),
        ([84_000.0, 446_070.0, 1.0], None),
        ([84_000.0, 446_070.0, -30.0], Some(1.7)),
    ] {
        let is_same = match (lifted(eye), expected) {
            (Some(z), Some(expected)) => f64::abs(z - expected) < 0.05,
            (z, expected) => z == expected,
        };
        assert!(is_same, "{eye:?}: {:?}", lifted(eye));
    }
}

/// A camera that looks down to the north-west, with a direction of no round numbers.
fn camera_at(position: [f64; 3]) -> ExportCamera {
    let [x, y, z] = position;
    ExportCamera { position, target: [x - 7.3, y + 31.1, z - 20.3], up: [0.0, 0.0, 1.0], fov_y_deg: 57.3 }
}

#[tokio::test]
async fn cameras_are_drawn_as_given_and_lifted_out_of_houses() {
    let server = start(|_| {}).await;
    let city = CityStore::open(&server.folder.path().join("two")).unwrap();
    let read = |kind, id| city.tile(kind, id);
    let source = StoredCity::open(city.manifest(), &read).unwrap();
    let drawn = |camera: ExportCamera| {
        let request = request(DrawView::Perspective(camera), None, Stylesheet::default());
        draw(&source, &request, &|_, _| true).map(|drawing| encode(&drawing, DrawingFormat::Svg))
    };
    let posted = async |ExportCamera { position, target, fov_y_deg, .. }, rest: &str| {
        let options = format!(
            r#"{{"format":"svg","paper":"A4","title":"A <title>","view":{{"position":{position:?},"target":{target:?},"fov_y_deg":{fov_y_deg}}}{rest}}}"#
        );
        let (head, body) = post(&server, PATH, JSON, &options).await;
        (head.starts_with("HTTP/1.1 200 "), body)
    };
    let outside = camera_at([85_080.0, 446_040.0, 30.0]);
    assert!(lifted_camera(&source, outside).unwrap().is_none());
    assert!(posted(outside, "").await == (true, drawn(outside).unwrap()));
    // In the house of the mesh.
    let inside = camera_at([85_069.0, 446_070.0, 3.0]);
    let lifted = lifted_camera(&source, inside).unwrap().unwrap();
    let (is_made, body) = posted(inside, "").await;
    assert!(is_made && body == drawn(lifted).unwrap(), "{}", String::from_utf8_lossy(&body));
    let (is_made, kept) = posted(inside, r#","keep_camera":true"#).await;
    match drawn(inside) {
        Ok(expected) => assert!(is_made && kept == expected && kept != body),
        Err(_) => assert!(!is_made),
    }
    server.stop().await;
}

#[tokio::test]
async fn a_stylesheet_and_a_camera_are_parts_of_the_options() {
    let server = start(|_| {}).await;
    let [min, max] = small_city::manifest("two").bounds;
    let target = [0, 1, 2].map(|k| 0.5 * (min[k] + max[k]));
    let position = [target[0], target[1] - 150.0, target[2] + 120.0];
    let options = format!(
        r##"{{"format":"svg","bare":true,"paper":"200x100","view":{{"position":{position:?},"target":{target:?}}},
        "style":{{"fill":"kind","colors":{{"relief":"#123456"}},"lines":{{"crease":0}}}}}}"##
    );
    let (head, body) = post(&server, PATH, JSON, &options).await;
    let svg = String::from_utf8(body).unwrap();
    assert!(head.starts_with("HTTP/1.1 200 "), "{head} {svg}");
    assert!(svg.contains("width=\"200mm\"") && svg.contains("#123456"), "{svg}");
    server.stop().await;
}

#[tokio::test]
async fn without_the_settings_there_are_no_drawings_and_no_analyses() {
    let server = TestServer::start(|_| {}).await;
    for (path, options) in [(PATH, r#"{"format":"svg"}"#), ("/v1/cities/two/analyse", r#"{"kind":"sky"}"#)] {
        assert_problem(&server.get(path, "").await, 404);
        let (head, _) = post(&server, path, JSON, options).await;
        assert!(head.starts_with("HTTP/1.1 400 "), "no other route takes a body: {head}");
        let (head, _) = post(&server, path, "", "").await;
        assert!(head.starts_with("HTTP/1.1 404 "), "{head}");
    }
    server.stop().await;
}

#[tokio::test]
async fn private_cities_need_their_token() {
    let folder = tempfile::tempdir().unwrap();
    let tokens = folder.path().join("tokens");
    fs::write(&tokens, "0123456789abcdef-office\n").unwrap();
    let server = start(|config| config.access.tokens = Some(tokens.clone())).await;
    let options = r#"{"format":"svg"}"#;
    assert_refused(&server, PATH, JSON, options, 401, "bearer token").await;
    let (head, _) = post(&server, "/v1/cities/none/draw", JSON, options).await;
    assert!(head.starts_with("HTTP/1.1 401 "), "{head}");
    let token = format!("{JSON}Authorization: Bearer 0123456789abcdef-office\r\n");
    let (head, _) = post(&server, PATH, &token, options).await;
    assert!(head.starts_with("HTTP/1.1 200 "), "{head}");
    let (head, _) = post(&server, "/v1/cities/none/draw", &token, options).await;
    assert!(head.starts_with("HTTP/1.1 404 "), "{head}");
    server.stop().await;
}

#[tokio::test]
async fn hostile_options_are_explained() {
    let server = start(|_| {}).await;
    let deep = format!(r#"{{"format":"svg","filter":"{}height > 2"}}"#, "!(".repeat(1500));
    let nested = "[".repeat(20_000);
    let long_title = format!(r#"{{"format":"svg","title":"{}"}}"#, "x".repeat(300));
    for (options, words) in [
        ("", "EOF"),
        ("{}", "format"),
        (r#"{"format":"png"}"#, "png"),
        (r#"{"format":"svg","out":"/tmp/x.svg"}"#, "out"),
        (r#"{"format":"svg","paper":"A99"}"#, "A99"),
        (r#"{"format":"svg","paper":"1e9x1e9"}"#, "not a paper"),
        (r#"{"format":"svg","scale":"1:0"}"#, "scale"),
        (r#"{"format":"svg","scale":"1:nan"}"#, "scale"),
        (r#"{"format":"svg","bbox":[5,5,1,9]}"#, "bbox"),
        (r#"{"format":"svg","bbox":[1e300,0,2e300,1]}"#, "bbox_metres takes metres"),
        (r#"{"format":"svg","bbox_metres":[1e300,0,2e300,1]}"#, "in metres"),
        (r#"{"format":"svg","view":{"position":[0,0,50],"target":[0,0,90]}}"#, "nothing to draw"),
        (r#"{"format":"svg","axonometric":[0,-5]}"#, "axonometric"),
        (r#"{"format":"svg","plan":true,"axonometric":[0,5]}"#, "at most one"),
        (r#"{"format":"svg","view":{"position":[0,0,1],"target":[0,0,1]}}"#, "camera"),
        (r#"{"format":"svg","sun":[0,-5]}"#, "sun"),
        (r#"{"format":"svg","filter":"height >"}"#, "filter"),
        (r#"{"format":"svg","filter":"nothing == 1"}"#, "filter"),
        (r#"{"format":"svg","color_by":"nothing:viridis"}"#, "color_by"),
        (r#"{"format":"svg","style":{"fil":"light"}}"#, "fil"),
        (r##"{"format":"svg","style":{"colors":{"sea":"#000000"}}}"##, "sea"),
        (r##"{"format":"svg","style":{"colors":{"water":"url(http://x)"}}}"##, "not a colour"),
        (r#"{"format":"svg","style":{"hatch":{"building":{"spacing":1e-9,"width":0}}}}"#, "out of range"),
        (&deep, "filter"),
        (&nested, "expected value"),
        (&long_title, "title"),
    ] {
        assert_refused(&server, PATH, JSON, options, 400, words).await;
    }
    // Nothing of this has taken the only place.
    let (head, _) = post(&server, PATH, JSON, r#"{"format":"svg"}"#).await;
    assert!(head.starts_with("HTTP/1.1 200 "), "{head}");
    server.stop().await;
}

#[tokio::test]
async fn limits_have_their_status() {
    let server = start(|config| config.drawings.triangles = 4).await;
    let options = r#"{"format":"svg"}"#;
    assert_refused(&server, PATH, JSON, options, 400, "too large").await;
    assert_refused(&server, PATH, "Content-Type: text/plain\r\n", options, 415, "JSON").await;
    assert_refused(&server, PATH, "", options, 415, "JSON").await;
    let long = format!(r#"{{"format":"svg","title":"{}"}}"#, "x".repeat(64 << 10));
    assert_refused(&server, PATH, JSON, &long, 413, "64 KiB").await;
    let get = server.get(PATH, "").await;
    assert_problem(&get, 405);
    assert!(get.contains("allow: POST,OPTIONS\r\n"), "{get}");
    server.stop().await;
    let server = start(|config| (config.limits.client_rate, config.limits.client_burst) = (0.001, 1)).await;
    let (head, _) = post(&server, PATH, JSON, options).await;
    assert!(head.starts_with("HTTP/1.1 200 "), "{head}");
    assert_refused(&server, PATH, JSON, options, 429, "").await;
    server.stop().await;
}

#[tokio::test]
async fn a_full_queue_is_503_and_every_request_ends() {
    let server = start(|config| config.drawings.waiting = 1).await;
    let options = r#"{"format":"pdf","shadows":true}"#;
    assert_full_queue_sheds(&server, PATH, options).await;
    // A client that leaves frees its place.
    let mut stream = server.connect().await;
    let request =
        format!("POST {PATH} HTTP/1.1\r\nHost: x\r\nContent-Length: {}\r\n{JSON}\r\n{options}", options.len());
    stream.write_all(request.as_bytes()).await.unwrap();
    drop(stream);
    let (head, _) = post(&server, PATH, JSON, options).await;
    assert!(head.starts_with("HTTP/1.1 200 "), "{head}");
    server.stop().await;
}
