//! Bakes that are killed at random states and resumed end with the same files as an undisturbed bake, and no others.

use crate::test_server::PATIENCE;
use insula_test_support::rng::Rng;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};
use std::{fs, thread};

/// Pause between two looks at the files of a bake.
const POLL: Duration = Duration::from_millis(1);

/// Bakes `input` to `out`. `temporary` is the system's folder for temporary files, which must stay empty.
fn bake(input: &Path, out: &Path, temporary: &Path, options: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_insula-server"));
    command.arg("bake").arg(input).arg("--out").arg(out).args(options).env("TMPDIR", temporary);
    command.env_remove("RUST_LOG").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    names(folder).into_iter().map(|name| (name.clone(), fs::read(folder.join(name)).unwrap())).collect()
}

fn write_city(folder: &Path, files: &BTreeMap<String, Vec<u8>>) {
    fs::create_dir(folder).unwrap();
    files.iter().for_each(|(name, bytes)| fs::write(folder.join(name), bytes).unwrap());
}

/// Adds the path of every file below a folder, in which a bake may create and remove files meanwhile.
fn add_paths(folder: &Path, found: &mut BTreeSet<PathBuf>) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            add_paths(&entry.path(), found);
        } else {
            found.insert(entry.path());
        }
    }
}

/// Runs a bake, and kills it when so many files have appeared in its scratch folder. Returns how it ended, and the number of files
/// that appeared.
fn run_and_kill(mut bake: Command, out: &Path, after_files: usize) -> (ExitStatus, usize) {
    let scratch = out.with_extension("partial");
    let mut found = BTreeSet::new();
    add_paths(&scratch, &mut found);
    let earlier = found.len();
    let mut child = bake.spawn().unwrap();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        add_paths(&scratch, &mut found);
        if found.len() - earlier >= after_files {
            child.kill().unwrap();
            break child.wait().unwrap();
        }
        thread::sleep(POLL);
    };
    (status, found.len() - earlier)
}

/// Bakes cities that are killed one to three times and then resumed, until so many kills have hit a running bake. Every second one
/// updates a city of `before`.
fn kill_and_resume(input: &Path, before: &Path, cell: &str, kills: u32) {
    let folder = tempfile::tempdir().unwrap();
    let city_folder = |run: &str| {
        let parent = folder.path().join(run);
        fs::create_dir_all(&parent).unwrap();
        parent.join("city")
    };
    let temporary = folder.path().join("temporary");
    fs::create_dir(&temporary).unwrap();
    let (whole, old) = (city_folder("whole"), city_folder("old"));
    let (status, file_count) = run_and_kill(bake(input, &whole, &temporary, &["--cell", cell]), &whole, usize::MAX);
    assert!(status.success());
    assert!(bake(before, &old, &temporary, &["--cell", cell]).status().unwrap().success());
    let (baked, old) = (files(&whole), files(&old));
    assert!(baked != old);
    // Objects keep their numbers in an update, so its files differ from those of a full bake.
    let updated = city_folder("updated");
    write_city(&updated, &old);
    assert!(bake(input, &updated, &temporary, &["--cell", cell, "--update"]).status().unwrap().success());
    let updated = files(&updated);
    let (mut random, mut run, mut hits) = (Rng::new(7), 0, 0);
    while hits < kills {
        assert!(run < 10 * kills, "only {hits} kills of {run} cities hit a running bake");
        let out = city_folder(&format!("run-{run}"));
        let mut options = vec!["--cell", cell, "--resume"];
        let is_update = run % 2 == 1;
        if is_update {
            write_city(&out, &old);
            options.push("--update");
        }
        let expected = if is_update { &updated } else { &baked };
        for _ in 0..1 + run % 3 {
            // A bake that finds finished blocks may end before.
            let after_files = 1 + random.below(file_count);
            let (status, _) = run_and_kill(bake(input, &out, &temporary, &options), &out, after_files);
            assert!(status.success() || status.code().is_none(), "run {run}: {status}");
            hits += u32::from(status.code().is_none());
            let found = if out.exists() { files(&out) } else { BTreeMap::new() };
            assert!(found.is_empty() || found == old || found == *expected, "run {run}: an incomplete city");
        }
        let status = bake(input, &out, &temporary, &options).status().unwrap();
        assert!(status.success(), "run {run}: {status}");
        assert!(files(&out) == *expected, "run {run}: the files differ from those of an undisturbed bake");
        assert_eq!(names(out.parent().unwrap()), ["city"], "run {run}: a file was left beside the city");
        assert!(names(&temporary).is_empty(), "run {run}: temporary files were left");
        fs::remove_dir_all(out.parent().unwrap()).unwrap();
        run += 1;
    }
    println!("{hits} kills in {run} cities of {file_count} scratch files");
}

