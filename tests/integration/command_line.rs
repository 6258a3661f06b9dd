//! The command lines of both programs: alike, and as the documentation has them.

use clap::CommandFactory;
use insula_client::args::Cli;
use insula_server::args::Args;
use insula_test_support::programs::{ServerProcess, program, run};
use insula_tests::source_code::tracked_files;
use insula_tests::tests;
use insula_tests::trials::Trials;
use std::ffi::OsStr;
use std::fs;
use std::path::Path;
use std::process::Command as Process;

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![
        the_page_of_all_commands_is_what_the_programs_print,
        both_programs_show_help_and_errors_alike,
        each_program_names_the_other_one_for_its_commands,
        a_view_link_is_a_place_of_all_commands,
        a_cache_folder_that_cannot_be_written_is_a_warning,
        a_view_is_exported_with_its_camera,
        a_city_at_an_address_is_drawn_as_its_folder_is,
        without_a_desktop_no_driver_complains,
        results_are_json_where_that_is_asked_for
    ]);
    #[cfg(target_os = "linux")]
    trials.add(tests![names_that_are_not_text_work_everywhere]);
}

/// A block of houses.
const FOOTPRINTS: &str = r#"{"type": "FeatureCollection", "crs": {"type": "name", "properties": {"name": "EPSG:28992"}},
    "features": [{"type": "Feature", "properties": {"height": 9}, "geometry": {"type": "Polygon",
    "coordinates": [[[85000, 447000], [85020, 447000], [85020, 447012], [85000, 447012], [85000, 447000]]]}}]}"#;
/// A view of it from the south-west.
const CAMERA: &str =
    r#"{"position": [84980, 446970, 30], "target": [85010, 447006, 4], "up": [0, 0, 1], "fov_y_deg": 60}"#;
const VIEW: &str = "camera=84980,446970,30,40,-25,60";

fn the_page_of_all_commands_is_what_the_programs_print() {
    let print = |name: &str| {
        let output = run(Process::new(program(name).unwrap()).arg("options")).unwrap();
        assert!(output.status.success(), "{name} {}", output.status);
        String::from_utf8(output.stdout).unwrap()
    };
    let printed = format!("{}\n{}", print("insula-server"), print("insula"));
    for row in ["## insula-server bake\n", "| `--crs EPSG:N` | ", "## insula fly\n", "| `--adapter ADAPTER` | "] {
        assert!(printed.contains(row), "no {row}: {printed}");
    }
    let is_new = tracked_files().unwrap().get("docs/cli.md") == Some(&printed);
    assert!(is_new, "docs/cli.md is old: write it by (insula-server options; echo; insula options) > docs/cli.md");
}

fn both_programs_show_help_and_errors_alike() {
    for name in ["insula", "insula-server"] {
        let call = |arguments: &[&str]| {
            let output = run(Process::new(program(name).unwrap()).args(arguments)).unwrap();
            let text = |bytes| String::from_utf8(bytes).unwrap();
            (output.status.code(), text(output.stdout), text(output.stderr))
        };
        let (code, help, errors) = call(&["--help"]);
        assert_eq!((code, errors.as_str()), (Some(0), ""));
        assert!(help.contains(&format!("Usage: {name}")) && !help.contains("completions"), "{help}");
        assert_eq!(call(&["help"]).0, Some(0));
        assert!(call(&["help"]).1.contains(&format!("Usage: {name}")));
        let (code, output, help) = call(&[]);
        assert_eq!((code, output.as_str()), (Some(2), ""));
        assert!(help.contains(&format!("Usage: {name}")), "{help}");
        let (code, output, error) = call(&["dance"]);
        assert_eq!((code, output.as_str(), error.lines().count()), (Some(2), "", 1));
        assert_eq!(error.trim_end(), format!("error: unrecognized subcommand 'dance'; see {name} --help"));
        let (command, arguments) =
            if name == "insula" { ("fly", &["--path", "none"][..]) } else { ("verify", &[][..]) };
        let (code, _, error) = call(&[&[command, "nowhere"][..], arguments].concat());
        let is_named =
            code != Some(0) && error.starts_with(&format!("error: {command}: ")) && error.lines().count() == 1;
        assert!(is_named, "{error}");
        let (code, _, error) = call(&[command]);
        assert_eq!(code, Some(2));
        let help = format!("; see {name} {command} --help\n");
        assert!(error.starts_with(&format!("error: {command}: ")) && error.ends_with(&help), "{error}");
        for shell in ["bash", "zsh", "fish"] {
            let (code, script, errors) = call(&["completions", shell]);
            assert_eq!((code, errors.as_str()), (Some(0), ""));
            assert!(script.contains(name), "{script}");
        }
        let version = call(&["--version"]);
        assert_eq!(version, call(&["-V"]));
        assert_eq!(version.1, format!("{name} {}\n", env!("CARGO_PKG_VERSION")));
    }
}

