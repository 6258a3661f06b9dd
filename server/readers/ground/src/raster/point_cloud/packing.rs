//! Unpacks the points of LAZ files, with the decoder of the `laz` crate.
//!
//! The decoder panics on some damaged files; that ends the reading with an error like any other damage.

use super::super::error::RasterError;
use laz::record::{LayeredPointRecordDecompressor, RecordDecompressor, SequentialPointRecordDecompressor};
use laz::{DecompressionSelection, LasZipError, LazItem, LazItemType};
use std::io::{Cursor, Read};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Layers of the fields that all points of the formats 6 to 10 have.
const POINT_LAYERS: usize = 9;

/// How points are packed.
pub(super) enum Packing {
    None,
    /// Point by point, with these groups of fields.
    Sequential(Vec<LazItem>),
    /// The values of each field together.
    Layered(Vec<LazItem>),
}

impl Packing {
    /// Fails if the fields are not those of points with `record_bytes`.
    pub(super) fn new(items: &[LazItem], record_bytes: usize) -> Result<Self, RasterError> {
        let has_own_size = |item: &LazItem| bytes_of(item.item_type()) == item.size();
        let item_bytes: usize = items.iter().map(|item| usize::from(item.size())).sum();
        if item_bytes != record_bytes || !items.iter().all(has_own_size) {
            return Err(RasterError::damaged("its points have another size than its packed points"));
        }
        match items.first().map(LazItem::item_type) {
            Some(LazItemType::Point10) => Ok(Self::Sequential(items.to_vec())),
            Some(LazItemType::Point14) => Ok(Self::Layered(items.to_vec())),
            _ => Err(RasterError::damaged("its packed points do not start with a place")),
        }
    }

    /// Calls `each` for the records of a chunk. Fails if the chunk is damaged.
    pub(super) fn unpack(
        &self,
        bytes: &[u8],
        points: u64,
        record_bytes: usize,
        each: &mut dyn FnMut(&[u8]),
    ) -> Result<(), RasterError> {
        match self {
            Self::None => bytes.chunks_exact(record_bytes).for_each(each),
            Self::Sequential(items) => unpack_sequential(items, bytes, points, record_bytes, each)?,
            Self::Layered(items) => {
                check_layers(items, bytes, record_bytes)?;
                // Other fields than these are not unpacked.
                let wanted = DecompressionSelection::base().decompress_z();
                let wanted = wanted.decompress_classification().decompress_flags();
                guarded(|| {
                    let mut decoder = LayeredPointRecordDecompressor::new(Cursor::new(bytes));
                    decoder.set_fields_from(items)?;
                    decoder.set_selection(wanted);
                    read_records(&mut decoder, points, record_bytes, each)
                })?;
            }
        }
        Ok(())
    }
}

/// Calls `each` for the records of a chunk that is packed point by point.
pub(super) fn unpack_sequential<R: Read>(
    items: &Vec<LazItem>,
    input: R,
    points: u64,
    record_bytes: usize,
    each: &mut dyn FnMut(&[u8]),
) -> Result<(), RasterError> {
    guarded(|| {
        let mut decoder = SequentialPointRecordDecompressor::new(input);
        decoder.set_fields_from(items)?;
        read_records(&mut decoder, points, record_bytes, each)
    })
}

fn read_records<R>(
    decoder: &mut dyn RecordDecompressor<R>,
    points: u64,
    record_bytes: usize,
    each: &mut dyn FnMut(&[u8]),
) -> Result<(), LasZipError> {
    let mut record = vec![0; record_bytes];
    for _ in 0..points {
        decoder.decompress_next(&mut record)?;
        each(&record);
    }
    Ok(())
}

/// Checks that the layers of a chunk are within it, because the decoder takes memory for them before it reads them. A
/// chunk has its first record, the number of records, the size of each layer, and the layers.
fn check_layers(items: &[LazItem], bytes: &[u8], record_bytes: usize) -> Result<(), RasterError> {
    let ends_early = || RasterError::damaged("one of its chunks ends early");
    let layers: usize = items.iter().map(layers_of).sum();
    let sizes = bytes.get(record_bytes + 4..).ok_or_else(ends_early)?;
    let (sizes, rest) = sizes.split_at_checked(layers * 4).ok_or_else(ends_early)?;
    let total: u64 = sizes.as_chunks().0.iter().map(|size| u64::from(u32::from_le_bytes(*size))).sum();
    if total > rest.len() as u64 { Err(ends_early()) } else { Ok(()) }
}

/// Bytes of a group of fields in an unpacked point.
fn bytes_of(item: LazItemType) -> u16 {
    match item {
        LazItemType::Byte(count) | LazItemType::Byte14(count) => count,
        LazItemType::Point10 => 20,
        LazItemType::GpsTime | LazItemType::RGBNIR14 => 8,
        LazItemType::RGB12 | LazItemType::RGB14 => 6,
        LazItemType::WavePacket13 | LazItemType::WavePacket14 => 29,
        LazItemType::Point14 => 30,
    }
}

fn layers_of(item: &LazItem) -> usize {
    match item.item_type() {
        LazItemType::Point14 => POINT_LAYERS,
        LazItemType::RGBNIR14 => 2,
        LazItemType::Byte14(count) => usize::from(count),
        _ => 1,
    }
}

/// Runs the decoder. Its panics are errors.
pub(super) fn guarded<T>(decode: impl FnOnce() -> Result<T, LasZipError>) -> Result<T, RasterError> {
    match catch_unwind(AssertUnwindSafe(decode)) {
        Ok(result) => result.map_err(fault),
        Err(_) => Err(RasterError::damaged("its packed points cannot be unpacked")),
    }
}

pub(super) fn fault(error: LasZipError) -> RasterError {
    match error {
        LasZipError::IoError(error) => error.into(),
        error @ (LasZipError::UnsupportedLazItemVersion(..) | LasZipError::UnsupportedPointFormat(_)) => {
            RasterError::unsupported(format!("packed points that are not known ({error})"))
        }
        error => RasterError::damaged(error.to_string()),
    }
}
