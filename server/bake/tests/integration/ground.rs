//! Generated ground in a finished city.

use super::support::{BakedCity, add_box, options};
use insula_bake::sample::SampleSettings;
use insula_bake::scene::{Material, ObjectKind, Scene, SceneObject};
use insula_bake::{BakeOptions, GroundOption};
use insula_protocol::blockmap::flag;
use insula_protocol::blockmap::ground::{GROUND_COLOUR, SKY_MAX, VERTICES};
use insula_protocol::{BlockMap, TileId};
use std::path::Path;
use std::sync::OnceLock;

/// Distance of the houses, and their side.
const STEP_M: f32 = 24.0;
const HOUSE_M: f32 = 10.0;
/// Rise of the hillside per metre to the east.
const SLOPE: f32 = 0.05;

/// Houses of 10 m in rows on a hillside, around a yard of 20 m between walls of 30 m.
fn hillside() -> Scene {
    let mut scene =
        Scene { materials: vec![Material { rgb: [200; 3], texture: None, is_reflective: false }], ..Scene::default() };
    for (column, row) in (0..12).flat_map(|row| (0..12).map(move |column| (column as f32, row as f32))) {
        let [x, y] = [column * STEP_M, row * STEP_M];
        let is_yard = (4.0..8.0).contains(&column) && (4.0..8.0).contains(&row);
        if !is_yard {
            add_house(&mut scene, [x, y], [x + HOUSE_M, y + HOUSE_M], 8.0);
        }
    }
    let [west, south, east, north] = [120.0, 120.0, 140.0, 140.0];
    add_house(&mut scene, [west - 5.0, south - 5.0], [west, north + 5.0], 30.0);
    add_house(&mut scene, [east, south - 5.0], [east + 5.0, north + 5.0], 30.0);
    add_house(&mut scene, [west, south - 5.0], [east, south], 30.0);
    add_house(&mut scene, [west, north], [east, north + 5.0], 30.0);
    scene
}

/// Height of the hillside.
fn base_m(x: f32) -> f32 {
    5.0 + SLOPE * x
}

fn add_house(scene: &mut Scene, [west, south]: [f32; 2], [east, north]: [f32; 2], height_m: f32) {
    let base_z_m = base_m(west);
    scene.objects.push(SceneObject { id: scene.objects.len().to_string(), kind: ObjectKind::Building, base_z_m });
    add_box(scene, [west, south, base_z_m], [east, north, base_z_m + height_m], [0, 0]);
}

fn bake(name: &str, ground: GroundOption, threads: usize) -> BakedCity {
    // With all views: the occlusion of the ground is compared.
    let sample = SampleSettings::default();
    BakedCity::bake(name, hillside(), BakeOptions { ground, cell_m: 1.0, sample, ..options(Path::new(""), threads) })
}

/// The hillside with generated ground, baked once with three threads.
fn with_ground() -> &'static BakedCity {
    static CITY: OnceLock<BakedCity> = OnceLock::new();
    CITY.get_or_init(|| bake("hillside", GroundOption::Auto, 3))
}

#[test]
fn ground_follows_the_feet_and_meets_the_plane() {
    let city = with_ground();
    let manifest = city.manifest();
    assert!(manifest.generated_ground && !manifest.has_terrain);
    let maps = city.maps();
    let height_at = |x: f64, y: f64| {
        let side_m = manifest.node_side_m(manifest.depth);
        let at = [x - manifest.origin[0], y - manifest.origin[1]].map(|v| v / side_m);
        let map = &maps[&TileId::new(manifest.depth, at[0] as u32, at[1] as u32)?];
        let [x, y] = at.map(|v| (v.fract() * 64.0) as f32);
        let point = map.ground.as_ref()?.surface().at(x, y)?;
        Some(manifest.origin[2] + map.z_base_m() + f64::from(point.z * map.cell_m))
    };
    for (column, row) in (0..12).flat_map(|row| (0..12).map(move |column| (column, row))) {
        let [x, y] = [column, row].map(|n| f64::from(n as f32 * STEP_M) + 5.0);
        let base = f64::from(base_m(column as f32 * STEP_M));
        // A house stands level on the slope, so the ground lies between its base and its higher side.
        let ground = height_at(x, y).unwrap();
        assert!(ground > base - 0.3 && ground < base + 1.3, "{ground} below the house at {x}, {y} with base {base}");
    }
    // The ends of the ground are as high as the plane.
    let ends = maps.values().filter(|map| map.id.level() == manifest.depth).filter_map(|map| {
        let ground = map.ground.as_ref()?;
        let base_m = manifest.origin[2] + map.z_base_m();
        let heights = ground.surface().heights;
        let has_square = |x: usize, y: usize| ground.squares >> (y * 8 + x) & 1 == 1;
        let pairs = (0..8).flat_map(|y| (1..8).map(move |x| (x, y))).collect::<Vec<_>>();
        // Vertices on the line between a square with ground and one without.
        let west_east = pairs.iter().filter(|(x, y)| has_square(*x, *y) != has_square(x - 1, *y));
        let south_north = pairs.iter().filter(|(x, y)| has_square(*y, *x) != has_square(*y, x - 1));
        let on_lines = west_east.map(|(x, y)| y * VERTICES + x).chain(south_north.map(|(x, y)| x * VERTICES + y));
        Some(on_lines.map(|i| base_m + f64::from(heights[i] * map.cell_m)).collect::<Vec<_>>())
    });
    let ends: Vec<f64> = ends.flatten().collect();
    assert!(!ends.is_empty());
    for z in ends {
        assert!(
            (z - manifest.ground_z_m).abs() < 0.3,
            "ground ends at {z}, and the plane is at {}",
            manifest.ground_z_m
        );
    }
}

