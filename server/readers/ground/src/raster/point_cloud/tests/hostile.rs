//! Damaged files: they give an error, never a panic, and never more memory than the limits allow.

use super::super::super::error::RasterError;
use super::super::super::facts::Window;
use super::file::{TestCloud, TestPacking, TestPoint};
use super::open;

const POINTS: usize = 24;

fn cloud(format: u8, packing: TestPacking) -> TestCloud {
    let points = (0..POINTS).map(|i| TestPoint::ground((i % 8) as f64, (i / 8) as f64, (i % 3) as f64));
    let cloud = TestCloud::new(points.collect()).format(format).packing(packing);
    let mut cloud = cloud.keys(&[[1024, 1], [3072, 28992], [4096, 5709]]);
    cloud.late_records.push(("LASF_Projection", 2112, b"PROJCS[]".to_vec()));
    cloud
}

fn samples() -> Vec<Vec<u8>> {
    let packings = [TestPacking::None, TestPacking::Fixed(9), TestPacking::Growing];
    let mut samples: Vec<Vec<u8>> =
        packings.iter().flat_map(|packing| [3, 7].map(|format| cloud(format, *packing).bytes())).collect();
    samples.push(cloud(1, TestPacking::OneRun).bytes());
    samples
}

/// Opens a file and reads what it has. Only panics matter.
fn try_all(bytes: &[u8]) -> bool {
    let Ok((mut cloud, facts)) = open(bytes) else { return false };
    assert!(facts.size.pixels() <= 1 << 20);
    let window = Window { x: 0, y: 0, width: facts.size.width, height: 1 };
    cloud.read_heights(window, facts.size.width as usize).is_ok()
}

#[test]
fn files_that_end_early() {
    for bytes in samples() {
        assert!(try_all(&bytes));
        let points_offset = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
        for end in 0..bytes.len() {
            let is_read = try_all(&bytes[..end]);
            assert!(!is_read || end > points_offset + 200, "{end} of {}", bytes.len());
        }
    }
}

#[test]
fn files_with_other_bytes() {
    for bytes in samples() {
        let points_offset = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
        // Not all bytes of packed points, because each takes some milliseconds.
        let places = (0..bytes.len()).filter(|place| place % if *place < points_offset { 7 } else { 31 } == 1);
        for place in places {
            let mut other = bytes.clone();
            other[place] ^= 0x95;
            try_all(&other);
            // Numbers of 32 bits, such as counts and offsets.
            let mut bytes = bytes.clone();
            let end = bytes.len().min(place + 4);
            bytes[place..end].fill(0xff);
            try_all(&bytes);
        }
    }
}

#[test]
fn headers_with_absurd_numbers() {
    let with = |packing: TestPacking, offset: usize, number: &[u8]| {
        let mut bytes = cloud(6, packing).bytes();
        bytes[offset..offset + number.len()].copy_from_slice(number);
        open(&bytes).err().map(|error| error.to_string()).unwrap_or_default()
    };
    for packing in [TestPacking::None, TestPacking::Fixed(9), TestPacking::Growing] {
        let with = |offset, number: &[u8]| with(packing, offset, number);
        for points in [1000_u64, 1 << 32, 1 << 60, u64::MAX] {
            assert!(!with(247, &points.to_le_bytes()).is_empty(), "{packing:?} {points}");
        }
        assert!(with(0, b"LASX").contains("format"));
        assert!(with(24, &[2]).contains("version 2.4"));
        assert!(with(104, &[11]).contains("format 11"));
        assert!(with(105, &29_u16.to_le_bytes()).contains("too short"));
        assert!(with(105, &u16::MAX.to_le_bytes()).contains("too large"));
        for offset in [0, 374, u32::MAX] {
            assert!(with(96, &offset.to_le_bytes()).contains("behind its header"), "{offset}");
        }
        for number in [f64::NAN, f64::INFINITY, -1.0, 0.0, 1e300] {
            assert!(with(139, &number.to_le_bytes()).contains("scale"), "{number}");
        }
        for number in [f64::NAN, f64::INFINITY, 1e15] {
            assert!(with(171, &number.to_le_bytes()).contains("offset"), "{number}");
            assert!(with(179, &number.to_le_bytes()).contains("bounds"), "{number}");
        }
        assert!(with(179, &(-5_f64).to_le_bytes()).contains("bounds"));
    }
}