fn each_program_names_the_other_one_for_its_commands() {
    for (name, other) in [("insula", Args::command()), ("insula-server", Cli::command())] {
        for command in other.get_subcommands().filter(|command| !command.is_hide_set()) {
            let (other, command) = (other.get_name(), command.get_name());
            let expected = format!("error: {command} is a command of {other}; see {other} {command} --help\n");
            assert_eq!(call(name, Path::new("."), &[OsStr::new(command)]), (Some(2), expected));
        }
    }
}

/// Runs a program in a folder to its end. Returns its exit code, and what it says on standard error.
pub(crate) fn call(name: &str, folder: &Path, arguments: &[&OsStr]) -> (Option<i32>, String) {
    let mut command = Process::new(program(name).unwrap());
    command
        .current_dir(folder)
        .args(arguments)
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("RUST_LOG");
    let output = run(&mut command).unwrap();
    // How far a bake is says only one that takes long.
    let text = String::from_utf8_lossy(&output.stderr);
    let lines = text.lines().filter(|line| !line.starts_with("baking: "));
    (output.status.code(), lines.map(|line| format!("{line}\n")).collect())
}

fn baked_city(input: &OsStr, city: &OsStr) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir_all(folder.path().join(input).parent().unwrap()).unwrap();
    fs::write(folder.path().join(input), FOOTPRINTS).unwrap();
    fs::write(folder.path().join("camera.json"), CAMERA).unwrap();
    let report: &OsStr = "report.json".as_ref();
    let arguments = ["bake".as_ref(), input, "--out".as_ref(), city, "--report".as_ref(), report];
    assert_eq!(call("insula-server", folder.path(), &arguments), (Some(0), String::new()));
    folder
}

/// `insula snapshot` of a place with further arguments.
fn snapshot(folder: &Path, place: &OsStr, out: &OsStr, more: &[&str]) -> (Option<i32>, String) {
    let fixed = ["snapshot", "--size", "64x48", "--adapter", "cpu", "--server"].map(OsStr::new);
    let more = more.iter().map(OsStr::new);
    let arguments: Vec<&OsStr> = fixed.into_iter().chain([place, "--out".as_ref(), out]).chain(more).collect();
    let (code, text) = call("insula", folder, &arguments);
    // What it wrote is no error.
    (code, text.lines().filter(|line| !line.starts_with("wrote ")).map(|line| format!("{line}\n")).collect())
}

