//! Packed files have the same heights as others.

use super::super::super::error::RasterError;
use super::super::super::facts::RasterLimits;
use super::file::{TestCloud, TestPacking, TestPoint};
use super::{LIMITS, assert_heights, heights, open, open_within, read};

const PACKINGS: [TestPacking; 4] =
    [TestPacking::Fixed(50), TestPacking::Fixed(50_000), TestPacking::Growing, TestPacking::Fixed(1)];

/// Points of all kinds, without order.
fn points(count: u32) -> Vec<TestPoint> {
    let noise = |i: u32| i.wrapping_mul(2_654_435_761) >> 16;
    let point = |i: u32| {
        let along = |seed: u32| f64::from(noise(i * 3 + seed) % 4000) / 100.0;
        let point = TestPoint::ground(along(0), along(1), along(2)).class([2, 2, 5, 9, 1][noise(i) as usize % 5]);
        point.flags([0, 0, 0, 2, 4][noise(i + 7) as usize % 5]).returns(1, 1 + (noise(i) % 3) as u8)
    };
    (0..count).map(point).collect()
}

#[test]
fn packings_give_the_same() {
    for format in [0, 1, 2, 3, 6, 7, 8] {
        for extra_bytes in [0, 3] {
            let mut cloud = TestCloud::new(points(150)).format(format);
            cloud.extra_bytes = extra_bytes;
            let expected = read(&cloud.bytes());
            for packing in PACKINGS {
                let found = read(&cloud.clone().packing(packing).bytes());
                assert_eq!(found.0, expected.0, "{format} {packing:?}");
                assert_heights(&found.1, &expected.1);
            }
        }
    }
}

#[test]
fn points_without_chunks() {
    let cloud = TestCloud::new(points(700)).format(3);
    assert_heights(&heights(&cloud.clone().packing(TestPacking::OneRun).bytes()), &heights(&cloud.bytes()));
}

#[test]
fn chunks_that_are_read_on_their_own() {
    // More than are unpacked together with others.
    for format in [1, 6] {
        let cloud = TestCloud::new(points(300_000)).format(format);
        let packed = cloud.clone().packing(TestPacking::Fixed(400_000)).bytes();
        assert_heights(&heights(&packed), &heights(&cloud.bytes()));
        // Layers are in memory.
        let limits = RasterLimits { max_chunk_bytes: 1 << 16, ..LIMITS };
        match open_within(&packed, limits) {
            Err(error) => assert!(format == 6 && matches!(error, RasterError::TooLarge { .. })),
            Ok(_) => assert_eq!(format, 1),
        }
    }
}

#[test]
fn a_table_of_chunks_whose_place_is_at_the_end() {
    let cloud = TestCloud::new(points(300)).packing(TestPacking::Fixed(50));
    let mut bytes = cloud.bytes();
    let expected = heights(&bytes);
    let offset = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
    let place: [u8; 8] = bytes[offset..offset + 8].try_into().unwrap();
    bytes[offset..offset + 8].fill(0xff);
    assert!(matches!(open(&bytes), Err(RasterError::Damaged(_))));
    bytes.extend(place);
    assert_heights(&heights(&bytes), &expected);
}

#[test]
fn records_behind_packed_points() {
    let mut cloud = TestCloud::new(points(300)).format(6).packing(TestPacking::Growing);
    let expected = heights(&cloud.bytes());
    cloud.late_records.push(("copc", 1000, vec![1; 5000]));
    assert_heights(&heights(&cloud.bytes()), &expected);
}
