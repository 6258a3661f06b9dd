//! What hostile inputs and careless arguments cannot do: destroy files, use more memory than allowed, publish files from
//! elsewhere.

use flate2::Compression;
use flate2::write::GzEncoder;
use insula_test_support::folder::tree;
use serde_json::{Value, json};
use std::fs;
use std::io::Write;
use std::path::PathBuf;
use std::process::{Command, Output};
use tempfile::TempDir;

/// A folder with files for one test.
struct Workplace(TempDir);

impl Workplace {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, bytes).unwrap();
        path
    }

    /// Runs the program in the folder.
    fn run(&self, line: &str) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_insula-server"));
        command.args(line.split_whitespace()).current_dir(self.0.path()).env_remove("RUST_LOG").output().unwrap()
    }

    fn succeeds(&self, line: &str) {
        let output = self.run(line);
        assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
    }

    /// Runs a command that must fail with one line, which is returned, and change no file.
    #[track_caller]
    fn refused(&self, line: &str) -> String {
        let before = tree(self.0.path());
        let message = one_error(line, &self.run(line));
        assert!(tree(self.0.path()) == before, "{line} changed files: {message}");
        message
    }
}

/// The one line that a failed command prints.
#[track_caller]
fn one_error(what: &str, output: &Output) -> String {
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(matches!(output.status.code(), Some(1..=3)), "{what}: {:?}: {text}", output.status);
    // A slow bake also says how far it is, and a bake that guesses what it guesses.
    let is_other = |line: &&str| !line.starts_with("baking: ") && !line.starts_with("warning: ");
    let lines: Vec<&str> = text.lines().filter(is_other).collect();
    assert!(lines.len() == 1 && lines[0].starts_with("error: "), "{what}: {text:?}");
    lines[0].to_owned()
}

/// A CityJSON document.
fn document(objects: &Value, vertices: &Value) -> Value {
    json!({ "type": "CityJSON", "version": "2.0", "CityObjects": objects, "vertices": vertices })
}

fn corners([x, y]: [f64; 2], side: f64, height: f64) -> Vec<Value> {
    let square = [(0.0, 0.0), (side, 0.0), (side, side), (0.0, side)];
    [0.0, height].iter().flat_map(|z| square.map(|(dx, dy)| json!([x + dx, y + dy, z]))).collect()
}

/// A box whose corners begin at `first`.
fn solid(first: usize) -> Value {
    let faces = [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];
    let faces = faces.map(|face: [usize; 4]| json!([face.map(|corner| corner + first)]));
    json!({ "type": "Building", "geometry": [{ "type": "Solid", "lod": "2", "boundaries": [faces] }] })
}

fn house() -> String {
    document(&json!({ "house": solid(0) }), &json!(corners([0.0; 2], 10.0, 9.0))).to_string()
}

#[test]
fn a_folder_that_cannot_be_created_is_wrong_usage() {
    let place = Workplace::new();
    place.write("a.obj", "v 0 0 0\nv 9 0 0\nv 0 9 9\nf 1 2 3\n");
    place.write("notes", "dear");
    let output = place.run("bake a.obj --out notes/city");
    let text = one_error("bake below a file", &output);
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(text.contains("notes/city: the folder cannot be created in ") && !text.contains(".insula"), "{text}");
}

#[test]
fn output_that_is_or_holds_the_input_or_other_files_is_refused() {
    let place = Workplace::new();
    place.write("delft/city.json", house());
    assert!(place.refused("bake delft/city.json --out delft").contains("input"));
    place.write("town.city.json", house());
    assert!(place.refused("bake town.city.json --out delft").contains("city.json"), "a city.json that is no manifest");
    place.write("delft/notes.txt", "dear");
    assert!(place.refused("bake town.city.json --out delft").contains("notes.txt"));
    assert!(place.refused("bake delft --out delft").contains("input"));
    assert!(place.refused("bake delft/city.json --out delft/../delft/").contains("delft"));
    place.succeeds("bake town.city.json --out town --cell 4");
    place.succeeds("bake town.city.json --out town --cell 2");
    place.write("town/notes.txt", "dear");
    assert!(place.refused("bake town.city.json --out town --cell 4").contains("notes.txt"));
    fs::remove_file(place.path("town/notes.txt")).unwrap();
    place.write("town.partial/mine.txt", "dear");
    assert!(place.refused("bake town.city.json --out town --cell 4").contains("mine.txt"));
    place.write("new.partial/a.city.json", house());
    assert!(place.refused("bake new.partial/a.city.json --out new").contains("input"));
}

