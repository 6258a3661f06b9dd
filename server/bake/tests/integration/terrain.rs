//! Elevation models in finished cities.

use super::support::{BakedCity, FEW_VIEWS};
use insula_bake::BakeOptions;
use insula_bake::read::{ReadOptions, SurroundingsOptions, TerrainOptions};
use insula_bake::sample::SampleSettings;
use insula_protocol::blockmap::flag;
use insula_protocol::{BlockMap, Manifest, TileId, octahedral};
use insula_test_support::folder::TestFolder;
use insula_test_support::map_files::{ascii_grid, feature_collection, rectangle};
use insula_test_support::rng::Rng;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// Where the test's maps are, in EPSG:25832.
const EAST_M: f64 = 500_000.0;
const NORTH_M: f64 = 5_400_000.0;

/// Hills and a sea in the south.
fn land_m(x: f64, y: f64) -> f64 {
    let hills = 80.0 + 60.0 * (x / 700.0).sin() + 50.0 * (y / 900.0).cos();
    if y < -2000.0 { 0.0 } else { hills }
}

/// Writes an ASCII grid of heights between two corners, from the origin of the test's maps.
fn write_grid(path: &Path, low: [f64; 2], high: [f64; 2], step_m: f64, height_m: impl Fn(f64, f64) -> f64) {
    let size = [0, 1].map(|axis| ((high[axis] - low[axis]) / step_m) as usize + 1);
    let corner = [EAST_M + low[0], NORTH_M + low[1]];
    let text = ascii_grid(corner, size, step_m, |x, y| height_m(low[0] + x, low[1] + y));
    fs::write(path, text).unwrap();
    fs::write(path.with_extension("prj"), "EPSG:25832").unwrap();
}