fn a_view_link_is_a_place_of_all_commands() {
    let folder = baked_city("houses.geojson".as_ref(), "city".as_ref());
    let folder = folder.path();
    let server = ServerProcess::serve(&folder.join("city"), "127.0.0.1:0").unwrap();
    let link = format!("insula://{}/v1/cities/city?{VIEW}&time=2024-06-21T12:00", server.address);
    let draw = |place: &str, out: &str, more: &[&str]| snapshot(folder, place.as_ref(), out.as_ref(), more);
    let ok = (Some(0), String::new());
    assert_eq!(draw(&link, "link.png", &[]), ok);
    let address = format!("http://{}", server.address);
    let camera = ["--camera", "camera.json"];
    assert_eq!(draw(&address, "address.png", &camera), ok);
    assert_eq!(draw(&link, "other.png", &camera), ok);
    assert_eq!(draw(&link, "noon.png", &["--camera", "camera.json", "--time", "2024-06-21T12:00"]), ok);
    let image = |name: &str| fs::read(folder.join(name)).unwrap();
    assert_ne!(image("link.png"), image("other.png"), "--camera comes before the link's");
    assert_ne!(image("address.png"), image("other.png"), "the light is the link's");
    assert_eq!(image("noon.png"), image("other.png"));
    // The address of a page, as a browser shows it.
    let page = format!("{address}/cities/city#{VIEW}&time=2024-06-21T12:00");
    assert_eq!(draw(&page, "page.png", &[]), ok);
    assert_eq!(image("page.png"), image("link.png"));
    // The first view, without a camera.
    assert_eq!(draw(&address, "first.png", &[]), ok);
    assert_ne!(image("first.png"), image("address.png"));
    let (code, error) = draw(&address, "far.png", &["--at-street", "4.3,-52.1"]);
    assert!(code == Some(2) && error.contains("--at-street"), "{error}");
    fs::write(
        folder.join("path.json"),
        format!(r#"{{"seconds": 0.1, "keys": [{}]}}"#, CAMERA.replacen('{', r#"{"t": 0, "#, 1)),
    )
    .unwrap();
    let fly = ["fly", "--path", "path.json", "--size", "64x48", "--adapter", "cpu", "--report", "fly.json", "--server"];
    let arguments: Vec<&OsStr> = fly.iter().map(OsStr::new).chain([OsStr::new(&link)]).collect();
    assert_eq!(call("insula", folder, &arguments), ok);
    // Without a screen there is no window, but the place is a city for both.
    for command in ["view", "open"] {
        for place in [link.as_ref(), OsStr::new("city")] {
            let (code, error) = call("insula", folder, &[command.as_ref(), place]);
            assert!(code == Some(1) && !error.contains("not a"), "{command}: {error}");
        }
        assert_eq!(call("insula", folder, &[command.as_ref(), "insula://".as_ref()]).0, Some(2));
    }
}

fn results_are_json_where_that_is_asked_for() {
    const MESH: &str = "v 0 0 0\nv 4 0 0\nv 0 4 0\nv 0 0 4\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    let folder = baked_city("in.geojson".as_ref(), "city".as_ref());
    fs::write(folder.path().join("a.obj"), MESH).unwrap();
    let keys = "one 0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef\n";
    fs::write(folder.path().join("keys"), keys).unwrap();
    for (line, fact) in [
        ("bake in.geojson --out other", "city_bytes"),
        ("verify city", "fault_count"),
        ("inspect city", "manifest"),
        ("objects city", "attributes"),
        ("export city --out rows.csv", "objects"),
        ("export city --out city.glb", "triangles"),
        ("changes city city --all --out changes.csv", "unchanged"),
        ("export city --format 3dtiles --out tiles", "files"),
        ("analyse city sky --out sky.tif", "roofs"),
        ("sign --city city --expires 1h --keys keys", "url"),
        ("compress a.obj a.insm", "bytes"),
        ("decompress a.insm b.obj", "vertices"),
        ("simplify a.obj c.obj --ratio 1", "largest_distance"),
        ("compare a.obj b.obj", "hausdorff"),
        ("ao a.obj --out ao.ply --views 4", "mean"),
    ] {
        let mut command = Process::new(program("insula-server").unwrap());
        let output = run(command.args(line.split(' ')).arg("--json").current_dir(folder.path())).unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
        let facts: serde_json::Value =
            serde_json::from_str(&text).unwrap_or_else(|error| panic!("{line}: {error}: {text}"));
        assert!(facts.get(fact).is_some(), "{line}: {text}");
    }
}

fn without_a_desktop_no_driver_complains() {
    let folder = baked_city("in.geojson".as_ref(), "city".as_ref());
    let mut command = Process::new(program("insula").unwrap());
    command.args(["snapshot", "city", "--size", "32x24", "--out", "any.png"]).current_dir(folder.path());
    let output = run(command.env_remove("XDG_RUNTIME_DIR")).unwrap();
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && !errors.contains("XDG_RUNTIME_DIR"), "{errors}");
}

