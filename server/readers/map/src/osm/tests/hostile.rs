//! Files that are damaged, or made to do harm.

use super::map::{Map, blob, bytes, deltas, number, packed, pbf_file, read_bytes, zigzag, zlib_blob};
use crate::osm::classes::POINT_STRUCTURE;
use crate::osm::relations::TOO_SHARED;
use insula_source::error::InputError;
use insula_source::problems::ENCODING_GUESSED;
use insula_source::testing::gzip;

fn map() -> Map {
    let mut map = Map::default();
    map.rectangle(1, [0, 0, 1000, 1000], &[("building", "yes")]).rectangle(
        2,
        [0, 0, 900, 1000],
        &[("building:part", "yes")],
    );
    map.rectangle(3, [0, 0, 1000, 1000], &[]);
    map.relation(1, &[('w', 3, "outer")], &[("type", "multipolygon"), ("landuse", "grass")]);
    map
}

/// A file of one block with texts and a group.
fn block(texts: &[&str], group: &[u8], others: impl Fn(&mut Vec<u8>)) -> Vec<u8> {
    let mut table = Vec::new();
    texts.iter().for_each(|text| bytes(&mut table, 1, text.as_bytes()));
    let mut block = Vec::new();
    bytes(&mut block, 1, &table);
    bytes(&mut block, 2, group);
    others(&mut block);
    pbf_file(&[&block])
}

#[test]
fn a_file_that_ends_early_is_an_error_at_every_length() {
    let pbf = map().pbf(true);
    let header_bytes = pbf_file(&[]).len();
    for length in 0..pbf.len() {
        let (_, read) = read_bytes("map.pbf", &pbf[..length]);
        assert_eq!(read.is_ok(), length == header_bytes, "{length}: {read:?}");
    }
    let xml = map().xml().trim_end().to_owned();
    for length in 0..xml.len() {
        let (_, read) = read_bytes("map.osm", &xml.as_bytes()[..length]);
        assert!(matches!(read, Err(InputError::Damaged { .. })), "{length}: {read:?}");
    }
    let packed = gzip(xml.as_bytes());
    for length in 0..packed.len() {
        assert!(read_bytes("map.osm.gz", &packed[..length]).1.is_err(), "{length}");
    }
}

#[test]
fn changed_bytes_are_errors_or_other_objects() {
    let files = [("map.pbf", uncompressed(&map())), ("map.osm", map().xml().into_bytes())];
    let mut seed = 1_u64;
    for (name, file) in files {
        for _ in 0..300 {
            let mut changed = file.clone();
            for _ in 0..3 {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                let place = (seed >> 33) as usize % changed.len();
                changed[place] = (seed >> 20) as u8;
            }
            let _ = read_bytes(name, &changed);
        }
    }
}

/// The PBF form without compression, so that changes reach the elements.
fn uncompressed(map: &Map) -> Vec<u8> {
    let packed = map.pbf(true);
    let header = pbf_file(&[]);
    let start =
        header.len() + 4 + u32::from_be_bytes(packed[header.len()..header.len() + 4].try_into().unwrap()) as usize;
    // The zlib stream follows the tag and the length of the field.
    let stream = packed[start..].windows(2).position(|pair| pair == [0x78, 0x01]).unwrap();
    let mut raw = Vec::new();
    std::io::Read::read_to_end(&mut flate2::read::ZlibDecoder::new(&packed[start + stream..]), &mut raw).unwrap();
    let mut message = Vec::new();
    bytes(&mut message, 1, &raw);
    [header, blob("OSMData", &message)].concat()
}

#[test]
fn texts_that_a_block_lacks_cost_the_tag() {
    let (mut way, mut group) = (Vec::new(), Vec::new());
    number(&mut way, 1, 5);
    bytes(&mut way, 2, &packed([1, u64::MAX, 3].into_iter()));
    bytes(&mut way, 3, &packed([2, 1, 99].into_iter()));
    bytes(&mut way, 8, &deltas([1, 2, 3, 1].into_iter()));
    bytes(&mut group, 3, &way);
    let (sink, read) = read_bytes("map.pbf", &block(&["", "building", "yes", "height"], &group, |_| ()));
    read.unwrap();
    assert_eq!(sink.problems, [("tag with a text that the block lacks", "way/5".to_owned())]);
    assert_eq!(sink.skipped, [("outside of the extract", "way/5".to_owned())]);
    // As many values as keys.
    let (mut way, mut group) = (Vec::new(), Vec::new());
    bytes(&mut way, 2, &packed([1, 1].into_iter()));
    bytes(&mut way, 3, &packed([1].into_iter()));
    bytes(&mut group, 3, &way);
    let (_, read) = read_bytes("map.pbf", &block(&["", "building"], &group, |_| ()));
    assert!(matches!(read, Err(InputError::Damaged { .. })), "{read:?}");
}

