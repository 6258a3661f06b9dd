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
    BakeError, BakeOptions, BakeStage, BakeSteps, GroundOption, Job, JobRequest, Silent, WorkFolder, read::FacadeOption,
};
use insula_test_support::{folder::TestFolder, rng::Rng};
use support::files;

/// Writes files of footprints in degrees, each with its own part of a town with this south-west corner, and some of the neighbour's.
fn write_town(folder: &Path, [longitude, latitude]: [f64; 2], count: usize) -> Vec<PathBuf> {
    let house = |file: usize, i: usize| {
        let (x, y) = (file as f64 * 500.0 + (i % 6) as f64 * 70.0, (i / 6) as f64 * 55.0);
        let (west, south) = (longitude + x / 90_500.0, latitude + y / 110_900.0);
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
        BakeSteps::begin(&store, options, &request, &Silent)?;
    }
    let mut rng = Rng::new(u64::from(region_leaves));
    for (_, stage) in BakeStage::NAMES {
        let tasks = BakeSteps::open(&store, Job::read(&store)?, options, &Silent)?.tasks(stage)?;
        for task in shuffled(tasks, &mut rng) {
            let steps = BakeSteps::open(&store, Job::read(&store)?, options, &Silent)?;
            steps.run(stage, task)?;
        }
        let status = BakeSteps::open(&store, Job::read(&store)?, options, &Silent)?.status()?;
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
    let options = options(write_town(&folder.path, [139.75, 35.68], 3));
    let plain = plain(&folder.path, &options);
    assert!(plain.len() == 8 && plain["meshes.pmtiles"].len() > 10_000);
    for (region_leaves, chunk_bytes) in [(2, 1), (4, u64::MAX), (32, 1)] {
        let work = folder.path.join(format!("work-{region_leaves}"));
        bake_in_steps(&work, &options, chunk_bytes, region_leaves).unwrap();
        assert_same(&files(&work.join("city")), &plain, &format!("regions of {region_leaves} leaves"));
    }
}

#[test]
fn photos_and_formats_of_all_kinds_give_the_bytes_of_a_plain_bake() {
    let folder = TestFolder::new("steps-mixed");
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    // A part of Yokosuka with photos on its walls, footprints around it, and a mesh without a place.
    let mut inputs = write_town(&folder.path, [139.737, 35.257], 2);
    inputs.insert(1, data.join("yokosuka/52397519_bldg_6697_op.gml.gz"));
    let options = BakeOptions { cell_m: 4.0, facades: FacadeOption::Plain, ..options(inputs) };
    let plain = plain(&folder.path, &options);
    for (region_leaves, chunk_bytes) in [(2, 1), (64, u64::MAX)] {
        let work = folder.path.join(format!("work-{region_leaves}"));
        bake_in_steps(&work, &options, chunk_bytes, region_leaves).unwrap();
        assert_same(&files(&work.join("city")), &plain, &format!("regions of {region_leaves} leaves"));
    }
}

/// Ten towns on a line of 1,000 km.
fn write_country(folder: &Path) -> Vec<PathBuf> {
    let town = |town: usize| {
        let house = |i: usize| {
            let (x, y) =
                (100_000.0 * town as f64 + 300_000.0 + 40.0 * (i % 5) as f64, 5_000_000.0 + 30.0 * (i / 5) as f64);
            format!(
                r#"{{"type":"Feature","id":"t{town}-{i}","properties":{{"height":9}},"geometry":{{"type":"Polygon",
                "coordinates":[[[{x},{y}],[{0},{y}],[{0},{1}],[{x},{1}],[{x},{y}]]]}}}}"#,
                x + 12.25,
                y + 10.5
            )
        };
        let houses: Vec<String> = (0..25).map(house).collect();
        let crs = r#""crs":{"type":"name","properties":{"name":"urn:ogc:def:crs:EPSG::25832"}}"#;
        let path = folder.join(format!("town-{town}.geojson"));
        fs::write(&path, format!(r#"{{"type":"FeatureCollection",{crs},"features":[{}]}}"#, houses.join(","))).unwrap();
        path
    };
    (0..10).map(town).collect()
}

