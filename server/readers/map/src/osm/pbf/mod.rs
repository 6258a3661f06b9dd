//! Files in the binary form of OpenStreetMap, `.osm.pbf`: blobs of elements that are read one at a time.
//!
//! <https://wiki.openstreetmap.org/wiki/PBF_Format>

mod block;
mod wire;

use super::element::{ElementFile, Pass, Position, Visit, of_history, position};
use block::{BlockContent, BlockDecoder, BlockFault, Visitor, Wanted};
use flate2::read::ZlibDecoder;
use insula_source::error::InputError;
use insula_source::input::{Input, LocalFile};
use insula_source::object::ObjectSink;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use wire::{WireFault, fields, zigzag};

/// Limits of the format.
const MAX_BLOB_HEADER_BYTES: u32 = 64 << 10;
const MAX_BLOB_BYTES: u64 = 32 << 20;
/// More blobs are refused. A file of the whole world has less than a million.
const MAX_BLOBS: usize = 4 << 20;
/// In a unit of positions.
const NANODEGREES: i64 = 100;
/// Features of files that are understood.
const FEATURES: [&[u8]; 2] = [b"OsmSchema-V0.6", b"DenseNodes"];

/// A blob of elements.
#[derive(Debug, Clone, Copy)]
struct BlobPlace {
    start: u64,
    size_bytes: u32,
    content: BlockContent,
}

pub(super) struct PbfFile<'a> {
    label: &'a str,
    /// Unpacked bytes that are allowed.
    max_bytes: u64,
    file: BufReader<File>,
    size_bytes: u64,
    /// Keeps the file as long as it is read.
    _local: LocalFile,
    /// The blobs of elements; filled by the first pass.
    blobs: Vec<BlobPlace>,
    extent: Option<[Position; 2]>,
    decoder: BlockDecoder,
    packed: Vec<u8>,
    unpacked: Vec<u8>,
}

impl<'a> PbfFile<'a> {
    pub(super) fn open(input: &Input<'a>) -> Result<Self, InputError> {
        let io = |cause| InputError::io(input.label, cause);
        // It is read piece by piece, whatever its size.
        let local = Input { max_bytes: u64::MAX, ..*input }.on_disk()?;
        let file = File::open(&local.path).map_err(io)?;
        let size_bytes = file.metadata().map_err(io)?.len();
        Ok(Self {
            label: input.label,
            max_bytes: input.max_bytes,
            file: BufReader::with_capacity(1 << 16, file),
            size_bytes,
            _local: local,
            blobs: Vec::new(),
            extent: None,
            decoder: BlockDecoder::default(),
            packed: Vec::new(),
            unpacked: Vec::new(),
        })
    }

    fn damaged(&self, byte: u64, what: &str) -> InputError {
        InputError::damaged(self.label, format!("byte {byte}"), what)
    }

    /// Reads all blobs in the order of the file, and stores their offsets.
    fn read_first(&mut self, sink: &mut dyn ObjectSink, visit: &mut Visit<'_>) -> Result<(), InputError> {
        self.blobs.clear();
        let (mut start, mut unpacked_bytes, mut has_header) = (0_u64, 0_u64, false);
        while start < self.size_bytes {
            let (kind, place) = self.read_blob_header(start)?;
            start = place.start + u64::from(place.size_bytes);
            match kind {
                BlobKind::Header => {
                    self.unpack(&place)?;
                    self.read_header(&place)?;
                    has_header = true;
                }
                BlobKind::Data if !has_header => return Err(self.damaged(place.start, "the file has no header")),
                BlobKind::Data => {
                    self.unpack(&place)?;
                    let wanted =
                        Wanted { nodes: true, node_tags: true, ways: 0..u64::MAX, way_nodes: false, relations: true };
                    let way = self.blobs.last().map_or(0, |blob| blob.content.ways[1]);
                    let (content, _) = self.visit_block(place.start, way, &wanted, sink, visit)?;
                    self.blobs.push(BlobPlace { content, ..place });
                }
                BlobKind::Other => {}
            }
            unpacked_bytes += self.unpacked.len() as u64;
            let too_large = |what: &str, limit: u64| {
                Err(InputError::TooLarge { path: self.label.to_owned(), what: what.to_owned(), limit })
            };
            if unpacked_bytes > self.max_bytes {
                return too_large("its unpacked size in bytes", self.max_bytes);
            }
            if self.blobs.len() > MAX_BLOBS {
                return too_large("the number of its blobs", MAX_BLOBS as u64);
            }
            sink.tick(start / 2);
        }
        if has_header { Ok(()) } else { Err(self.damaged(0, "the file has no header")) }
    }