#[test]
fn texts_in_other_pages_are_read_and_reported() {
    let mut map = Map::default();
    map.rectangle(1, [0, 0, 1000, 1000], &[("building", "Buero"), ("name", "Koelner Str.")]);
    let mut file = uncompressed(&map);
    for (text, other) in [(&b"Buero"[..], &b"B\xfcro "[..]), (b"Koelner Str.", b"K\xf6lner Str. ")] {
        let place = file.windows(text.len()).position(|bytes| bytes == text).unwrap();
        file[place..place + text.len()].copy_from_slice(other);
    }
    let (sink, read) = read_bytes("map.pbf", &file);
    read.unwrap();
    let [house] = &sink.objects[..] else { panic!("{:?}", sink.skipped) };
    assert_eq!(house.source_type, "building=Büro ");
    assert_eq!(house.attributes.get("name").unwrap().to_string(), "Kölner Str.");
    let [(kind, first), (_, second)] = &sink.problems[..] else { panic!("{:?}", sink.problems) };
    assert!(*kind == ENCODING_GUESSED && first.contains("windows-1252: Büro"), "{first}");
    assert!(second.contains("Kölner Str."), "{second}");
}

#[test]
fn sums_beyond_all_numbers_are_no_positions() {
    let huge = [zigzag(i64::MAX), zigzag(i64::MAX), zigzag(i64::MIN)];
    let (mut dense, mut group) = (Vec::new(), Vec::new());
    bytes(&mut dense, 1, &packed(huge.into_iter()));
    bytes(&mut dense, 8, &packed(huge.into_iter()));
    bytes(&mut dense, 9, &packed(huge.into_iter()));
    bytes(&mut group, 2, &dense);
    let (mut way, id) = (Vec::new(), (-7_i64) as u64);
    number(&mut way, 1, id);
    bytes(&mut way, 2, &packed([1].into_iter()));
    bytes(&mut way, 3, &packed([1].into_iter()));
    bytes(&mut way, 8, &packed(huge.into_iter()));
    bytes(&mut group, 3, &way);
    let file = block(&["", "building"], &group, |block| {
        number(block, 17, i32::MAX as u64);
        number(block, 19, i64::MAX as u64);
        number(block, 20, i64::MIN as u64);
    });
    let (sink, read) = read_bytes("map.pbf", &file);
    read.unwrap();
    assert_eq!(sink.problems.iter().filter(|(kind, _)| *kind == "node outside of the world").count(), 3);
    assert_eq!(sink.skipped, [("ring is not closed", "way/-7".to_owned())]);
}

#[test]
fn blobs_have_no_more_bytes_than_they_say() {
    let header = pbf_file(&[]);
    let zeros = vec![0; 33 << 20];
    let claims: [(&[u8], u64); 4] =
        [(&zeros[..1 << 20], 10), (&zeros[..10], 11), (&zeros, 33 << 20), (&zeros[..10], u64::MAX)];
    for (raw, claimed) in claims {
        let file = [header.clone(), blob("OSMData", &zlib_blob(raw, claimed))].concat();
        let (_, read) = read_bytes("map.pbf", &file);
        assert!(matches!(read, Err(InputError::Damaged { .. })), "{claimed}: {read:?}");
    }
    // Many blobs that unpack to more than is allowed.
    let bomb = blob("OSMData", &zlib_blob(&zeros[..30 << 20], 30 << 20));
    let (_, read) = read_bytes("map.pbf", &[header.clone(), bomb.clone(), bomb.clone(), bomb].concat());
    assert!(read.is_err());
    // Absurd sizes of headers.
    for size in [0_u32, 1 << 17, u32::MAX] {
        let (_, read) = read_bytes("map.pbf", &[&header[..], &size.to_be_bytes(), &[0; 9]].concat());
        assert!(matches!(read, Err(InputError::Damaged { .. })), "{size}: {read:?}");
    }
}

