//! Well-known binary in all dialects: ISO (types + 1000, 2000, 3000), EWKB of PostGIS (flags and SRID), both byte orders.

use super::geometry::{Geometry, MALFORMED, MAX_DEPTH, Polygon, Ring, TOO_DEEP, UNKNOWN_TYPE, is_same_place};
use insula_source::arc::divide_arcs;

const FLAG_Z: u32 = 0x8000_0000;
const FLAG_M: u32 = 0x4000_0000;
const FLAG_SRID: u32 = 0x2000_0000;
/// A nested geometry is at least its byte order and its type.
const MIN_GEOMETRY_BYTES: usize = 5;

/// Reads a geometry. Returns its SRID if it names one. Fails with the reason for skipping the feature.
pub(super) fn parse(bytes: &[u8], geometry: &mut Geometry) -> Result<Option<u32>, &'static str> {
    let mut reader = WkbReader { bytes, is_big_endian: false, srid: None };
    reader.geometry(geometry, 0)?;
    geometry.level_without_heights();
    Ok(reader.srid)
}

/// Reads a geometry written as hexadecimal digits, as PostGIS prints it; `None` if the text is something else.
pub(super) fn bytes_of_hex(text: &str) -> Option<Vec<u8>> {
    let text = text.trim().as_bytes();
    let is_header = text.len() >= 10 && text.len().is_multiple_of(2) && matches!(&text[..2], b"00" | b"01");
    let digit = |byte: u8| char::from(byte).to_digit(16);
    let byte = |pair: &[u8]| Some((digit(*pair.first()?)? << 4 | digit(*pair.get(1)?)?) as u8);
    if is_header { text.chunks(2).map(byte).collect() } else { None }
}

struct WkbReader<'a> {
    /// What is not yet read.
    bytes: &'a [u8],
    is_big_endian: bool,
    srid: Option<u32>,
}

/// Type of a geometry without its dimensions, and the numbers of each position.
#[derive(Clone, Copy)]
struct GeometryHeader {
    kind: u32,
    has_z: bool,
    has_m: bool,
}

impl GeometryHeader {
    fn position_bytes(self) -> usize {
        (2 + usize::from(self.has_z) + usize::from(self.has_m)) * 8
    }
}

impl WkbReader<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], &'static str> {
        let (taken, rest) = self.bytes.split_first_chunk::<N>().ok_or(MALFORMED)?;
        self.bytes = rest;
        Ok(*taken)
    }

    fn u32(&mut self) -> Result<u32, &'static str> {
        let bytes = self.take()?;
        Ok(if self.is_big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    fn f64(&mut self) -> Result<f64, &'static str> {
        let bytes = self.take()?;
        Ok(if self.is_big_endian { f64::from_be_bytes(bytes) } else { f64::from_le_bytes(bytes) })
    }

    /// A number of items of at least `item_bytes` each, which the rest of the bytes can hold.
    fn count(&mut self, item_bytes: usize) -> Result<usize, &'static str> {
        let count = self.u32()? as usize;
        if count > self.bytes.len() / item_bytes { Err(MALFORMED) } else { Ok(count) }
    }

    fn header(&mut self) -> Result<GeometryHeader, &'static str> {
        self.is_big_endian = match self.take::<1>()? {
            [0] => true,
            [1] => false,
            _ => return Err(MALFORMED),
        };
        let code = self.u32()?;
        if code & FLAG_SRID != 0 {
            let srid = self.u32()?;
            self.srid.get_or_insert(srid);
        }
        let iso = code & !(FLAG_Z | FLAG_M | FLAG_SRID);
        let (dimensions, kind) = (iso / 1000, iso % 1000);
        if dimensions > 3 {
            return Err(UNKNOWN_TYPE);
        }
        let has_z = code & FLAG_Z != 0 || dimensions == 1 || dimensions == 3;
        Ok(GeometryHeader { kind, has_z, has_m: code & FLAG_M != 0 || dimensions >= 2 })
    }

    fn position(&mut self, header: GeometryHeader) -> Result<[f64; 3], &'static str> {
        let (x, y) = (self.f64()?, self.f64()?);
        let z = if header.has_z { self.f64()? } else { f64::NAN };
        if header.has_m {
            self.f64()?;
        }
        Ok([x, y, z])
    }

    fn line(&mut self, header: GeometryHeader) -> Result<Ring, &'static str> {
        let count = self.count(header.position_bytes())?;
        (0..count).map(|_| self.position(header)).collect()
    }

    fn polygon(&mut self, header: GeometryHeader) -> Result<Polygon, &'static str> {
        let count = self.count(4)?;
        (0..count).map(|_| self.line(header)).collect()
    }

    /// A line of a compound curve or ring of a curve polygon: with its own header.
    fn curve(&mut self, depth: u32) -> Result<Ring, &'static str> {
        if depth > MAX_DEPTH {
            return Err(TOO_DEEP);
        }
        let header = self.header()?;
        match header.kind {
            2 => self.line(header),
            8 => Ok(divide_arcs(&self.line(header)?)),
            9 => self.compound_curve(depth),
            _ => Err(UNKNOWN_TYPE),
        }
    }

    fn compound_curve(&mut self, depth: u32) -> Result<Ring, &'static str> {
        let mut line = Ring::new();
        for _ in 0..self.count(MIN_GEOMETRY_BYTES)? {
            let part = self.curve(depth + 1)?;
            let shared = usize::from(is_same_place(line.last(), part.first()));
            line.extend(part.into_iter().skip(shared));
        }
        Ok(line)
    }

    fn geometry(&mut self, geometry: &mut Geometry, depth: u32) -> Result<(), &'static str> {
        if depth > MAX_DEPTH {
            return Err(TOO_DEEP);
        }
        let header = self.header()?;
        geometry.has_z |= header.has_z;
        match header.kind {
            1 => {
                let point = self.position(header)?;
                geometry.push_point(point);
            }
            2 => geometry.push_line(self.line(header)?),
            3 | 17 => geometry.push_polygon(self.polygon(header)?),
            8 => geometry.push_line(divide_arcs(&self.line(header)?)),
            9 => geometry.push_line(self.compound_curve(depth)?),
            10 => {
                let count = self.count(MIN_GEOMETRY_BYTES)?;
                let rings: Result<Polygon, _> = (0..count).map(|_| self.curve(depth + 1)).collect();
                geometry.push_polygon(rings?);
            }
            4..=7 | 11 | 12 | 15 | 16 => {
                geometry.is_surface |= header.kind >= 15;
                for _ in 0..self.count(MIN_GEOMETRY_BYTES)? {
                    self.geometry(geometry, depth + 1)?;
                }
            }
            _ => return Err(UNKNOWN_TYPE),
        }
        Ok(())
    }
}
