//! The same input gives the same bytes, with any number of threads.

use anyhow::{Context, Result, ensure};
use insula_bake::{BakeOptions, Silent};
use insula_tests::fixtures;
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

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

/// Bakes with one thread, with two, and with two again.
fn check_same_bytes(inputs: &[PathBuf], cell_m: f64) -> Result<()> {
    let folder = tempfile::tempdir()?;
    let mut first: Option<BTreeMap<String, Vec<u8>>> = None;
    for (turn, threads) in [1, 2, 2].into_iter().enumerate() {
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

#[test]
fn a_textured_part_bakes_to_the_same_bytes() -> Result<()> {
    check_same_bytes(&[fixtures::chiba_quarter()?], 1.0)
}

#[test]
fn a_town_of_blocks_bakes_to_the_same_bytes() -> Result<()> {
    let folder = tempfile::tempdir()?;
    check_same_bytes(&[fixtures::write_city_json(folder.path(), 14)?], 1.0)
}