#[test]
fn only_work_stores_of_bakes_are_cleared() {
    let place = Workplace::new();
    for name in ["mine/job.json", "mine/tiles/a.png", "mine/plan/notes.txt", "mine/pic/b.png", "mine/city/index.html"] {
        place.write(name, "dear");
    }
    place.write("town.city.json", house());
    assert!(place.refused("bake abort --work mine").contains("nothing is removed"));
    assert!(place.refused("bake plan --inputs town.city.json --work mine --update").contains("no bake wrote it"));
    place.write("work/in/a.city.json", house());
    assert!(place.refused("bake plan --inputs work/in --work work").contains("input"));
    place.write("work/palette.json", "{}");
    place.write("work/labels.toml", "");
    for option in ["--palette work/palette.json", "--labels work/labels.toml"] {
        let line = format!("bake plan --inputs town.city.json --work work {option}");
        assert!(place.refused(&line).contains("input"), "{line}");
    }
    place.succeeds("bake town.city.json --out town --cell 4");
    for line in ["bake plan --inputs town.city.json --work town", "bake plan --inputs town.city.json --work town/work"]
    {
        assert!(place.refused(line).contains("baked city"), "{line}");
    }
    assert!(place.refused("bake town.city.json --out town/more").contains("baked city"));
    place.write("other.job", "dear");
    assert!(place.refused("bake plan --inputs town.city.json --work other").contains("other.job"));
    place.succeeds("bake plan --inputs town.city.json --work new --cell 4");
    place.succeeds("bake scan 0 --work new");
    place.write("new/tiles/My photo.png", "dear");
    place.succeeds("bake abort --work new");
    let left: Vec<_> = tree(&place.path("new")).into_iter().filter(|(path, _)| path.is_file()).collect();
    assert!(
        left.iter().any(|(path, text)| path.ends_with("My photo.png") && text == b"dear") && left.len() == 2,
        "{left:?}"
    );
}

/// Who can write to a work store cannot make a step read other files than those of the job that was begun.
#[test]
fn a_job_in_the_place_of_another_is_refused() {
    let place = Workplace::new();
    for name in ["town.city.json", "private/secret.city.json"] {
        place.write(name, house());
    }
    let hash = |output: &Output| {
        String::from_utf8_lossy(&output.stdout).lines().find_map(|line| Some(line.strip_prefix("job ")?.to_owned()))
    };
    let begun = hash(&place.run("bake plan --inputs town.city.json --work work --cell 4")).unwrap();
    assert_eq!(fs::read_to_string(place.path("work.job")).unwrap().trim(), begun);
    let (job, good) = (place.path("work/job.json"), fs::read_to_string(place.path("work/job.json")).unwrap());
    for bad in [
        good.replace("town.city.json", "private/secret.city.json"),
        good.replace("\"--cell\"", "\"--texture-root\",\"private\",\"--cell\""),
        good.replace("\"--cell\"", "\"--palette\",\"private/secret.city.json\",\"--cell\""),
    ] {
        assert_ne!(bad, good);
        fs::write(&job, &bad).unwrap();
        for step in ["scan 0", "plan", "status", "tasks scan"] {
            let output = place.run(&format!("bake {step} --work work"));
            let message = one_error(step, &output);
            assert!(output.status.code() == Some(3) && message.contains("not the job"), "{message}");
        }
    }
    fs::write(&job, &good).unwrap();
    // Without the hash beside the folder, as on a machine that has the folder alone.
    fs::remove_file(place.path("work.job")).unwrap();
    assert!(place.refused("bake scan 0 --work work").contains("--job"));
    // A file, although it looks like an address.
    fs::write(&job, good.replace("town.city.json", "work/x://../../private/secret.city.json")).unwrap();
    assert!(place.refused("bake scan 0 --work work").contains("--job"));
    fs::write(&job, &good).unwrap();
    place.refused(&format!("bake scan 0 --work work --job {}", begun.replace(['0', '1'], "2")));
    place.succeeds(&format!("bake scan 0 --work work --job {begun}"));
}

