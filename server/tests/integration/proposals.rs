//! Proposals for a city, as its page asks for them.

use crate::analyse::bake_house;
use crate::test_server::{TestServer, assert_problem};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

const PATH: &str = "/v1/cities/house/proposals.json";

/// A folder with proposals for the house: a tower instead of it, and one that fits no city.
fn write_proposals(folder: &Path) {
    let ring = [[85_030, 446_990], [85_040, 446_990], [85_040, 447_000], [85_030, 447_000], [85_030, 446_990]];
    let polygon = json!({ "type": "Polygon", "coordinates": [ring] });
    let of_city = folder.join("house");
    fs::create_dir(&of_city).unwrap();
    for (name, text) in [
        ("tower.geojson", polygon.to_string()),
        (
            "tower.toml",
            "title = \"Tower\"\n[[add]]\noutline = \"tower.geojson\"\nheight_m = 40\n[[remove]]\nids = [\"feature 1\"]\n"
                .to_owned(),
        ),
        ("wrong.toml", "[[remove]]\nids = [\"nobody\"]\n".to_owned()),
    ] {
        fs::write(of_city.join(name), text).unwrap();
    }
}

fn json_of(response: &str) -> Value {
    let (head, body) = response.split_once("\r\n\r\n").unwrap();
    assert!(head.starts_with("HTTP/1.1 200 ") && head.contains("content-type: application/json"), "{response}");
    serde_json::from_str(body).unwrap()
}

#[tokio::test]
async fn a_page_gets_what_proposals_change() {
    let folder = tempfile::tempdir().unwrap();
    write_proposals(folder.path());
    let server = TestServer::start(|config| config.site.proposals = Some(folder.path().to_owned())).await;
    bake_house(server.folder.path());
    server.reload().await;

    let found = json_of(&server.get(PATH, "").await);
    let [tower] = &found["proposals"].as_array().unwrap()[..] else { panic!("{found}") };
    assert_eq!((&tower["name"], &tower["title"]), (&json!("tower"), &json!("Tower")));
    assert_eq!(tower["hidden"].as_array().unwrap().len(), 1);
    let [block] = &tower["added"].as_array().unwrap()[..] else { panic!("{tower}") };
    assert_eq!(block["origin"][0], 85_030.0);
    assert!(block["name"].as_str().is_some_and(|name| name.ends_with(".geojson")), "{block}");
    let corners: Vec<i64> =
        block["triangles_cm"].as_array().unwrap().iter().map(|value| value.as_i64().unwrap()).collect();
    // Two triangles for each of six sides, from the ground to 40 m above it.
    assert_eq!(corners.len(), 12 * 9);
    let heights = || corners.iter().skip(2).step_by(3);
    assert_eq!(heights().max().unwrap() - heights().min().unwrap(), 4000);

    // Other cities have none, and those that do not exist are as elsewhere.
    assert_eq!(json_of(&server.get("/v1/cities/two/proposals.json", "").await), json!({ "proposals": [] }));
    assert_problem(&server.get("/v1/cities/nobody/proposals.json", "").await, 404);
    server.stop().await;
}

/// A model of equal small triangles beside the house, as a proposal.
fn write_model(of_city: &Path, name: &str, triangles: usize) {
    let corners = "v 85030 446990 0\nv 85030.2 446990 0\nv 85030 446990.2 0.2\n";
    fs::write(of_city.join(format!("{name}.obj")), corners.to_owned() + &"f 1 2 3\n".repeat(triangles)).unwrap();
    fs::write(of_city.join(format!("{name}.toml")), format!("[[add]]\nfile = \"{name}.obj\"\n")).unwrap();
}

#[tokio::test]
async fn proposals_past_the_triangles_of_a_city_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    write_proposals(folder.path());
    // With the 12 triangles of the tower, which comes before, one more than there may be.
    write_model(&folder.path().join("house"), "whole", 262_133);
    write_model(&folder.path().join("house"), "yard", 100);
    let server = TestServer::start(|config| config.site.proposals = Some(folder.path().to_owned())).await;
    bake_house(server.folder.path());
    server.reload().await;

    let found = json_of(&server.get(PATH, "").await);
    let names: Vec<&Value> = found["proposals"].as_array().unwrap().iter().map(|proposal| &proposal["name"]).collect();
    assert_eq!(names, ["tower", "yard"]);
    let yard = &found["proposals"][1]["added"][0]["triangles_cm"];
    assert_eq!(yard.as_array().unwrap().len(), 100 * 9);
    server.stop().await;
}
