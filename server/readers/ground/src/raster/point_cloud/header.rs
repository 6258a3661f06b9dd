//! The header of a LAS file (ASPRS LAS 1.0 to 1.5).

use super::super::error::RasterError;
use super::super::source::Source;

pub(super) const SIGNATURE: &[u8] = b"LASF";
/// Of versions up to 1.2, and of versions from 1.4 on.
const HEADER_BYTES: [u64; 2] = [227, 375];
/// Bytes of the records of each format, without extra ones.
const FORMAT_BYTES: [u16; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];
/// The first format with more classes and returns.
const FIRST_EXTENDED: u8 = 6;
/// Records with more bytes are refused: the decoder of packed files takes memory for each.
const MAX_RECORD_BYTES: u16 = 1 << 11;
/// Larger coordinates are taken for damage.
const MAX_COORDINATE: f64 = 1e12;
const WKT_FLAG: u16 = 1 << 4;

/// What is used of a header.
pub(super) struct Header {
    pub(super) records: RecordPlaces,
    /// The coordinate system is in well-known text.
    pub(super) has_wkt: bool,
    /// Points are packed (LAZ).
    pub(super) is_packed: bool,
    /// Records have the fields of the formats 6 to 10.
    pub(super) is_extended: bool,
    /// Where points start in the file.
    pub(super) points_offset: u64,
    pub(super) record_bytes: u16,
    pub(super) points: u64,
    pub(super) scaling: Scaling,
    /// Lowest and highest x and y.
    pub(super) bounds: [[f64; 2]; 2],
}

/// Where variable-length records are in the file.
pub(super) struct RecordPlaces {
    /// Of the first record before the points.
    pub(super) offset: u64,
    pub(super) count: u32,
    /// Of the first record behind the points, and their number.
    pub(super) extended: Option<(u64, u32)>,
}

/// Coordinates of the whole numbers in the file: `number * scale + offset`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scaling {
    pub(super) scale: [f64; 3],
    pub(super) offset: [f64; 3],
}

impl Scaling {
    pub(super) fn coordinate(&self, axis: usize, number: f64) -> f64 {
        number * self.scale[axis] + self.offset[axis]
    }

    /// x and y of a point.
    pub(super) fn position(&self, numbers: [i32; 3]) -> [f64; 2] {
        [0, 1].map(|axis| self.coordinate(axis, f64::from(numbers[axis])))
    }
}

impl Header {
    /// Fails if the header is damaged, or of a version or with points that are not known.
    pub(super) fn read(source: &mut Source) -> Result<Self, RasterError> {
        let bytes = Fields(source.start(HEADER_BYTES[1])?);
        if !bytes.0.starts_with(SIGNATURE) {
            return Err(RasterError::NotThisFormat);
        }
        let [major, minor] = bytes.take(24)?;
        if major != 1 || minor > 5 {
            return Err(RasterError::unsupported(format!("version {major}.{minor} of LAS")));
        }
        let has_large_counts = minor >= 4;
        let (header_bytes, points_offset) = (u64::from(bytes.u16(94)?), u64::from(bytes.u32(96)?));
        let needed = HEADER_BYTES[usize::from(has_large_counts)];
        if header_bytes < needed || points_offset < header_bytes || points_offset > source.len() {
            return Err(RasterError::damaged("its points are not behind its header"));
        }
        let [format] = bytes.take(104)?;
        // Packed files have one of the two highest bits.
        let (is_packed, format) = (format & 0xc0 != 0, format & 0x3f);
        let record_bytes = bytes.u16(105)?;
        let Some(least) = FORMAT_BYTES.get(usize::from(format)) else {
            return Err(RasterError::unsupported(format!("points of format {format}")));
        };
        if record_bytes < *least {
            return Err(RasterError::damaged("its records of points are too short"));
        }
        if record_bytes > MAX_RECORD_BYTES {
            return Err(RasterError::TooLarge { what: "a record of a point", limit: u64::from(MAX_RECORD_BYTES) });
        }
        let points = match has_large_counts {
            true => Some(bytes.u64(247)?).filter(|count| *count > 0),
            false => None,
        };
        let extended = match has_large_counts {
            true => Some((bytes.u64(235)?, bytes.u32(243)?)).filter(|(_, count)| *count > 0),
            false => None,
        };
        Ok(Self {
            records: RecordPlaces { offset: header_bytes, count: bytes.u32(100)?, extended },
            has_wkt: bytes.u16(6)? & WKT_FLAG != 0 || format >= FIRST_EXTENDED,
            is_packed,
            is_extended: format >= FIRST_EXTENDED,
            points_offset,
            record_bytes,
            points: points.unwrap_or(u64::from(bytes.u32(107)?)),
            scaling: bytes.scaling()?,
            bounds: bytes.bounds()?,
        })
    }
}

/// Bytes of a header.
struct Fields(Vec<u8>);

impl Fields {
    fn take<const N: usize>(&self, offset: usize) -> Result<[u8; N], RasterError> {
        let bytes = self.0.get(offset..).and_then(<[u8]>::first_chunk);
        bytes.copied().ok_or_else(|| RasterError::damaged("its header ends early"))
    }

    fn u16(&self, offset: usize) -> Result<u16, RasterError> {
        self.take(offset).map(u16::from_le_bytes)
    }

    fn u32(&self, offset: usize) -> Result<u32, RasterError> {
        self.take(offset).map(u32::from_le_bytes)
    }

    fn u64(&self, offset: usize) -> Result<u64, RasterError> {
        self.take(offset).map(u64::from_le_bytes)
    }

    fn f64(&self, offset: usize) -> Result<f64, RasterError> {
        self.take(offset).map(f64::from_le_bytes)
    }

    fn f64s(&self, offset: usize) -> Result<[f64; 3], RasterError> {
        Ok([self.f64(offset)?, self.f64(offset + 8)?, self.f64(offset + 16)?])
    }

    fn scaling(&self) -> Result<Scaling, RasterError> {
        let scaling = Scaling { scale: self.f64s(131)?, offset: self.f64s(155)? };
        let is_valid = (0..3).all(|axis| {
            let ends = [i32::MIN, i32::MAX].map(|number| scaling.coordinate(axis, f64::from(number)));
            scaling.scale[axis] > 0.0 && ends.iter().all(|end| end.abs() <= MAX_COORDINATE)
        });
        if !is_valid {
            return Err(RasterError::damaged("the scale or the offset of its coordinates is invalid"));
        }
        Ok(scaling)
    }

    /// The header has the highest and the lowest x, then y.
    fn bounds(&self) -> Result<[[f64; 2]; 2], RasterError> {
        let (low, high) = ([self.f64(187)?, self.f64(203)?], [self.f64(179)?, self.f64(195)?]);
        let is_valid = (0..2).all(|axis| {
            let is_near = low[axis].abs() <= MAX_COORDINATE && high[axis].abs() <= MAX_COORDINATE;
            is_near && low[axis] <= high[axis]
        });
        if !is_valid {
            return Err(RasterError::damaged("the bounds in its header are invalid"));
        }
        Ok([low, high])
    }
}
