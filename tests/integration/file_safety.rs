//! No command removes, replaces or endlessly reads a file that it should not: every option of both programs that is a path has a case.

use super::random_commands::COMMANDS;
use clap::{Command, CommandFactory};
use insula_client::args::Cli;
use insula_server::args::Args;
use insula_test_support::programs::program;
use insula_tests::tests;
use insula_tests::trials::Trials;
use std::any::TypeId;
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command as Process, Output, Stdio};

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![
        every_path_of_the_command_lines_has_a_case,
        each_output_is_one_of_the_random_commands,
        outputs_replace_only_earlier_outputs,
        files_that_a_pattern_names_are_inputs,
        outputs_that_cannot_be_written_are_refused_before_the_work,
        folders_are_written_outside_of_kept_ones,
        folders_that_are_read_stay_as_they_are,
        addresses_without_an_answer_are_errors_that_show_no_password
    ]);
    #[cfg(target_os = "linux")]
    trials.add(tests![inputs_that_are_no_regular_files_are_refused]);
}

/// What a path of a command line is.
#[derive(Debug, Clone, Copy)]
enum PathUse {
    /// A file that is read: a command line, in which `{}` is the path, and the end of a name that the command takes.
    Reads(&'static str, &'static str),
    /// The same of a file that is written.
    Writes(&'static str, &'static str),
    /// A folder or the place of a city that is read.
    ReadsFolder(&'static str),
    WritesFolder(&'static str),
    /// A text, or a reason why there is no case.
    Else(&'static str),
}
use PathUse::{Else, Reads, ReadsFolder, Writes, WritesFolder};

/// What lines have in common.
const SHORT: [(&str, &str); 4] = [
    ("SNAPSHOT", "insula snapshot --server city --camera camera.json SMALL"),
    ("SMALL", "--size 16x12 --adapter cpu"),
    ("SERVE", "serve city --listen 127.0.0.1:0"),
    ("AREA", "--bbox-metres 0,0,9,9"),
];

const TEXT: PathUse = Else("a text");
/// Nobody answers here.
const ADDRESS: &str = "http://me:s3cret@127.0.0.1:9/x";

/// All options and arguments that are paths or texts, by program and command.
const CASES: &[(&str, &[&str], PathUse)] = &[
    ("insula-server bake", &["inputs"], Reads("bake {} --out new", ".obj")),
    ("insula-server bake", &["step_inputs"], Reads("bake plan --inputs {} --work steps", ".obj")),
    ("insula-server bake", &["streets"], Reads("bake town.geojson --out new --streets {}", ".geojson")),
    ("insula-server bake", &["surroundings"], Reads("bake town.geojson --out new --surroundings {}", ".asc")),
    ("insula-server bake", &["landmarks"], Reads("bake town.geojson --out new --landmarks {}", ".json")),
    ("insula-server bake", &["stone"], Reads("bake a.off --out new --stone {}", ".json")),
    ("insula-server bake", &["palette"], Reads("bake town.geojson --out new --palette {}", ".json")),
    ("insula-server bake", &["labels"], Reads("bake town.geojson --out new --labels {}", ".toml")),
    ("insula-server bake", &["proposal"], Reads("bake town.geojson --out new --reuse city --proposal {}", ".toml")),
    ("insula-server bake", &["reuse"], ReadsFolder("bake town.geojson --cell 4 --out new --reuse {}")),
    (
        "insula-server bake",
        &["version_of"],
        ReadsFolder("bake town.geojson --cell 4 --out new --date 2024-01-31 --version-of {}"),
    ),
    ("insula-server bake", &["report"], Writes("bake town.geojson --cell 4 --out baked --report {}", ".json")),
    ("insula-server bake", &["out"], WritesFolder("bake town.geojson --cell 4 --out {}")),
    ("insula-server bake", &["work"], WritesFolder("bake plan --inputs town.geojson --cell 4 --work {}")),
    ("insula-server bake", &["texture_root"], ReadsFolder("bake a.off --out new --texture-root {}")),
    ("insula-server bake", &["grids"], ReadsFolder("bake a.off --out new --grids {}")),
    ("insula-server bake", &["job", "crs", "date", "name", "title", "attribution", "licence", "source_url"], TEXT),
    ("insula-server bake", &["only", "skip", "height_field", "drop", "search", "axis_order", "allow_host"], TEXT),
    ("insula-server serve", &["config"], Reads("SERVE --config {}", ".toml")),
    ("insula-server serve", &["set"], Reads("SERVE --set tls.certificate={} --set tls.key={}", ".pem")),
    ("insula-server serve", &["cities"], Else("it runs until it is stopped; its tests are those of the server")),
    ("insula-server serve", &["proposals"], Else("it runs until it is stopped; a folder that is none is a warning")),
    ("insula-server serve", &["listen", "metrics_address"], TEXT),
    ("insula-server sign", &["keys"], Reads("sign --city city --expires 1h --keys {}", ".keys")),
    ("insula-server sign", &["config"], Reads("sign --city city --expires 1h --config {}", ".toml")),
    ("insula-server sign", &["city"], Else("a name, or the folder of a city, which is opened as by other commands")),
    ("insula-server sign", &["version"], TEXT),
    ("insula-server publish", &["cities"], ReadsFolder("publish {} --out new")),
    ("insula-server publish", &["out"], WritesFolder("publish city --out {}")),
    ("insula-server publish", &["config"], Reads("publish city --out site --config {}", ".toml")),
    ("insula-server publish", &["proposals"], ReadsFolder("publish city --out new-site --proposals {}")),
    ("insula-server publish", &["title", "url"], TEXT),
    ("insula-server inspect", &["city"], Reads("inspect {}", ".obj")),
    ("insula-server inspect", &["png"], Writes("inspect city --tile 0/0/0 --png {}", ".png")),
    ("insula-server inspect", &["ply"], Writes("inspect city --volume 0/0/0 --ply {}", ".ply")),
    ("insula-server inspect", &["grids"], ReadsFolder("inspect town.geojson --grids {}")),
    ("insula-server inspect", &["crs", "only", "skip", "height_field", "drop"], TEXT),
    ("insula-server inspect", &["search", "axis_order", "allow_host"], TEXT),
    ("insula-server objects", &["city"], ReadsFolder("objects {}")),
    ("insula-server search", &["city"], ReadsFolder("search {} Hall")),
    ("insula-server search", &["text"], TEXT),
    ("insula-server analyse", &["rule"], Reads("analyse city sun AREA --out new.tif --rule {}", ".toml")),
    ("insula-server analyse", &["points"], Reads("analyse city sun --rule en-17037 --out new.csv --points {}", ".csv")),
    ("insula-server analyse", &["between"], Reads("analyse city view --out new.csv --between {} town.geojson", ".csv")),
    ("insula-server analyse", &["weather"], Reads("analyse city solar --out new.tif --weather {}", ".epw")),
    ("insula-server analyse", &["vista"], Reads("analyse city view --out new.tif --vista {}", ".geojson")),
    ("insula-server analyse", &["gardens"], Reads("analyse city sky --out new.tif --gardens {}", ".geojson")),
    ("insula-server analyse", &["of"], Reads("analyse city view --height 9 --out new.tif --of {}", ".geojson")),
    ("insula-server analyse", &["proposal"], Reads("analyse city sky AREA --out new.tif --proposal {}", ".toml")),
    ("insula-server analyse", &["out"], Writes("analyse city sky --out {}", ".tif")),
    ("insula-server analyse", &["buildings"], Writes("analyse city sky --out sky.tif --buildings {}", ".csv")),
    ("insula-server analyse", &["pdf"], Writes("analyse city sky --out sky.tif --pdf {}", ".pdf")),
    ("insula-server analyse", &["city"], ReadsFolder("analyse {} sky --out new.tif")),
    (
        "insula-server analyse",
        &["evidence"],
        WritesFolder("analyse city sun --rule en-17037 --points points.csv --out new.csv --evidence {}"),
    ),
    ("insula-server analyse", &["time", "times", "time_zone"], TEXT),
    ("insula-server changes", &["before"], ReadsFolder("changes {} city --out new.csv")),
    ("insula-server changes", &["after"], ReadsFolder("changes city {} --out new.csv")),
    ("insula-server changes", &["attribute"], TEXT),
    ("insula-server changes", &["out"], Writes("changes city city --out {}", ".csv")),
    ("insula-server export", &["polygon"], Reads("export city --format csv --out new.csv --polygon {}", ".geojson")),
    ("insula-server export", &["view"], Reads("export city --format glb --out new.glb --camera {}", ".json")),
    ("insula-server export", &["out"], Writes("export city --format csv --out {}", ".csv")),
    ("insula-server export", &["out"], WritesFolder("export city --format 3dtiles --out {}")),
    ("insula-server export", &["city"], ReadsFolder("export {} --format csv --out new.csv")),
    ("insula-server export", &["filter"], TEXT),
    ("insula-server verify", &["city"], ReadsFolder("verify {}")),
    ("insula-server compress", &["input"], Reads("compress {} new.insm", ".off")),
    ("insula-server compress", &["output"], Writes("compress a.off {}", ".insm")),
    ("insula-server decompress", &["input"], Reads("decompress {} new.off", ".insm")),
    ("insula-server decompress", &["output"], Writes("decompress a.insm {}", ".ply")),
    ("insula-server simplify", &["input"], Reads("simplify {} new.off --ratio 0.5", ".off")),
    ("insula-server simplify", &["output"], Writes("simplify a.off {} --ratio 0.5", ".obj")),
    ("insula-server compare", &["a"], Reads("compare {} a.off", ".off")),
    ("insula-server compare", &["b"], Reads("compare a.off {}", ".off")),
    ("insula-server compare", &["heatmap"], Writes("compare a.off b.off --samples 9 --heatmap {}", ".ply")),
    ("insula-server ao", &["mesh"], Reads("ao {} --out new.ply", ".off")),
    ("insula-server ao", &["out"], Writes("ao a.off --views 16 --map 64 --out {}", ".ply")),
    ("insula-server man", &["out"], WritesFolder("man --out {}")),
    ("insula man", &["out"], WritesFolder("insula man --out {}")),
    ("insula view", &["place"], ReadsFolder("insula view {}")),
    ("insula view", &["server"], ReadsFolder("insula view --server {}")),
    ("insula view", &["camera"], Reads("insula view city --camera {}", ".json")),
    ("insula view", &["path"], Reads("insula view city --path {}", ".json")),
    ("insula view", &["proposal"], Reads("insula view city --proposal {}", ".toml")),
    ("insula open", &["inputs"], Reads("insula open {}", ".obj")),
    ("insula open", &["server"], Reads("insula open --server {}", ".obj")),
    ("insula open", &["palette"], Reads("insula open town.geojson --palette {}", ".json")),
    ("insula demo", &["out"], Else("bakes for minutes; its check is that of `snapshot`")),
    ("insula snapshot", &["place"], ReadsFolder("insula snapshot {} SMALL --out new.png")),
    ("insula snapshot", &["server"], ReadsFolder("insula snapshot --server {} SMALL --out new.png")),
    ("insula snapshot", &["camera"], Reads("insula snapshot --server city SMALL --out new.png --camera {}", ".json")),
    ("insula snapshot", &["proposal"], Reads("SNAPSHOT --out new.png --proposal {}", ".toml")),
    ("insula snapshot", &["out"], Writes("SNAPSHOT --out {}", ".png")),
    ("insula snapshot", &["distance"], Writes("SNAPSHOT --out p.png --distance {}", ".pfm")),
    ("insula snapshot", &["radiance"], Writes("SNAPSHOT --out p.png --radiance {}", ".pfm")),
    ("insula snapshot", &["objects"], Writes("SNAPSHOT --out p.png --objects {}", ".bin")),
    ("insula snapshot", &["objects_json"], Writes("SNAPSHOT --out p.png --objects-json {}", ".json")),
    ("insula snapshot", &["report"], Writes("SNAPSHOT --out p.png --report {}", ".json")),
    ("insula snapshot", &["color_by", "filter"], TEXT),
    ("insula fly", &["place"], ReadsFolder("insula fly {} SMALL --path path.json")),
    ("insula fly", &["server"], ReadsFolder("insula fly --server {} SMALL --path path.json")),
    ("insula fly", &["path"], Reads("insula fly --server city SMALL --path {}", ".json")),
    ("insula fly", &["report"], Writes("insula fly --server city SMALL --path path.json --report {}", ".json")),
    ("insula draw", &["sources"], Reads("insula draw {} --plan --out new.svg", ".obj")),
    ("insula draw", &["server"], Reads("insula draw --server {} --plan --out new.svg", ".obj")),
    ("insula draw", &["view"], Reads("insula draw city --out new.svg --camera {}", ".json")),
    ("insula draw", &["style"], Reads("insula draw city --plan --out new.svg --style {}", ".toml")),
    ("insula draw", &["out"], Writes("insula draw city --plan --out {}", ".svg")),
    ("insula draw", &["filter", "color_by", "paper", "title"], TEXT),
    ("insula", &["city"], TEXT),
];

/// Arguments of a program's commands that are of one of these types, by program and command.
fn in_help(program: &Command, types: &[TypeId]) -> BTreeMap<String, BTreeSet<String>> {
    let name = program.get_name();
    let named = |command: &Command| {
        if command.get_name() == name { name.to_owned() } else { format!("{name} {}", command.get_name()) }
    };
    let of = |command: &Command| -> BTreeSet<String> {
        let all = command.get_arguments().filter(|argument| {
            let parser = argument.get_value_parser();
            let is_choice = parser.possible_values().is_some();
            argument.get_action().takes_values() && !is_choice && types.iter().any(|kind| parser.type_id() == *kind)
        });
        all.map(|argument| argument.get_id().to_string()).collect()
    };
    let commands = program.get_subcommands().chain([program]);
    commands.map(|command| (named(command), of(command))).filter(|(_, found)| !found.is_empty()).collect()
}

fn every_path_of_the_command_lines_has_a_case() {
    let of_types = |types: &[TypeId]| -> BTreeMap<_, _> {
        in_help(&Cli::command(), types).into_iter().chain(in_help(&Args::command(), types)).collect()
    };
    let existing = of_types(&[TypeId::of::<PathBuf>(), TypeId::of::<OsString>(), TypeId::of::<String>()]);
    let paths = of_types(&[TypeId::of::<PathBuf>()]);
    let mut known = BTreeMap::<String, BTreeSet<String>>::new();
    for (command, names, kind) in CASES {
        if let Else(reason) = kind {
            assert!(!reason.is_empty(), "{command} {names:?}: no reason");
            let is_path = |name: &&str| paths.get(*command).is_some_and(|paths| paths.contains(*name));
            assert!(*reason != "a text" || !names.iter().any(is_path), "{command} {names:?}: a path is no text");
        }
        known.entry((*command).to_owned()).or_default().extend(names.iter().map(|name| (*name).to_owned()));
    }
    for (command, names) in &existing {
        let missing: Vec<_> = names.difference(known.get(command).unwrap_or(&BTreeSet::new())).cloned().collect();
        assert!(missing.is_empty(), "{command}: no case for {missing:?}: does it read, write or remove files?");
    }
    for (command, names) in &known {
        let gone: Vec<_> = names.difference(existing.get(command).unwrap_or(&BTreeSet::new())).cloned().collect();
        assert!(gone.is_empty(), "{command}: {gone:?} does not exist");
    }
}

/// Program and command of a line.
fn command_of(line: &str) -> [&str; 2] {
    let mut words = line.split(' ');
    match words.next() {
        Some("SNAPSHOT") => ["insula", "snapshot"],
        Some("insula") => ["insula", words.next().unwrap_or_default()],
        command => ["insula-server", command.unwrap_or_default()],
    }
}

fn each_output_is_one_of_the_random_commands() {
    for line in CASES.iter().filter_map(|(.., kind)| match kind {
        Writes(line, _) | WritesFolder(line) => Some(*line),
        _ => None,
    }) {
        let (before, _) = line.split_once(" {}").unwrap();
        let option = before.rsplit(' ').next().filter(|word| word.starts_with("--"));
        let is_known = COMMANDS.iter().any(|known| {
            command_of(known) == command_of(line) && option.is_none_or(|option| known.split(' ').any(|w| w == option))
        });
        assert!(is_known, "{line}: no line of `random_commands` has this output");
    }
}

/// A folder with inputs of all commands, a city, a site and a work store.
pub(crate) struct Workplace(tempfile::TempDir);

pub(crate) const TOWN: &str = r#"{"type":"FeatureCollection","features":[{"type":"Feature","id":"a","properties":{"height":9,"name":"Hall"},
    "geometry":{"type":"Polygon","coordinates":[[[4.36,52.01],[4.3602,52.01],[4.3602,52.0101],[4.36,52.0101],[4.36,52.01]]]}}]}"#;
