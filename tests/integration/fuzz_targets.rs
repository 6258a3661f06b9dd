//! The fuzz targets compile and take the inputs of their corpora, so that findings stay fixed without a fuzzer.

#![allow(clippy::duplicate_mod, reason = "two programs share a module")]

use insula_tests::source_code::tracked_files;
use insula_tests::tests;
use insula_tests::trials::Trials;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

pub(crate) fn add(trials: &mut Trials) {
    trials.add(tests![every_target_is_listed, targets_take_their_corpora]);
}

/// In place of libFuzzer's: a function that takes an input.
#[macro_export]
macro_rules! fuzz_target {
    (|$input:ident: &[u8]| $body:expr) => {
        pub(crate) fn run($input: &[u8]) {
            $body
        }
    };
    (|$input:ident: &str| $body:expr) => {
        pub(crate) fn run(bytes: &[u8]) {
            if let Ok($input) = std::str::from_utf8(bytes) {
                $body
            }
        }
    };
}

macro_rules! targets {
    ($($name:ident $path:literal)*) => {
        $(
            #[path = $path]
            #[allow(unused_attributes, unused_imports, unreachable_pub, reason = "written as programs of their own")]
            mod $name;
        )*

        fn targets() -> Vec<Target> {
            let of_readers = reader::READERS.map(|(name, _)| target(name, move |bytes| reader::read(name, bytes)));
            [$(target(stringify!($name), $name::run)),*].into_iter().chain(of_readers).collect()
        }
    };
}

/// A name, and what takes an input.
type Target = (&'static str, Box<dyn Fn(&[u8])>);

fn target(name: &'static str, run: impl Fn(&[u8]) + 'static) -> Target {
    (name, Box::new(run))
}

/// One file for the programs of all readers.
#[path = "../fuzz/targets/reader.rs"]
#[allow(dead_code, unused_attributes, unused_imports, unreachable_pub, reason = "written as a program of its own")]
mod reader;

targets! {
    archive "../fuzz/targets/archive.rs"
    archive_directory "../fuzz/targets/archive_directory.rs"
    blockmap "../fuzz/targets/blockmap.rs"
    elevation "../fuzz/targets/elevation.rs"
    filter "../fuzz/targets/filter.rs"
    filtered_objects "../fuzz/targets/filtered_objects.rs"
    manifest "../fuzz/targets/manifest.rs"
    mesh "../fuzz/targets/mesh.rs"
    mesh_tile "../fuzz/targets/mesh_tile.rs"
    object_block "../fuzz/targets/object_block.rs"
    route "../fuzz/targets/route.rs"
    search_index "../fuzz/targets/search_index.rs"
    subtree "../fuzz/targets/subtree.rs"
    tile "../fuzz/targets/tile.rs"
    tile_group "../fuzz/targets/tile_group.rs"
    visibility_tile "../fuzz/targets/visibility_tile.rs"
}

fn every_target_is_listed() {
    let names: BTreeSet<&str> = targets().iter().map(|(name, _)| *name).collect();
    let files = tracked_files().expect("files of the repository");
    let lines = files["tests/fuzz/Cargo.toml"].lines();
    let mut programs: BTreeSet<&str> =
        lines.filter_map(|line| line.strip_prefix("name = \"")?.strip_suffix('"')).collect();
    assert!(programs.remove("insula-fuzz"));
    assert_eq!(names, programs);
    let found = files.keys().filter_map(|file| file.strip_prefix("tests/fuzz/targets/")?.strip_suffix(".rs"));
    for file in found.filter(|name| !name.contains('/')) {
        assert!(names.contains(file) || file == "reader", "{file} is no program");
    }
}

/// A file that is named if it makes a target fail.
struct Input(PathBuf);

impl Drop for Input {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("{}", self.0.display());
        }
    }
}

fn targets_take_their_corpora() {
    let corpora = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus");
    let mut inputs = 0;
    for (name, run) in targets() {
        run(&[]);
        let Ok(folder) = fs::read_dir(corpora.join(name)) else { continue };
        for file in folder {
            let input = Input(file.expect("a readable corpus").path());
            run(&fs::read(&input.0).expect("a readable input"));
            inputs += 1;
        }
    }
    assert!(inputs >= 40, "{inputs} inputs");
}
