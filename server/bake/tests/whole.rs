//! A finished city: the same whatever the threads, sound in every node, and in place of the one before it.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use std::{fs, path::Path, sync::Mutex};

use insula_bake::{
    BakeError, BakeOptions, Progress, Silent, bake_scene,
    read::ReadReport,
    scene::{ObjectKind, Scene, SceneObject, SceneTriangle},
};
use insula_protocol::{BlockMap, Manifest, TileId, manifest::Attribution, subtree::NodeInfo};
use support::{Archive, Folder, bake, city, files, manifest, nodes, options, partial};

#[test]
fn one_thread_and_three_give_the_same_bytes() {
    let folder = Folder::new("threads");
    let report = bake(&options(&folder.out("one"), 1), &Silent).unwrap();
    bake(&options(&folder.out("three"), 3), &Silent).unwrap();
    let one = files(&folder.out("one"));
    assert_eq!(
        one.keys().collect::<Vec<_>>(),
        ["blockmaps.pmtiles", "city.json", "fingerprints.bin", "meshes.pmtiles", "subtrees.pmtiles"]
    );
    assert!(one == files(&folder.out("three")));
    assert_eq!(report.city_bytes, one.values().map(|bytes| bytes.len() as u64).sum::<u64>());
    assert!(!partial(&folder.out("one")).exists());
}

fn centre(manifest: &Manifest, node: &NodeInfo) -> [f32; 3] {
    let side = manifest.node_side_m(node.id.level());
    let [x, y] = [node.id.x(), node.id.y()].map(|v| ((f64::from(v) + 0.5) * side) as f32);
    [x, y, (node.z_min_m + node.z_max_m) / 2.0]
}

fn check_child(manifest: &Manifest, parent: &NodeInfo, child: &NodeInfo) {
    let id = child.id;
    assert!(child.error_m <= parent.error_m, "the error of {id} does not nest");
    assert!(child.z_min_m >= parent.z_min_m && child.z_max_m <= parent.z_max_m, "the heights of {id} do not nest");
    let (p, c) = (centre(manifest, parent), centre(manifest, child));
    let distance = (0..3).map(|k| (p[k] - c[k]).powi(2)).sum::<f32>().sqrt();
    assert!(distance + child.radius_m <= parent.radius_m, "the sphere of {id} does not nest");
}

#[test]
fn every_named_node_has_a_tile_and_spheres_and_errors_nest() {
    let folder = Folder::new("nodes");
    let out = folder.out("city");
    bake(&options(&out, 2), &Silent).unwrap();
    let (manifest, nodes) = (manifest(&out), nodes(&out));
    let archive = Archive::open(&out.join("blockmaps.pmtiles"));
    assert_eq!(archive.tiles(), nodes.len() as u64);
    assert!(archive.clustered());
    for (id, node) in &nodes {
        let bytes = archive.get(*id).unwrap();
        assert_eq!(bytes.len() as u32, node.blockmap_bytes);
        let map = BlockMap::decode(*id, &bytes).unwrap();
        assert_eq!((map.id, f64::from(map.cell_m)), (*id, manifest.cell_m_at(id.level())));
        for i in (0..map.flags.len()).filter(|i| map.flags[*i] != 0) {
            let [low, high] = [map.z_min[i], map.z_max[i]]
                .map(|code| (map.z_base_m() + f64::from(code) * f64::from(map.z_step_m())) as f32);
            assert!(low >= node.z_min_m && high <= node.z_max_m, "a column of {id} lies outside its node");
        }
        assert!(f64::from(node.error_m) > 0.8660 * manifest.cell_m_at(id.level()));
        assert_eq!(node.child_mask == 0, id.level() == manifest.depth);
        for child in id.children().filter_map(|child| nodes.get(&child)) {
            assert!(node.child_mask >> child.id.quadrant() & 1 == 1);
            check_child(&manifest, node, child);
        }
        assert!(id.parent().is_none_or(|parent| nodes.contains_key(&parent)));
    }
}

#[test]
fn equal_squares_are_stored_once() {
    let folder = Folder::new("equal");
    let mut scene = Scene { materials: city().materials, ..Scene::default() };
    let corner = |x: f32, y: f32| [x * 1000.0, y * 1000.0, 5.0];
    for corners in
        [[corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0)], [corner(0.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)]]
    {
        scene.triangles.push(SceneTriangle { corners, uv: [[0.0; 2]; 3], material: 0, object: 0 });
    }
    scene.objects.push(SceneObject { id: "plain".into(), kind: ObjectKind::Terrain, base_z_m: 5.0 });
    let out = folder.out("plain");
    bake_scene(scene, ReadReport::default(), &options(&out, 2), &Silent).unwrap();
    // Of a PMTiles v3 header: tiles that can be asked for, and contents that are stored.
    let header = fs::read(out.join("blockmaps.pmtiles")).unwrap();
    let number = |at: usize| u64::from_le_bytes(header[at..at + 8].try_into().unwrap());
    let (tiles, contents) = (number(72), number(88));
    assert!(tiles > 40 && contents < tiles / 2, "{contents} contents for {tiles} tiles");
}

