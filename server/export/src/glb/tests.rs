//! GLBs of a synthetic city.

use super::test_city::{TERRAIN, TestCity, city, webp};
use super::test_reader::Glb;
use super::write_glb;
use crate::camera::ExportCamera;
use crate::glb::{ExportError, ExportReport, ExportView};
use crate::selection::ObjectSelection;
use insula_protocol::TileId;
use insula_protocol::mesh::PositionGrid;
use insula_protocol::mesh_tile::cuboid;
use insula_protocol::subtree::{MeshLod, NodeMesh};
use std::collections::{BTreeMap, BTreeSet};

fn export(city: &TestCity, selection: &ObjectSelection) -> Result<(Glb, ExportReport), ExportError> {
    let mut bytes = Vec::new();
    let report = write_glb(city, selection, None, &mut bytes)?;
    assert_eq!(report.bytes, bytes.len() as u64);
    Ok((Glb::parse(&bytes), report))
}

#[test]
fn a_city_is_one_document_with_all_leaves() {
    let (glb, report) = export(&city(), &ObjectSelection::default()).unwrap();
    assert_eq!(glb.check_primitives() as u64, report.triangles);
    assert_eq!((glb.list("meshes").len(), glb.list("nodes").len()), (4, 5));
    assert_eq!(glb.json["asset"]["copyright"], "Town Hall, licence: CC BY 4.0");
    assert_eq!(glb.json["asset"]["extras"]["crs"], "EPSG:28992");
    let required: Vec<&str> = glb.list("extensionsRequired").iter().map(|name| name.as_str().unwrap()).collect();
    assert_eq!(required, ["EXT_texture_webp", "KHR_mesh_quantization"]);
    let image = glb.view(glb.json["images"][0]["bufferView"].as_u64().unwrap() as usize);
    assert_eq!(image, super::test_city::webp().bytes);
}

#[test]
fn objects_keep_numbers_identifiers_and_attributes() {
    let (glb, report) = export(&city(), &ObjectSelection::default()).unwrap();
    // By first use, leaf by leaf.
    assert_eq!(glb.column("id"), ["2", "0", "4", "3", "5"]);
    assert_eq!(report.objects, 5);
    assert_eq!(glb.column("identifier"), ["", "terrain", "house-4", "house-3", "house-5"]);
    assert_eq!(glb.column("parent"), ["", "", "", "", "house-1"]);
    assert_eq!(glb.column("kind"), ["", "relief", "building", "building", "building-part"]);
    assert_eq!(glb.column("name"), ["", "", "M\u{fc}hle 4", "M\u{fc}hle 3", "M\u{fc}hle 5"]);
    let missing = i32::MIN.to_string();
    assert_eq!(glb.column("storeys_above"), [&missing, &missing, "5", "4", "6"]);
    assert_eq!(glb.column("listed"), ["2", "2", "1", "0", "0"]);
    let heights = glb.column("height");
    assert_eq!((&heights[2], &heights[1]), (&"12.5".to_owned(), &f64::MIN.to_string()));
    let class = &glb.json["extensions"]["EXT_structural_metadata"]["schema"]["classes"]["object"]["properties"];
    assert_eq!(class["storeys_above"]["name"], "storeys above");
    assert_eq!((&class["height"]["noData"], &class["height"]["description"]), (&f64::MIN.into(), &"in m".into()));
}

#[test]
fn positions_are_metres_from_the_middle_with_y_up() {
    let (glb, _) = export(&city(), &ObjectSelection::default()).unwrap();
    let positions = glb.scene_positions();
    // The city is 128 m wide. The first house is at 10 to 22 m from its south-western corner.
    let is_near = |p: &[f64; 3], q: [f64; 3]| (0..3).all(|k| (p[k] - q[k]).abs() < 0.01);
    assert!(positions.iter().any(|p| is_near(p, [10.0 - 64.0, 15.0, 64.0 - 22.0])));
    assert!(positions.iter().all(|p| p[0].abs() <= 64.01 && p[2].abs() <= 64.01 && (0.0..=15.01).contains(&p[1])));
}

#[test]
fn a_selection_takes_whole_objects_and_land_by_place() {
    let city = city();
    let objects = Some([4].into_iter().collect());
    let (glb, _) = export(&city, &ObjectSelection { objects, ..ObjectSelection::default() }).unwrap();
    assert_eq!((glb.column("id"), glb.list("meshes").len()), (vec!["4".to_owned()], 1));
    // The western half of the south-eastern leaf, with the middle of its house.
    let bbox = Some([[1064.0, 2000.0], [1096.0, 2064.0]]);
    let (glb, _) = export(&city, &ObjectSelection { bbox, ..ObjectSelection::default() }).unwrap();
    assert_eq!(glb.column("id"), ["3"]);
    assert!(glb.scene_positions().iter().all(|p| p[0].abs() <= 6.01));
    // A strip without the middle of any house, in a leaf with columns: all that is left is land.
    let bbox = Some([[1000.0, 2064.0], [1012.0, 2128.0]]);
    let (glb, _) = export(&city, &ObjectSelection { bbox, ..ObjectSelection::default() }).unwrap();
    assert_eq!(glb.column("kind"), ["relief"]);
    let nothing = ObjectSelection { bbox: Some([[0.0; 2]; 2]), ..ObjectSelection::default() };
    assert!(matches!(export(&city, &nothing), Err(ExportError::Nothing(_))));
}

