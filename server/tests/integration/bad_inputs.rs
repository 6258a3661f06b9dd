//! Inputs of which nothing can be baked, and bakes that would take hours: what the terminal says before anything is written.

use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::Value;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;
use tempfile::TempDir;

fn run(folder: &Path, args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_insula-server"));
    command.args(args).current_dir(folder).env_remove("RUST_LOG").output().unwrap()
}

/// Lines of standard error, without those of progress.
fn told(output: &Output) -> Vec<String> {
    let text = String::from_utf8(output.stderr.clone()).unwrap();
    text.lines().filter(|line| !line.starts_with("baking: ")).map(str::to_owned).collect()
}

/// Houses of 10 m, one every 20 m to the east of `x`.
fn houses(x: f64, count: usize) -> String {
    let mut text = String::new();
    for i in 0..count {
        let (west, at) = (x + 20.0 * i as f64, 4 * i);
        text += &format!("o house-{i}\nv {west} 0 0\nv {} 0 0\nv {} 10 0\nv {west} 10 9\n", west + 10.0, west + 10.0);
        text += &format!("f {} {} {}\nf {} {} {}\n", at + 1, at + 2, at + 3, at + 1, at + 3, at + 4);
    }
    text
}

/// A folder with files, of which `town.obj` is whole.
fn workplace(files: &[(&str, &str)]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("town.obj"), houses(0.0, 5)).unwrap();
    for (name, text) in files {
        let bytes = if name.ends_with(".gz") { cut_gz(text) } else { text.as_bytes().to_vec() };
        fs::write(folder.path().join(name), bytes).unwrap();
    }
    folder
}

/// The packed text without its last bytes: all of it is read before the fault is found.
fn cut_gz(text: &str) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(text.as_bytes()).unwrap();
    let mut bytes = encoder.finish().unwrap();
    bytes.truncate(bytes.len() - 4);
    bytes
}

fn files(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    found.sort();
    found.iter().map(|path| (path.file_name().unwrap().into(), fs::read(path).unwrap())).collect()
}

/// The files of a city of the town alone.
fn town_alone() -> &'static [(PathBuf, Vec<u8>)] {
    static FILES: OnceLock<Vec<(PathBuf, Vec<u8>)>> = OnceLock::new();
    FILES.get_or_init(|| {
        let folder = workplace(&[]);
        let output = run(folder.path(), &["bake", "town.obj", "--cell", "4", "--name", "c", "--out", "c"]);
        assert!(output.status.success(), "{output:?}");
        files(&folder.path().join("c"))
    })
}

/// Asserts that `bad` beside the town fails the bake before anything is written, with an error that has `words`; and that
/// the rest is baked with the option, to the bytes that it has alone.
#[track_caller]
fn assert_bad(bad: &str, text: Option<&str>, words: &[&str]) {
    let folder = workplace(&text.map(|text| (bad, text)).into_iter().collect::<Vec<_>>());
    let path = |name: &str| folder.path().join(name);
    let bake = ["bake", "town.obj", bad, "--cell", "4", "--name", "c", "--report", "r.json", "--out"];
    let output = run(folder.path(), &[&bake[..], &["c"]].concat());
    let lines = told(&output);
    assert_eq!((output.status.code(), lines.len()), (Some(1), 1), "{lines:?}");
    assert!(lines[0].starts_with(&format!("error: bake: {bad}: ")), "{}", lines[0]);
    for word in words.iter().chain(&["; --skip-bad-inputs bakes the other inputs"]) {
        assert!(lines[0].contains(word), "{word} is not in {}", lines[0]);
    }
    assert!(!path("c").exists() && !path("c.partial").exists() && !path("r.json").exists());

    // The bad input is first, too: what it did before it failed must not stay.
    for inputs in [["town.obj", bad], [bad, "town.obj"]] {
        let output = run(folder.path(), &[&["bake", "--skip-bad-inputs"][..], &inputs, &bake[3..], &["c"]].concat());
        let (lines, summary) = (told(&output), String::from_utf8(output.stdout).unwrap());
        assert_eq!((output.status.code(), lines.len()), (Some(0), 1), "{lines:?}");
        assert!(lines[0].starts_with(&format!("warning: {bad}: left out: ")), "{}", lines[0]);
        assert!(words.iter().all(|word| lines[0].contains(word)), "{}", lines[0]);
        assert!(summary.contains("5 buildings") && summary.contains("1 input left out"), "{summary}");
        let report: Value = serde_json::from_slice(&fs::read(path("r.json")).unwrap()).unwrap();
        assert_eq!(report["read"]["bad_inputs"][0]["path"], bad);
        assert_eq!(report["read"]["sources"].as_array().map(Vec::len), Some(1));
        assert!(files(&path("c")) == town_alone(), "other bytes than without the input");
    }
}