#[test]
fn files_of_other_kinds_are_refused_with_a_reason() {
    let mut lzma = Vec::new();
    bytes(&mut lzma, 4, &[1, 2, 3]);
    let mut history = Vec::new();
    bytes(&mut history, 4, b"HistoricalInformation");
    let versions = "<osm><way id='7' version='1' visible='true'/><way id='7' version='2'/></osm>";
    let files: [(&str, Vec<u8>, &str); 6] = [
        ("a.pbf", [pbf_file(&[]), blob("OSMData", &lzma)].concat(), "LZMA"),
        ("b.pbf", blob("OSMHeader", &zlib_blob(&history, history.len() as u64)), "HistoricalInformation"),
        ("c.pbf", blob("OSMData", &zlib_blob(&[], 0)), "no header"),
        ("d.osm", b"<osmChange version='0.6'></osmChange>".to_vec(), "osmChange"),
        ("e.osm", b"\x89PNG\r\n".to_vec(), "byte"),
        ("f.osm", versions.into(), "way/7 has several versions); osmium time-filter"),
    ];
    for (name, file, expected) in files {
        let message = read_bytes(name, &file).1.unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn texts_are_in_the_encoding_that_xml_declares() {
    let mut map = Map::default();
    map.rectangle(1, [0, 0, 1000, 1000], &[("building", "yes"), ("name", "Gro~haus")]);
    let xml = map.xml().replace("'UTF-8'", "'ISO-8859-1'");
    let latin: Vec<u8> = xml.bytes().map(|byte| if byte == b'~' { 0xdf } else { byte }).collect();
    let (sink, read) = read_bytes("a.osm", &latin);
    read.unwrap();
    assert_eq!(sink.objects[0].attributes.get("name").map(ToString::to_string).as_deref(), Some("Großhaus"));
    let unknown = xml.replace("ISO-8859-1", "klingon");
    assert!(read_bytes("a.osm", unknown.as_bytes()).1.unwrap_err().to_string().contains("klingon"));
}

#[test]
fn structures_without_a_plan_are_counted() {
    let tower = "<osm><node id='7' lat='1' lon='1'><tag k='man_made' v='tower'/><tag k='height' v='30'/></node></osm>";
    let (sink, read) = read_bytes("a.osm", tower.as_bytes());
    read.unwrap();
    assert_eq!(sink.skipped, [(POINT_STRUCTURE, "node/7".to_owned())]);
}

#[test]
fn hostile_xml_takes_neither_memory_nor_depth() {
    let deep = format!("<osm>{}", "<a>".repeat(1000));
    let long = format!("<osm><node id='1' lat='0' lon='{}'/></osm>", "0".repeat(5 << 20));
    for text in [deep, long] {
        assert!(read_bytes("map.osm", text.as_bytes()).1.is_err());
    }
    let entities = r#"<!DOCTYPE osm [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]>
        <osm><node id='1' lat='0' lon='0'><tag k='natural' v='tree'/><tag k='name' v='&b;'/></node>
        <node id='x' lat='0' lon='0'/><node id='2' lat='nan' lon='inf'/><node id='3' lat='1e300' lon='0'/>
        <way id='4'><nd ref='99999999999999999999'/><nd/><tag k='highway' v='path'/></way></osm>"#;
    let (sink, read) = read_bytes("map.osm", entities.as_bytes());
    read.unwrap();
    let problems: Vec<(&str, &str)> = sink.problems.iter().map(|(kind, id)| (*kind, &**id)).collect();
    assert_eq!(
        problems,
        [
            ("tag not understood", "node/1"),
            ("element without a valid identifier", "node"),
            ("node outside of the world", "node/2"),
            ("node outside of the world", "node/3"),
            ("node of a way not understood", "way/4"),
        ]
    );
    assert_eq!(sink.objects.len(), 1);
}

#[test]
fn multipolygons_that_repeat_a_way_are_few() {
    let mut map = Map::default();
    map.rectangle(1, [0, 0, 1000, 1000], &[]);
    for id in 1..=70 {
        map.relation(id, &[('w', 1, "outer")], &[("type", "multipolygon"), ("building", "yes")]);
    }
    let (sink, read) = read_bytes("map.pbf", &map.pbf(true));
    read.unwrap();
    assert_eq!(sink.objects.len(), 64);
    let left_out: Vec<_> = (65..=70).map(|id| (TOO_SHARED, format!("relation/{id}"))).collect();
    assert_eq!(sink.skipped, left_out);
}