/// Writes two houses of 10 m with a distance of 400 m.
fn write_houses(path: &Path) {
    let house = |x: f64, y: f64| {
        let (x, y) = (EAST_M + x, NORTH_M + y);
        rectangle(r#""properties":{"height":12}"#, [x, y, x + 10.0, y + 10.0])
    };
    fs::write(path, feature_collection("EPSG:25832", &[house(30.0, 20.0), house(410.0, 250.0)])).unwrap();
}

/// Bakes files of a folder with few views, on which the heights of land hardly depend.
fn bake(folder: &TestFolder, options: BakeOptions) -> BakedCity {
    let sample = SampleSettings::with_views(FEW_VIEWS);
    BakedCity::bake_files(&folder.path, BakeOptions { threads: Some(2), sample, ..options })
}

/// The finest columns of a city.
struct Columns {
    manifest: Manifest,
    maps: BTreeMap<TileId, BlockMap>,
}

impl Columns {
    fn new(city: &BakedCity) -> Self {
        Self { manifest: city.manifest(), maps: city.maps() }
    }

    /// The finest node at a world position, and its column there.
    fn at(&self, world: [f64; 2]) -> (&BlockMap, usize, [f64; 2]) {
        let mut found = None;
        for level in 0..=self.manifest.depth {
            let side_m = self.manifest.node_side_m(level);
            let place = [0, 1].map(|axis| (world[axis] - self.manifest.origin[axis]) / side_m);
            let Some(map) = TileId::new(level, place[0] as u32, place[1] as u32).and_then(|id| self.maps.get(&id))
            else {
                break;
            };
            let cells = place.map(|along| along.fract() * 64.0);
            found = Some((map, cells[1] as usize * 64 + cells[0] as usize, cells.map(|cell| cell.fract() - 0.5)));
        }
        found.unwrap()
    }

    /// Side of the finest column at a world position, and world height of its top; `None` without one.
    fn top_m(&self, world: [f64; 2]) -> Option<(f64, f64)> {
        let (map, column, within) = self.at(world);
        if map.flags[column] & flag::OCCUPIED == 0 {
            let point = map.ground.as_ref()?.surface();
            let cell = [column % 64, column / 64];
            let at = [0, 1].map(|axis| cell[axis] as f64 + within[axis] + 0.5);
            let ground = point.at(at[0] as f32, at[1] as f32)?;
            let cell_m = f64::from(map.cell_m);
            return Some((cell_m, self.manifest.origin[2] + map.z_base_m() + f64::from(ground.z) * cell_m));
        }
        let cell_m = f64::from(map.cell_m);
        let mut top_m = f64::from(map.z_max[column]) * f64::from(map.z_step_m());
        if map.flags[column] & flag::INCLINED != 0 {
            let [nx, ny, nz] = octahedral::decode(map.roof_normal[column]).map(f64::from);
            top_m -= (nx * within[0] + ny * within[1]) / nz * cell_m;
        }
        Some((cell_m, self.manifest.origin[2] + map.z_base_m() + top_m))
    }
}

#[test]
fn land_surrounds_the_city_without_gaps() {
    let folder = TestFolder::new("terrain-far");
    write_houses(&folder.path.join("houses.geojson"));
    write_grid(&folder.path.join("far.asc"), [-7000.0, -7000.0], [7000.0, 7000.0], 50.0, land_m);
    let surroundings = SurroundingsOptions { files: vec![folder.path.join("far.asc")], reach_m: 4000.0 };
    let terrain = TerrainOptions { margin_m: 100.0, ..TerrainOptions::default() };
    let inputs = vec!["houses.geojson".into()];
    let read = ReadOptions { surroundings, terrain, ..ReadOptions::default() };
    let city = bake(&folder, BakeOptions { inputs, read, ..BakeOptions::default() });
    let columns = Columns::new(&city);
    let manifest = &columns.manifest;
    assert!(manifest.root_side_m >= 8000.0, "{}", manifest.root_side_m);
    // The initial view is that of the city.
    assert!(manifest.bounds[1][0] - manifest.bounds[0][0] < 1500.0, "{:?}", manifest.bounds);
    assert!(manifest.ground_z_m <= 0.0, "{}", manifest.ground_z_m);
    let widest = columns.maps.values().filter(|map| map.id.level() < manifest.depth);
    assert!(widest.clone().count() < 400, "{} nodes", widest.count());
    let mut rng = Rng::new(5);
    let mut cells = BTreeMap::new();
    for _ in 0..4000 {
        let [x, y] = [0, 1].map(|_| rng.range(-3900.0, 3900.0));
        let Some((cell_m, top_m)) = columns.top_m([EAST_M + x, NORTH_M + y]) else {
            panic!("no column at {x}, {y}");
        };
        *cells.entry(cell_m as u32).or_insert(0) += 1;
        let is_house = [[30.0, 20.0], [410.0, 250.0]]
            .iter()
            .any(|[west, south]| (west - 1.0..west + 11.0).contains(&x) && (south - 1.0..south + 11.0).contains(&y));
        // The shore is as steep as the grid has it.
        let is_shore = (y + 2025.0).abs() < 50.0 + 2.0 * cell_m;
        if !is_house && !is_shore {
            let expected_m = land_m(x, y);
            // Slopes are below 0.15, and the grid's points are 50 m apart.
            assert!((top_m - expected_m).abs() < 0.5 + 0.25 * cell_m, "{x}, {y}: {top_m} {expected_m}, cell {cell_m}");
        }
    }
    // Near the city cells are those of leaves, and far away they are large.
    assert!(cells.contains_key(&1) && cells.keys().any(|cell| *cell >= 16), "{cells:?}");
    assert!(cells.keys().all(|cell| *cell <= 64), "{cells:?}");
}

#[test]
fn drawn_terrain_is_within_the_error_of_the_model() {
    let folder = TestFolder::new("terrain-error");
    let hill_m = |x: f64, y: f64| 40.0 + 25.0 * (-(x * x + y * y) / 20_000.0).exp() + 3.0 * (x / 17.0).sin();
    write_grid(&folder.path.join("dem.asc"), [-300.0, -300.0], [300.0, 300.0], 2.0, hill_m);
    let inputs = vec!["dem.asc".into()];
    let city = BakedCity::bake_files(&folder.path, BakeOptions { inputs, threads: Some(2), ..BakeOptions::default() });
    let columns = Columns::new(&city);
    let mut rng = Rng::new(6);
    let mut errors: Vec<f64> = (0..20_000)
        .map(|_| {
            let [x, y] = [0, 1].map(|_| rng.range(-290.0, 290.0));
            let (_, top_m) =
                columns.top_m([EAST_M + x, NORTH_M + y]).unwrap_or_else(|| panic!("no ground at {x}, {y}"));
            (top_m - hill_m(x, y)).abs()
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    let at = |share: f64| errors[(errors.len() as f64 * share) as usize];
    // Within the error of a fifth of a cell, and the steps of heights.
    assert!(at(0.95) < 0.2 + 0.07, "median {}, 95% {}, largest {}", at(0.5), at(0.95), at(0.9999));
}

#[test]
fn plain_land_ends_above_the_leaves() {
    let folder = TestFolder::new("terrain-plain");
    write_houses(&folder.path.join("houses.geojson"));
    // Level in the west, evenly inclined in the middle, hilly in the east.
    let land_m = |x: f64, y: f64| match x {
        x if x < -100.0 => 20.0,
        x if x < 200.0 => 20.0 + 0.1 * (x + 100.0),
        x => 50.0 + 4.0 * ((x - 200.0) / 30.0).sin() + 3.0 * (y / 25.0).sin(),
    };
    write_grid(&folder.path.join("dem.asc"), [-900.0, -320.0], [660.0, 510.0], 10.0, land_m);
    let terrain = TerrainOptions { margin_m: 600.0, ..TerrainOptions::default() };
    let options = || BakeOptions {
        inputs: vec!["houses.geojson".into(), "dem.asc".into()],
        read: ReadOptions { terrain, ..ReadOptions::default() },
        ..BakeOptions::default()
    };
    let city = bake(&folder, options());
    let columns = Columns::new(&city);
    let depth = columns.manifest.depth;
    let has_leaf = |x: f64, y: f64| {
        let side_m = columns.manifest.node_side_m(depth);
        let [x, y] = [(0, EAST_M + x), (1, NORTH_M + y)]
            .map(|(axis, along)| ((along - columns.manifest.origin[axis]) / side_m) as u32);
        TileId::new(depth, x, y).is_some_and(|id| columns.maps.contains_key(&id))
    };
    let mut rng = Rng::new(8);
    let mut leaves = [[0, 0]; 2];
    for _ in 0..4000 {
        // Without the nodes at the southern and northern border.
        let [x, y] = [rng.range(-550.0, 640.0), rng.range(-190.0, 440.0)];
        let (cell_m, top_m) =
            columns.top_m([EAST_M + x, NORTH_M + y]).unwrap_or_else(|| panic!("no column at {x}, {y}"));
        let near_house = [[30.0, 20.0], [410.0, 250.0]]
            .iter()
            .any(|[west, south]| (west - 12.0..west + 22.0).contains(&x) && (south - 12.0..south + 22.0).contains(&y));
        if !near_house && cell_m > 1.0 {
            assert!((top_m - land_m(x, y)).abs() < 0.35, "{x}, {y}: {top_m} {}, cell {cell_m}", land_m(x, y));
        }
        if !(-100.0..200.0).contains(&x) {
            leaves[usize::from(x > 0.0)][usize::from(has_leaf(x, y))] += 1;
        }
    }
    let share = |[without, with]: [u32; 2]| f64::from(with) / f64::from(without + with);
    assert!(share(leaves[0]) < 0.3 && share(leaves[1]) > 0.9, "leaves in the level and in the hilly part: {leaves:?}");
    let version = columns.manifest.version.clone();
    let updated = bake(&folder, BakeOptions { update: true, ..options() });
    assert_eq!(updated.manifest().version, version);
}