const OFF: &str = "OFF\n5 6 0\n0 0 0\n10 0 0\n10 8 0\n0 8 0\n4 3 7\n4 3 2 1 0\n3 0 1 4\n3 1 2 4\n3 2 3 4\n3 3 0 4\n";
const CAMERA: &str = r#"{"position":[0,-100,60],"target":[10,0,0],"up":[0,0,1],"fov_y_deg":60}"#;

impl Workplace {
    pub(crate) fn new() -> Self {
        let place = Self(tempfile::tempdir().unwrap());
        for (name, text) in [
            ("town.geojson", TOWN),
            ("a.off", OFF),
            ("b.off", &OFF.replace("4 3 7", "4 3 8")),
            ("camera.json", CAMERA),
            ("points.csv", "lon,lat,height\n4.3601,52.01005,0\n"),
            ("path.json", &format!(r#"{{"seconds":0.05,"keys":[{}]}}"#, CAMERA.replacen('{', r#"{"t":0,"#, 1))),
            ("site/insula-site.json", r#"{"assets":"a","cities":[],"files":{}}"#),
            ("site/index.html", "dear"),
            ("plan.toml", "[[add]]\nfile = \"a.off\"\nplace = [4.3601, 52.01005]\nbase_m = 30\n"),
        ] {
            place.write(name, text);
        }
        for line in [
            "bake town.geojson --out city --cell 4 --name city",
            "bake plan --inputs town.geojson --work work --cell 4",
            "bake scan 0 --work work",
            "compress a.off a.insm",
        ] {
            let output = place.run(line);
            assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
        }
        place
    }

    /// Another one with the same files.
    pub(crate) fn copy(&self) -> Self {
        let place = Self(tempfile::tempdir().unwrap());
        for (path, bytes) in tree(self.0.path()) {
            let path = place.0.path().join(path.strip_prefix(self.0.path()).unwrap());
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, bytes).unwrap();
        }
        place
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, text: &str) {
        fs::create_dir_all(self.path(name).parent().unwrap()).unwrap();
        fs::write(self.path(name), text).unwrap();
    }

    /// Runs a command line of `insula-server`, or of the program that it begins with, with a limit of memory where that is possible.
    fn run(&self, line: &str) -> Output {
        self.run_for(line, "60")
    }

    /// The same, ended or killed (`-s KILL`) after so many seconds where that is possible.
    pub(crate) fn run_for(&self, line: &str, timeout: &str) -> Output {
        let line = SHORT.iter().fold(line.to_owned(), |line, (word, words)| line.replacen(word, words, 1));
        let (name, words) = match line.strip_prefix("insula ") {
            Some(rest) => ("insula", rest),
            None => ("insula-server", line.as_str()),
        };
        let program = program(name).unwrap();
        let mut command = if cfg!(target_os = "linux") {
            let mut shell = Process::new("sh");
            // A file without an end would fill the memory, and one that nobody writes would never end.
            shell.args(["-c", &format!("ulimit -v 8000000; exec timeout {timeout} \"$@\""), "sh"]).arg(program);
            shell
        } else {
            Process::new(program)
        };
        command.args(words.split_whitespace()).current_dir(self.0.path());
        for name in ["RUST_LOG", "DISPLAY", "WAYLAND_DISPLAY", "INSULA_JOB"] {
            command.env_remove(name);
        }
        command.env("XDG_CACHE_HOME", self.path(".cache")).stdin(Stdio::null()).output().unwrap()
    }
}

/// Every file below a folder with its content, without those of the programs' cache. Links and pipes have none.
pub(crate) fn tree(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
            let kind = entry.file_type().unwrap();
            if kind.is_dir() {
                if entry.file_name() != ".cache" {
                    open.push(entry.path());
                }
            } else {
                let bytes = if kind.is_file() { fs::read(entry.path()).unwrap() } else { Vec::new() };
                found.insert(entry.path(), bytes);
            }
        }
    }
    found
}

