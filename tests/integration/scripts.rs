//! The Python scripts: each says how to use it, the second decoder reads the frozen tiles, and the faults that tests must catch
//! have a place. Without Python, or a module that a
//! script needs, they are reported as ignored.

use anyhow::{Context, Result, ensure};
use insula_tests::programs::{find_installed, run};
use libtest_mimic::{Arguments, Failed, Trial};
use std::{
    path::{Path, PathBuf},
    process::Command,
};

fn main() {
    let has_python = find_installed("python3").is_some();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let trial = |name: String, test: fn(&Path) -> Result<()>, path: PathBuf| {
        let is_ignored = !has_python || path.is_file() && lacks_a_module(&path);
        let test = move || test(&path).map_err(|error| Failed::from(format!("{error:#}")));
        Trial::test(name, test).with_ignored_flag(is_ignored)
    };
    let mut trials: Vec<Trial> = scripts(root)
        .into_iter()
        .map(|script| {
            let name = script.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            trial(format!("{name}_explains_itself"), explains_itself, script)
        })
        .collect();
    let decoder = "the_second_decoder_reads_the_frozen_tiles".to_owned();
    trials.push(trial(decoder, passes_its_unit_tests, root.join("tools")));
    let reader = "the_second_reader_of_formats_passes_its_tests".to_owned();
    let formats = root.join("tools/formats");
    let has_modules =
        has_python && python(&["-c", "import test_second_reader as t; assert not t.MISSING"], &formats).is_ok();
    trials.push(trial(reader, passes_its_unit_tests, formats).with_ignored_flag(!has_modules));
    trials.push(trial("faults_have_a_place".to_owned(), faults_have_a_place, root.join("tools/mutations.py")));
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}

/// The scripts that a person runs.
fn scripts(root: &Path) -> Vec<PathBuf> {
    let files =
        ["load", "tools", "tools/formats"].iter().filter_map(|folder| root.join(folder).read_dir().ok()).flatten();
    let paths = files.filter_map(|file| Some(file.ok()?.path()));
    let is_script = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.ends_with(".py") && !name.starts_with("test_")
    };
    let mut scripts: Vec<PathBuf> = paths.filter(is_script).collect();
    scripts.sort();
    scripts
}

fn python(arguments: &[&str], folder: &Path) -> Result<String> {
    let mut command = Command::new("python3");
    let output = run(command.arg("-B").args(arguments).current_dir(folder))?;
    let text = [output.stdout, output.stderr].concat();
    let text = String::from_utf8_lossy(&text).into_owned();
    ensure!(output.status.success(), "{text}");
    Ok(text)
}

fn help_of(script: &Path) -> Result<String> {
    let name = script.file_name().and_then(|name| name.to_str()).context("no name")?;
    python(&[name, "--help"], script.parent().context("no folder")?)
}

fn lacks_a_module(script: &Path) -> bool {
    help_of(script).is_err_and(|error| error.to_string().contains("ModuleNotFoundError"))
}

fn explains_itself(script: &Path) -> Result<()> {
    let name = script.file_name().and_then(|name| name.to_str()).context("no name")?;
    let help = help_of(script)?;
    ensure!(help.contains("usage: ") && help.contains(name), "{help}");
    Ok(())
}

/// Each fault of `mutations.toml` changes one line that exists.
fn faults_have_a_place(script: &Path) -> Result<()> {
    python(&["mutations.py", "--check"], script.parent().context("no folder")?)?;
    Ok(())
}

fn passes_its_unit_tests(folder: &Path) -> Result<()> {
    python(&["-m", "unittest", "discover"], folder)?;
    Ok(())
}
