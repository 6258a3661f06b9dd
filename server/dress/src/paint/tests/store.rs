//! Shapes that are kept and found again.

use super::*;
use crate::map_store::{MapRecord, MapStore, MapStoreError, overlap};
use crate::paint::class::{AreaClass, LineClass};
use crate::paint::shape::{PaintArea, PaintLine, Sidewalks};
use crate::paint::surfacing::Surfacing;
use std::path::Path;

const FILE_LIMIT: u64 = 1 << 30;

/// A square around a position.
fn square([x, y]: [f64; 2], half_m: f64, class: AreaClass) -> PaintShape {
    let ring =
        vec![[x - half_m, y - half_m], [x + half_m, y - half_m], [x + half_m, y + half_m], [x - half_m, y + half_m]];
    let hole = vec![[x, y], [x + 0.1, y], [x, f64::MIN_POSITIVE]];
    PaintShape::Area(PaintArea { rings: vec![ring, hole, Vec::new()], class, surfacing: None })
}

fn line(points: Vec<[f64; 2]>) -> PaintShape {
    PaintShape::Line(PaintLine {
        width_m: 7.25,
        lanes: Some(3),
        is_one_way: true,
        sidewalks: Sidewalks::Left,
        surfacing: Some(Surfacing::Clay),
        ..PaintLine::new(LineClass::Motorway, points)
    })
}

fn shapes() -> Vec<PaintShape> {
    let mut shapes: Vec<PaintShape> = (0..400)
        .map(|i| {
            let at = [25_496_000.0 + 130.0 * f64::from(i % 20), 6_672_000.0 + 130.0 * f64::from(i / 20)];
            if i % 3 == 0 { line(vec![at, [at[0] + 900.0, at[1] + 40.0]]) } else { square(at, 55.0, AreaClass::Forest) }
        })
        .collect();
    shapes.push(square([25_497_000.0, 6_673_000.0], 900_000.0, AreaClass::Water));
    shapes
}

fn store(memory_bytes: u64, path: &Path) -> MapStore<PaintShape> {
    let mut store = MapStore::new(path, memory_bytes, FILE_LIMIT);
    shapes().into_iter().for_each(|shape| store.push(shape).unwrap());
    store
}

#[test]
fn shapes_are_found_by_place_whereever_they_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shapes");
    for memory_bytes in [0, 10_000, u64::MAX] {
        let store = store(memory_bytes, &path);
        assert_eq!(path.exists(), memory_bytes < u64::MAX);
        assert_eq!(store.len(), 401);
        for (x, y, side_m) in [(0.0, 0.0, 1024.0), (700.0, 300.0, 10.0), (-5000.0, 0.0, 100.0), (-1e6, -1e6, 4e6)] {
            let low = [25_496_000.0 + x, 6_672_000.0 + y];
            let rectangle = [low, low.map(|v| v + side_m)];
            let found: Vec<PaintShape> =
                store.shapes_in(rectangle).unwrap().iter().map(|shape| (**shape).clone()).collect();
            let expected: Vec<PaintShape> =
                shapes().into_iter().filter(|shape| overlap(shape.bounds().unwrap(), rectangle)).collect();
            assert!(found == expected, "{memory_bytes} {x} {y}: {} {}", found.len(), expected.len());
            assert!(!found.is_empty());
        }
        drop(store);
        assert!(!path.exists());
    }
}

#[test]
fn shapes_can_be_added_after_reads() {
    let folder = tempfile::tempdir().unwrap();
    let mut store = MapStore::new(&folder.path().join("shapes"), 0, FILE_LIMIT);
    for i in 0..300 {
        let shape = square([f64::from(i) * 10.0, 0.0], 4.0, AreaClass::ALL[i as usize % AreaClass::ALL.len()]);
        store.push(shape.clone()).unwrap();
        let x = f64::from(i) * 10.0;
        let found = store.shapes_in([[x - 1.0, -1.0], [x + 1.0, 1.0]]).unwrap();
        assert_eq!(found.len(), 1);
        assert_eq!(*found[0], shape);
    }
}

#[test]
fn what_has_no_place_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let mut store = MapStore::new(&folder.path().join("shapes"), 0, FILE_LIMIT);
    for at in [f64::NAN, f64::INFINITY, 1e300] {
        store.push(line(vec![[at, 0.0], [0.0, at]])).unwrap();
    }
    assert!(store.is_empty());
    store.push(line(vec![[f64::NAN, 0.0], [1e9, -1e9], [-1e9, 1e9]])).unwrap();
    assert_eq!(store.shapes_in([[0.0; 2], [1.0; 2]]).unwrap().len(), 1);
    for rectangle in [[[f64::NAN; 2], [1.0; 2]], [[5.0; 2], [1.0; 2]], [[0.0; 2], [f64::INFINITY; 2]]] {
        assert!(store.shapes_in(rectangle).unwrap().is_empty(), "{rectangle:?}");
    }
}

#[test]
fn limits_and_files_of_others_are_respected() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shapes");
    let mut small = MapStore::new(&path, 0, 300);
    small.push(square([0.0; 2], 1.0, AreaClass::Grass)).unwrap();
    assert!(matches!(small.push(line(vec![[0.0; 2]; 50])), Err(MapStoreError::TooLarge { .. })));
    assert_eq!(small.shapes_in([[-1.0; 2], [1.0; 2]]).unwrap().len(), 1);
    let mut other = MapStore::new(&path, 0, FILE_LIMIT);
    assert!(matches!(other.push(line(vec![[0.0; 2]])), Err(MapStoreError::Io { .. })));
    drop(other);
    assert!(path.exists(), "the file of the other store");
}

#[test]
fn a_file_that_changed_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shapes");
    let store = store(0, &path);
    let rectangle = [[25_496_000.0, 6_672_000.0], [25_499_000.0, 6_675_000.0]];
    assert_eq!(store.shapes_in(rectangle).unwrap().len(), 401);
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    assert!(matches!(store.shapes_in(rectangle), Err(MapStoreError::Io { .. })));
    std::fs::write(&path, vec![0xff; bytes.len()]).unwrap();
    assert!(matches!(store.shapes_in(rectangle), Err(MapStoreError::Damaged { .. })));
}

#[test]
fn records_are_read_whole_or_not_at_all() {
    for shape in [square([3.0, 4.0], 2.0, AreaClass::TrackBed), line(vec![[1.0, 2.0], [f64::INFINITY, -0.0]])] {
        let mut bytes = shape.encode().unwrap();
        assert_eq!(PaintShape::decode(&bytes).as_ref(), Some(&shape));
        for end in 0..bytes.len() {
            assert_eq!(PaintShape::decode(&bytes[..end]), None, "{end}");
        }
        bytes.push(0);
        assert_eq!(PaintShape::decode(&bytes), None);
        // Any byte may be wrong; counts must not be believed.
        for i in 0..bytes.len() {
            let mut wrong = bytes.clone();
            wrong[i] = 0xff;
            let _ = PaintShape::decode(&wrong);
        }
    }
}
