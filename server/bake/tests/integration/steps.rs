//! Bakes in steps give the city of a plain bake, byte for byte.

use super::support::{FEW_VIEWS, files};
use insula_bake::read::{FacadeOption, ReadOptions, SurroundingsOptions, TerrainOptions};
use insula_bake::sample::SampleSettings;
use insula_bake::{
    BakeError, BakeOptions, BakeStage, BakeSteps, GroundOption, Job, JobRequest, Progress, Silent, WorkFolder,
    WorkStore,
};
use insula_test_support::folder::TestFolder;
use insula_test_support::map_files::{ascii_grid, feature_collection, rectangle};
use insula_test_support::rng::Rng;
use insula_test_support::tier;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Writes files of footprints in degrees, each with its own part of a town with this south-west corner, and some of the neighbour's.
pub(crate) fn write_town(folder: &Path, [longitude, latitude]: [f64; 2], count: usize) -> Vec<PathBuf> {
    let house = |file: usize, i: usize| {
        let (x, y) = (file as f64 * 500.0 + (i % 6) as f64 * 70.0, (i / 6) as f64 * 55.0);
        let (west, south) = (longitude + x / 90_500.0, latitude + y / 110_900.0);
        let (east, north) = (west + 22.0 / 90_500.0, south + (12 + i % 9) as f64 / 110_900.0);
        let height = 6 + i * 5 % 37;
        let members = format!(r#""id":"h{file}-{i}","properties":{{"height":{height},"name":"House {i}"}}"#);
        rectangle(&members, [west, south, east, north])
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

pub(crate) fn options(inputs: Vec<PathBuf>) -> BakeOptions {
    BakeOptions {
        inputs,
        out: "town".into(),
        cell_m: 2.0,
        ground: GroundOption::Auto,
        read: ReadOptions { facades: FacadeOption::Windows, ..ReadOptions::default() },
        threads: Some(2),
        sample: SampleSettings::with_views(FEW_VIEWS),
        ..BakeOptions::default()
    }
}

/// Leaves along the side of a region, and least size of a chunk in bytes.
type Division = (u32, u64);

/// What the quick tier bakes of some divisions: the first `quick`.
fn divisions(all: &[Division], quick: usize) -> &[Division] {
    if tier::is_full() { all } else { &all[..quick] }
}

pub(crate) fn plain(folder: &Path, options: &BakeOptions) -> BTreeMap<String, Vec<u8>> {
    let out = folder.join("plain").join("town");
    insula_bake::bake(&BakeOptions { out: out.clone(), ..options.clone() }, &Silent).unwrap();
    files(&out)
}

#[derive(Default)]
struct Warnings(Mutex<Vec<String>>);

impl Progress for Warnings {
    fn stage(&self, _: &str, _: u64) {}

    fn advance(&self, _: u64) {}

    fn warn(&self, message: &str) {
        self.0.lock().unwrap().push(message.to_owned());
    }
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
pub(crate) fn bake_in_steps(
    work: &Path,
    options: &BakeOptions,
    chunk_bytes: u64,
    region_leaves: u32,
) -> Result<(), BakeError> {
    let store = WorkFolder::new(work);
    let request = JobRequest { arguments: Vec::new(), chunk_bytes, region_leaves, is_update: false };
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

pub(crate) fn assert_same(made: &BTreeMap<String, Vec<u8>>, plain: &BTreeMap<String, Vec<u8>>, what: &str) {
    assert!(made.keys().eq(plain.keys()), "{what}: {:?}", made.keys());
    // The manifest follows from the others.
    let (manifest, others): (Vec<_>, Vec<_>) = made.iter().partition(|(name, _)| name.ends_with(".json"));
    for (name, bytes) in others.into_iter().chain(manifest) {
        if name.ends_with(".json") {
            let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
            assert_eq!(text(bytes), text(&plain[name]), "{what}: {name}");
        }
        assert!(plain[name] == *bytes, "{what}: {name} differs");
    }
}

#[test]
fn steps_in_any_order_give_the_bytes_of_a_plain_bake() {
    let folder = TestFolder::new("steps");
    let inputs = write_town(&folder.path, [139.75, 35.68], 3);
    let options = BakeOptions { street_sets: true, picture: true, ..options(inputs) };
    let plain = plain(&folder.path, &options);
    assert!(plain.len() == 9 && plain["meshes.pmtiles"].len() > 10_000);
    for &(region_leaves, chunk_bytes) in divisions(&[(2, 1), (4, u64::MAX), (32, 1)], 2) {
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
    inputs.push(write_sequence(&folder.path));
    let options = BakeOptions { cell_m: 4.0, read: ReadOptions::default(), ..options(inputs) };
    let plain = plain(&folder.path, &options);
    for &(region_leaves, chunk_bytes) in divisions(&[(2, 1), (64, u64::MAX)], 1) {
        let work = folder.path.join(format!("work-{region_leaves}"));
        bake_in_steps(&work, &options, chunk_bytes, region_leaves).unwrap();
        assert_same(&files(&work.join("city")), &plain, &format!("regions of {region_leaves} leaves"));
    }
}

/// A sequence of features, every other one without an identifier, that is long enough to be divided.
fn write_sequence(folder: &Path) -> PathBuf {
    let feature = |i: usize| {
        let (west, south) = (139.74 + (i % 40) as f64 * 3e-4, 35.26 + (i / 40) as f64 * 3e-4);
        let (east, north) = (west + 1e-4, south + 1e-4);
        let id = if i.is_multiple_of(2) { format!(r#""id":"s{i}","#) } else { String::new() };
        let (height, note) = (4 + i % 30, "x".repeat(2500));
        let members = format!(r#"{id}"properties":{{"height":{height},"note":"{note}"}}"#);
        rectangle(&members, [west, south, east, north])
    };
    let path = folder.join("sequence.geojsonl");
    fs::write(&path, (0..900).map(feature).collect::<Vec<_>>().join("\n")).unwrap();
    path
}

/// A building of CityJSON with a photo on its walls, at the origin of the grid's maps.
fn write_photographed(folder: &Path) -> PathBuf {
    let photo = "tests/data/yokosuka/52397519_bldg_6697_appearance/14201-bldg-110968-1.jpg";
    fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join(photo), folder.join("photo.jpg")).unwrap();
    let (corners, mut vertices) = ([[0, 0], [30, 0], [30, 20], [0, 20]], Vec::new());
    for z in [12, 27] {
        vertices.extend(corners.map(|[x, y]| format!("[{},{},{z}]", 500_060 + x, 5_400_050 + y)));
    }
    let walls = (0..4).map(|i| format!("[[{i},{0},{1},{2}]]", (i + 1) % 4, (i + 1) % 4 + 4, i + 4));
    let faces: Vec<String> = walls.chain(["[[4,5,6,7]]".to_owned(), "[[3,2,1,0]]".to_owned()]).collect();
    let textures = ["[[0,0,1,2,3]]"; 4].into_iter().chain(["[[null]]"; 2]).collect::<Vec<_>>().join(",");
    let text = format!(
        r#"{{"type":"CityJSON","version":"2.0","metadata":{{"referenceSystem":"https://www.opengis.net/def/crs/EPSG/0/25832"}},
        "transform":{{"scale":[1,1,1],"translate":[0,0,0]}},"vertices":[{}],"appearance":{{"textures":[{{"type":"JPG","image":"photo.jpg"}}],
        "vertices-texture":[[0,0],[1,0],[1,1],[0,1]]}},"CityObjects":{{"hall":{{"type":"Building","geometry":[{{"type":"MultiSurface",
        "lod":"2","boundaries":[{}],"texture":{{"photo":{{"values":[{textures}]}}}}}}]}}}}}}"#,
        vertices.join(","),
        faces.join(",")
    );
    let path = folder.join("hall.city.json");
    fs::write(&path, text).unwrap();
    path
}

#[test]
fn terrain_landmarks_and_photos_give_the_bytes_of_a_plain_bake() {
    let folder = TestFolder::new("steps-terrain");
    let waves_m = |x: f64, y: f64| 10.0 + 6.0 * (x / 80.0).sin() + 2.0 * (y / 60.0).sin();
    let dem = ascii_grid([499_900.0, 5_399_700.0], [50, 28], 20.0, waves_m);
    fs::write(folder.path.join("dem.asc"), dem).unwrap();
    fs::write(folder.path.join("dem.prj"), "EPSG:25832").unwrap();
    // Flat areas are painted on the terrain.
    let lawn = r#"{"type":"FeatureCollection","features":[{"type":"Feature","id":"lawn","properties":{"landuse":"grass"},
        "geometry":{"type":"Polygon","coordinates":[[[9.0005,48.7505],[9.003,48.7505],[9.003,48.752],[9.0005,48.752],[9.0005,48.7505]]]}}]}"#;
    fs::write(folder.path.join("lawn.geojson"), lawn).unwrap();
    let pyramid = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\nelement face 6\n\
        property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0.5 0.5 2\n3 0 1 4\n3 1 2 4\n3 2 3 4\n3 3 0 4\n\
        3 0 2 1\n3 0 3 2\n";
    fs::write(folder.path.join("pyramid.ply"), pyramid).unwrap();
    let landmarks = folder.path.join("landmarks.json");
    let entry = |place: [f64; 2], stone: &str| {
        format!(r#"{{"mesh":"pyramid.ply","position":{place:?},"target-height":6{stone}}}"#)
    };
    let [first, second] =
        [entry([500_020.0, 5_400_090.0], r#","stone":"carrara-marble""#), entry([500_400.0, 5_400_010.0], "")];
    fs::write(&landmarks, format!(r#"{{"landmarks":[{first},{second}]}}"#)).unwrap();
    // The towns come first, but have no projected system: they are read after the building that has one.
    let mut inputs = write_town(&folder.path, [9.0002, 48.7502], 2);
    inputs.extend(["lawn.geojson", "dem.asc"].map(|name| folder.path.join(name)));
    inputs.push(write_photographed(&folder.path));
    let [small, large]: [Division; 2] = [(2, 1), (8, u64::MAX)];
    for (ground, all) in [(GroundOption::Auto, [small, large]), (GroundOption::None, [large, small])] {
        let options = BakeOptions {
            read: ReadOptions { landmarks: Some(landmarks.clone()), ..ReadOptions::default() },
            street_sets: true,
            ground,
            ..options(inputs.clone())
        };
        let out = folder.path.join("plain").join("town");
        let report = insula_bake::bake(&BakeOptions { out: out.clone(), ..options.clone() }, &Silent).unwrap();
        let terrain = report.read.sources.iter().find(|source| source.path.ends_with("dem.asc")).unwrap();
        let painted: u64 = report.read.sources.iter().map(|source| source.painted).sum();
        let photos: u64 = report.read.sources.iter().map(|source| source.textures).sum();
        assert!(terrain.terrain_triangles > 100 && painted == 1 && photos > 0, "{painted} painted, {photos} photos");
        assert_eq!(report.read.stones.len(), 1);
        for &(region_leaves, chunk_bytes) in divisions(&all, 1) {
            let work = folder.path.join(format!("work-{region_leaves}-{ground:?}").to_lowercase());
            bake_in_steps(&work, &options, chunk_bytes, region_leaves).unwrap();
            assert_same(&files(&work.join("city")), &files(&out), &format!("regions of {region_leaves}, {ground:?}"));
        }
    }
}

#[test]
fn land_around_the_city_gives_the_bytes_of_a_plain_bake() {
    let folder = TestFolder::new("steps-land");
    let grid = |name: &str, [x0, y0]: [f64; 2], size: usize, step_m: f64| {
        let land_m =
            |x: f64, y: f64| 40.0 + 25.0 * ((x0 - 5e5 + x) / 700.0).sin() + 20.0 * ((y0 - 5.4e6 + y) / 900.0).cos();
        fs::write(folder.path.join(name), ascii_grid([x0, y0], [size, size], step_m, land_m)).unwrap();
        fs::write(folder.path.join(name).with_extension("prj"), "EPSG:25832").unwrap();
        folder.path.join(name)
    };
    let mut inputs = write_town(&folder.path, [9.0002, 48.7502], 2);
    inputs.push(write_photographed(&folder.path));
    inputs.push(grid("dem.asc", [499_800.0, 5_399_700.0], 70, 20.0));
    let far = grid("far.asc", [493_000.0, 5_393_000.0], 141, 100.0);
    let surroundings = SurroundingsOptions { files: vec![far], reach_m: 4000.0 };
    let terrain = TerrainOptions { margin_m: 100.0, ..TerrainOptions::default() };
    let read = ReadOptions { surroundings, terrain, ..ReadOptions::default() };
    let options = BakeOptions { read, ..options(inputs) };
    let plain = plain(&folder.path, &options);
    let nodes =
        |levels: &str| serde_json::from_str::<serde_json::Value>(levels).unwrap()["counts"]["nodes_per_level"].clone();
    let counts = nodes(std::str::from_utf8(&plain["city.json"]).unwrap());
    assert!(counts.as_array().is_some_and(|levels| levels.len() >= 6), "{counts}");
    // The columns of a region's root are of 8 and 128 m: coarser land than 64 m is divided.
    for (region_leaves, chunk_bytes) in [(4, 1), (64, u64::MAX)] {
        let work = folder.path.join(format!("work-{region_leaves}"));
        bake_in_steps(&work, &options, chunk_bytes, region_leaves).unwrap();
        assert_same(&files(&work.join("city")), &plain, &format!("regions of {region_leaves} leaves"));
    }
}

#[test]
fn few_objects_that_make_the_city_wide_are_named() {
    let folder = TestFolder::new("steps-wide");
    let mut inputs = write_town(&folder.path, [139.75, 35.68], 1);
    let far = folder.path.join("far");
    fs::create_dir(&far).unwrap();
    let stray = fs::read_to_string(&write_town(&far, [140.75, 35.68], 1)[0]).unwrap();
    let start = stray.find(r#"{"type":"Feature","id":"h0-0""#).unwrap();
    let end = stray.find(r#"{"type":"Feature","id":"h0-1""#).unwrap();
    let only = format!(r#"{{"type":"FeatureCollection","features":[{}]}}"#, stray[start..end].trim_end_matches(','));
    inputs.push(folder.path.join("stray.geojson"));
    fs::write(&inputs[1], only.replace("h0-0", "stray")).unwrap();
    let options = BakeOptions { ground: GroundOption::None, out: folder.path.join("town"), ..options(inputs) };
    let plain = Warnings::default();
    insula_bake::bake(&options, &plain).unwrap();
    let found: Vec<String> = plain.0.into_inner().unwrap();
    let wide = found.iter().find(|text| text.contains("stray.geojson")).unwrap();
    assert!(wide.contains("stray: 8") && wide.contains("km from the others") && wide.contains("--bbox"), "{wide}");
    assert_eq!(found.iter().filter(|text| text.contains("as wide")).count(), 1, "{found:?}");
    let (steps, store) = (Warnings::default(), WorkFolder::new(&folder.path.join("work")));
    let request = JobRequest { arguments: Vec::new(), chunk_bytes: 1, region_leaves: 32, is_update: false };
    let job = BakeSteps::begin(&store, &options, &request, &Silent).unwrap();
    for scan in 0..2 {
        BakeSteps::open(&store, job.clone(), &options, &Silent).unwrap().run(BakeStage::Scan, scan).unwrap();
    }
    BakeSteps::open(&store, job, &options, &steps).unwrap().run(BakeStage::Plan, 0).unwrap();
    assert!(steps.0.into_inner().unwrap().contains(wide));
}

/// Counts the regions that are baked.
#[derive(Default)]
struct BakedRegions(AtomicUsize);

impl Progress for BakedRegions {
    fn stage(&self, name: &str, _: u64) {
        self.0.fetch_add(usize::from(name == "sample"), Ordering::Relaxed);
    }

    fn advance(&self, _: u64) {}
}

/// Updates the city of a work store. Returns the number of regions, and how many of them were baked.
fn update_in_steps(work: &Path, options: &BakeOptions) -> [usize; 2] {
    let (store, baked) = (WorkFolder::new(work), BakedRegions::default());
    let request = JobRequest { arguments: Vec::new(), chunk_bytes: 1, region_leaves: 4, is_update: true };
    let before = fs::read(work.join("city/city.json")).unwrap();
    let job = BakeSteps::begin(&store, options, &request, &Silent).unwrap();
    // Begun again before there is a city, the job is the same.
    assert_eq!(BakeSteps::begin(&store, options, &request, &Silent).unwrap(), job);
    let mut regions = 0;
    for (_, stage) in BakeStage::NAMES {
        let steps = || BakeSteps::open(&store, job.clone(), options, &baked).unwrap();
        let tasks = steps().tasks(stage).unwrap();
        regions = if stage == BakeStage::Region { tasks } else { regions };
        // Readers have the city before until the last step.
        assert_eq!(fs::read(work.join("city/city.json")).unwrap(), before);
        (0..tasks).chain(0..tasks).for_each(|task| steps().run(stage, task).unwrap());
    }
    [regions, baked.0.into_inner()]
}

#[test]
fn an_update_bakes_only_changed_regions_and_gives_the_bytes_of_a_whole_bake() {
    let folder = TestFolder::new("steps-update");
    let inputs = write_town(&folder.path, [139.75, 35.68], 3);
    let options = BakeOptions { ground: GroundOption::None, ..options(inputs.clone()) };
    let (work, updated) = (folder.path.join("work"), folder.path.join("updated").join("town"));
    bake_in_steps(&work, &options, 1, 4).unwrap();
    let update_plainly = || {
        let options = BakeOptions { out: updated.clone(), update: true, ..options.clone() };
        insula_bake::bake(&options, &Silent).unwrap();
        files(&updated)
    };
    assert_same(&files(&work.join("city")), &update_plainly(), "before");
    // Nothing has changed.
    let [regions, baked] = update_in_steps(&work, &options);
    assert!(regions > 5 && baked == 0, "{baked} of {regions}");
    assert_same(&files(&work.join("city")), &update_plainly(), "unchanged");
    // A house has another height.
    let text = fs::read_to_string(&inputs[1]).unwrap();
    let changed = text.replacen(r#""height":20,"#, r#""height":21,"#, 1);
    assert_ne!(changed, text);
    fs::write(&inputs[1], &changed).unwrap();
    let [_, baked] = update_in_steps(&work, &options);
    assert!((1..=4).contains(&baked), "{baked} of {regions}");
    let whole = plain(&folder.path, &options);
    assert_same(&files(&work.join("city")), &whole, "a changed house");
    assert_same(&update_plainly(), &whole, "a changed house, plainly");
    // A house more, in the middle of the town: the others keep their numbers.
    let at = changed.find(r#"{"type":"Feature","id":"h1-9""#).unwrap();
    let end = changed.find(r#"{"type":"Feature","id":"h1-10""#).unwrap();
    let house = changed[at..end].replace("h1-9", "new").replace(r#""height":"#, r#""height":1"#);
    let more = format!("{}{house}{}", &changed[..at], &changed[at..]);
    fs::write(&inputs[1], more).unwrap();
    let [_, baked] = update_in_steps(&work, &options);
    assert!((1..=4).contains(&baked), "{baked} of {regions}");
    assert_same(&files(&work.join("city")), &update_plainly(), "a house more");
    // Tiles that no region has any more are removed, and so are the numbers of the jobs before.
    assert_eq!([objects(&work, "tiles").len(), objects(&work, "numbers").len()], [2 * regions, 1]);
}

/// Ten towns on a line of 1,000 km.
fn write_country(folder: &Path) -> Vec<PathBuf> {
    let town = |town: usize| {
        let house = |i: usize| {
            let (x, y) =
                (100_000.0 * town as f64 + 300_000.0 + 40.0 * (i % 5) as f64, 5_000_000.0 + 30.0 * (i / 5) as f64);
            let members = format!(r#""id":"t{town}-{i}","properties":{{"height":9}}"#);
            rectangle(&members, [x, y, x + 12.25, y + 10.5])
        };
        let houses: Vec<String> = (0..25).map(house).collect();
        let path = folder.join(format!("town-{town}.geojson"));
        fs::write(&path, feature_collection("urn:ogc:def:crs:EPSG::25832", &houses)).unwrap();
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
    // The same town twice: alone, and 900 km east of another one. Its columns and meshes are the same.
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
    let both = vec![towns[0].clone(), towns[9].clone()];
    let (alone, of_country) = (town_bytes("alone", towns[9..].to_vec()), town_bytes("country", both));
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
    let request = |region_leaves| JobRequest { arguments: Vec::new(), chunk_bytes: 1, region_leaves, is_update: false };
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
    // Another job would find the tiles of a region by its input.
    ["region/0", "tiles"].iter().for_each(|name| fs::remove_dir_all(work.join(name)).unwrap());
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
    store.begin_parts("scan/0/triangles", 9).unwrap();
    let aborted = insula_bake::abort(&store).unwrap();
    assert!(aborted.objects > 10 && aborted.uploads.len() == 1);
    assert_eq!(fs::read_dir(&work).unwrap().count(), 0, "not even folders");
}

#[test]
fn a_change_of_the_inputs_ends_the_job() {
    let folder = TestFolder::new("steps-changed");
    let options = options(write_town(&folder.path, [139.75, 35.68], 2));
    let store = WorkFolder::new(&folder.path.join("work"));
    let request = JobRequest { arguments: Vec::new(), chunk_bytes: 1, region_leaves: 4, is_update: false };
    let job = BakeSteps::begin(&store, &options, &request, &Silent).unwrap();
    fs::write(&options.inputs[0], "{}").unwrap();
    let error = BakeSteps::open(&store, job, &options, &Silent).unwrap().run(BakeStage::Scan, 1).unwrap_err();
    assert!(error.is_final() && error.to_string().contains("have changed"), "{error}");
}