#[test]
fn the_same_city_gives_the_same_bytes() {
    let bytes = || {
        let mut bytes = Vec::new();
        write_glb(&city(), &ObjectSelection::default(), None, &mut bytes).unwrap();
        bytes
    };
    assert_eq!(bytes(), bytes());
}

#[test]
fn missing_and_broken_parts_are_errors_or_left_out() {
    let mut broken = city();
    broken.broken.insert(TileId::ROOT.child(2).unwrap());
    assert!(matches!(export(&broken, &ObjectSelection::default()), Err(ExportError::Source(_))));
    let mut damaged = city();
    damaged.blocks.insert(0, vec![1, 2, 3]);
    assert!(matches!(export(&damaged, &ObjectSelection::default()), Err(ExportError::Source(_))));
    let mut without = city();
    without.subtrees.clear();
    let error = export(&without, &ObjectSelection::default()).err().unwrap();
    assert_eq!(error.to_string(), "subtree 0/0/0 cannot be read: it is missing: bake the city again");
    let mut bare = city();
    bare.blocks.clear();
    bare.columns.remove(&TileId::ROOT.child(3).unwrap());
    let (glb, _) = export(&bare, &ObjectSelection::default()).unwrap();
    assert_eq!(glb.column("id"), ["2", "0", "4", "3"]);
}

