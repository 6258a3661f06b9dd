//! Unpacks tiles and strips.

use super::super::error::RasterError;
use flate2::read::ZlibDecoder;
use std::io::Read;
use weezl::decode::Configuration;
use weezl::{BitOrder, LzwStatus};

pub(super) const NOT_COMPRESSED: u64 = 1;
const LZW: u64 = 5;
pub(super) const JPEG: u64 = 7;
const DEFLATE: u64 = 8;
const OLD_DEFLATE: u64 = 32946;
const PACK_BITS: u64 = 32773;
const ZSTD: u64 = 50000;
pub(super) const WEBP: u64 = 50001;
/// What to do with a file of another compression.
const REWRITE: &str = "gdal_translate -co COMPRESS=DEFLATE IN OUT makes a file that is read";

/// Unpacks the first `size` bytes of a chunk. Fails if there are fewer. Memory grows with what is there, not with what
/// the file says.
pub(super) fn unpack(compression: u64, packed: Vec<u8>, size: usize) -> Result<Vec<u8>, RasterError> {
    let mut bytes = match compression {
        NOT_COMPRESSED => packed,
        LZW => lzw(&packed, size)?,
        DEFLATE | OLD_DEFLATE => all_of(ZlibDecoder::new(&packed[..]), size)?,
        ZSTD => all_of(zstd::Decoder::with_buffer(&packed[..])?, size)?,
        PACK_BITS => pack_bits(&packed, size),
        _ => return Err(RasterError::unsupported(name(compression))),
    };
    if bytes.len() < size {
        return Err(RasterError::damaged("a tile or strip has too few bytes"));
    }
    bytes.truncate(size);
    Ok(bytes)
}

fn all_of(reader: impl Read, size: usize) -> Result<Vec<u8>, RasterError> {
    let mut bytes = Vec::new();
    let read = reader.take(size as u64).read_to_end(&mut bytes);
    read.map_err(|error| RasterError::damaged(format!("a tile or strip cannot be unpacked: {error}")))?;
    Ok(bytes)
}

fn lzw(mut packed: &[u8], size: usize) -> Result<Vec<u8>, RasterError> {
    let configuration = Configuration::with_tiff_size_switch(BitOrder::Msb, 8).with_yield_on_full_buffer(true);
    let (mut decoder, mut bytes, mut buffer) = (configuration.build(), Vec::new(), vec![0; 1 << 14]);
    while bytes.len() < size {
        let result = decoder.decode_bytes(packed, &mut buffer);
        packed = &packed[result.consumed_in..];
        bytes.extend_from_slice(&buffer[..result.consumed_out]);
        match result.status {
            Ok(LzwStatus::Ok) => {}
            Ok(LzwStatus::Done | LzwStatus::NoProgress) => break,
            Err(error) => {
                return Err(RasterError::damaged(format!("a tile or strip cannot be unpacked: {error}")));
            }
        }
    }
    Ok(bytes)
}

/// Runs of equal bytes, and runs of different ones.
fn pack_bits(mut packed: &[u8], size: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    while let [control, rest @ ..] = packed
        && bytes.len() < size
    {
        let count = usize::from(*control);
        packed = match (count, rest) {
            (0..=127, _) => {
                let (different, rest) = rest.split_at(rest.len().min(count + 1));
                bytes.extend_from_slice(different);
                rest
            }
            (129.., [repeated, rest @ ..]) => {
                bytes.resize(bytes.len() + 257 - count, *repeated);
                rest
            }
            _ => rest,
        };
    }
    bytes
}

fn name(compression: u64) -> String {
    let name = match compression {
        2..=4 => "fax",
        6 => "old JPEG",
        34712 => "JPEG 2000",
        34887 => "LERC",
        34925 => "LZMA",
        50002 | 52546 => "JPEG XL",
        _ => return format!("compression {compression} ({REWRITE})"),
    };
    format!("{name} compression ({REWRITE})")
}