/// An output is refused in the place of an input, of a file of a city, a site and a work store, and of another file; it takes a new
/// place, and that again.
fn outputs_replace_only_earlier_outputs() {
    let place = Workplace::new();
    for (command, names, line, end) in CASES.iter().filter_map(|(command, names, kind)| match kind {
        Writes(line, end) => Some((command, names, line, end)),
        _ => None,
    }) {
        let what = format!("{command} {}", names[0]);
        let with = |path: &str| line.replace("{}", path);
        place.write(&format!("foreign{end}"), "my very dear thesis");
        let mut refused: Vec<String> =
            ["city", "city/more", "site", "work", "work/scan"].map(|folder| format!("{folder}/new{end}")).into();
        refused.push(format!("foreign{end}"));
        // Links to what must not be written, with a name that the command takes.
        for (number, target) in [
            "town.geojson", "a.off", "camera.json", "path.json", "city/city.json", "city/blockmaps.pmtiles",
            "work/job.json",
        ]
        .into_iter()
        .enumerate()
        {
            let link = format!("link-{number}{end}");
            let _ = fs::remove_file(place.path(&link));
            #[cfg(unix)]
            std::os::unix::fs::symlink(place.path(target), place.path(&link)).unwrap();
            refused.push(if cfg!(unix) { link } else { target.to_owned() });
        }
        for path in refused {
            // An input of the command that is replaced by its like is still an input.
            let before = tree(place.0.path());
            let output = place.run(&with(&path));
            let text = String::from_utf8_lossy(&output.stderr);
            assert!(matches!(output.status.code(), Some(1 | 2)), "{what} to {path}: {:?} {text}", output.status);
            assert!(tree(place.0.path()) == before, "{what} to {path} changed files: {text}");
        }
        let new = format!("out-{}-{}{end}", command.replace(' ', "-"), names[0]);
        for path in [new.clone(), new, format!("foreign{end}")] {
            // Any file could be the bare words of a `.bin`.
            let is_unknown = path.starts_with("foreign") || *end == ".bin" && place.path(&path).exists();
            let output = place.run(&(with(&path) + if is_unknown { " --overwrite" } else { "" }));
            assert!(output.status.success(), "{what} to {path}: {}", String::from_utf8_lossy(&output.stderr));
            assert_ne!(fs::read(place.path(&path)).unwrap(), b"my very dear thesis");
            assert!(
                !tree(place.0.path()).keys().any(|path| path.to_string_lossy().ends_with(".tmp")),
                "{what} leaves a file"
            );
        }
        if line.matches("p.png").count() == 1 {
            let before = tree(place.0.path());
            assert!(!place.run(&with("p.png")).status.success(), "{what}: two outputs of one name");
            assert!(tree(place.0.path()) == before, "{what}: two outputs of one name");
        }
    }
}