#[cfg(target_os = "linux")]
fn names_that_are_not_text_work_everywhere() {
    use std::os::unix::ffi::OsStrExt;
    let [input, city, image, report] =
        [&b"in\xff/caf\xe9.geojson"[..], b"city\xfe", b"image\xff.png", b"report\xff.json"].map(OsStr::from_bytes);
    let folder = baked_city(input, city);
    let folder = folder.path();
    let ok = (Some(0), String::new());
    let server = |arguments: &[&OsStr]| assert_eq!(call("insula-server", folder, arguments), ok, "{arguments:?}");
    server(&["verify".as_ref(), city]);
    server(&["inspect".as_ref(), city, "--tile".as_ref(), "0/0/0".as_ref(), "--png".as_ref(), image]);
    // A folder of sources.
    server(&["bake".as_ref(), OsStr::from_bytes(b"in\xff"), "--out".as_ref(), city, "--report".as_ref(), report]);
    assert!(folder.join(report).is_file());
    fs::remove_file(folder.join(image)).unwrap();
    assert_eq!(snapshot(folder, city, image, &["--camera", "camera.json"]), ok);
    assert!(fs::metadata(folder.join(image)).unwrap().len() > 100);
    for command in ["view", "open"] {
        let (code, error) = call("insula", folder, &[command.as_ref(), city]);
        assert!(code == Some(1) && !error.contains("not a city"), "{error}");
    }
    let mut command = Process::new(program("insula-server").unwrap());
    ServerProcess::start(command.current_dir(folder), city, "127.0.0.1:0", &[]).unwrap();
}

#[cfg(target_os = "linux")]
fn a_cache_folder_that_cannot_be_written_is_a_warning() {
    let folder = baked_city("houses.geojson".as_ref(), "city".as_ref());
    let server = ServerProcess::serve(&folder.path().join("city"), "127.0.0.1:0").unwrap();
    let mut command = Process::new(program("insula").unwrap());
    command.args(["snapshot", "--camera", "camera.json", "--size", "64x48", "--adapter", "cpu", "--out", "a.png"]);
    command.args(["--disk-cache-mib", "8", "--server", &format!("http://{}", server.address)]);
    let output = run(command.current_dir(folder.path()).env("XDG_CACHE_HOME", "/proc/none")).unwrap();
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && folder.path().join("a.png").is_file(), "{text}");
    assert!(text.starts_with("warning: ") && text.contains("/proc/none") && text.lines().count() == 2, "{text}");
}