#[test]
fn report_overwrites_only_an_earlier_report() {
    let place = Workplace::new();
    place.write("town.city.json", house());
    place.write("package.json", r#"{"name": "a", "version": "1"}"#);
    place.write("thesis.txt", "dear");
    for report in
        ["town.city.json", "./town.city.json", "package.json", "thesis.txt", "out/report.json", "out.partial/r.json"]
    {
        place.refused(&format!("bake town.city.json --out out --report {report}"));
    }
    for _ in 0..2 {
        place.succeeds("bake town.city.json --out out --cell 4 --report report.json");
    }
    let report: Value = serde_json::from_slice(&fs::read(place.path("report.json")).unwrap()).unwrap();
    assert_eq!(report["objects"], 1);
}

#[test]
fn mesh_commands_do_not_overwrite_their_input() {
    let place = Workplace::new();
    let off = "OFF\n5 6 0\n0 0 0\n10 0 0\n10 8 0\n0 8 0\n4 3 7\n4 3 2 1 0\n3 0 1 4\n3 1 2 4\n3 2 3 4\n3 3 0 4\n";
    place.write("a.off", off);
    place.refused("compress a.off a.off");
    place.refused("simplify a.off ./a.off --ratio 0.5");
    place.succeeds("ao a.off --out a.ply --views 16 --map 64");
    place.refused("ao a.ply --out ./a.ply");
    place.refused("ao a.ply --out b.obj");
    place.succeeds("compress a.off a.insm");
    fs::copy(place.path("a.insm"), place.path("b.off")).unwrap();
    place.refused("decompress b.off b.off");
    #[cfg(unix)]
    {
        fs::hard_link(place.path("a.off"), place.path("hard.off")).unwrap();
        place.refused("simplify a.off hard.off --ratio 0.5");
    }
    place.write("town.city.json", house());
    place.succeeds("bake town.city.json --out town --cell 4");
    place.refused("inspect town --tile 0/0/0 --png town/city.json");
    place.refused("inspect town --tile 0/0/0 --png a.off");
    // A file of another kind is replaced only when that is asked for.
    place.write("thesis.ply", "dear");
    assert!(place.refused("simplify a.off thesis.ply --ratio 0.5").contains("--overwrite"));
    place.succeeds("simplify a.off thesis.ply --ratio 0.5 --overwrite");
    place.succeeds("simplify a.off thesis.ply --ratio 0.5");
    for out in [
        "--format csv --out town/city.json",
        "--format 3dtiles --out town/meshes.pmtiles",
        "--format 3dtiles --out town",
    ] {
        assert!(place.refused(&format!("export town {out}")).contains("baked city"));
    }
    for tileset in ["{}", r#"{"asset":{"version":"1.1","generator":"theirs"},"geometricError":1,"root":{}}"#] {
        place.write("photos/tileset.json", tileset);
        assert!(place.refused("export town --format 3dtiles --out photos").contains("did not write"));
    }
    assert!(place.refused("export town --plain --out town.csv").contains("3dtiles"));
    assert!(place.refused("export town --plain --out town.pmtiles").contains(".3tz"));
    for _ in 0..2 {
        let output = place.run("export town --format 3dtiles --out tiles");
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && text.contains("note: the city's place on Earth is not known"), "{text}");
    }
}

/// A limit of the length of files is as a full disk: nothing can be written.
#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_leaves_the_old_file() {
    let place = Workplace::new();
    place.write("a.off", "OFF\n4 2 0\n0 0 0\n9 0 0\n9 9 0\n0 9 0\n3 0 1 2\n3 0 2 3\n");
    place.write("town.city.json", house());
    place.succeeds("bake town.city.json --out town --cell 4");
    for (line, out) in [
        ("simplify a.off b.ply --ratio 1", "b.ply"),
        ("compress a.off b.insm", "b.insm"),
        ("export town --format csv --out b.csv", "b.csv"),
        ("export town --format glb --out b.glb", "b.glb"),
        ("export town --format 3dtiles --out b.3tz", "b.3tz"),
        ("export town --format 3dtiles --out b.pmtiles", "b.pmtiles"),
        ("export town --format 3dtiles --out b", "b/tileset.json"),
    ] {
        place.succeeds(line);
        let before = fs::read(place.path(out)).unwrap();
        let mut limited = Command::new("sh");
        limited.args(["-c", "ulimit -f 0; exec \"$@\"", "sh", env!("CARGO_BIN_EXE_insula-server")]);
        let output = limited.args(line.split_whitespace()).current_dir(place.0.path()).output().unwrap();
        assert!(!output.status.success(), "{line}");
        assert!(fs::read(place.path(out)).unwrap() == before, "{line}");
    }
}

