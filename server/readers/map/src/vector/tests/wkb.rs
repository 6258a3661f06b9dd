//! Well-known binary.

use super::{on_map, polygon_wkb, square};
use crate::vector::geometry::{Geometry, MALFORMED, TOO_DEEP, UNKNOWN_TYPE};
use crate::vector::wkb::{bytes_of_hex, parse};

fn read(bytes: &[u8]) -> Result<Geometry, &'static str> {
    let mut geometry = Geometry::default();
    parse(bytes, &mut geometry).map(|_| geometry)
}

/// A geometry of nested geometries.
fn collection(kind: u32, parts: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = vec![1];
    bytes.extend(kind.to_le_bytes());
    bytes.extend((parts.len() as u32).to_le_bytes());
    parts.iter().for_each(|part| bytes.extend(part));
    bytes
}

fn line(kind: u32, positions: &[&[f64]]) -> Vec<u8> {
    let mut bytes = vec![1];
    bytes.extend(kind.to_le_bytes());
    bytes.extend((positions.len() as u32).to_le_bytes());
    positions.iter().copied().flatten().for_each(|value| bytes.extend(value.to_le_bytes()));
    bytes
}

#[test]
fn polygons_with_holes_in_all_dialects() {
    let rings = [square(0.0, 0.0, 9.0), square(1.0, 1.0, 2.0)];
    assert_eq!(on_map(&read(&polygon_wkb(&rings, None)).unwrap()), [rings.to_vec()]);
    let with_z = read(&polygon_wkb(&rings, Some(7.0))).unwrap();
    assert_eq!((on_map(&with_z), with_z.polygons[0][1][4]), (vec![rings.to_vec()], [1.0, 1.0, 7.0]));
    let both = read(&collection(6, &[polygon_wkb(&rings, None), polygon_wkb(&rings[..1], None)])).unwrap();
    assert_eq!(on_map(&both), [rings.to_vec(), rings[..1].to_vec()]);
    // EWKB: Z and SRID as flags, then a measure that is left out.
    let mut ewkb = vec![1];
    ewkb.extend((1 | 0xe000_0000_u32).to_le_bytes());
    ewkb.extend(28992_u32.to_le_bytes());
    [1.0_f64, 2.0, 3.0, 4.0].iter().for_each(|value| ewkb.extend(value.to_le_bytes()));
    let mut geometry = Geometry::default();
    assert_eq!(parse(&ewkb, &mut geometry), Ok(Some(28992)));
    assert_eq!(geometry.points, [[1.0, 2.0, 3.0]]);
    let mut big_endian = vec![0];
    big_endian.extend(2_u32.to_be_bytes());
    big_endian.extend(1_u32.to_be_bytes());
    [5.0_f64, 6.0].iter().for_each(|value| big_endian.extend(value.to_be_bytes()));
    assert_eq!(read(&big_endian).unwrap().lines, [vec![[5.0, 6.0, 0.0]]]);
    assert!(read(&line(1, &[])).is_err());
}

#[test]
fn surfaces_curves_and_empty_geometries() {
    let patch = polygon_wkb(&[square(0.0, 0.0, 1.0)], Some(2.0));
    assert!(read(&collection(1015, std::slice::from_ref(&patch))).unwrap().is_surface);
    assert!(!read(&collection(1006, &[patch])).unwrap().is_surface);
    let arc = line(8, &[&[0.0, 0.0], &[1.0, 1.0], &[2.0, 0.0]]);
    let back = line(2, &[&[2.0, 0.0], &[0.0, 0.0]]);
    let area = read(&collection(12, &[collection(10, &[collection(9, &[arc, back])])])).unwrap();
    let ring = &area.polygons[0][0];
    assert_eq!((ring.len(), ring.first(), ring.last()), (47, Some(&[0.0; 3]), Some(&[0.0; 3])));
    assert!(read(&collection(7, &[])).unwrap().is_empty());
    assert!(read(&polygon_wkb(&[], None)).unwrap().is_empty());
    let nowhere = [&[1, 1, 0, 0, 0][..], &f64::NAN.to_le_bytes(), &f64::NAN.to_le_bytes()].concat();
    assert!(read(&nowhere).unwrap().is_empty());
}

#[test]
fn heights_that_some_parts_lack_are_not_taken_for_0() {
    let [near, far] = [square(0.0, 0.0, 9.0), square(20.0, 0.0, 9.0)];
    let parts = [polygon_wkb(&[near], Some(512.0)), polygon_wkb(&[far], None)];
    let mut mixed = read(&collection(7, &parts)).unwrap();
    assert!(mixed.fill_heights().is_some_and(f64::is_nan));
    assert!(mixed.positions().all(|position| position[2] == 512.0), "{mixed:?}");
}

#[test]
fn hostile_bytes_fail() {
    let whole = collection(6, &[polygon_wkb(&[square(0.0, 0.0, 9.0), square(1.0, 1.0, 2.0)], Some(1.0))]);
    for length in 0..whole.len() {
        assert_eq!(read(&whole[..length]), Err(MALFORMED), "{length} bytes");
    }
    assert_eq!(read(&[1, 3, 0, 0, 0, 0xff, 0xff, 0xff, 0xff]), Err(MALFORMED), "count of rings");
    assert_eq!(read(&[1, 7, 0, 0, 0, 0xff, 0xff, 0xff, 0x7f, 1]), Err(MALFORMED), "count of parts");
    assert_eq!(read(&[7, 3, 0, 0, 0]), Err(MALFORMED), "byte order");
    assert_eq!(read(&line(99, &[])), Err(UNKNOWN_TYPE));
    assert_eq!(read(&line(4003, &[])), Err(UNKNOWN_TYPE));
    let nested = |kind: u32| (0..100).fold(collection(kind, &[]), |inner, _| collection(kind, &[inner]));
    assert_eq!(read(&nested(7)), Err(TOO_DEEP));
    assert_eq!(read(&nested(9)), Err(TOO_DEEP));
}

#[test]
fn hexadecimal_digits() {
    assert_eq!(bytes_of_hex(" 0101000000 "), Some(vec![1, 1, 0, 0, 0]));
    assert_eq!(bytes_of_hex("0101000020E6100000").map(|bytes| bytes.len()), Some(9));
    for other in ["", "01", "010100000", "0101zz0000", "0201000000", "POINT (1 2)"] {
        assert_eq!(bytes_of_hex(other), None, "{other}");
    }
}
