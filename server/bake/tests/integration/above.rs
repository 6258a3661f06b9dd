//! Things above one another: it does not matter whether a source has them as one object or as many, and layers on the ground do
//! not shade each other. Stored occlusion is that of a hemisphere.

use super::support::{BakedCity, add_box, options};
use insula_bake::columns::voxels::VoxelNode;
use insula_bake::sample::{BlockInput, SampleSettings, sample_block};
use insula_bake::scene::grid::CityGrid;
use insula_bake::scene::{Material, ObjectKind, Scene, SceneObject, SceneTriangle};
use insula_bake::{BakeOptions, GroundOption};
use insula_protocol::blockmap::ground::GROUND_COLOUR;
use insula_protocol::texel::AO_MAX;
use insula_protocol::{BlockMap, TileId};
use std::collections::BTreeMap;
use std::path::Path;

fn empty() -> Scene {
    Scene { materials: vec![Material { rgb: [200; 3], texture: None, is_reflective: false }], ..Scene::default() }
}

fn add_object(scene: &mut Scene, kind: ObjectKind, base_z_m: f32) {
    scene.objects.push(SceneObject { id: scene.objects.len().to_string(), kind, base_z_m });
}

fn add_face(scene: &mut Scene, [a, b, c, d]: [[f32; 3]; 4]) {
    let object = scene.objects.len() as u32 - 1;
    let face = |corners| SceneTriangle { corners, uv: [[0.0; 2]; 3], material: 0, object };
    scene.triangles.extend([face([a, b, c]), face([a, c, d])]);
}

/// Adds a level rectangle of ground as an object of its own: west, south, east, north, height.
fn add_ground(scene: &mut Scene, [west, south, east, north, z]: [f32; 5]) {
    add_object(scene, ObjectKind::Terrain, z);
    add_face(scene, [[west, south, z], [east, south, z], [east, north, z], [west, north, z]]);
}

/// Boxes as one object, or each as its own, and two small ones far away, so that there are levels above the leaves.
fn stacked(boxes: &[[[f32; 3]; 2]], is_one: bool) -> Scene {
    let mut scene = empty();
    let lowest = boxes.iter().map(|[low, _]| low[2]).fold(f32::INFINITY, f32::min);
    for (i, [low, high]) in boxes.iter().enumerate() {
        if i == 0 || !is_one {
            add_object(&mut scene, ObjectKind::Building, if is_one { lowest } else { low[2] });
        }
        add_box(&mut scene, *low, *high, [0, 0]);
    }
    for at in [-90.0, 150.0] {
        add_object(&mut scene, ObjectKind::Building, 0.0);
        add_box(&mut scene, [at, at, 0.0], [at + 2.0, at + 2.0, 2.0], [0, 0]);
    }
    scene
}

/// The heights that are full, and whether the column stands on the ground.
type Form = (u16, u16, bool, Option<[u16; 2]>, Vec<bool>);

/// The forms of the columns of all nodes.
fn forms(name: &str, scene: Scene, ground: GroundOption) -> BTreeMap<TileId, Vec<Option<Form>>> {
    let options = BakeOptions { ground, cell_m: 1.0, meshes: false, ..options(Path::new(""), 2) };
    let city = BakedCity::bake(name, scene, options);
    let node = |(id, map): (TileId, BlockMap)| {
        let form = |column: insula_protocol::blockmap::MapColumn| {
            let rows = column.strip.iter().flat_map(|strip| &strip.texels).map(|texel| texel.is_open()).collect();
            (column.z_min, column.z_max, column.suspended, column.gap, rows)
        };
        (id, map.columns().into_iter().map(|column| column.map(form)).collect())
    };
    city.maps().into_iter().map(node).collect()
}

#[test]
fn objects_above_others_have_the_columns_of_one_object() {
    let slabs = [0.0, 9.0, 18.0, 27.0].map(|z| [[10.0, 10.0, z], [50.0, 40.0, z + 1.0]]);
    let part = [[[10.0, 10.0, 0.0], [40.0, 40.0, 6.0]], [[8.0, 8.0, 20.0], [42.0, 42.0, 30.0]]];
    let bridge = [
        [[5.0, 25.0, 0.0], [60.0, 35.0, 0.3]],
        [[25.0, 5.0, 6.0], [35.0, 60.0, 7.0]],
        [[28.0, 6.0, 0.0], [32.0, 7.5, 6.0]],
        [[28.0, 57.0, 0.0], [32.0, 58.5, 6.0]],
    ];
    for (name, boxes) in [("slabs", &slabs[..]), ("part", &part), ("bridge", &bridge)] {
        for ground in [GroundOption::None, GroundOption::Auto] {
            let [one, many] = [true, false].map(|is_one| forms(name, stacked(boxes, is_one), ground));
            assert_eq!(one.keys().collect::<Vec<_>>(), many.keys().collect::<Vec<_>>());
            for (id, columns) in &one {
                let differing = columns.iter().zip(&many[id]).filter(|(one, many)| one != many).count();
                assert_eq!(differing, 0, "{name} {ground:?} {id:?}");
            }
            let has_gaps = |columns: &Vec<Option<Form>>| {
                columns.iter().flatten().any(|(_, _, suspended, gap, rows)| {
                    *suspended || gap.is_some() || rows.iter().any(|is_open| *is_open)
                })
            };
            let depth = many.keys().map(|id| id.level()).max().unwrap();
            for level in [depth, depth - 1, depth - 2] {
                assert!(many.iter().any(|(id, columns)| id.level() == level && has_gaps(columns)), "{name} {level}");
            }
        }
    }
}

