//! Water and glass in a finished city: which columns are reflective.

use super::support::{BakedCity, options};
use insula_bake::BakeOptions;
use insula_bake::read::{ReadOptions, read_embedded};
use insula_bake::sample::SampleSettings;
use insula_bake::scene::{Material, ObjectKind, Scene, SceneObject, SceneTriangle};
use insula_protocol::blockmap::{COLUMNS, NODE_CELLS, Quality, flag};
use insula_protocol::{BlockMap, TileId};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::OnceLock;

/// West, south, east and north end in metres.
type Square = [f64; 4];

const LAKE: Square = [0.0, 0.0, 100.0, 100.0];
const BRIDGE: Square = [0.0, 40.0, 100.0, 52.0];
const HOUSE: Square = [110.0, 20.0, 130.0, 60.0];
const TOWER: Square = [150.0, 20.0, 162.0, 32.0];

/// A lake at height 0, a bridge over it, a house beside it and a tower with walls of glass.
fn lake_city() -> String {
    let (mut vertices, mut objects) = (Vec::new(), Vec::new());
    let mut corners = |[west, south, east, north]: Square, z: f64| {
        let first = vertices.len();
        vertices.extend([[west, south, z], [east, south, z], [east, north, z], [west, north, z]]);
        [0, 1, 2, 3].map(|i| first + i)
    };
    let water = corners(LAKE, 0.0);
    let geometry = format!(r#"{{"type": "MultiSurface", "lod": "1", "boundaries": [[{water:?}]]}}"#);
    objects.push(format!(r#""lake": {{"type": "WaterBody", "geometry": [{geometry}]}}"#));
    let boxes = [
        ("bridge", "Bridge", BRIDGE, 5.0, 6.0, "WallSurface"),
        ("house", "Building", HOUSE, 0.0, 12.0, "WallSurface"),
        ("tower", "Building", TOWER, 0.0, 30.0, "Window"),
    ];
    for (id, kind, square, low, high, wall) in boxes {
        let [a, b, c, d] = corners(square, low);
        let [e, f, g, h] = corners(square, high);
        let faces = [[a, d, c, b], [e, f, g, h], [a, b, f, e], [b, c, g, f], [c, d, h, g], [d, a, e, h]];
        let boundaries = faces.map(|face| format!("[{face:?}]")).join(", ");
        let types = ["GroundSurface", "RoofSurface", wall].map(|kind| format!(r#"{{"type": "{kind}"}}"#)).join(", ");
        let semantics = format!(r#"{{"surfaces": [{types}], "values": [[0, 1, 2, 2, 2, 2]]}}"#);
        objects.push(format!(
            r#""{id}": {{"type": "{kind}", "geometry": [{{"type": "Solid", "lod": "2",
                "boundaries": [[{boundaries}]], "semantics": {semantics}}}]}}"#
        ));
    }
    let objects = objects.join(", ");
    format!(r#"{{"type": "CityJSON", "version": "2.0", "CityObjects": {{{objects}}}, "vertices": {vertices:?}}}"#)
}

fn scene() -> Scene {
    read_embedded(&[("lake.city.json", lake_city().as_bytes())], &ReadOptions::default(), &|_| {}).unwrap().0
}

fn bake(name: &str, scene: Scene) -> BakedCity {
    let sample = SampleSettings::default();
    BakedCity::bake(name, scene, BakeOptions { cell_m: 1.0, sample, ..options(Path::new(""), 2) })
}

/// The city, baked once.
fn reflective() -> &'static BakedCity {
    static CITY: OnceLock<BakedCity> = OnceLock::new();
    CITY.get_or_init(|| bake("reflective", scene()))
}

fn maps(city: &BakedCity) -> BTreeMap<TileId, BlockMap> {
    city.maps().into_iter().map(|(id, map)| (id, map.stand_on_ground())).collect()
}

/// Distance by which a point is inside of a square; negative outside.
fn depth_in([west, south, east, north]: Square, [x, y]: [f64; 2]) -> f64 {
    (x - west).min(east - x).min(y - south).min(north - y)
}

/// Calls `check` with the centre and the flags of each column of a level.
fn for_each_column(city: &BakedCity, level: u8, mut check: impl FnMut([f64; 2], u8)) {
    let manifest = city.manifest();
    let (side_m, cell_m) = (manifest.node_side_m(level), manifest.cell_m_at(level));
    for (id, map) in maps(city).into_iter().filter(|(id, _)| id.level() == level) {
        for i in (0..COLUMNS).filter(|i| map.flags[*i] & flag::OCCUPIED != 0) {
            let at = [(id.x(), i % NODE_CELLS), (id.y(), i / NODE_CELLS)]
                .map(|(node, cell)| f64::from(node) * side_m + (cell as f64 + 0.5) * cell_m);
            check([manifest.origin[0] + at[0], manifest.origin[1] + at[1]], map.flags[i]);
        }
    }
}

#[test]
fn water_and_glass_reflect_in_leaves_and_parents_but_not_what_stands_over_water() {
    let city = reflective();
    let depth = city.manifest().depth;
    assert!(depth >= 2);
    for level in [depth, depth - 1] {
        let cell_m = city.manifest().cell_m_at(level);
        let (mut water, mut bridge, mut land, mut glass) = (0, 0, 0, 0);
        for_each_column(city, level, |at, flags| {
            let is_reflective = flags & flag::REFLECTIVE != 0;
            let [lake, on_bridge, house, tower] = [LAKE, BRIDGE, HOUSE, TOWER].map(|square| depth_in(square, at));
            if lake > cell_m && on_bridge < -cell_m {
                assert!(is_reflective, "water at {at:?} of level {level} is matt");
                water += 1;
            } else if on_bridge > cell_m || house > cell_m || (lake < -cell_m && tower < -cell_m) {
                assert!(!is_reflective, "{at:?} of level {level} reflects");
                *(if on_bridge > cell_m { &mut bridge } else { &mut land }) += 1;
            } else if tower > 0.0 && is_reflective {
                glass += 1;
            }
        });
        let area = |m2: f64| (m2 / (cell_m * cell_m)) as i32;
        assert!(water > area(7000.0) && bridge > area(600.0) && land > area(700.0), "{water}, {bridge}, {land}");
        assert!(glass >= area(40.0), "{glass} columns of the tower reflect");
        assert!(glass <= area(12.0 * 12.0));
    }
}

#[test]
fn matt_cities_have_the_same_tiles_without_masks_and_other_fingerprints() {
    let reflective = reflective();
    let mut scene = scene();
    scene.materials.iter_mut().for_each(|material| material.is_reflective = false);
    let matt = bake("matt", scene);
    assert!(maps(&matt).values().all(|map| map.flags.iter().all(|flags| flags & flag::REFLECTIVE == 0)));
    assert_ne!(matt.files["fingerprints.bin"], reflective.files["fingerprints.bin"]);
    let mut of_reflective = maps(reflective);
    of_reflective.values_mut().flat_map(|map| &mut map.flags).for_each(|flags| *flags &= !flag::REFLECTIVE);
    assert!(of_reflective == maps(&matt));
}

/// A round pond of narrow triangles, 10 cm above land.
#[test]
fn what_lies_under_water_does_not_show_along_the_edges_of_its_triangles() {
    const MIDDLE: [f32; 2] = [60.0, 60.0];
    const RADIUS_M: f32 = 50.0;
    const CORNERS: usize = 40;
    let material = |rgb, is_reflective| Material { rgb, texture: None, is_reflective };
    let object = |id: &str| SceneObject { id: id.into(), kind: ObjectKind::Terrain, base_z_m: 0.0 };
    let (land, water) = ([200, 180, 150], [40, 90, 120]);
    let mut scene = Scene {
        materials: vec![material(land, false), material(water, true)],
        objects: vec![object("land"), object("pond")],
        ..Scene::default()
    };
    let mut add = |corners, number| {
        scene.triangles.push(SceneTriangle { corners, uv: [[0.0; 2]; 3], material: number, object: number });
    };
    let [a, b, c, d] = [[0.0, 0.0, 0.0], [120.0, 0.0, 0.0], [120.0, 120.0, 0.0], [0.0, 120.0, 0.0]];
    add([a, b, c], 0);
    add([a, c, d], 0);
    let shore = |i: usize| {
        let (sin, cos) = (i as f32 / CORNERS as f32 * std::f32::consts::TAU).sin_cos();
        [MIDDLE[0] + RADIUS_M * cos, MIDDLE[1] + RADIUS_M * sin, 0.1]
    };
    for i in 1..CORNERS - 1 {
        add([shore(0), shore(i), shore(i + 1)], 1);
    }
    let sample = SampleSettings::with_views(32);
    let options = BakeOptions { cell_m: 1.0, sample, quality: Quality::Lossless, ..options(Path::new(""), 2) };
    let city = BakedCity::bake("pond", scene, options);
    let manifest = city.manifest();
    let mut columns = 0;
    for (id, map) in maps(&city).into_iter().filter(|(id, _)| id.level() == manifest.depth) {
        for i in (0..COLUMNS).filter(|i| map.flags[*i] & flag::OCCUPIED != 0) {
            let at = |node: u32, cell: usize, axis: usize| {
                let m = f64::from(node) * manifest.node_side_m(manifest.depth) + cell as f64 + 0.5;
                manifest.origin[axis] + m - f64::from(MIDDLE[axis])
            };
            let from_middle = at(id.x(), i % NODE_CELLS, 0).hypot(at(id.y(), i / NODE_CELLS, 1));
            if from_middle < f64::from(RADIUS_M) - 2.0 {
                assert_eq!(map.roof[i].rgb(), water, "{from_middle} m from the middle");
                columns += 1;
            }
        }
    }
    assert!(columns > 7000, "{columns}");
}
