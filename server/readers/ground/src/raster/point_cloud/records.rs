//! Variable-length records: the coordinate system, and how points are packed.

use super::super::error::RasterError;
use super::super::geo_keys::{GEO_KEYS, GEO_REALS, GEO_TEXTS, GeoKeys};
use super::super::source::Source;
use super::header::Header;

/// Bytes of the header of a record before the points, and of one behind them.
const HEADER_BYTES: [u64; 2] = [54, 60];
/// Further records are not looked at.
const MAX_RECORDS: u32 = 10_000;
/// Longer records are not read: systems of coordinates need a few kilobytes.
const MAX_RECORD_BYTES: u64 = 1 << 18;
const PROJECTION: &[u8] = b"LASF_Projection";
const PACKING: &[u8] = b"laszip encoded";
const WKT_RECORD: u16 = 2112;
const PACKING_RECORD: u16 = 22204;

/// The contents of the records that are used.
#[derive(Default)]
pub(super) struct Records {
    /// The coordinate system in well-known text.
    pub(super) wkt: Option<String>,
    pub(super) geo_keys: Option<GeoKeys>,
    /// How points are packed, as LASzip describes it.
    pub(super) packing: Option<Vec<u8>>,
}

impl Records {
    /// Reads the wanted records. Those whose length is invalid end the search, since the points can be read without
    /// them.
    pub(super) fn read(source: &mut Source, header: &Header) -> Result<Self, RasterError> {
        let mut records = Self::default();
        let places = &header.records;
        records.read_list(source, [places.offset, header.points_offset], places.count, false)?;
        if let Some((offset, count)) = places.extended.filter(|(offset, _)| *offset >= header.points_offset) {
            let end = source.len();
            records.read_list(source, [offset, end], count, true)?;
        }
        Ok(records)
    }

    /// Reads up to `count` records between two offsets.
    fn read_list(
        &mut self,
        source: &mut Source,
        [mut offset, end]: [u64; 2],
        count: u32,
        is_extended: bool,
    ) -> Result<(), RasterError> {
        let header_bytes = HEADER_BYTES[usize::from(is_extended)];
        for _ in 0..count.min(MAX_RECORDS) {
            if end.saturating_sub(offset) < header_bytes {
                break;
            }
            let header = source.read_at(offset, header_bytes)?;
            offset += header_bytes;
            let Some((user, id, length)) = parse_header(&header, is_extended) else { break };
            if length > end - offset {
                break;
            }
            let is_wanted = user == PROJECTION || user == PACKING;
            if is_wanted && length <= MAX_RECORD_BYTES {
                let bytes = source.read_at(offset, length)?;
                self.take(user, id, bytes);
            }
            offset += length;
        }
        Ok(())
    }

    /// Keeps the first record of each kind.
    fn take(&mut self, user: &[u8], id: u16, bytes: Vec<u8>) {
        if user == PACKING {
            if id == PACKING_RECORD {
                self.packing.get_or_insert(bytes);
            }
            return;
        }
        match id {
            WKT_RECORD => {
                let text = String::from_utf8_lossy(&bytes);
                let text = text.trim_matches(|c: char| c == '\0' || c.is_whitespace());
                // Some writers have only quotes there.
                if text.contains(['[', '(']) {
                    self.wkt.get_or_insert_with(|| text.to_owned());
                }
            }
            GEO_KEYS => {
                let keys = bytes.as_chunks().0.iter().map(|bytes| u64::from(u16::from_le_bytes(*bytes)));
                self.geo_keys().keys = keys.collect();
            }
            GEO_REALS => {
                self.geo_keys().reals = bytes.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
            }
            GEO_TEXTS => self.geo_keys().texts = bytes,
            _ => {}
        }
    }

    fn geo_keys(&mut self) -> &mut GeoKeys {
        self.geo_keys.get_or_insert_default()
    }
}

/// The name of the user, the number and the length of a record: two unused bytes, 16 for the name, 2 for the number,
/// 2 or 8 for the length, and a text.
fn parse_header(header: &[u8], is_extended: bool) -> Option<(&[u8], u16, u64)> {
    let user = header.get(2..18)?;
    let user = user.split(|byte| *byte == 0).next()?;
    let id = u16::from_le_bytes(*header.get(18..)?.first_chunk()?);
    let length = match is_extended {
        true => u64::from_le_bytes(*header.get(20..)?.first_chunk()?),
        false => u64::from(u16::from_le_bytes(*header.get(20..)?.first_chunk()?)),
    };
    Some((user, id, length))
}