/// The leaf over the square of 64 m from the scene's origin, with cells of 1 m.
fn leaf(scene: &Scene) -> VoxelNode {
    let grid = CityGrid { corner: [0.0, 0.0, -10.0], depth: 1, cell_m: 1.0 };
    let triangles: Vec<u32> = (0..scene.triangles.len() as u32).collect();
    let leaves = [TileId::new(1, 0, 0).unwrap()];
    let input = BlockInput { scene, grid: &grid, triangles: &triangles, leaves: &leaves };
    sample_block(&input, &SampleSettings::default()).pop().unwrap()
}

#[test]
fn layers_on_the_ground_do_not_shade_each_other() {
    let mut scene = empty();
    add_ground(&mut scene, [-100.0, -100.0, 200.0, 200.0, 0.01]);
    add_ground(&mut scene, [8.0, 8.0, 50.0, 50.0, 0.02]);
    // A path and a road across.
    add_ground(&mut scene, [20.0, -50.0, 22.0, 150.0, 0.05]);
    add_ground(&mut scene, [-50.0, 30.0, 150.0, 36.0, 0.07]);
    let node = leaf(&scene);
    for (i, column) in node.columns.iter().enumerate() {
        let ao = column.as_ref().unwrap().roof.ao;
        assert!(ao > 0.97, "{ao} at {}, {}", i % 64, i / 64);
    }
}

#[test]
fn generated_ground_hides_no_flat_land_at_any_level() {
    let mut scene = empty();
    for [x, y] in [[-20.0, -20.0], [260.0, -20.0], [-20.0, 260.0], [260.0, 260.0]] {
        add_object(&mut scene, ObjectKind::Building, 0.0);
        add_box(&mut scene, [x, y, 0.0], [x + 10.0, y + 10.0, 8.0], [0, 0]);
    }
    add_ground(&mut scene, [0.0, 0.0, 250.0, 250.0, 0.02]);
    add_ground(&mut scene, [120.0, -40.0, 126.0, 290.0, 0.05]);
    let options = BakeOptions { ground: GroundOption::Auto, cell_m: 1.0, meshes: false, ..options(Path::new(""), 2) };
    let city = BakedCity::bake("flat-land", scene, options);
    let manifest = city.manifest();
    let mut levels = BTreeMap::new();
    for (id, map) in city.maps() {
        let map = map.stand_on_ground();
        let cell_m = f64::from(map.cell_m);
        for (i, column) in map.columns().iter().enumerate() {
            let at = |axis: usize, tile: u32, n: usize| {
                manifest.origin[axis] + (f64::from(tile) * 64.0 + n as f64 + 0.5) * cell_m
            };
            let [x, y] = [at(0, id.x(), i % 64), at(1, id.y(), i / 64)];
            if [x, y].iter().all(|v| *v > 2.0 * cell_m && *v < 250.0 - 2.0 * cell_m) {
                let roof = column.as_ref().unwrap().roof;
                assert_ne!(roof.rgb(), GROUND_COLOUR, "{id:?} at {x}, {y}");
                assert!(f32::from(roof.ao()) > 0.9 * f32::from(AO_MAX), "{} of {id:?} at {x}, {y}", roof.ao());
                *levels.entry(id.level()).or_insert(0) += 1;
            }
        }
    }
    assert!(levels.len() >= 4, "{levels:?}");
}

/// Share of the sky that a point on a wall that faces east sees past a long wall at a distance: every direction of a fine grid
/// over the quarter of the sphere in front of it, weighted by its cosine.
fn brute_force_sky(z: f32, street_m: f32, wall_m: f32) -> f32 {
    const STEPS: usize = 400;
    let (mut seen, mut all) = (0.0, 0.0);
    for (i, j) in (0..STEPS).flat_map(|i| (0..STEPS).map(move |j| (i, j))) {
        let up = (i as f32 + 0.5) / STEPS as f32;
        let (sin, cos) =
            ((j as f32 + 0.5) / STEPS as f32 * std::f32::consts::PI - std::f32::consts::FRAC_PI_2).sin_cos();
        let level = (1.0 - up * up).sqrt();
        let [east, north] = [level * cos, level * sin];
        let is_past_the_end = (north / east * street_m).abs() > 120.0;
        all += 2.0 * east;
        if is_past_the_end || z + up / east * street_m > wall_m {
            seen += east;
        }
    }
    seen / all
}

#[test]
fn occlusion_of_walls_in_a_deep_street_is_that_of_a_hemisphere() {
    let mut scene = empty();
    for [west, east] in [[10.0, 20.0], [30.0, 40.0]] {
        add_object(&mut scene, ObjectKind::Building, 0.0);
        add_box(&mut scene, [west, -88.0, 0.0], [east, 152.0, 24.0], [0, 0]);
    }
    let node = leaf(&scene);
    for z in [1, 6, 12, 18, 22] {
        let expected = brute_force_sky(z as f32 + 0.5, 10.0, 24.0);
        let rows = (20..44).map(|y| {
            let column = node.columns[y * 64 + 19].as_ref().unwrap();
            column.wall[(z + 10 - column.first_row) as usize].ao
        });
        let mean = rows.sum::<f32>() / 24.0;
        assert!((mean - expected).abs() < 0.02, "{mean} instead of {expected} at {z} m");
    }
}
