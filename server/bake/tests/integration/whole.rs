//! A finished city: independent of the number of threads, valid in every node, and replaced only when complete.

use super::support::{BakedCity, COARSE_CELL_M, bake, city, coarse_options, files, options, out_folder, partial};
use insula_archive::mark::{MARK_AT, mark_of};
use insula_bake::read::ReadReport;
use insula_bake::scene::{ObjectKind, Scene, SceneObject, SceneTriangle};
use insula_bake::{BakeError, BakeOptions, Progress, Silent, bake_scene};
use insula_protocol::blockmap::voxel_error_m;
use insula_protocol::manifest::Attribution;
use insula_protocol::subtree::NodeInfo;
use insula_protocol::{BlockMap, Manifest, TileId};
use insula_test_support::folder::TestFolder;
use std::fs;
use std::path::Path;
use std::sync::Mutex;

#[test]
fn number_of_threads_does_not_change_the_bytes() {
    let with_three = BakedCity::boxes();
    let with_one = BakedCity::bake("one-thread", city(), options(Path::new(""), 1));
    assert_eq!(
        with_one.files.keys().collect::<Vec<_>>(),
        [
            "blockmaps.pmtiles", "city.json", "fingerprints.bin", "meshes.pmtiles", "objects.pmtiles", "search.index",
            "subtrees.pmtiles"
        ]
    );
    assert!(with_one.files == with_three.files);
    assert_eq!(with_one.report.city_bytes, with_one.files.values().map(|bytes| bytes.len() as u64).sum::<u64>());
}

#[test]
fn each_archive_has_the_mark_of_its_city() {
    let baked = BakedCity::boxes();
    let mark = mark_of(&baked.manifest().version);
    for (name, bytes) in baked.files.iter().filter(|(name, _)| name.ends_with(".pmtiles")) {
        assert_eq!(bytes[MARK_AT], mark, "{name}");
    }
}

#[test]
fn the_picture_shows_the_first_view_on_any_number_of_threads() {
    let pictured = |threads| BakeOptions { picture: true, threads: Some(threads), ..coarse_options(Path::new("")) };
    let [one, three] = [1, 3].map(|threads| BakedCity::bake("picture", city(), pictured(threads)));
    let jpeg = &one.files["thumbnail.jpg"];
    assert!(*jpeg == three.files["thumbnail.jpg"] && jpeg.len() < 500_000, "{} bytes", jpeg.len());
    let mark = b"drawn by Insula";
    assert!(
        jpeg[..64].windows(mark.len()).any(|bytes| bytes == mark),
        "a bake takes others for pictures of somebody else, and does not replace them"
    );
    assert_eq!(one.report.city_bytes, one.files.values().map(|bytes| bytes.len() as u64).sum::<u64>());
    let picture = image::load_from_memory(jpeg).unwrap().to_rgb8();
    assert_eq!(picture.dimensions(), (1280, 720));
    // Red boxes stand on light ground, of which the lower edge has most.
    let red = picture.pixels().filter(|pixel| i32::from(pixel[0]) > i32::from(pixel[2]) + 25).count();
    assert!((100..200_000).contains(&red), "{red} pixels");
    let corner = picture.get_pixel(4, 715);
    assert!(corner.0.iter().all(|channel| *channel > 120), "{corner:?}");
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
fn every_node_has_a_tile_and_bounds_and_errors_nest() {
    let baked = BakedCity::boxes();
    let (manifest, nodes) = (baked.manifest(), baked.nodes());
    let archive = baked.archive("blockmaps.pmtiles");
    assert_eq!(archive.tiles(), nodes.len() as u64);
    assert!(archive.is_clustered());
    for (id, node) in &nodes {
        let bytes = archive.get(*id).unwrap();
        assert_eq!(bytes.len() as u32, node.blockmap_bytes);
        let map = BlockMap::decode(*id, &bytes).unwrap();
        assert_eq!((map.id, f64::from(map.cell_m)), (*id, manifest.cell_m_at(id.level())));
        for i in (0..map.flags.len()).filter(|i| map.flags[*i] != 0) {
            let [low, high] = [map.z_min[i], map.z_max[i]]
                .map(|code| (map.z_base_m() + f64::from(code) * f64::from(map.z_step_m())) as f32);
            assert!(low >= node.z_min_m && high <= node.z_max_m, "a column of {id} is outside its node");
        }
        assert!(node.error_m >= voxel_error_m(manifest.cell_m_at(id.level())) as f32);
        assert_eq!(node.child_mask == 0, id.level() == manifest.depth);
        for child in id.children().filter_map(|child| nodes.get(&child)) {
            assert!(node.child_mask >> child.id.quadrant() & 1 == 1);
            check_child(&manifest, node, child);
        }
        assert!(id.parent().is_none_or(|parent| nodes.contains_key(&parent)));
    }
}

#[test]
fn equal_tiles_are_stored_once() {
    let mut scene = Scene { materials: city().materials, ..Scene::default() };
    // Furrows, because plain ground would have no leaves.
    let corner = |furrow: u32, y: f32| [furrow as f32 * 4.0, y, if furrow.is_multiple_of(2) { 5.0 } else { 7.0 }];
    for furrow in 0..250 {
        let [a, b] = [corner(furrow, 0.0), corner(furrow + 1, 0.0)];
        let [c, d] = [corner(furrow + 1, 1000.0), corner(furrow, 1000.0)];
        for corners in [[a, b, c], [a, c, d]] {
            scene.triangles.push(SceneTriangle { corners, uv: [[0.0; 2]; 3], material: 0, object: 0 });
        }
    }
    scene.objects.push(SceneObject { id: "plain".into(), kind: ObjectKind::Terrain, base_z_m: 5.0 });
    let baked = BakedCity::bake("equal", scene, BakeOptions { cell_m: 2.0, ..options(Path::new(""), 2) });
    let archive = baked.archive("blockmaps.pmtiles");
    let (tiles, contents) = (archive.tiles(), archive.contents());
    assert!(tiles > 40 && contents < tiles / 2, "{contents} contents for {tiles} tiles");
}

#[test]
fn manifest_and_report_agree_with_the_nodes() {
    let baked = BakedCity::boxes();
    let (manifest, nodes, report) = (baked.manifest(), baked.nodes(), &baked.report);
    manifest.check().unwrap();
    assert_eq!((manifest.name.as_str(), manifest.title.as_str(), manifest.depth), ("boxes", "boxes", 6));
    assert_eq!(manifest.crs.as_deref(), Some("EPSG:7415"));
    assert_eq!((manifest.counts.objects, manifest.counts.triangles), (9, 108));
    assert_eq!((manifest.counts.buildings, report.buildings, report.size.as_str()), (Some(9), 9, "9 buildings"));
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
    assert!(serde_json::to_value(report).unwrap()["triangles_per_second"].as_f64().unwrap() > 0.0);
}

#[test]
fn version_depends_on_attribution_and_content() {
    let manifest = |name: &str, options: BakeOptions| BakedCity::bake(name, city(), options).manifest();
    let coarse = || coarse_options(Path::new(""));
    let base = manifest("version-base", coarse());
    let attribution = vec![Attribution { text: "Kadaster".into(), licence: Some("CC BY 4.0".into()), url: None }];
    let attributed = manifest("version-attributed", BakeOptions { attribution: attribution.clone(), ..coarse() });
    assert_ne!(base.version, attributed.version);
    assert_eq!(attributed.attribution, attribution);
    let coarser = manifest("version-coarser", BakeOptions { cell_m: 2.0 * COARSE_CELL_M, ..coarse() });
    assert_ne!(base.version, coarser.version);
}

/// Checks at every step that the previous city is still complete.
struct PreviousCityCheck<'a> {
    city: &'a Path,
    manifest: Vec<u8>,
    stages: Mutex<Vec<String>>,
}