    fn read_blob_header(&mut self, start: u64) -> Result<(BlobKind, BlobPlace), InputError> {
        let fault = |file: &Self| file.damaged(start, "no valid header of a blob");
        let mut size = [0; 4];
        self.read_at(start, &mut size)?;
        let size = u32::from_be_bytes(size);
        if size > MAX_BLOB_HEADER_BYTES {
            return Err(fault(self));
        }
        let mut header = vec![0; size as usize];
        self.read_at(start + 4, &mut header)?;
        let (mut kind, mut blob_bytes) = (BlobKind::Other, None);
        let read = fields(&header, |number, value| {
            match number {
                1 => kind = BlobKind::by_name(value.bytes()?),
                3 => blob_bytes = Some(value.number()?),
                _ => {}
            }
            Ok(())
        });
        let start = start + 4 + u64::from(size);
        let blob_bytes =
            blob_bytes.filter(|bytes| read.is_ok() && *bytes <= MAX_BLOB_BYTES).ok_or_else(|| fault(self))?;
        if blob_bytes > self.size_bytes.saturating_sub(start) {
            return Err(self.damaged(start, "the file ends within a blob"));
        }
        Ok((kind, BlobPlace { start, size_bytes: blob_bytes as u32, content: BlockContent::default() }))
    }

    fn read_at(&mut self, start: u64, buffer: &mut [u8]) -> Result<(), InputError> {
        let position = self.file.stream_position();
        let moved = position.and_then(|position| match start.checked_signed_diff(position) {
            Some(0) => Ok(()),
            Some(step) => self.file.seek_relative(step),
            None => self.file.seek(SeekFrom::Start(start)).map(|_| ()),
        });
        match moved.and_then(|()| self.file.read_exact(buffer)) {
            Err(cause) if cause.kind() == std::io::ErrorKind::UnexpectedEof => {
                Err(self.damaged(start, "the file ends within a blob"))
            }
            read => read.map_err(|cause| InputError::io(self.label, cause)),
        }
    }

    fn unpack(&mut self, place: &BlobPlace) -> Result<(), InputError> {
        let mut packed = std::mem::take(&mut self.packed);
        packed.resize(place.size_bytes as usize, 0);
        let read = self.read_at(place.start, &mut packed);
        let unpacked = read.and_then(|()| {
            unpack_blob(&packed, &mut self.unpacked).map_err(|fault| match fault {
                UnpackFault::Damaged => self.damaged(place.start, "a blob cannot be unpacked"),
                UnpackFault::Compression(name) => InputError::unsupported(
                    self.label,
                    format!("PBF blobs packed with {name} are not read; write the file again with zlib"),
                ),
            })
        });
        self.packed = packed;
        unpacked
    }

    /// Checks the features that the unpacked header requires, and notes its extent.
    fn read_header(&mut self, place: &BlobPlace) -> Result<(), InputError> {
        let (mut unknown, mut extent) = (None, None);
        let read = fields(&self.unpacked, |number, value| {
            if number == 1 {
                // West, east, north, south.
                let mut sides = [None; 4];
                fields(value.bytes()?, |side, value| {
                    if let Some(place) = (side as usize).checked_sub(1).and_then(|side| sides.get_mut(side)) {
                        *place = Some(zigzag(value.number()?) / NANODEGREES);
                    }
                    Ok(())
                })?;
                if let [Some(west), Some(east), Some(north), Some(south)] = sides {
                    extent = position(west, south).zip(position(east, north));
                }
            } else if number == 4 {
                let feature = value.bytes()?;
                if !FEATURES.contains(&feature) {
                    unknown = Some(String::from_utf8_lossy(feature).chars().take(64).collect::<String>());
                }
            }
            Ok(())
        });
        self.extent = extent.map(Into::into);
        if unknown.as_deref() == Some("HistoricalInformation") {
            return Err(of_history(self.label, "it needs HistoricalInformation"));
        }
        if let Some(feature) = unknown {
            return Err(InputError::unsupported(self.label, format!("a PBF file that needs {feature}")));
        }
        read.map_err(|WireFault| self.damaged(place.start, "the header is damaged"))
    }

