//! GLBs of a synthetic city.

use super::{
    test_city::{TestCity, city},
    test_reader::Glb,
    write_glb,
};
use crate::{
    glb::{ExportError, ExportReport},
    selection::ObjectSelection,
};
use insula_protocol::TileId;

fn export(city: &TestCity, selection: &ObjectSelection) -> Result<(Glb, ExportReport), ExportError> {
    let mut bytes = Vec::new();
    let report = write_glb(city, selection, &mut bytes)?;
    assert_eq!(report.bytes, bytes.len() as u64);
    Ok((Glb::parse(&bytes), report))
}

#[test]
fn a_city_is_one_document_with_all_leaves() {
    let (glb, report) = export(&city(), &ObjectSelection::default()).unwrap();
    assert_eq!(glb.check_primitives() as u64, report.triangles);
    assert_eq!((glb.list("meshes").len(), glb.list("nodes").len()), (4, 5));
    assert_eq!(glb.json["asset"]["copyright"], "Town Hall, CC BY 4.0");
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
        write_glb(&city(), &ObjectSelection::default(), &mut bytes).unwrap();
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
    assert!(matches!(write_glb(&city(), &ObjectSelection::default(), &mut Full), Err(ExportError::Write { .. })));
}