#[test]
fn numbers_of_records_that_are_not_there() {
    for count in [0, 500, u32::MAX] {
        let mut bytes = cloud(6, TestPacking::None).bytes();
        bytes[100..104].copy_from_slice(&count.to_le_bytes());
        bytes[243..247].copy_from_slice(&count.to_le_bytes());
        assert!(try_all(&bytes), "{count}");
        // Records behind the points that are before them, and far behind the end.
        for offset in [0_u64, 375, u64::MAX] {
            bytes[235..243].copy_from_slice(&offset.to_le_bytes());
            assert!(try_all(&bytes), "{count} {offset}");
        }
    }
}

#[test]
fn layers_that_claim_to_be_large() {
    let bytes = cloud(6, TestPacking::Fixed(50_000)).bytes();
    let points_offset = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
    // Behind the place of the table, the first point and the number of points.
    let sizes = points_offset + 8 + 30 + 4;
    for layer in 0..9 {
        let mut bytes = bytes.clone();
        bytes[sizes + layer * 4..][..4].fill(0xff);
        let error = open(&bytes).err().unwrap();
        assert!(error.to_string().contains("ends early"), "{error}");
    }
}

#[test]
fn fields_that_claim_to_be_of_another_size() {
    // The decoder would look for the sizes of layers where they were not checked.
    let bytes = cloud(7, TestPacking::Fixed(50_000)).bytes();
    let name = bytes.windows(14).position(|bytes| bytes == b"laszip encoded").unwrap();
    // A header of 54 bytes, of which the name is behind the first two, then 34 bytes, and 6 bytes for each group.
    let colours = name - 2 + 54 + 34 + 6;
    assert_eq!(bytes[colours..colours + 4], [11, 0, 6, 0]);
    let mut other = bytes.clone();
    other[colours + 2] = 106;
    other[105] += 100;
    let error = open(&other).err().unwrap();
    assert!(error.to_string().contains("another size"), "{error}");
}

#[test]
fn tables_of_chunks_that_claim_to_be_large() {
    for (format, packing) in [(1, TestPacking::Fixed(9)), (6, TestPacking::Growing)] {
        let bytes = cloud(format, packing).bytes();
        let points_offset = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
        let place = u64::from_le_bytes(bytes[points_offset..points_offset + 8].try_into().unwrap()) as usize;
        for count in [1_000, u32::MAX] {
            let mut bytes = bytes.clone();
            bytes[place + 4..place + 8].copy_from_slice(&count.to_le_bytes());
            let error = open(&bytes).err().unwrap();
            assert!(error.to_string().contains("too long"), "{error}");
        }
    }
}

#[test]
fn few_bytes_that_claim_to_be_many_points() {
    // All points of the header are in the only chunk.
    let mut bytes = cloud(6, TestPacking::Fixed(u32::MAX - 1)).bytes();
    bytes[247..255].copy_from_slice(&10_000_000_u64.to_le_bytes());
    let error = open(&bytes).err().unwrap();
    assert!(matches!(&error, RasterError::Damaged(what) if what.contains("can hold")), "{error}");
}

#[test]
fn points_that_are_too_far_apart() {
    let mut cloud = cloud(1, TestPacking::None);
    cloud.scale = [400.0, 400.0, 0.01];
    cloud
        .points
        .extend([i32::MIN, i32::MAX].map(|number| TestPoint { numbers: [number, number, 0], ..cloud.points[0] }));
    let (_, facts) = open(&cloud.bytes()).unwrap();
    assert!(facts.size.pixels() <= 1 << 20);
}

#[test]
fn files_without_points() {
    for packing in [TestPacking::None, TestPacking::Fixed(9), TestPacking::OneRun] {
        let mut empty = TestCloud::new(vec![]).packing(packing);
        empty.bounds = Some([[0.0; 2]; 2]);
        let error = open(&empty.bytes()).err().unwrap();
        assert!(error.to_string().contains("no points"), "{error}");
    }
}
