//! Landmarks: from a file that places scans to mesh tiles with smooth, occluded objects of stone.

use super::support::{BakedCity, obj_box, options};
use insula_bake::read::ReadOptions;
use insula_bake::sample::SampleSettings;
use insula_bake::{BakeOptions, GroundOption};
use insula_protocol::{MeshTile, TileId, mesh_tile};
use insula_test_support::folder::TestFolder;
use insula_test_support::tier;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::sync::OnceLock;

/// A house of 8 m on level ground at height 3, 20 m west of the middle of the map, as OBJ.
fn house() -> String {
    let house = obj_box(0, [-24.0, -4.0, 3.0], [-16.0, 4.0, 11.0]);
    format!("o house\n{house}o terrain\nv -60 -60 3\nv 60 -60 3\nv 60 60 3\nv -60 60 3\nf 9 10 11 12\n")
}

/// A sphere of radius 1, inside out and with vertices of its own for each triangle, as text PLY.
fn scan(steps: u32) -> String {
    let point = |i: u32, j: u32| {
        let (theta, phi) = (
            f64::from(i) * std::f64::consts::PI / f64::from(steps),
            f64::from(j % (2 * steps)) * std::f64::consts::PI / f64::from(steps),
        );
        let is_pole = i == 0 || i == steps;
        let ring = if is_pole { 0.0 } else { theta.sin() };
        // Rough, as scans are: regular meshes code so well that levels of detail save nothing.
        let rough = if is_pole { 0 } else { (i * 7919 + j % (2 * steps) * 104_729) % 1000 };
        let radius = 1.0 - f64::from(rough) * 1e-5;
        format!("{:.7} {:.7} {:.7}\n", radius * ring * phi.cos(), radius * ring * phi.sin(), radius * theta.cos())
    };
    let (mut vertices, mut faces, mut count) = (String::new(), String::new(), 0);
    for (i, j) in (0..steps).flat_map(|i| (0..2 * steps).map(move |j| (i, j))) {
        let [a, b, c, d] = [point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)];
        for corners in [[&a, &c, &b], [&a, &d, &c]] {
            corners.iter().for_each(|corner| vertices.push_str(corner));
            writeln!(faces, "3 {} {} {}", count, count + 1, count + 2).unwrap();
            count += 3;
        }
    }
    let header = "ply\nformat ascii 1.0\n";
    let columns = "property float x\nproperty float y\nproperty float z\n";
    let list = "property list uchar int vertex_indices\nend_header\n";
    format!("{header}element vertex {count}\n{columns}element face {}\n{list}{vertices}{faces}", count / 3)
}

/// Bakes `town.obj` with the landmarks of `landmarks.json`.
fn bake_landmarks(folder: &TestFolder, ground: GroundOption, threads: usize) -> BakedCity {
    let options = BakeOptions {
        inputs: vec!["town.obj".into()],
        read: ReadOptions { landmarks: Some(folder.path.join("landmarks.json")), ..ReadOptions::default() },
        cell_m: 0.5,
        sample: SampleSettings::default(),
        ground,
        ..options(Path::new(""), threads)
    };
    BakedCity::bake_files(&folder.path, options)
}

/// Bakes the house with [`BALLS`].
fn baked(name: &str, threads: usize) -> BakedCity {
    let folder = TestFolder::new(name);
    fs::write(folder.path.join("town.obj"), house()).unwrap();
    fs::write(folder.path.join("ball.ply"), scan(40)).unwrap();
    fs::write(folder.path.join("landmarks.json"), BALLS).unwrap();
    bake_landmarks(&folder, GroundOption::None, threads)
}

/// The house with [`BALLS`], baked once with three threads.
fn balls() -> &'static BakedCity {
    static CITY: OnceLock<BakedCity> = OnceLock::new();
    CITY.get_or_init(|| baked("landmarks", 3))
}

/// All mesh tiles with their levels of detail.
fn tiles(city: &BakedCity) -> BTreeMap<(TileId, u8), MeshTile> {
    let (depth, archive) = (city.manifest().depth, city.archive("meshes.pmtiles"));
    let leaves = city.nodes().into_keys().filter(|id| id.level() == depth);
    let lods = leaves.flat_map(|leaf| (0..mesh_tile::MAX_LODS).map(move |lod| (leaf, lod)));
    let tile = |(leaf, lod): (TileId, u8)| {
        let bytes = archive.get(mesh_tile::archive_id(leaf, lod)?)?;
        Some(((leaf, lod), MeshTile::decode(leaf, lod, &bytes).unwrap()))
    };
    lods.filter_map(tile).collect()
}