/// GeoJSON of `n` buildings in rows.
fn buildings(n: u32) -> String {
    let mut text = String::from("{\"type\":\"FeatureCollection\",\"features\":[");
    for i in 0..n {
        let (x, y) = (13.0 + f64::from(i % 6) * 8e-4, 52.0 + f64::from(i / 6) * 6e-4);
        let [east, north] = [x + 2e-4 + f64::from(i % 5) * 4e-5, y + 1.5e-4];
        let comma = if i == 0 { "" } else { "," };
        write!(
            text,
            "{comma}{{\"type\":\"Feature\",\"properties\":{{\"height\":{}}},\"geometry\":{{\"type\":\"Polygon\",\
             \"coordinates\":[[[{x},{y}],[{east},{y}],[{east},{north}],[{x},{north}],[{x},{y}]]]}}}}",
            5 + i * 7 % 31
        )
        .unwrap();
    }
    text + "]}"
}

#[test]
fn killed_bakes_resume_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let [input, before] = [("new.geojson", 12), ("old.geojson", 10)].map(|(name, n)| {
        let path = folder.path().join(name);
        fs::write(&path, buildings(n)).unwrap();
        path
    });
    kill_and_resume(&input, &before, "1", 5);
}

/// The same with real data: `INSULA_KILL_INPUT=city.geojson INSULA_KILL_BEFORE=older.geojson
/// cargo test --profile ci -p insula-server --test integration kill:: -- --ignored --nocapture`. `INSULA_KILL_CELL` (default 1)
/// and `INSULA_KILL_TIMES` (default 50) are optional.
#[test]
#[ignore = "needs files in INSULA_KILL_INPUT and INSULA_KILL_BEFORE, and kills 50 bakes"]
fn killed_bakes_of_real_data_resume_to_the_same_bytes() {
    let path = |name: &str| PathBuf::from(std::env::var_os(name).unwrap_or_else(|| panic!("{name} is not set")));
    let text = |name: &str, default: &str| std::env::var(name).unwrap_or(default.to_owned());
    let kills = text("INSULA_KILL_TIMES", "50").parse().unwrap();
    kill_and_resume(&path("INSULA_KILL_INPUT"), &path("INSULA_KILL_BEFORE"), &text("INSULA_KILL_CELL", "1"), kills);
}

#[test]
#[cfg(unix)]
fn interrupted_bake_names_the_command_that_continues_it() {
    use std::os::unix::process::ExitStatusExt;
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::write(path("my town.geojson"), buildings(24)).unwrap();
    let line = "bake my_town.geojson --out my_city --cell 0.5 --threads 1";
    let words: Vec<String> = line.split(' ').map(|word| word.replace('_', " ")).collect();
    let mut command = Command::new(env!("CARGO_BIN_EXE_insula-server"));
    command.args(words).current_dir(folder.path()).env_remove("RUST_LOG").stdin(Stdio::null());
    let child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let has_pack = || fs::read_dir(path("my city.partial/packs")).is_ok_and(|mut packs| packs.next().is_some());
    let start = Instant::now();
    while !has_pack() {
        assert!(start.elapsed() < PATIENCE, "no block is finished");
        thread::sleep(POLL);
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.signal(), Some(2), "a shell has to know that it was interrupted");
    let text = String::from_utf8(output.stderr).unwrap();
    let told = text.lines().last().unwrap();
    assert!(told.starts_with("interrupted in stage ") && told.contains("kept in 'my city.partial'"), "{text}");
    let (_, command) = told.split_once("continue with: ").unwrap();
    let resumed = Command::new("sh").args(["-c", command]).current_dir(folder.path()).output().unwrap();
    assert!(resumed.status.success() && command.contains(" --resume "), "{command}: {resumed:?}");
    assert!(path("my city/city.json").exists() && !path("my city.partial").exists());
}

/// Copies of packed inputs, which some readers need, go with the program also if it is asked to end.
#[cfg(unix)]
#[test]
fn a_signal_leaves_no_copy_of_a_packed_input() {
    use rustix::process::{Pid, Signal, kill_process};
    let folder = tempfile::tempdir().unwrap();
    let temporary = folder.path().join("temporary");
    fs::create_dir(&temporary).unwrap();
    let mut grid = String::from("ncols 700\nnrows 700\nxllcorner 85000\nyllcorner 446000\ncellsize 1\n");
    for row in 0..700 {
        let heights: Vec<String> = (0..700).map(|column| ((row * column) % 7).to_string()).collect();
        writeln!(grid, "{}", heights.join(" ")).unwrap();
    }
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    std::io::Write::write_all(&mut packed, grid.as_bytes()).unwrap();
    let input = folder.path().join("ground.asc.gz");
    fs::write(&input, packed.finish().unwrap()).unwrap();
    let out = folder.path().join("city");
    let mut child = bake(&input, &out, &temporary, &["--crs", "28992", "--cell", "0.5"]).spawn().unwrap();
    while names(&temporary).is_empty() {
        assert!(child.try_wait().unwrap().is_none(), "the bake ends without a copy");
        thread::sleep(POLL);
    }
    kill_process(Pid::from_child(&child), Signal::TERM).unwrap();
    assert!(!child.wait().unwrap().success());
    assert_eq!(names(&temporary), [""; 0]);
}
