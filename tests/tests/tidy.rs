//! Rules about the text of the project itself.

#![allow(clippy::unwrap_used)]

use std::{
    path::{Path, PathBuf},
    process::Command,
};

/// Longest source file.
const MAX_LINES: usize = 600;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Tracked text files that are still there, relative to the root; build outputs and pictures are none.
fn tracked() -> Vec<(String, String)> {
    let output = Command::new("git").args(["ls-files", "-z"]).current_dir(root()).output().unwrap();
    assert!(output.status.success(), "the rules are about what git tracks: run them in a clone");
    let names = String::from_utf8(output.stdout).unwrap();
    let files: Vec<_> = names
        .split('\0')
        .filter(|name| !name.is_empty())
        .filter_map(|name| Some((name.to_owned(), std::fs::read_to_string(root().join(name)).ok()?)))
        .collect();
    assert!(files.len() > 50, "only {} files", files.len());
    files
}

fn is_source(name: &str) -> bool {
    name.ends_with(".rs") || name.ends_with(".wgsl")
}

/// A stage of a datum's way: not the rooms' doors, not what only says what is wrong or wanted, not tests.
fn is_stage(name: &str) -> bool {
    let stem = name.rsplit('/').next().unwrap_or_default();
    let room = ["server/bake/src/", "client/src/", "shaders/src/"].iter().any(|room| name.starts_with(room));
    let other = ["lib.rs", "main.rs", "mod.rs", "error.rs", "config.rs", "tests.rs", "layout.rs"].contains(&stem);
    room && name.ends_with(".rs") && !other && !name.contains("/tests/")
}

#[test]
fn every_stage_says_what_goes_in_and_out_and_what_comes_next() {
    let mut stages = 0;
    for (name, text) in tracked().into_iter().filter(|(name, _)| is_stage(name)) {
        let doc: String = text.lines().take_while(|line| line.starts_with("//!")).collect();
        for word in ["In: ", "Out: ", "Next: "] {
            assert!(doc.contains(word), "{name}: its doc says no \"{}\"", word.trim_end());
        }
        stages += 1;
    }
    assert!(stages > 20, "only {stages} stages");
}

#[test]
fn every_module_says_what_it_is() {
    for (name, text) in tracked().into_iter().filter(|(name, _)| name.ends_with(".rs")) {
        assert!(text.starts_with("//!"), "{name} has no doc");
    }
}

#[test]
fn no_file_is_too_long_to_read() {
    for (name, text) in tracked().into_iter().filter(|(name, _)| is_source(name)) {
        let lines = text.lines().count();
        assert!(lines <= MAX_LINES, "{name} has {lines} lines, {MAX_LINES} are allowed: split it");
    }
}

#[test]
fn nothing_is_left_to_do_in_comments() {
    for (name, text) in tracked() {
        for word in [concat!("TO", "DO"), concat!("FIX", "ME"), concat!("XX", "X:"), concat!("dbg", "!(")] {
            assert!(!text.contains(word), "{name} says {word}");
        }
    }
}

/// Paths of one machine, hosts of one network: of no use to anybody else.
#[test]
fn nothing_names_a_machine() {
    let banned = [
        concat!("/wo", "rk/"),
        concat!("/ro", "ot/"),
        concat!("/ho", "me/"),
        concat!("arti", "factory"),
        concat!("index.crates", ".io:"),
    ];
    for (name, text) in tracked() {
        for word in banned {
            let line = text.lines().position(|line| line.contains(word) && !line.contains("github.com"));
            assert!(line.is_none(), "{name}:{} names {word}", line.unwrap_or_default() + 1);
        }
    }
}

/// One word names a stage in its WGSL file, its CPU twin and its test.
#[test]
fn twins_bear_the_same_name() {
    let names: Vec<String> = tracked().into_iter().map(|(name, _)| name).collect();
    for stage in ["raycast"] {
        for path in [
            format!("shaders/wgsl/{stage}.wgsl"),
            format!("shaders/src/cpu/{stage}.rs"),
            format!("shaders/src/gpu/{stage}.rs"),
            format!("tests/tests/twin_{stage}.rs"),
        ] {
            assert!(names.contains(&path), "{path} is missing");
        }
    }
}