fn a_view_is_exported_with_its_camera() {
    let folder = baked_city("houses.geojson".as_ref(), "city".as_ref());
    let export_to = |out: &str, more: &[&str]| {
        let arguments = [&["export", "city", "--out", out], more].concat();
        let arguments: Vec<&OsStr> = arguments.into_iter().map(OsStr::new).collect();
        call("insula-server", folder.path(), &arguments)
    };
    let export = |more: &[&str]| export_to("view.glb", more);
    let view = ["--format", "glb", "--camera", "camera.json"];
    assert_eq!(export(&[&view[..], &["--tau", "2", "--size", "640x360"]].concat()), (Some(0), String::new()));
    // As people type it, and as a link has it.
    for camera in ["4.36740,52.00668,30,39,-29", VIEW] {
        assert_eq!(export(&["--camera", camera]), (Some(0), String::new()), "{camera}");
        let seen = ["--camera", camera];
        assert_eq!(snapshot(folder.path(), "city".as_ref(), "seen.png".as_ref(), &seen), (Some(0), String::new()));
    }
    assert_eq!(export(&view), (Some(0), String::new()));
    let glb = fs::read(folder.path().join("view.glb")).unwrap();
    let camera = br#""perspective":{"aspectRatio":1.7777777777777777,"yfov":1.04719755"#;
    assert!(glb.windows(camera.len()).any(|bytes| bytes == camera), "no camera");
    // The name tells the format. The text has the same bytes.
    let by_name = |name: &str| {
        let arguments = ["export", "city", "--out", name].map(OsStr::new);
        assert_eq!(call("insula-server", folder.path(), &arguments), (Some(0), String::new()), "{name}");
        fs::read(folder.path().join(name)).unwrap()
    };
    let (whole, text) = (by_name("all.glb"), by_name("all.gltf"));
    let model: serde_json::Value = serde_json::from_slice(&text).unwrap();
    let uri = model["buffers"][0]["uri"].as_str().unwrap();
    assert!(uri.starts_with("data:application/octet-stream;base64,") && text.len() > whole.len(), "{}", text.len());
    assert!(!by_name("all.csv").is_empty());
    fs::write(folder.path().join("here.json"), CAMERA.replace("85010, 447006, 4", "84980, 446970, 30")).unwrap();
    let away = CAMERA.replace("84980, 446970", "80000, 440000").replace("85010, 447006", "79000, 439000");
    fs::write(folder.path().join("away.json"), away).unwrap();
    let elsewhere = r#"{"type": "Polygon", "coordinates": [[[8, 44], [8.1, 44], [8.1, 44.1]]]}"#;
    fs::write(folder.path().join("away.geojson"), elsewhere).unwrap();
    for (out, more, words) in [
        ("rows.csv", &["--camera", "camera.json"][..], "--format glb"),
        ("rows.csv", &["--format", "geojson"], "another format"),
        ("-", &["--format", "csv"], "standard output"),
        ("model.obj", &[], "end it in .csv, .geojson"),
        ("plan.dxf", &[], "`insula draw`"),
        ("rows.csv", &["--bbox", "8,44,8.1,44.1"], "--bbox 8,44,8.1,44.1: beyond the city, which lies in 4.3"),
        ("rows.csv", &["--bbox-metres", "0,0,9,9"], "beyond the city, which lies in 8"),
        ("rows.csv", &["--polygon", "away.geojson"], "--polygon away.geojson: beyond the city"),
    ] {
        let (found, error) = export_to(out, more);
        assert!(found == Some(2) && error.contains(words) && !folder.path().join(out).exists(), "{out}: {error}");
    }
    for (more, code, words) in [
        (&["--format", "glb", "--camera", "none.json"][..], 2, "none.json"),
        (&["--format", "glb", "--camera", "here.json"], 2, "must differ"),
        (&["--format", "glb", "--camera", "houses.geojson"], 2, "unknown field"),
        (&["--format", "glb", "--tau", "2"], 2, "--camera"),
        (&["--format", "glb", "--camera", "away.json"], 1, "nothing to export"),
        (&["--camera", "84980,446970,30,40,-25,60"], 2, "no place in degrees: write LON,LAT"),
        (&["--camera", "52.00668,4.36740,30,39,-29"], 2, "write longitude first"),
        (&["--camera", "camera=4.36740,52.00668,30,39,-29,60"], 2, "is in degrees"),
    ] {
        let (found, error) = export(more);
        assert!(found == Some(code) && error.contains(words), "{more:?}: {found:?} {error}");
    }
}

fn a_city_at_an_address_is_drawn_as_its_folder_is() {
    let folder = baked_city("houses.geojson".as_ref(), "city".as_ref());
    let server = ServerProcess::serve(&folder.path().join("city"), "127.0.0.1:0").unwrap();
    let draw = |place: &str, out: &str| {
        let arguments = ["draw", place, "--axonometric", "20,30", "--out", out].map(OsStr::new);
        let (code, text) = call("insula", folder.path(), &arguments);
        assert_eq!(code, Some(0), "{text}");
        fs::read_to_string(folder.path().join(out)).unwrap()
    };
    let drawing = draw("city", "folder.svg");
    assert!(drawing.contains("<path"), "{drawing}");
    assert_eq!(draw(&format!("http://{}/v1/cities/city", server.address), "address.svg"), drawing);
    let missing = format!("http://{}/v1/cities/none", server.address);
    let missing = ["draw", &missing, "--plan", "--out", "none.svg"].map(OsStr::new);
    let (code, error) = call("insula", folder.path(), &missing);
    assert!(code == Some(1) && !folder.path().join("none.svg").exists(), "{error}");
}
