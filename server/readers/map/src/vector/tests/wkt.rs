//! Well-known text.

use super::{on_map, square};
use crate::vector::geometry::{Geometry, TOO_DEEP};
use crate::vector::wkt::{looks_like_wkt, parse};

fn read(text: &str) -> Result<Geometry, &'static str> {
    let mut geometry = Geometry::default();
    parse(text, &mut geometry).map(|_| geometry)
}

#[test]
fn all_types_of_geometry() {
    let area = read("POLYGON ((0 0,9 0,9 9,0 9,0 0), (1 1,3 1,3 3,1 3,1 1))").unwrap();
    assert_eq!(on_map(&area), [vec![square(0.0, 0.0, 9.0), square(1.0, 1.0, 2.0)]]);
    let areas = read("multipolygon z(((0 0 1,1 0 1,1 1 1,0 1 1,0 0 1)),((5 5 2,6 5 2,6 6 2,5 6 2,5 5 2)))").unwrap();
    assert_eq!((areas.polygons.len(), areas.polygons[1][0][0]), (2, [5.0, 5.0, 2.0]));
    assert_eq!(read("POINT ZM (1 2 3 4)").unwrap().points, [[1.0, 2.0, 3.0]]);
    assert_eq!(read("POINTM(1 2 4)").unwrap().points, [[1.0, 2.0, 0.0]]);
    assert_eq!(read("POINT(1e2 -2.5E-1 7)").unwrap().points, [[100.0, -0.25, 7.0]]);
    assert_eq!(read("MULTIPOINT(1 2,3 4)").unwrap(), read("MULTIPOINT((1 2),(3 4))").unwrap());
    assert_eq!(read("MULTILINESTRING((1 2,3 4),EMPTY,(5 6,7 8))").unwrap().lines.len(), 2);
    let mixed = read("GEOMETRYCOLLECTION(POINT(1 1),LINESTRING(0 0,1 1),POLYGON((0 0,1 0,1 1,0 0)))").unwrap();
    assert_eq!((mixed.points.len(), mixed.lines.len(), mixed.polygons.len()), (1, 1, 1));
    let tin = read("TIN Z (((0 0 0,1 0 0,0 1 1,0 0 0)),((0 0 0,1 0 0,0 1 1,0 0 0)))").unwrap();
    assert_eq!((tin.is_surface, tin.polygons.len()), (true, 2));
    assert!(read("POLYGON EMPTY").unwrap().is_empty());
    let curve = "CURVEPOLYGON(COMPOUNDCURVE(CIRCULARSTRING(0 0,1 1,2 0),(2 0,0 0)),(0.5 0.1,1 0.2,1 0.1,0.5 0.1))";
    let curved = read(curve).unwrap();
    assert_eq!(curved.polygons[0].iter().map(Vec::len).collect::<Vec<_>>(), [47, 4]);
    assert_eq!(read("MULTISURFACE(((0 0,1 0,1 1,0 0)),CURVEPOLYGON((0 0,1 0,1 1,0 0)))").unwrap().polygons.len(), 2);
}

#[test]
fn heights_that_some_parts_lack_are_not_taken_for_0() {
    let parts = "POLYGON Z((0 0 512,9 0 512,9 9 512,0 0 512)),POLYGON((20 0,29 0,29 9,20 0))";
    let mut mixed = read(&format!("GEOMETRYCOLLECTION({parts})")).unwrap();
    assert!(mixed.fill_heights().is_some_and(f64::is_nan));
    assert!(mixed.positions().all(|position| position[2] == 512.0), "{mixed:?}");
}

#[test]
fn systems_in_front() {
    let srid = |text: &str| parse(text, &mut Geometry::default());
    assert_eq!(srid("SRID=28992;POINT(1 2)"), Ok(Some(28992)));
    assert_eq!(srid("epsg:4326; POINT(1 2)"), Ok(Some(4326)));
    assert_eq!(srid("POINT(1 2)"), Ok(None));
}

#[test]
fn what_looks_like_a_geometry() {
    for text in ["POINT(1 2)", " polygon ((", "SRID=1;LINESTRING Z (", "POLYGON EMPTY", "MultiPolygonZ(("] {
        assert!(looks_like_wkt(text), "{text}");
    }
    for text in ["", "Point Street 7", "TIN", "tinsmith (closed)", "SRID=7", "é", "(1 2)"] {
        assert!(!looks_like_wkt(text), "{text}");
    }
}

#[test]
fn hostile_text_fails() {
    let whole = "GEOMETRYCOLLECTION Z(POLYGON Z((0 0 1,9 0 1,9 9 1,0 0 1)),MULTIPOINT((1 2),(3 4)))";
    for length in 0..whole.len() {
        assert!(read(&whole[..length]).is_err(), "{length} characters");
    }
    for text in
        ["POINT(1)", "POINT(1 2 3 4 5)", "POINT(1 2", "POINT(a b)", "POINT(1 2) x", "POLYGONX((0 0))", "🏠", "SRID=;"]
    {
        assert!(read(text).is_err(), "{text}");
    }
    assert_eq!(read(&"GEOMETRYCOLLECTION(".repeat(10_000)), Err(TOO_DEEP));
    assert_eq!(read(&format!("CURVEPOLYGON({}", "COMPOUNDCURVE(".repeat(10_000))), Err(TOO_DEEP));
}
