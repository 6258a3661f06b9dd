//! Tests of all vector formats on small data that they make.

mod csv;
mod features;
mod flatgeobuf;
mod geopackage;
mod geoparquet;
mod shapefile;
mod wkb;
mod wkt;

use super::geometry::Geometry;
use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::error::InputError;
use insula_source::input::{Input, Share};
use insula_source::object::{Footprint, ObjectSink, Shape};
use insula_source::testing::{TestFiles, TestSink};
use std::fs;

type Reader = fn(&Input<'_>, &mut dyn ObjectSink) -> Result<(), InputError>;

const MAX_BYTES: u64 = 1 << 24;

/// Runs a reader on files of these names and bytes, the first of which is the source.
fn run(reader: Reader, files: &[(&str, &[u8])], bbox_deg: Option<[f64; 4]>) -> (Result<(), InputError>, TestSink) {
    run_share(reader, files, bbox_deg, Share::WHOLE)
}

/// Runs a reader on a share of a source.
fn run_share(
    reader: Reader,
    files: &[(&str, &[u8])],
    bbox_deg: Option<[f64; 4]>,
    share: Share,
) -> (Result<(), InputError>, TestSink) {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        fs::write(folder.path().join(name), bytes).unwrap();
    }
    let files_of = TestFiles(folder.path().to_path_buf());
    let name = files[0].0;
    let input = Input { bbox_deg, share, ..Input::new(name, name, &files_of, MAX_BYTES) };
    let mut sink = TestSink::default();
    let result = reader(&input, &mut sink);
    (result, sink)
}

/// Runs a reader that must succeed.
fn read(reader: Reader, files: &[(&str, &[u8])]) -> TestSink {
    let (result, sink) = run(reader, files, None);
    result.unwrap();
    sink
}

/// Compares what the shares of a source have with what the whole of it has.
fn assert_shares_are_the_whole(reader: Reader, file: (&str, &[u8]), bbox_deg: Option<[f64; 4]>) {
    let (result, whole) = run(reader, &[file], bbox_deg);
    result.unwrap();
    for count in [2, 3, 7] {
        let mut found = TestSink::default();
        for number in 0..count {
            let (result, sink) = run_share(reader, &[file], bbox_deg, Share { number, count });
            result.unwrap();
            assert!(sink.crs.is_empty() || sink.crs == whole.crs, "{} of {count}", number);
            found.objects.extend(sink.objects);
            found.skipped.extend(sink.skipped);
        }
        assert_eq!(found.skipped, whole.skipped, "{count} shares");
        assert!(found.objects == whole.objects, "{count} shares");
    }
}

/// Runs a reader on all beginnings of a file, and on copies with a changed byte. It may fail, but must not panic, and must
/// account for no more objects than `max_objects`.
fn attack(reader: Reader, files: &[(&str, &[u8])], step: usize, max_objects: usize) {
    attack_share(reader, files, step, max_objects, Share::WHOLE);
}

/// As [`attack`], of a share.
fn attack_share(reader: Reader, files: &[(&str, &[u8])], step: usize, max_objects: usize, share: Share) {
    let folder = tempfile::tempdir().unwrap();
    let files_of = TestFiles(folder.path().to_path_buf());
    for (name, bytes) in files {
        fs::write(folder.path().join(name), bytes).unwrap();
    }
    let (name, bytes) = files[0];
    let input = Input { share, ..Input::new(name, name, &files_of, MAX_BYTES) };
    let check = |bytes: &[u8]| {
        fs::write(folder.path().join(name), bytes).unwrap();
        let mut sink = TestSink::default();
        let _ = reader(&input, &mut sink);
        assert!(sink.objects.len() + sink.skipped.len() <= max_objects);
    };
    for length in (0..bytes.len()).step_by(step) {
        check(&bytes[..length]);
    }
    for index in (0..bytes.len()).step_by(step) {
        for change in [0xff, 0x80, 0x01] {
            let mut changed = bytes.to_vec();
            changed[index] ^= change;
            check(&changed);
        }
    }
}

/// Corners of a square, closed.
fn square(x: f64, y: f64, size: f64) -> Vec<[f64; 2]> {
    vec![[x, y], [x + size, y], [x + size, y + size], [x, y + size], [x, y]]
}

fn rings(shape: &Shape) -> &[Footprint] {
    match shape {
        Shape::Footprints(footprints) => footprints,
        other => panic!("no footprints: {other:?}"),
    }
}

fn attributes(pairs: &[(&str, AttributeValue)]) -> Attributes {
    let mut attributes = Attributes::default();
    pairs.iter().for_each(|(name, value)| attributes.push(name, value.clone()));
    attributes
}

fn text(text: &str) -> AttributeValue {
    AttributeValue::Text(text.to_owned())
}

/// WKB of a polygon, little-endian, with heights if `z` is given.
fn polygon_wkb(rings: &[Vec<[f64; 2]>], z: Option<f64>) -> Vec<u8> {
    let mut wkb = vec![1];
    wkb.extend((if z.is_some() { 1003_u32 } else { 3 }).to_le_bytes());
    wkb.extend((rings.len() as u32).to_le_bytes());
    for ring in rings {
        wkb.extend((ring.len() as u32).to_le_bytes());
        for [x, y] in ring {
            wkb.extend([Some(*x), Some(*y), z].into_iter().flatten().flat_map(f64::to_le_bytes));
        }
    }
    wkb
}

fn on_map(geometry: &Geometry) -> Vec<Vec<Vec<[f64; 2]>>> {
    let ring = |ring: &Vec<[f64; 3]>| ring.iter().map(|[x, y, _]| [*x, *y]).collect();
    geometry.polygons.iter().map(|polygon| polygon.iter().map(ring).collect()).collect()
}