    /// Visits the elements of the unpacked block, whose first way has the number `first_way`. Returns its content, and whether the visitor ended.
    fn visit_block(
        &mut self,
        start: u64,
        first_way: u64,
        wanted: &Wanted,
        sink: &mut dyn ObjectSink,
        visit: &mut Visit<'_>,
    ) -> Result<(BlockContent, bool), InputError> {
        let content = BlockContent { ways: [first_way; 2], ..BlockContent::default() };
        let mut visitor = Visitor { sink, visit, wanted, content, is_ended: false };
        let unpacked = std::mem::take(&mut self.unpacked);
        let decoded = self.decoder.decode(&unpacked, &mut visitor);
        self.unpacked = unpacked;
        match decoded {
            Ok(()) => Ok((visitor.content, visitor.is_ended)),
            Err(BlockFault::Visit(error)) => Err(error),
            Err(BlockFault::Wire) => Err(self.damaged(start, "a block of elements is damaged")),
        }
    }
}

impl ElementFile for PbfFile<'_> {
    fn read_through(
        &mut self,
        pass: Pass<'_>,
        sink: &mut dyn ObjectSink,
        visit: &mut Visit<'_>,
    ) -> Result<(), InputError> {
        let wanted = match &pass {
            Pass::First => return self.read_first(sink, visit),
            Pass::Ways(ways) => Wanted { ways: ways.clone(), ..Wanted::default() },
            Pass::Nodes(_) => Wanted { nodes: true, way_nodes: true, ..Wanted::default() },
        };
        for i in 0..self.blobs.len() {
            let place = self.blobs[i];
            let [first_way, end_way] = place.content.ways;
            let is_wanted = match pass {
                Pass::Nodes(is_needed) => {
                    place.content.has_way_nodes
                        || place.content.nodes.is_some_and(|(first, last)| is_needed(first, last))
                }
                _ => wanted.ways.start < end_way && first_way < wanted.ways.end,
            };
            if !is_wanted || first_way == end_way && !wanted.nodes {
                continue;
            }
            self.unpack(&place)?;
            let (_, is_ended) = self.visit_block(place.start, first_way, &wanted, sink, visit)?;
            if is_ended {
                break;
            }
        }
        Ok(())
    }

    fn extent(&self) -> Option<[Position; 2]> {
        self.extent
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum BlobKind {
    Header,
    Data,
    /// Of an extension.
    Other,
}

impl BlobKind {
    fn by_name(name: &[u8]) -> Self {
        match name {
            b"OSMHeader" => Self::Header,
            b"OSMData" => Self::Data,
            _ => Self::Other,
        }
    }
}

enum UnpackFault {
    Damaged,
    Compression(&'static str),
}

fn unpack_blob(blob: &[u8], unpacked: &mut Vec<u8>) -> Result<(), UnpackFault> {
    let (mut raw, mut zlib, mut raw_bytes, mut other) = (None, None, None, None);
    let read = fields(blob, |number, value| {
        match number {
            1 => raw = Some(value.bytes()?),
            2 => raw_bytes = Some(value.number()?),
            3 => zlib = Some(value.bytes()?),
            4 => other = Some("LZMA"),
            5 => other = Some("bzip2"),
            6 => other = Some("LZ4"),
            7 => other = Some("Zstandard"),
            _ => {}
        }
        Ok(())
    });
    unpacked.clear();
    match (read, raw, zlib, other) {
        (Err(WireFault), ..) | (Ok(()), None, None, None) => Err(UnpackFault::Damaged),
        (_, Some(raw), ..) => {
            unpacked.extend_from_slice(raw);
            Ok(())
        }
        (_, None, Some(zlib), _) => {
            let raw_bytes = raw_bytes.filter(|bytes| *bytes <= MAX_BLOB_BYTES).ok_or(UnpackFault::Damaged)?;
            let read = ZlibDecoder::new(zlib).take(raw_bytes + 1).read_to_end(unpacked);
            if read.is_ok_and(|read| read as u64 == raw_bytes) { Ok(()) } else { Err(UnpackFault::Damaged) }
        }
        (_, None, None, Some(name)) => Err(UnpackFault::Compression(name)),
    }
}