/// An input of a pattern, of the kind of the output, is not replaced.
fn files_that_a_pattern_names_are_inputs() {
    let place = Workplace::new();
    let made = place.run("compare a.off b.off --samples 9 --heatmap mine.ply");
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let before = tree(place.0.path());
    let output = place.run("compare mine* b.off --samples 9 --heatmap mine.ply");
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && text.contains("the input"), "{text}");
    assert!(tree(place.0.path()) == before, "{text}");
}

/// Nothing is written, not even another output, if the folder of an output does not exist or is none.
fn outputs_that_cannot_be_written_are_refused_before_the_work() {
    let place = Workplace::new();
    let before = tree(place.0.path());
    let lines = CASES.iter().flat_map(|(.., kind)| match kind {
        Writes(line, end) => vec![(line, format!("none/new{end}")), (line, format!("a.off/new{end}"))],
        WritesFolder(line) => vec![(line, "a.off/new".to_owned())],
        _ => Vec::new(),
    });
    for (line, path) in lines {
        let output = place.run(&line.replace("{}", &path));
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(matches!(output.status.code(), Some(1..=3)), "{line} to {path}: {:?} {text}", output.status);
        assert!(text.lines().last().is_some_and(|line| line.starts_with("error: ")), "{line} to {path}: {text}");
        assert!(tree(place.0.path()) == before, "{line} to {path} changed files: {text}");
    }
}