impl Progress for PreviousCityCheck<'_> {
    fn stage(&self, name: &str, _total: u64) {
        self.stages.lock().unwrap().push(name.to_owned());
    }
    fn advance(&self, _n: u64) {
        assert_eq!(fs::read(self.city.join("city.json")).unwrap(), self.manifest);
    }
}

#[test]
fn previous_city_is_replaced_after_the_last_stage() {
    let folder = TestFolder::new("replace");
    let out = out_folder(&folder, "city");
    bake(&BakeOptions { cell_m: 2.0 * COARSE_CELL_M, ..options(&out, 2) }, &Silent).unwrap();
    let previous = files(&out);
    let check = PreviousCityCheck { city: &out, manifest: previous["city.json"].clone(), stages: Mutex::default() };
    bake(&coarse_options(&out), &check).unwrap();
    assert_eq!(check.stages.into_inner().unwrap().last().unwrap(), "write");
    let now = files(&out);
    assert!(now != previous);
    bake_scene(Scene::default(), ReadReport::default(), &coarse_options(&out), &Silent).unwrap_err();
    assert!(files(&out) == now, "a failed bake changed the city");
    assert!(!partial(&out).exists());
}

#[test]
fn folder_without_a_city_is_not_replaced_unless_empty() {
    let folder = TestFolder::new("foreign");
    let out = out_folder(&folder, "city");
    fs::create_dir_all(&out).unwrap();
    fs::write(out.join("letter.txt"), "dear").unwrap();
    let error = bake(&coarse_options(&out), &Silent).unwrap_err();
    assert!(matches!(error, BakeError::Out { .. }), "{error}");
    assert_eq!(fs::read_to_string(out.join("letter.txt")).unwrap(), "dear");
    fs::remove_file(out.join("letter.txt")).unwrap();
    bake(&coarse_options(&out), &Silent).unwrap();
}

#[test]
fn too_wide_or_invalid_scene_is_an_error_of_one_line() {
    let folder = TestFolder::new("wide");
    let out = out_folder(&folder, "city");
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
fn city_of_one_leaf_is_baked() {
    let mut scene = city();
    scene.triangles.truncate(12);
    let baked = BakedCity::bake("leaf", scene, BakeOptions { cell_m: 4.0, ..options(Path::new(""), 1) });
    assert_eq!((baked.manifest().depth, baked.nodes().len()), (0, 1));
}