#[test]
fn a_failing_writer_is_reported() {
    struct Full;
    impl std::io::Write for Full {
        fn write(&mut self, _: &[u8]) -> std::io::Result<usize> {
            Err(std::io::ErrorKind::StorageFull.into())
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }
    assert!(matches!(write_glb(&city(), &ObjectSelection::default(), None, &mut Full), Err(ExportError::Write { .. })));
}

/// Looks north over the city from its southern border, in pixels of tolerated error.
fn view(tau_px: f64) -> ExportView {
    let camera = ExportCamera {
        position: [1064.0, 1990.0, 60.0],
        target: [1064.0, 2050.0, 40.0],
        up: [0.0, 0.0, 1.0],
        fov_y_deg: 60.0,
    };
    ExportView::new(camera, [1280, 720], tau_px).unwrap()
}

fn export_view(city: &TestCity, view: &ExportView) -> (Glb, ExportReport) {
    let mut bytes = Vec::new();
    let report = write_glb(city, &ObjectSelection::default(), Some(view), &mut bytes).unwrap();
    (Glb::parse(&bytes), report)
}

#[test]
fn a_view_has_its_camera() {
    let (glb, report) = export_view(&city(), &view(1.0));
    assert_eq!(glb.check_primitives() as u64, report.triangles);
    let camera = &glb.json["cameras"][0]["perspective"];
    assert!((camera["yfov"].as_f64().unwrap() - 60f64.to_radians()).abs() < 1e-12);
    assert_eq!(camera["aspectRatio"], 1280.0 / 720.0);
    let node = glb.list("nodes").iter().find(|node| !node["camera"].is_null()).unwrap();
    let matrix: Vec<f64> = node["matrix"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    // East is to the right; the camera looks along -z, to the north and down.
    assert_eq!(matrix[..3], [1.0, 0.0, 0.0]);
    assert!(matrix[9] < -0.9 && matrix[10] > 0.0 && matrix[10] < 0.4, "{matrix:?}");
    assert_eq!(matrix[12..15], [0.0, -74.0, 30.0]);
}

/// All four leaves with hills of triangles of 1 m, of one colour.
fn hills() -> TestCity {
    let mut city = city();
    let height = |x: f64, y: f64| 6.0 + 3.0 * (x / 20.0).sin() + 2.0 * (y / 15.0).cos();
    for (quadrant, leaf) in TileId::ROOT.children().enumerate() {
        let corner = [quadrant % 2, quadrant / 2].map(|at| 64.0 * at as f64);
        let mut mesh = cuboid([0.0; 3], [64.0, 64.0, 20.0], [90, 110, 80], None);
        let place = |i: usize| [(i % 65) as f64, (i / 65) as f64];
        let points = (0..65 * 65).map(place).map(|[x, y]| [x, y, height(corner[0] + x, corner[1] + y)]);
        mesh.mesh.grid = PositionGrid::enclosing(&[[0.0; 3], [64.0, 64.0, 20.0]], 16);
        mesh.mesh.positions = points.map(|point| mesh.mesh.grid.nearest(point)).collect();
        let cells = (0..64 * 64).map(|i| (i / 64 * 65 + i % 64) as u32);
        mesh.mesh.triangles = cells.flat_map(|a| [[a, a + 1, a + 66], [a, a + 66, a + 65]]).collect();
        mesh.mesh.attributes[0].corners = vec![0; 3 * mesh.mesh.triangles.len()];
        mesh.objects = vec![TERRAIN; mesh.mesh.triangles.len()];
        city.meshes.insert(leaf, mesh);
    }
    let subtree = city.subtrees.get_mut(&TileId::ROOT).unwrap();
    let lod = MeshLod { error_m: 0.02, bytes: 1000, triangles: 8192, texture_px: 0 };
    subtree.meshes = TileId::ROOT.children().map(|id| NodeMesh { id, lods: vec![lod] }).collect();
    city
}

#[test]
fn terrain_of_a_view_is_one_surface_that_is_finest_near_the_eye() {
    let city = hills();
    let (whole, _) = export(&city, &ObjectSelection::default()).unwrap();
    assert_eq!(whole.check_primitives(), 4 * 8192);
    let counts = [1.0, 4.0].map(|tau_px| {
        let (glb, report) = export_view(&city, &view(tau_px));
        assert_eq!((glb.list("meshes").len(), glb.check_primitives() as u64), (1, report.triangles));
        assert_eq!(glb.column("identifier"), ["terrain"]);
        let positions = glb.scene_positions();
        let (low, high) = positions.iter().fold((f64::MAX, f64::MIN), |(low, high), p| (low.min(p[0]), high.max(p[0])));
        assert!((low + 64.0).abs() < 1e-6 && (high - 64.0).abs() < 1e-6, "{low} {high}");
        // South is towards the eye.
        let near = positions.iter().filter(|p| p[2] > 32.0).count();
        let far = positions.iter().filter(|p| p[2] < -32.0).count();
        assert!(near > 2 * far, "{near} {far}");
        report.triangles
    });
    assert!(counts[0] < 8000 && counts[1] * 2 < counts[0], "{counts:?}");
}

#[test]
fn land_of_columns_meets_the_terrain_of_meshes() {
    let mut city = hills();
    TileId::ROOT.children().skip(2).for_each(|leaf| _ = city.meshes.remove(&leaf));
    city.subtrees.get_mut(&TileId::ROOT).unwrap().meshes.truncate(2);
    let (glb, report) = export_view(&city, &view(1.0));
    assert_eq!(glb.check_primitives() as u64, report.triangles);
    let names: Vec<&str> = glb.list("nodes").iter().filter_map(|node| node["name"].as_str()).collect();
    assert!(["terrain", "1/0/1", "1/1/1"].iter().all(|name| names.contains(name)), "{names:?}");
    // The leaves with meshes end in the middle of the city. Strips of other borders hang at both ends of the line.
    let millimetres = |at: f64| (at * 1000.0).round() as i64;
    let mut heights: BTreeMap<i64, BTreeSet<i64>> = BTreeMap::new();
    for [x, z, _] in glb.scene_positions().into_iter().filter(|p| p[2].abs() < 1e-6 && p[0].abs() < 63.9) {
        heights.entry(millimetres(x)).or_default().insert(millimetres(z));
    }
    assert!(heights.len() > 8 && heights.values().all(|found| found.len() == 1), "{heights:?}");
}

#[test]
fn terrain_with_pictures_and_leaves_with_holes_keep_their_meshes() {
    let mut pictured = hills();
    let first = TileId::ROOT.child(0).unwrap();
    let mesh = pictured.meshes.get_mut(&first).unwrap();
    mesh.texture = Some(webp());
    mesh.mesh.attributes = cuboid([0.0; 3], [1.0; 3], [0; 3], mesh.texture.clone()).mesh.attributes;
    mesh.mesh.attributes[0].corners = vec![0; 3 * mesh.mesh.triangles.len()];
    assert_eq!(export_view(&pictured, &view(1.0)).1.triangles, 4 * 8192);
    let mut holed = hills();
    let mesh = holed.meshes.get_mut(&first).unwrap();
    mesh.mesh.triangles.drain(2000..2010);
    mesh.mesh.attributes[0].corners.truncate(3 * mesh.mesh.triangles.len());
    mesh.objects.truncate(mesh.mesh.triangles.len());
    let (glb, report) = export_view(&holed, &view(1.0));
    let names: Vec<&str> = glb.list("nodes").iter().filter_map(|node| node["name"].as_str()).collect();
    assert!(names.contains(&"terrain") && names.contains(&"1/0/0"), "{names:?}");
    assert!((8182..8192 + 8000).contains(&report.triangles), "{}", report.triangles);
}
