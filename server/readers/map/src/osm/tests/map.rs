//! Small maps that are written in every form of a file.

use crate::osm::collect::Limits;
use crate::osm::read_within;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::testing::{TestFiles, TestSink};
use std::io::Write;

type Tags = Vec<(&'static str, &'static str)>;

type Member = (char, i64, &'static str);

/// Elements of a map. Positions are in units of 1e-7 degrees.
#[derive(Debug, Clone, Default)]
pub(super) struct Map {
    pub(super) nodes: Vec<(i64, [i64; 2], Tags)>,
    pub(super) ways: Vec<(i64, Vec<i64>, Tags)>,
    /// Members with their types (`n`, `w`, `r`) and roles.
    pub(super) relations: Vec<(i64, Vec<Member>, Tags)>,
}

impl Map {
    pub(super) fn node(&mut self, id: i64, position: [i64; 2]) -> &mut Self {
        self.nodes.push((id, position, Vec::new()));
        self
    }

    pub(super) fn way(&mut self, id: i64, refs: &[i64], tags: &[(&'static str, &'static str)]) -> &mut Self {
        self.ways.push((id, refs.to_vec(), tags.to_vec()));
        self
    }

    pub(super) fn relation(
        &mut self,
        id: i64,
        members: &[(char, i64, &'static str)],
        tags: &[(&'static str, &'static str)],
    ) -> &mut Self {
        self.relations.push((id, members.to_vec(), tags.to_vec()));
        self
    }

    /// Adds a closed way around a rectangle with new nodes, whose identifiers follow from that of the way.
    pub(super) fn rectangle(
        &mut self,
        id: i64,
        [west, south, east, north]: [i64; 4],
        tags: &[(&'static str, &'static str)],
    ) -> &mut Self {
        let first = id * 100;
        for (i, position) in [[west, south], [east, south], [east, north], [west, north]].into_iter().enumerate() {
            self.node(first + i as i64, position);
        }
        self.way(id, &[first, first + 1, first + 2, first + 3, first], tags)
    }

    pub(super) fn xml(&self) -> String {
        let escape = |text: &str| text.replace('&', "&amp;").replace('"', "&quot;").replace('<', "&lt;");
        let tags = |tags: &Tags| -> String {
            tags.iter().map(|(k, v)| format!("<tag k=\"{}\" v=\"{}\"/>", escape(k), escape(v))).collect()
        };
        let mut text = "<?xml version='1.0' encoding='UTF-8'?>\n<osm version=\"0.6\">\n".to_owned();
        for (id, [lon, lat], own) in &self.nodes {
            let (lon, lat) = (*lon as f64 / 1e7, *lat as f64 / 1e7);
            text += &format!("<node id=\"{id}\" lat=\"{lat}\" lon=\"{lon}\">{}</node>\n", tags(own));
        }
        for (id, refs, own) in &self.ways {
            let refs: String = refs.iter().map(|id| format!("<nd ref=\"{id}\"/>")).collect();
            text += &format!("<way id=\"{id}\">{refs}{}</way>\n", tags(own));
        }
        for (id, members, own) in &self.relations {
            text += &format!("<relation id=\"{id}\">");
            for (kind, id, role) in members {
                let kind = match kind {
                    'n' => "node",
                    'w' => "way",
                    _ => "relation",
                };
                text += &format!("<member type=\"{kind}\" ref=\"{id}\" role=\"{role}\"/>");
            }
            text += &format!("{}</relation>\n", tags(own));
        }
        text + "</osm>\n"
    }

    /// The map as a PBF file of one block, with dense nodes or single ones.
    pub(super) fn pbf(&self, is_dense: bool) -> Vec<u8> {
        self.pbf_with(is_dense, |_, _| ())
    }

    /// The map as a PBF file whose ways have the positions of their nodes, so that only nodes with tags are elements.
    pub(super) fn pbf_of_placed_ways(&self) -> Vec<u8> {
        let mut map = self.clone();
        map.nodes.retain(|(.., tags)| !tags.is_empty());
        map.pbf_with(true, |way, refs| {
            let place = |id: &i64| self.nodes.iter().find(|(known, ..)| known == id).unwrap().1;
            for (field, axis) in [(9, 1), (10, 0)] {
                bytes(way, field, &deltas(refs.iter().map(|id| place(id)[axis])));
            }
        })
    }

    fn pbf_with(&self, is_dense: bool, add_to_way: impl Fn(&mut Vec<u8>, &[i64])) -> Vec<u8> {
        let mut table = Texts(vec![String::new()]);
        let mut group = Vec::new();
        if is_dense {
            self.write_dense(&mut table, &mut group);
        } else {
            for (id, [lon, lat], tags) in &self.nodes {
                let mut node = Vec::new();
                number(&mut node, 1, zigzag(*id));
                table.write_tags(tags, &mut node);
                number(&mut node, 8, zigzag(*lat));
                number(&mut node, 9, zigzag(*lon));
                bytes(&mut group, 1, &node);
            }
        }
        for (id, refs, tags) in &self.ways {
            let mut way = Vec::new();
            number(&mut way, 1, *id as u64);
            table.write_tags(tags, &mut way);
            bytes(&mut way, 8, &deltas(refs.iter().copied()));
            add_to_way(&mut way, refs);
            bytes(&mut group, 3, &way);
        }
        for (id, members, tags) in &self.relations {
            let mut relation = Vec::new();
            number(&mut relation, 1, *id as u64);
            table.write_tags(tags, &mut relation);
            bytes(&mut relation, 8, &packed(members.iter().map(|(.., role)| table.index(role))));
            bytes(&mut relation, 9, &deltas(members.iter().map(|(_, id, _)| *id)));
            let kinds = members.iter().map(|(kind, ..)| "nwr".find(*kind).unwrap() as u64);
            bytes(&mut relation, 10, &packed(kinds));
            bytes(&mut group, 4, &relation);
        }
        let mut block = Vec::new();
        let texts = table.0.iter().fold(Vec::new(), |mut texts, text| {
            bytes(&mut texts, 1, text.as_bytes());
            texts
        });
        bytes(&mut block, 1, &texts);
        bytes(&mut block, 2, &group);
        pbf_file(&[&block])
    }

    fn write_dense(&self, table: &mut Texts, group: &mut Vec<u8>) {
        let mut dense = Vec::new();
        bytes(&mut dense, 1, &deltas(self.nodes.iter().map(|(id, ..)| *id)));
        bytes(&mut dense, 8, &deltas(self.nodes.iter().map(|(_, [_, lat], _)| *lat)));
        bytes(&mut dense, 9, &deltas(self.nodes.iter().map(|(_, [lon, _], _)| *lon)));
        let mut tags = Vec::new();
        for (.., own) in &self.nodes {
            tags.extend(own.iter().flat_map(|(key, value)| [table.index(key), table.index(value)]));
            tags.push(0);
        }
        bytes(&mut dense, 10, &packed(tags.into_iter()));
        bytes(group, 2, &dense);
    }
}

struct Texts(Vec<String>);

impl Texts {
    fn index(&mut self, text: &str) -> u64 {
        let known = self.0.iter().position(|known| known == text);
        known.unwrap_or_else(|| {
            self.0.push(text.to_owned());
            self.0.len() - 1
        }) as u64
    }

    fn write_tags(&mut self, tags: &Tags, into: &mut Vec<u8>) {
        let keys: Vec<u64> = tags.iter().map(|(key, _)| self.index(key)).collect();
        let values: Vec<u64> = tags.iter().map(|(_, value)| self.index(value)).collect();
        bytes(into, 2, &packed(keys.into_iter()));
        bytes(into, 3, &packed(values.into_iter()));
    }
}

pub(super) fn varint(into: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        into.push(value as u8 | 0x80);
        value >>= 7;
    }
    into.push(value as u8);
}

pub(super) fn number(into: &mut Vec<u8>, field: u64, value: u64) {
    varint(into, field << 3);
    varint(into, value);
}

pub(super) fn bytes(into: &mut Vec<u8>, field: u64, value: &[u8]) {
    varint(into, field << 3 | 2);
    varint(into, value.len() as u64);
    into.extend_from_slice(value);
}

pub(super) fn packed(values: impl Iterator<Item = u64>) -> Vec<u8> {
    let mut into = Vec::new();
    values.for_each(|value| varint(&mut into, value));
    into
}

pub(super) fn zigzag(value: i64) -> u64 {
    ((value << 1) ^ (value >> 63)) as u64
}

pub(super) fn deltas(values: impl Iterator<Item = i64>) -> Vec<u8> {
    let mut before = 0_i64;
    packed(values.map(|value| {
        let step = value.wrapping_sub(before);
        before = value;
        zigzag(step)
    }))
}

pub(super) fn pbf_file(blocks: &[&[u8]]) -> Vec<u8> {
    let mut header = Vec::new();
    bytes(&mut header, 4, b"OsmSchema-V0.6");
    bytes(&mut header, 4, b"DenseNodes");
    let mut file = blob("OSMHeader", &zlib_blob(&header, header.len() as u64));
    file.extend(blocks.iter().flat_map(|block| blob("OSMData", &zlib_blob(block, block.len() as u64))));
    file
}

/// A `Blob` message of packed bytes that claims a size.
pub(super) fn zlib_blob(raw: &[u8], claimed_bytes: u64) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(raw).unwrap();
    let mut blob = Vec::new();
    number(&mut blob, 2, claimed_bytes);
    bytes(&mut blob, 3, &encoder.finish().unwrap());
    blob
}

/// A `Blob` message with the header before it.
pub(super) fn blob(kind: &str, blob: &[u8]) -> Vec<u8> {
    let mut header = Vec::new();
    bytes(&mut header, 1, kind.as_bytes());
    number(&mut header, 3, blob.len() as u64);
    let mut file = (header.len() as u32).to_be_bytes().to_vec();
    file.extend(header);
    file.extend_from_slice(blob);
    file
}

pub(super) fn read_bytes(name: &str, bytes: &[u8]) -> (TestSink, Result<(), InputError>) {
    read_limited(name, bytes, Limits::default(), None)
}

pub(super) fn read_limited(
    name: &str,
    bytes: &[u8],
    limits: Limits,
    bbox_deg: Option<[f64; 4]>,
) -> (TestSink, Result<(), InputError>) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join(name), bytes).unwrap();
    let files = TestFiles(folder.path().to_owned());
    let input = Input { bbox_deg, ..Input::new(name, name, &files, 1 << 26) };
    let mut sink = TestSink::default();
    let read = read_within(&input, limits, &mut sink);
    (sink, read)
}

/// Reads a map in its XML form.
pub(super) fn read_map(map: &Map) -> TestSink {
    let (sink, read) = read_bytes("map.osm", map.xml().as_bytes());
    read.unwrap();
    sink
}