#[test]
fn a_country_loses_no_building() {
    let folder = TestFolder::new("steps-country");
    let options = BakeOptions { ground: GroundOption::None, ..options(write_country(&folder.path)) };
    let out = folder.path.join("plain").join("town");
    let report = insula_bake::bake(&BakeOptions { out: out.clone(), ..options.clone() }, &Silent).unwrap();
    assert_eq!((report.objects, report.read.skipped()), (250, 0));
    let work = folder.path.join("work");
    bake_in_steps(&work, &options, 1, 32).unwrap();
    assert_same(&files(&work.join("city")), &files(&out), "a country");
    // Every house is drawn: columns of its own object, in a leaf where it stands.
    let city = insula_archive::BakedCity::open(&out).unwrap();
    let mut drawn = std::collections::BTreeSet::new();
    for (id, bytes) in city.blockmaps().tiles() {
        if id.level() == city.manifest().depth {
            let map = insula_protocol::BlockMap::decode(id, &bytes.unwrap()).unwrap();
            drawn.extend(map.objects.iter().flat_map(|objects| objects.distinct()));
        }
    }
    assert_eq!(drawn.into_iter().collect::<Vec<u32>>(), (0..250).collect::<Vec<u32>>());
}

#[test]
fn houses_of_a_country_are_as_exact_as_those_of_a_town() {
    // The same town twice: alone, and as the last of a country. Its columns and meshes are the same.
    let folder = TestFolder::new("steps-exact");
    let towns = write_country(&folder.path);
    let town_bytes = |name: &str, inputs: Vec<PathBuf>| {
        let out = folder.path.join(name).join("town");
        let options = BakeOptions { ground: GroundOption::None, cell_m: 1.0, out: out.clone(), ..options(inputs) };
        insula_bake::bake(&options, &Silent).unwrap();
        let city = insula_archive::BakedCity::open(&out).unwrap();
        let side_m = city.manifest().node_side_m(city.manifest().depth);
        let origin = city.manifest().origin;
        let mut maps = BTreeMap::new();
        for (id, bytes) in city.blockmaps().tiles() {
            let west_m = origin[0] + f64::from(id.x()) * side_m;
            if id.level() == city.manifest().depth && west_m > 1_190_000.0 {
                let map = insula_protocol::BlockMap::decode(id, &bytes.unwrap()).unwrap();
                let south_m = origin[1] + f64::from(id.y()) * side_m;
                maps.insert([west_m, south_m].map(|v| v as i64), (map.z_max, map.z_min, map.flags));
            }
        }
        maps
    };
    let (alone, of_country) = (town_bytes("alone", towns[9..].to_vec()), town_bytes("country", towns));
    assert!(alone.len() >= 9 && alone == of_country);
}

/// The names of all objects below a folder of a work store, relative to it.
fn objects(work: &Path, folder: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(work.join(folder)).unwrap() {
        let path = entry.unwrap().path();
        let name = path.strip_prefix(work).unwrap().to_string_lossy().into_owned();
        if path.is_dir() { found.extend(objects(work, &name)) } else { found.push(path) }
    }
    found.sort();
    found
}

