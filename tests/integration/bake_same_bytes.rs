//! The same input gives the same bytes, with any number of threads.

use anyhow::{Context, Result, ensure};
use insula_bake::{BakeOptions, Silent};
use insula_test_support::tier;
use insula_tests::trials::{Trials, WHOLE_CITY};
use insula_tests::{fixtures, tests};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

pub(crate) fn add(trials: &mut Trials) {
    let tests = tests![a_textured_part_bakes_to_the_same_bytes, a_town_of_blocks_bakes_to_the_same_bytes];
    trials.add(tests.map(|test| test.in_turn(&WHOLE_CITY)));
}

fn files(city: &Path) -> Result<BTreeMap<String, Vec<u8>>> {
    let mut files = BTreeMap::new();
    for entry in fs::read_dir(city)? {
        let path = entry?.path();
        let name = path.file_name().context("no name")?.to_string_lossy().into_owned();
        files.insert(name, fs::read(path)?);
    }
    ensure!(files.len() >= 3, "only {:?}", files.keys());
    Ok(files)
}

/// Bakes with one thread, and with two; in the full tier, with two again.
fn check_same_bytes(inputs: &[PathBuf], cell_m: f64) -> Result<()> {
    let folder = tempfile::tempdir()?;
    let mut first: Option<BTreeMap<String, Vec<u8>>> = None;
    let threads: &[usize] = if tier::is_full() { &[1, 2, 2] } else { &[1, 2] };
    for (turn, threads) in threads.iter().copied().enumerate() {
        // In different folders of the same name, because the folder's name is the city's name.
        let out = folder.path().join(turn.to_string()).join("city");
        fs::create_dir_all(out.parent().context("no parent")?)?;
        let options = BakeOptions {
            inputs: inputs.to_vec(),
            out: out.clone(),
            cell_m,
            threads: Some(threads),
            ..BakeOptions::default()
        };
        insula_bake::bake(&options, &Silent)?;
        let made = files(&out)?;
        let Some(first) = &first else {
            first = Some(made);
            continue;
        };
        ensure!(made.keys().eq(first.keys()), "other files");
        for (name, bytes) in &made {
            ensure!(first.get(name) == Some(bytes), "{name} differs with {threads} threads, turn {turn}");
        }
    }
    Ok(())
}

fn a_textured_part_bakes_to_the_same_bytes() -> Result<()> {
    check_same_bytes(&[fixtures::chiba_quarter()?], if tier::is_full() { 1.0 } else { 2.0 })
}

fn a_town_of_blocks_bakes_to_the_same_bytes() -> Result<()> {
    let folder = tempfile::tempdir()?;
    check_same_bytes(&[fixtures::write_city_json(folder.path(), 14)?], 1.0)
}