#[test]
fn input_that_is_far_from_the_others_fails_the_bake() {
    let words = ["all of its 3 objects are left out: far from the city", "3950 km away", "check its coordinate system"];
    assert_bad("far.obj", Some(&houses(3_951_000.0, 3)), &words);
}

#[test]
fn inputs_that_cannot_be_read_fail_the_bake_in_the_same_way() {
    let town = |crs: &str| {
        format!(
            r#"{{"type": "CityJSON", "version": "2.0", "metadata": {{"referenceSystem": "{crs}"}}, "vertices": [[0,0,0], [9,0,0], [0,9,5]],
            "CityObjects": {{"a": {{"type": "Building", "geometry": [{{"type": "MultiSurface", "lod": "2", "boundaries": [[[0,1,2]]]}}]}}}}}}"#
        )
    };
    let unknown = town("https://www.opengis.net/def/crs/EPSG/0/999999");
    let cut = town("https://www.opengis.net/def/crs/EPSG/0/7415");
    assert_bad("unknown.city.json", Some(&unknown), &["999999"]);
    assert_bad("cut.city.json", Some(&cut[..cut.len() - 9]), &["damaged or cut short"]);
    // It names the system of its coordinates, and has a building, before it breaks off.
    let line = cut.replace('\n', " ");
    let header = line.replace("\"a\":", "\"b\":").replace("[0,9,5]", "[0,99,5]");
    let sequence = format!("{header}\n{}", line.replace("CityJSON\"", "CityJSONFeature\""));
    assert_bad("cut.city.jsonl.gz", Some(&sequence), &["cannot be read"]);
    assert_bad("missing.obj", None, &["cannot be read"]);
    assert_bad("lines.geojson", Some(LINE), &["its only object is left out: line without a width", "repair it"]);
    assert_bad("my town.kml", Some("<kml/>"), &["KML: not read", "'my town.gpkg' 'my town.kml'"]);
    assert_bad("town.gml", Some("<gml/>"), &["CityGML"]);
}

const LINE: &str = r#"{"type": "FeatureCollection", "features": [{"type": "Feature", "id": "fence", "properties": {},
    "geometry": {"type": "LineString", "coordinates": [[4.3, 52.0], [4.31, 52.0]]}}]}"#;

#[test]
fn bake_without_a_good_input_fails_with_the_first_bad_one() {
    let folder = workplace(&[("a.kml", ""), ("b.city.json", "{")]);
    for inputs in [&["a.kml", "b.city.json"][..], &["a.kml"]] {
        let output = run(folder.path(), &[&["bake", "--out", "c", "--skip-bad-inputs"][..], inputs].concat());
        let lines = told(&output);
        assert!(output.status.code() == Some(1) && lines.len() == 1, "{lines:?}");
        assert!(lines[0].starts_with("error: bake: a.kml: KML") && lines[0].ends_with("a.gpkg a.kml"), "{}", lines[0]);
        assert!(!folder.path().join("c.partial").exists());
    }
    fs::create_dir(folder.path().join("in")).unwrap();
    fs::write(folder.path().join("in/a.kml"), "").unwrap();
    let lines = told(&run(folder.path(), &["bake", "in", "--out", "c"]));
    assert!(lines[0].contains("in/a.kml: KML") && !lines[0].contains("--skip"), "{}", lines[0]);
}

#[test]
fn suggested_command_serves_a_folder_of_any_name() {
    let folder = workplace(&[]);
    let output = run(folder.path(), &["bake", "town.obj", "--cell", "4", "--out", "it's my city"]);
    let summary = String::from_utf8(output.stdout).unwrap();
    assert!(summary.ends_with("\nserve it with: insula-server serve 'it'\\''s my city'\n"), "{summary}");
}
