//! Bakes in steps give the city of a plain bake, byte for byte.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use std::{
    collections::BTreeMap,
    fmt::Write,
    fs,
    path::{Path, PathBuf},
};

use insula_bake::{
    BakeError, BakeOptions, GroundOption, Job, JobRequest, Silent, Stage, Steps, WorkFolder, read::FacadeOption,
};
use insula_test_support::{folder::TestFolder, rng::Rng};
use support::files;

/// Writes files of footprints in degrees, each with its own part of a town, and some of the neighbour's.
fn write_town(folder: &Path, count: usize) -> Vec<PathBuf> {
    let house = |file: usize, i: usize| {
        let (x, y) = (file as f64 * 500.0 + (i % 6) as f64 * 70.0, (i / 6) as f64 * 55.0);
        let (west, south) = (139.75 + x / 90_500.0, 35.68 + y / 110_900.0);
        let (east, north) = (west + 22.0 / 90_500.0, south + (12 + i % 9) as f64 / 110_900.0);
        let height = 6 + i * 5 % 37;
        format!(
            r#"{{"type":"Feature","id":"h{file}-{i}","properties":{{"height":{height},"name":"House {i}"}},
            "geometry":{{"type":"Polygon","coordinates":[[[{west},{south}],[{east},{south}],[{east},{north}],[{west},{north}],[{west},{south}]]]}}}}"#
        )
    };
    let file = |file: usize| {
        let mut features: Vec<String> = (0..48).map(|i| house(file, i)).collect();
        // Deliveries of neighbours overlap.
        features.extend((0..4).map(|i| house((file + 1) % count, i)));
        let mut text = String::from(r#"{"type":"FeatureCollection","features":["#);
        write!(text, "{}]}}", features.join(",")).unwrap();
        let path = folder.join(format!("town-{file}.geojson"));
        fs::write(&path, text).unwrap();
        path
    };
    (0..count).map(file).collect()
}

fn options(inputs: Vec<PathBuf>) -> BakeOptions {
    BakeOptions {
        inputs,
        out: "town".into(),
        cell_m: 2.0,
        ground: GroundOption::Auto,
        facades: FacadeOption::Windows,
        threads: Some(2),
        ..BakeOptions::default()
    }
}

fn plain(folder: &Path, options: &BakeOptions) -> BTreeMap<String, Vec<u8>> {
    let out = folder.join("plain").join("town");
    insula_bake::bake(&BakeOptions { out: out.clone(), ..options.clone() }, &Silent).unwrap();
    files(&out)
}

/// All tasks of a stage, each twice, in a random order.
fn shuffled(tasks: usize, rng: &mut Rng) -> Vec<usize> {
    let mut all: Vec<usize> = (0..tasks).chain(0..tasks).collect();
    for i in (1..all.len()).rev() {
        all.swap(i, rng.below(i + 1));
    }
    all
}

/// Runs all steps, each as a program of its own would.
fn bake_in_steps(work: &Path, options: &BakeOptions, chunk_bytes: u64, region_leaves: u32) -> Result<(), BakeError> {
    let store = WorkFolder::new(work);
    let request = JobRequest { arguments: Vec::new(), chunk_bytes, region_leaves };
    for _ in 0..2 {
        Steps::begin(&store, options, &request, &Silent)?;
    }
    let mut rng = Rng::new(u64::from(region_leaves));
    for (_, stage) in Stage::NAMES {
        let tasks = Steps::open(&store, Job::read(&store)?, options, &Silent)?.tasks(stage)?;
        for task in shuffled(tasks, &mut rng) {
            let steps = Steps::open(&store, Job::read(&store)?, options, &Silent)?;
            steps.run(stage, task)?;
        }
        let status = Steps::open(&store, Job::read(&store)?, options, &Silent)?.status()?;
        let of_stage = status.iter().find(|status| status.stage == stage).unwrap();
        assert_eq!((of_stage.tasks, of_stage.done), (Some(tasks), tasks), "{stage:?}");
    }
    Ok(())
}

fn assert_same(made: &BTreeMap<String, Vec<u8>>, plain: &BTreeMap<String, Vec<u8>>, what: &str) {
    assert!(made.keys().eq(plain.keys()), "{what}: {:?}", made.keys());
    for (name, bytes) in made {
        assert!(plain[name] == *bytes, "{what}: {name} differs");
    }
}

#[test]
fn steps_in_any_order_give_the_bytes_of_a_plain_bake() {
    let folder = TestFolder::new("steps");
    let options = options(write_town(&folder.path, 3));
    let plain = plain(&folder.path, &options);
    assert!(plain.len() == 8 && plain["meshes.pmtiles"].len() > 10_000);
    for (region_leaves, chunk_bytes) in [(2, 1), (4, u64::MAX), (32, 1)] {
        let work = folder.path.join(format!("work-{region_leaves}"));
        bake_in_steps(&work, &options, chunk_bytes, region_leaves).unwrap();
        assert_same(&files(&work.join("city")), &plain, &format!("regions of {region_leaves} leaves"));
    }
}