#[test]
fn textures_come_from_the_sources_folder_or_a_named_one_only() {
    let place = Workplace::new();
    let mut png = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_pixel(8, 8, image::Rgb([250, 10, 10])).write_to(&mut png, image::ImageFormat::Png).unwrap();
    place.write("private/photo.png", png.get_ref());
    let obj = "mtllib a.mtl\nv 0 0 0\nv 20 0 0\nv 0 20 9\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n";
    place.write("in/a.obj", obj);
    let textures = |name: &str, option: &str| {
        place.write("in/a.mtl", format!("newmtl m\nKd 0 0 1\nmap_Kd {name}\n"));
        place.succeeds(&format!("bake in/a.obj --out city --cell 4 --report r.json {option}"));
        let report: Value = serde_json::from_slice(&fs::read(place.path("r.json")).unwrap()).unwrap();
        let source = &report["read"]["sources"][0];
        (source["textures"].as_u64(), source["problems"]["texture outside of the source's folder"]["count"].as_u64())
    };
    let mut names = vec!["../private/photo.png", "..\\private\\photo.png"];
    if cfg!(unix) {
        #[cfg(unix)]
        std::os::unix::fs::symlink(place.path("private/photo.png"), place.path("in/link.png")).unwrap();
        names.push("link.png");
    }
    for name in names {
        assert_eq!(textures(name, ""), (Some(0), Some(1)), "{name}");
        assert_eq!(textures(name, "--texture-root private"), (Some(1), None), "{name}");
    }
}

#[test]
fn texts_of_any_length_give_a_city_that_opens() {
    let place = Workplace::new();
    let mut town: Value = serde_json::from_str(&house()).unwrap();
    let long = "\u{7}T".repeat(1 << 20);
    town["metadata"] = json!({ "title": long, "license": long, "contactName": long });
    town["CityObjects"][&long] = json!({ "type": long });
    place.write("town.city.json", town.to_string());
    place.succeeds("bake town.city.json --out town --cell 4 --report report.json");
    place.succeeds("verify town");
    assert!(fs::metadata(place.path("town/city.json")).unwrap().len() < 1 << 20);
    assert!(fs::metadata(place.path("report.json")).unwrap().len() < 1 << 17);
}

#[test]
fn version_tells_a_city_whose_files_are_of_two_bakes() {
    let place = Workplace::new();
    place.write("a.city.json", house());
    place.write("b.city.json", house().replace("9.0", "8.0"));
    place.succeeds("bake a.city.json --out a --cell 4");
    place.succeeds("bake b.city.json --out b --cell 4 --name a");
    place.succeeds("bake a.city.json --out expected/a --cell 4");
    place.succeeds("verify a");
    fs::copy(place.path("b/meshes.pmtiles"), place.path("a/meshes.pmtiles")).unwrap();
    let output = place.run("verify a");
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(1) && error.contains("another version of the city"), "{error}");
    place.succeeds("bake a.city.json --out a --cell 4 --update");
    let names = |folder: &str| tree(&place.path(folder)).into_values().collect::<Vec<_>>();
    assert!(names("a") == names("expected/a"), "an update does not reuse such a city");
}

/// Bakes with `--memory 64MiB` in an address space of that, the program and 560 MiB: threads reserve more of it than they use. Returns whether it succeeds.
#[cfg(target_os = "linux")]
fn bake_in_little_memory(place: &Workplace, name: &str, options: &str) -> Result<(), String> {
    let program_kib = fs::metadata(env!("CARGO_BIN_EXE_insula-server")).unwrap().len() >> 10;
    let limit_kib = ((64 + 560) << 10) + program_kib;
    let mut command = Command::new("sh");
    command.args(["-c", &format!("ulimit -v {limit_kib} && exec \"$0\" \"$@\"")]);
    command.arg(env!("CARGO_BIN_EXE_insula-server"));
    command.args(["bake", name, "--out", "out", "--threads", "1", "--memory", "64MiB", "--report", "report.json"]);
    command.args(options.split_whitespace()).current_dir(place.0.path()).env_remove("RUST_LOG");
    let output = command.output().unwrap();
    if output.status.success() { Ok(()) } else { Err(one_error(name, &output)) }
}

/// Few lines, whose triangles cover thousands of blocks each.
#[test]
fn scratch_files_are_refused_past_their_limit() {
    let place = Workplace::new();
    let triangles = "v 0 0 0\nv 16000 0 0\nv 0 16000 1\n".to_owned() + &"f 1 2 3\n".repeat(120);
    assert!(triangles.len() < 1100);
    place.write("wide.obj", triangles);
    let line = place.refused("bake wide.obj --out city --ground none --no-meshes --scratch 20MiB");
    assert!(line.contains("more than 20 MiB of scratch files") && line.contains("--scratch"), "{line}");
}