/// No folder is written into a city, a site or a work store, also by a path through a folder that would be created on the way.
fn folders_are_written_outside_of_kept_ones() {
    let place = Workplace::new();
    let lines = CASES.iter().filter_map(|(.., kind)| if let WritesFolder(line) = kind { Some(line) } else { None });
    for line in lines {
        let of_kept = ["city", "site", "work"].map(|kept| [format!("{kept}/new"), format!("none/../{kept}/new")]);
        for folder in of_kept.concat() {
            let before = tree(place.0.path());
            let output = place.run(&line.replace("{}", &folder));
            let text = String::from_utf8_lossy(&output.stderr);
            assert!(matches!(output.status.code(), Some(1..=3)), "{line} to {folder}: {:?} {text}", output.status);
            assert!(tree(place.0.path()) == before, "{line} to {folder} changed files: {text}");
            let _ = fs::remove_dir(place.path("none"));
        }
    }
}

fn folders_that_are_read_stay_as_they_are() {
    let place = Workplace::new();
    let before = tree(&place.path("city"));
    let lines = CASES.iter().filter_map(|(.., kind)| if let ReadsFolder(line) = kind { Some(line) } else { None });
    for line in lines {
        let output = place.run(&line.replace("{}", "city"));
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(matches!(output.status.code(), Some(0..=3)), "{line}: {:?} {text}", output.status);
        assert!(tree(&place.path("city")) == before, "{line} changed the city: {text}");
    }
}