#[test]
fn neighbours_agree_on_their_border_and_parents_follow() {
    let city = with_ground();
    let (manifest, maps) = (city.manifest(), city.maps());
    let mut compared = 0;
    for (id, map) in &maps {
        let east = TileId::new(id.level(), id.x() + 1, id.y()).and_then(|east| maps.get(&east));
        let (Some(own), Some((other, east))) = (&map.ground, east.and_then(|east| Some((east, east.ground.as_ref()?))))
        else {
            continue;
        };
        let (own, next) = (own.surface(), east.surface());
        for y in 0..VERTICES {
            let uses_both = |squares: u64, x: usize| y < 8 && squares >> (y * 8 + x) & 1 == 1;
            if uses_both(map.ground.as_ref().unwrap().squares, 7) && uses_both(east.squares, 0) {
                let z = |surface: &[f32], x: usize, map: &BlockMap| {
                    map.z_base_m() + f64::from(surface[y * VERTICES + x] * map.cell_m)
                };
                let (a, b) = (z(&own.heights, VERTICES - 1, map), z(&next.heights, 0, other));
                let tolerance_m =
                    if id.level() == manifest.depth { 1e-6 } else { 0.5 * manifest.cell_m_at(id.level()) };
                assert!((a - b).abs() <= tolerance_m, "{id}, row {y}: {a} and {b}");
                compared += 1;
            }
        }
    }
    assert!(compared > 100, "{compared}");
    assert!(maps[&TileId::ROOT].ground.is_some());
}

#[test]
fn yard_is_darker_than_the_open() {
    let city = with_ground();
    let (manifest, maps) = (city.manifest(), city.maps());
    let sky_at = |x: f64, y: f64| {
        let at = [x - manifest.origin[0], y - manifest.origin[1]].map(|v| v / manifest.node_side_m(manifest.depth));
        let map = &maps[&TileId::new(manifest.depth, at[0] as u32, at[1] as u32).unwrap()];
        let [x, y] = at.map(|v| (v.fract() * 64.0) as f32);
        map.ground.as_ref().unwrap().surface().at(x, y).unwrap().ao
    };
    let (yard, square) = (sky_at(130.0, 130.0), sky_at(105.0, 180.0));
    assert!(yard < 25 && square > 40, "{yard} and {square} of {}", 9 * SKY_MAX);
}

#[test]
fn columns_of_the_ground_close_the_gaps_between_houses() {
    let city = with_ground();
    let manifest = city.manifest();
    for map in city.maps().into_values().filter(|map| map.id.level() == manifest.depth) {
        let (had_ground, stored) = (map.ground.clone(), map.flags.clone());
        let map = map.stand_on_ground();
        let Some(ground) = had_ground.filter(|ground| ground.squares == u64::MAX) else { continue };
        assert!(map.flags.iter().all(|flags| flags & flag::OCCUPIED != 0), "{} has holes", map.id);
        for i in (0..stored.len()).filter(|i| stored[*i] == 0) {
            assert_eq!(map.roof[i].rgb(), GROUND_COLOUR);
        }
        drop(ground);
    }
}

#[test]
fn ground_does_not_depend_on_threads_and_can_be_left_out() {
    let one = bake("hillside-one", GroundOption::Auto, 1);
    assert!(one.files == with_ground().files);
    let none = bake("hillside-none", GroundOption::None, 2);
    assert!(!none.manifest().generated_ground);
    assert!(none.maps().values().all(|map| map.ground.is_none()));
    let bytes = |city: &BakedCity| city.files.values().map(Vec::len).sum::<usize>();
    assert!(bytes(&none) < bytes(&one));
}