#[test]
#[cfg(target_os = "linux")]
fn small_files_do_not_need_gigabytes() {
    let place = Workplace::new();
    let check = |name: &str, bytes: &[u8], options: &str| {
        place.write(name, bytes);
        bake_in_little_memory(&place, name, options)
    };
    assert_eq!(check("house.city.json", house().as_bytes(), ""), Ok(()));

    // One face half a million times, small and large, in one object and in many.
    let faces = |size: u32| format!("v 0 0 0\nv {size} 0 0\nv 0 {size} 1\n") + &"f 1 2 3\n".repeat(500_000);
    let _ = check("small.obj", faces(1).as_bytes(), "--no-meshes");
    let line = check("large.obj", faces(100).as_bytes(), "").unwrap_err();
    assert!(line.contains("too much surface for the cell size") && line.contains("large"), "{line}");
    let mut many = String::from("v 0 0 0\nv 100 0 0\nv 0 100 1\n");
    (0..100_000).for_each(|i| many += &format!("o face-{i}\nf 1 2 3\n"));
    // They are one object, unless duplicates are kept.
    assert_eq!(check("many.obj", many.as_bytes(), ""), Ok(()));
    let line = check("many.obj", many.as_bytes(), "--keep-duplicates").unwrap_err();
    assert!(line.contains("face-") && line.contains("MiB"), "{line}");

    // A tower of 10 km at cells of 0.1 m, beside a house.
    let vertices = [corners([0.0; 2], 10.0, 10_000.0), corners([30.0, 0.0], 5.0, 4.0)].concat();
    let tower = document(&json!({ "tower": solid(0), "house": solid(8) }), &json!(vertices)).to_string();
    assert_eq!(check("tower.city.json", tower.as_bytes(), "--cell 0.1"), Ok(()));
    let report = fs::read_to_string(place.path("report.json")).unwrap();
    assert!(report.contains("tower: 100000 cells high"), "{report}");

    // 3,000 instances of a template, in one object and in as many.
    let vertex = |i: usize| json!([i * 7 % 50, i * 11 % 50, i * 13 % 50]);
    let template: Vec<Value> = (0..1500).map(|i| json!([[3 * i, 3 * i + 1, 3 * i + 2]])).collect();
    let templates = json!({
        "templates": [{ "type": "MultiSurface", "lod": "2", "boundaries": template }],
        "vertices-templates": (0..4500).map(vertex).collect::<Vec<_>>(),
    });
    let instance = json!({ "type": "GeometryInstance", "template": 0, "boundaries": [0] });
    let one = json!({ "forest": { "type": "Building", "geometry": vec![instance.clone(); 3000] } });
    let tree = |i: usize| (format!("tree-{i}"), json!({ "type": "Building", "geometry": [instance.clone()] }));
    let many = Value::Object((0..3000).map(tree).collect());
    for (objects, id) in [(one, "forest"), (many, "tree-")] {
        let mut text = document(&objects, &json!([[0, 0, 0]]));
        text["geometry-templates"] = templates.clone();
        let line = check("instances.city.json", text.to_string().as_bytes(), "").unwrap_err();
        assert!(line.contains(id), "{line}");
    }

    // Megabytes that unpack to more than a gigabyte: the same member many times.
    let member = |text: &str| {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
        encoder.write_all(text.as_bytes()).unwrap();
        encoder.finish().unwrap()
    };
    let packed =
        |start: &str, part: &str| [member(start), member(&part.repeat((1 << 20) / part.len())).repeat(1200)].concat();
    let json_start = r#"{"type":"CityJSON","version":"2.0","CityObjects":{},"vertices":["#;
    let geo_start = r#"{"type":"FeatureCollection","features":[{"type":"Feature","geometry":{"coordinates":["#;
    for (name, bytes) in [
        ("bomb.city.json.gz", packed(json_start, "[0,0,0],")),
        ("bomb.geojson.gz", packed(geo_start, "[0,0],")),
        ("bomb.obj.gz", packed("v 0 0 0\n", "f 1 1 1\n")),
    ] {
        let line = check(name, &bytes, "").unwrap_err();
        assert!(line.contains(name), "{line}");
    }
}