/// An address in the place of each file and city that is read.
fn addresses_without_an_answer_are_errors_that_show_no_password() {
    let place = Workplace::new();
    for (line, end) in CASES.iter().filter_map(|(.., kind)| match kind {
        Reads(line, end) => Some((*line, *end)),
        ReadsFolder(line) => Some((*line, "")),
        _ => None,
    }) {
        // Viewers ask again for some time.
        let asks_again =
            ["insula draw ", "insula fly ", "insula snapshot "].iter().any(|start| line.starts_with(start));
        let timeout = if asks_again { " --timeout 1" } else { "" };
        let before = tree(place.0.path());
        let output = place.run(&(line.replace("{}", &format!("{ADDRESS}{end}")) + timeout));
        let [text, out] = [&output.stderr, &output.stdout].map(|bytes| String::from_utf8_lossy(bytes));
        assert!(matches!(output.status.code(), Some(1..=3)), "{line}: {:?} {text}", output.status);
        assert!(text.lines().last().is_some_and(|line| line.starts_with("error: ")), "{line}: {text}");
        assert!(!text.contains("s3cret") && !out.contains("s3cret"), "{line}: {text} {out}");
        assert!(tree(place.0.path()) == before, "{line} changed files: {text}");
    }
}

/// Pipes, devices and files without an end fail at once, and take no memory.
#[cfg(target_os = "linux")]
fn inputs_that_are_no_regular_files_are_refused() {
    let place = Workplace::new();
    let cases = CASES.iter().filter_map(|(command, names, kind)| match kind {
        Reads(line, end) => Some((command, names, line, end)),
        _ => None,
    });
    for (command, names, line, end) in cases {
        let (pipe, zero) = (format!("pipe{end}"), format!("zero{end}"));
        if !place.path(&pipe).exists() {
            assert!(Process::new("mkfifo").arg(place.path(&pipe)).status().unwrap().success());
            std::os::unix::fs::symlink("/dev/zero", place.path(&zero)).unwrap();
        }
        for path in [pipe, zero] {
            let output = place.run(&line.replace("{}", &path));
            let text = String::from_utf8_lossy(&output.stderr);
            let what = format!("{command} {} of {path}", names[0]);
            assert!(matches!(output.status.code(), Some(1..=3)), "{what}: {:?} {text}", output.status);
            assert!(text.lines().last().is_some_and(|line| line.starts_with("error: ")), "{what}: {text}");
        }
    }
}