const BALLS: &str = r#"{"landmarks": [
    {"mesh": "ball.ply", "name": "Ball", "position": [10, 5], "target-height": 4, "stone": "carrara-marble"},
    {"mesh": "ball.ply", "name": "Plain", "position": [10, -12, 9], "scale": 1.5}
]}"#;

#[test]
fn landmarks_stand_in_the_city_with_stone_and_occlusion() {
    let city = balls();
    let manifest = city.manifest();
    assert_eq!(manifest.stones, [r#"{"preset":"carrara-marble"}"#]);
    let (mut marble, mut plain) = (Vec::new(), Vec::new());
    for ((leaf, lod), tile) in tiles(city) {
        let corner = manifest.node_corner(leaf);
        let positions: Vec<[f64; 3]> = tile.mesh.positions_m().collect();
        for landmark in &tile.landmarks {
            let points = if landmark.stone == Some(0) { &mut marble } else { &mut plain };
            for (t, triangle) in
                tile.mesh.triangles.iter().enumerate().filter(|(t, _)| tile.objects[*t] == landmark.object)
            {
                for (k, vertex) in triangle.iter().enumerate().filter(|_| lod == 0) {
                    let p = positions[*vertex as usize];
                    points.push(([0, 1, 2].map(|axis| p[axis] + corner[axis]), tile.occlusion(3 * t + k).unwrap()));
                }
            }
        }
    }
    let range = |points: &[([f64; 3], f32)], axis: usize| {
        points.iter().fold([f64::MAX, f64::MIN], |[low, high], (p, _)| [low.min(p[axis]), high.max(p[axis])])
    };
    // On the terrain, around its place; the other one where it was put.
    for (points, expected) in
        [(&marble, [[8.0, 12.0], [3.0, 7.0], [3.0, 7.0]]), (&plain, [[8.5, 11.5], [-13.5, -10.5], [9.0, 12.0]])]
    {
        for (axis, [low, high]) in expected.into_iter().enumerate() {
            let found = range(points, axis);
            assert!((found[0] - low).abs() < 0.02 && (found[1] - high).abs() < 0.02, "{axis}: {found:?}");
        }
    }
    // The top sees the sky, the foot the ground.
    let mean = |z: std::ops::Range<f64>| {
        let at: Vec<f32> = marble.iter().filter(|(p, _)| z.contains(&p[2])).map(|(_, share)| *share).collect();
        at.iter().sum::<f32>() / at.len() as f32
    };
    let [foot, middle, top] = [mean(3.0..3.5), mean(4.8..5.2), mean(6.5..7.1)];
    assert!(foot < 0.15 && (0.4..0.6).contains(&middle) && top > 0.85, "{foot} {middle} {top}");
}

/// Two houses whose feet are 4 m apart in height, with a small landmark between.
#[test]
fn landmarks_stand_on_generated_ground() {
    let folder = TestFolder::new("landmark-ground");
    let block = |vertices: usize, x: f64, z: f64| obj_box(vertices, [x, 0.0, z], [x + 10.0, 10.0, z + 10.0]);
    let town = format!("o low\n{}o high\n{}", block(0, 0.0, 0.0), block(8, 50.0, 4.0));
    fs::write(folder.path.join("town.obj"), town).unwrap();
    fs::write(folder.path.join("ball.ply"), scan(40)).unwrap();
    let landmarks =
        r#"{"landmarks": [{"mesh": "ball.ply", "name": "Ball", "position": [18, 5], "target-height": 0.6}]}"#;
    fs::write(folder.path.join("landmarks.json"), landmarks).unwrap();
    let city = bake_landmarks(&folder, GroundOption::Auto, 2);
    let (mut lowest, mut ground) = (f64::MAX, f64::MIN);
    for ((leaf, _), tile) in tiles(&city).into_iter().filter(|((_, lod), _)| *lod == 0) {
        let corner = city.manifest().node_corner(leaf);
        let points: Vec<[f64; 3]> = tile.mesh.positions_m().map(|p| [0, 1, 2].map(|k| p[k] + corner[k])).collect();
        for (triangle, object) in tile.mesh.triangles.iter().zip(&tile.objects) {
            let [a, b, c] = triangle.map(|vertex| points[vertex as usize]);
            if tile.landmarks.iter().any(|landmark| landmark.object == *object) {
                lowest = lowest.min(a[2]).min(b[2]).min(c[2]);
                continue;
            }
            let cross = |p: [f64; 3], q: [f64; 3]| (p[0] - 18.0) * (q[1] - 5.0) - (p[1] - 5.0) * (q[0] - 18.0);
            let weights = [cross(b, c), cross(c, a), cross(a, b)];
            let whole: f64 = weights.iter().sum();
            if whole.abs() > 1e-9 && weights.iter().all(|weight| weight * whole >= 0.0) {
                ground = ground.max((weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2]) / whole);
            }
        }
    }
    assert!((-0.5..4.5).contains(&ground) && (lowest - ground).abs() < 0.05, "{lowest} on {ground}");
}

#[test]
fn landmarks_have_levels_of_a_quarter_each_and_the_same_bytes_on_any_threads() {
    let city = balls();
    assert!(city.files == baked("landmark-levels", 1).files);
    let triangles: Vec<u64> = city.report.meshes.iter().map(|lod| lod.triangles).collect();
    assert!(triangles.len() >= 3 && triangles.windows(2).all(|pair| pair[1] * 3 < pair[0]), "{triangles:?}");
}

/// Coarse levels of a leaf lose the smallest of its landmarks first, and those of which a few triangles cross its border.
#[test]
fn landmarks_of_any_size_stand_anywhere() {
    let (places, steps) = if tier::is_full() { (50, 40) } else { (12, 24) };
    let sizes_m: &[f64] = if tier::is_full() { &[0.3, 0.6, 1.2, 2.4, 6.0] } else { &[0.3, 0.6, 1.2, 2.4] };
    let folder = TestFolder::new("landmark-sizes");
    fs::write(folder.path.join("town.obj"), house()).unwrap();
    fs::write(folder.path.join("ball.ply"), scan(steps)).unwrap();
    let entry = |k: usize| {
        // One is larger than its leaf. Several would hide one another.
        let size_m = if tier::is_full() && k == 2 { 60.0 } else { sizes_m[k % sizes_m.len()] };
        let k = k as f64;
        // The leaf begins at 0. Each third one stands in that to the west, but for a little.
        let x = if k % 3.0 == 2.0 { -0.49 * size_m } else { (k * 37.7) % 28.0 + 2.0 };
        let y = (k * 23.3) % 28.0 + 2.0;
        format!(r#"{{"mesh": "ball.ply", "name": "{k}", "position": [{x}, {y}], "target-height": {size_m}}}"#)
    };
    let entries: Vec<String> = (0..places).map(entry).collect();
    fs::write(folder.path.join("landmarks.json"), format!(r#"{{"landmarks": [{}]}}"#, entries.join(","))).unwrap();
    let city = bake_landmarks(&folder, GroundOption::None, 2);
    let finest = tiles(&city).into_iter().filter(|((_, lod), _)| *lod == 0);
    let found: BTreeSet<u32> = finest.flat_map(|(_, tile)| tile.landmarks).map(|landmark| landmark.object).collect();
    assert_eq!(found.len(), places, "{found:?}");
}

#[test]
fn faults_name_the_file_and_the_landmark() {
    let folder = TestFolder::new("landmark-faults");
    fs::write(folder.path.join("town.obj"), house()).unwrap();
    fs::write(folder.path.join("ball.ply"), scan(8)).unwrap();
    for (text, expected) in [
        (r#"{"landmarks": [{"mesh": "ball.ply", "position": [1, 2], "stone": "chalk"}]}"#, "carrara-marble"),
        (r#"{"landmarks": [{"mesh": "ball.ply"}]}"#, "landmark 1"),
        (r#"{"landmarks": [{"mesh": "none.ply", "position": [1, 2]}]}"#, "none.ply"),
        (r#"{"landmarks": [{"mesh": "town.obj", "position": [1, 2], "size": 3}]}"#, "landmarks.json"),
    ] {
        let file = folder.path.join("landmarks.json");
        fs::write(&file, text).unwrap();
        let (inputs, out) = (vec![folder.path.join("town.obj")], folder.path.join("out"));
        let read = ReadOptions { landmarks: Some(file), ..ReadOptions::default() };
        let options = BakeOptions { inputs, read, ..options(&out, 2) };
        let error = insula_bake::bake(&options, &insula_bake::Silent).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
        assert!(!out.exists());
    }
}