#[test]
fn the_manifest_tells_the_truth() {
    let folder = Folder::new("manifest");
    let out = folder.out("city");
    let report = bake(&options(&out, 2), &Silent).unwrap();
    let (manifest, nodes) = (manifest(&out), nodes(&out));
    manifest.check().unwrap();
    assert_eq!((manifest.name.as_str(), manifest.title.as_str(), manifest.depth), ("boxes", "boxes", 6));
    assert_eq!(manifest.crs.as_deref(), Some("EPSG:7415"));
    assert_eq!((manifest.counts.objects, manifest.counts.triangles), (9, 108));
    assert!(!manifest.has_terrain);
    // The fifth of nine bases, 1 + 4 * 0.25, above the origin at -2.
    assert_eq!(manifest.ground_z_m, 0.0);
    assert_eq!(manifest.bounds, [[84_020.0, 447_030.0, -1.0], [86_312.0, 447_910.0, 80.0]]);
    for level in 0..=manifest.depth {
        let of_level = || nodes.values().filter(|node| node.id.level() == level);
        let bytes: u64 = of_level().map(|node| u64::from(node.blockmap_bytes)).sum();
        assert_eq!(manifest.counts.nodes_per_level[usize::from(level)], of_level().count() as u64);
        assert_eq!(manifest.counts.bytes_per_level[usize::from(level)], bytes);
        let reported = &report.levels[usize::from(level)];
        assert_eq!((reported.level, reported.bytes), (level, bytes));
    }
    let heights = nodes[&TileId::ROOT];
    let low = manifest.origin[2] + f64::from(heights.z_min_m);
    assert!((manifest.bounds[0][2] - low).abs() < 2.0, "{low}");
    let stages: Vec<_> = report.stages.iter().map(|stage| stage.name.as_str()).collect();
    assert_eq!(stages[..3], ["partition", "sample", "level 5"]);
    assert_eq!(stages.last(), Some(&"write"));
    assert!(serde_json::to_value(&report).unwrap()["triangles_per_second"].as_f64().unwrap() > 0.0);
}

#[test]
fn names_and_content_are_in_the_version() {
    let folder = Folder::new("version");
    let version = |run: &str, options: BakeOptions| {
        bake(&options, &Silent).unwrap();
        manifest(&folder.out(run)).version
    };
    let base = version("a", options(&folder.out("a"), 2));
    let attribution = vec![Attribution { text: "Kadaster".into(), licence: Some("CC BY 4.0".into()), url: None }];
    let named = version("b", BakeOptions { attribution: attribution.clone(), ..options(&folder.out("b"), 2) });
    assert_ne!(base, named);
    assert_eq!(manifest(&folder.out("b")).attribution, attribution);
    assert_ne!(base, version("c", BakeOptions { cell_m: 4.0, ..options(&folder.out("c"), 2) }));
}

/// Looks, at every step, whether the city from before is still whole.
struct Watch<'a> {
    city: &'a Path,
    before: Vec<u8>,
    stages: Mutex<Vec<String>>,
}

impl Progress for Watch<'_> {
    fn stage(&self, name: &str, _total: u64) {
        self.stages.lock().unwrap().push(name.to_owned());
    }
    fn advance(&self, _n: u64) {
        assert_eq!(fs::read(self.city.join("city.json")).unwrap(), self.before);
    }
}

#[test]
fn a_city_is_replaced_at_the_very_end() {
    let folder = Folder::new("replace");
    let out = folder.out("city");
    bake(&BakeOptions { cell_m: 4.0, ..options(&out, 2) }, &Silent).unwrap();
    let before = files(&out);
    let watch = Watch { city: &out, before: before["city.json"].clone(), stages: Mutex::default() };
    bake(&options(&out, 2), &watch).unwrap();
    assert_eq!(watch.stages.into_inner().unwrap().last().unwrap(), "write");
    assert_eq!(manifest(&out).cell_m, 1.0);
    let now = files(&out);
    bake_scene(Scene::default(), ReadReport::default(), &options(&out, 2), &Silent).unwrap_err();
    assert!(files(&out) == now, "a failed bake touched the city");
    assert!(!partial(&out).exists());
}

#[test]
fn what_is_no_city_is_not_replaced() {
    let folder = Folder::new("foreign");
    let out = folder.out("city");
    fs::create_dir_all(&out).unwrap();
    fs::write(out.join("letter.txt"), "dear").unwrap();
    let error = bake(&options(&out, 2), &Silent).unwrap_err();
    assert!(matches!(error, BakeError::Out { .. }), "{error}");
    assert_eq!(fs::read_to_string(out.join("letter.txt")).unwrap(), "dear");
    fs::remove_file(out.join("letter.txt")).unwrap();
    bake(&options(&out, 2), &Silent).unwrap();
}

#[test]
fn a_city_too_wide_or_unsound_is_an_error_of_one_line() {
    let folder = Folder::new("wide");
    let out = folder.out("city");
    let mut wide = city();
    wide.triangles[0].corners[0][0] = 1e9;
    let mut broken = city();
    broken.triangles[7].corners[2][1] = f32::NAN;
    for scene in [wide, broken] {
        let error = bake_scene(scene, ReadReport::default(), &options(&out, 2), &Silent).unwrap_err();
        assert!(matches!(error, BakeError::Extent { .. } | BakeError::Scene { .. }), "{error}");
        assert!(!error.to_string().contains('\n') && !out.exists() && !partial(&out).exists());
    }
}

#[test]
fn a_city_of_one_leaf_is_a_city() {
    let folder = Folder::new("leaf");
    let out = folder.out("city");
    let mut scene = city();
    scene.triangles.truncate(12);
    bake_scene(scene, ReadReport::default(), &BakeOptions { cell_m: 4.0, ..options(&out, 1) }, &Silent).unwrap();
    assert_eq!((manifest(&out).depth, nodes(&out).len()), (0, 1));
}