#[test]
fn other_jobs_settings_and_damaged_objects_are_refused() {
    let folder = TestFolder::new("steps-refused");
    let options = options(write_town(&folder.path, [139.75, 35.68], 2));
    let (work, store) = (folder.path.join("work"), WorkFolder::new(&folder.path.join("work")));
    let request = |region_leaves| JobRequest { arguments: Vec::new(), chunk_bytes: 1, region_leaves };
    assert!(matches!(Job::read(&store), Err(error @ BakeError::StepMissing { .. }) if !error.is_final()));
    BakeSteps::begin(&store, &options, &request(4), &Silent).unwrap();
    let other = BakeSteps::begin(&store, &options, &request(8), &Silent).unwrap_err();
    assert!(other.is_final() && other.to_string().contains("another job"), "{other}");
    assert!(BakeSteps::begin(&store, &options, &request(3), &Silent).unwrap_err().is_final());
    let finer = BakeOptions { cell_m: 1.0, ..options.clone() };
    let Err(error) = BakeSteps::open(&store, Job::read(&store).unwrap(), &finer, &Silent) else {
        panic!("other settings")
    };
    assert!(error.is_final() && error.to_string().contains("settings"), "{error}");
    let steps = || BakeSteps::open(&store, Job::read(&store).unwrap(), &options, &Silent).unwrap();
    // A step before its time may be tried again, one that does not exist may not.
    assert!(!steps().run(BakeStage::Plan, 0).unwrap_err().is_final());
    assert!(!steps().run(BakeStage::Region, 0).unwrap_err().is_final());
    assert!(steps().run(BakeStage::Scan, 2).unwrap_err().is_final());
    for stage in [BakeStage::Scan, BakeStage::Plan, BakeStage::Shuffle, BakeStage::Region, BakeStage::Crown] {
        (0..steps().tasks(stage).unwrap()).for_each(|task| steps().run(stage, task).unwrap());
    }
    let check = |paths: Vec<PathBuf>, stage: BakeStage, task: usize| {
        for path in paths {
            let good = fs::read(&path).unwrap();
            for cut in [0, good.len() / 2, good.len() - 1] {
                fs::write(&path, &good[..cut]).unwrap();
                assert!(steps().run(stage, task).is_err(), "{} cut to {cut}", path.display());
            }
            for at in [0, 9, good.len() / 2, good.len() - 1] {
                let mut bad = good.clone();
                bad[at] ^= 0x40;
                fs::write(&path, bad).unwrap();
                assert!(steps().run(stage, task).is_err(), "{} changed at {at}", path.display());
            }
            fs::write(&path, good).unwrap();
        }
    };
    let heads = objects(&work, "scan").into_iter().filter(|path| path.ends_with("head")).collect();
    fs::rename(work.join("plan"), work.join("kept")).unwrap();
    check(heads, BakeStage::Plan, 0);
    fs::rename(work.join("kept"), work.join("plan")).unwrap();
    fs::remove_dir_all(work.join("region/0")).unwrap();
    check(vec![work.join("shuffle/0/index")], BakeStage::Region, 0);
    let bundles = work.join("shuffle/0/bundles");
    let good = fs::read(&bundles).unwrap();
    for bad in [good[..good.len() / 9].to_vec(), [&[1], &good[1..]].concat(), [&good[..30], b"!", &good[31..]].concat()]
    {
        fs::write(&bundles, bad).unwrap();
        assert!(steps().run(BakeStage::Region, 0).is_err());
    }
    fs::write(&bundles, good).unwrap();
    check(vec![work.join("plan/plan")], BakeStage::Region, 0);
    steps().run(BakeStage::Region, 0).unwrap();
    fs::remove_dir_all(work.join("crown")).unwrap();
    check(vec![work.join("region/0/index")], BakeStage::Crown, 0);
    // Nothing is left of a job that is given up.
    assert!(insula_bake::abort(&store).unwrap() > 10);
    assert!(objects(&work, ".").is_empty());
}

#[test]
fn a_change_of_the_inputs_ends_the_job() {
    let folder = TestFolder::new("steps-changed");
    let options = options(write_town(&folder.path, [139.75, 35.68], 2));
    let store = WorkFolder::new(&folder.path.join("work"));
    let request = JobRequest { arguments: Vec::new(), chunk_bytes: 1, region_leaves: 4 };
    let job = BakeSteps::begin(&store, &options, &request, &Silent).unwrap();
    fs::write(&options.inputs[0], "{}").unwrap();
    let error = BakeSteps::open(&store, job, &options, &Silent).unwrap().run(BakeStage::Scan, 1).unwrap_err();
    assert!(error.is_final() && error.to_string().contains("have changed"), "{error}");
}
