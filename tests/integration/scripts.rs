//! The Python scripts: each says how to use it, the second decoder reads the frozen tiles, and the faults that tests must catch
//! have a place. The page's service worker, by a script of Node.js. Without Python or Node.js, or a module that a script needs, they are reported as ignored.

use anyhow::{Context, Result, ensure};
use insula_tests::programs::{find_installed, run};
use insula_tests::trials::{Test, Trials};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Prints the scripts whose imports, and those of the scripts that they import, are not all installed. Starting each script would
/// take longer than most tests.
const PRINT_LACKING: &str = r#"
import ast, importlib.util, pathlib, sys

FOLDERS = [pathlib.Path(folder) for folder in ("load", "tools", "tools/formats")]
known = {}

def is_missing(name, folder):
    places = [place / name for place in (folder, *FOLDERS)]
    files = [file for place in places for file in (place.with_suffix(".py"), *sorted(place.glob("*.py"))) if file.is_file()]
    return any(map(lacks_a_module, files)) if files else importlib.util.find_spec(name) is None

def lacks_a_module(path):
    if path not in known:
        known[path] = False
        known[path] = any(is_missing(name, path.parent) for name in imports(path))
    return known[path]

def imports(path):
    body = ast.parse(path.read_text(encoding="utf-8")).body
    for node in [inner for node in body for inner in (node.body if isinstance(node, ast.Try) else [node])]:
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module] if isinstance(node, ast.ImportFrom) and node.level == 0 else []
        yield from (name.partition(".")[0] for name in names)

for path in sys.argv[1:]:
    if lacks_a_module(pathlib.Path(path)):
        print(path)
"#;

/// The tests of the second reader, which import it.
const READER_TESTS: &str = "tools/formats/test_second_reader.py";

pub(crate) fn add(trials: &mut Trials) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let has_python = find_installed("python3").is_some();
    let scripts = scripts(root);
    let files: Vec<&Path> = scripts.iter().map(PathBuf::as_path).chain([Path::new(READER_TESTS)]).collect();
    // If they cannot be told, all tests run, and fail.
    let lacking = if has_python { lacking(root, &files).unwrap_or_default() } else { Vec::new() };
    let is_ignored = |script: &Path| !has_python || lacking.iter().any(|path| path == script);
    trials.add(scripts.iter().map(|script| {
        let name = script.file_stem().unwrap_or_default().to_string_lossy();
        let path = root.join(script);
        Test::new(format!("{name}_explains_itself"), move || explains_itself(&path)).ignored_if(is_ignored(script))
    }));
    let [decoder, reader] = ["tools", "tools/formats"].map(|folder| root.join(folder));
    trials.add([
        Test::new("the_second_decoder_reads_the_frozen_tiles", move || passes_its_unit_tests(&decoder, &[]))
            .ignored_if(!has_python),
        Test::new("the_second_reader_of_formats_passes_its_tests", move || passes_its_unit_tests(&reader, &[]))
            .ignored_if(is_ignored(Path::new(READER_TESTS))),
        Test::new("faults_have_a_place", faults_have_a_place).ignored_if(!has_python),
        Test::new("the_service_worker_never_stands_before_the_network", service_worker)
            .ignored_if(find_installed("node").is_none()),
        Test::new("degrees_and_figures_of_the_page_are_right", page_geometry)
            .ignored_if(find_installed("node").is_none()),
    ]);
}

/// Runs the page's service worker on made-up caches, which fail, hang and are full.
fn service_worker() -> Result<()> {
    passes_in_node(["tools/service_worker.mjs", "../client/web/page/service-worker.js"])
}

/// Compares degrees, cameras and figures with known values.
fn page_geometry() -> Result<()> {
    passes_in_node(["tools/page_geometry.mjs", "../client/web/page"])
}

/// Runs a script of Node with a path.
fn passes_in_node(paths: [&str; 2]) -> Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let paths = paths.map(|path| root.join(path));
    let output = run(Command::new("node").args(&paths))?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Ok(())
}

/// Those of `scripts` that cannot start. Paths are from `root`.
fn lacking(root: &Path, scripts: &[&Path]) -> Result<Vec<PathBuf>> {
    let arguments: Vec<&str> = scripts.iter().filter_map(|path| path.to_str()).collect();
    let text = python(&[&["-c", PRINT_LACKING][..], &arguments].concat(), root)?;
    Ok(text.lines().map(PathBuf::from).collect())
}

/// The scripts that a person runs, by their paths from `root`.
fn scripts(root: &Path) -> Vec<PathBuf> {
    let files =
        ["load", "tools", "tools/formats"].iter().filter_map(|folder| root.join(folder).read_dir().ok()).flatten();
    let paths = files.filter_map(|file| Some(file.ok()?.path().strip_prefix(root).ok()?.to_owned()));
    let is_script = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.ends_with(".py") && !name.starts_with("test_")
    };
    let mut scripts: Vec<PathBuf> = paths.filter(is_script).collect();
    scripts.sort();
    scripts
}

fn python(arguments: &[&str], folder: &Path) -> Result<String> {
    python_with(&[], arguments, folder)
}

fn python_with(variables: &[(&str, &Path)], arguments: &[&str], folder: &Path) -> Result<String> {
    let mut command = Command::new("python3");
    command.envs(variables.iter().copied());
    let output = run(command.arg("-B").args(arguments).current_dir(folder))?;
    let text = [output.stdout, output.stderr].concat();
    let text = String::from_utf8_lossy(&text).into_owned();
    ensure!(output.status.success(), "{text}");
    Ok(text)
}

fn explains_itself(script: &Path) -> Result<()> {
    let name = script.file_name().and_then(|name| name.to_str()).context("no name")?;
    let help = python(&[name, "--help"], script.parent().context("no folder")?)?;
    ensure!(help.contains("usage: ") && help.contains(name), "{help}");
    Ok(())
}

/// Each fault of `mutations.toml` changes one line that exists.
fn faults_have_a_place() -> Result<()> {
    python(&["mutations.py", "--check"], &Path::new(env!("CARGO_MANIFEST_DIR")).join("tools"))?;
    Ok(())
}

/// Runs the unit tests of a folder, with these variables of the environment.
pub(crate) fn passes_its_unit_tests(folder: &Path, variables: &[(&str, &Path)]) -> Result<()> {
    python_with(variables, &["-m", "unittest", "discover"], folder)?;
    Ok(())
}
