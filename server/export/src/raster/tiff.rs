//! Writes a tiled TIFF of one float32 band (TIFF 6.0; BigTIFF above 3.5 GB before compression), tile by tile.
//!
//! The crate `tiff` writes strips only. Tiles are packed by Deflate after the floating-point predictor (Adobe Photoshop TIFF Technical
//! Note 3). The directory is at the end, so that nothing but the position of each tile stays in memory.

use flate2::Compression;
use flate2::write::ZlibEncoder;
use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};

/// Side of a tile in cells.
pub(super) const TILE: u32 = 256;
/// Larger rasters are BigTIFF, whose offsets have 64 bits.
const MAX_CLASSIC_BYTES: u64 = 3_500_000_000;

/// What the directory says of the raster.
pub(super) struct TiffSetup<'a> {
    /// Columns and rows.
    pub(super) size: [u32; 2],
    /// World metres.
    pub(super) north_west: [f64; 2],
    pub(super) cell_m: f64,
    pub(super) nodata: f32,
    /// Codes of the projected and of the vertical system.
    pub(super) epsg: Option<u32>,
    pub(super) vertical_epsg: Option<u32>,
    pub(super) title: &'a str,
    pub(super) attribution: &'a str,
}

pub(super) struct TiffWriter {
    out: BufWriter<File>,
    is_big: bool,
    offset: u64,
    offsets: Vec<u64>,
    sizes: Vec<u64>,
}

impl TiffWriter {
    pub(super) fn new(file: File, setup: &TiffSetup<'_>) -> io::Result<Self> {
        let tiles = setup.size.map(|side| u64::from(side.div_ceil(TILE)));
        let is_big = tiles[0] * tiles[1] * u64::from(TILE * TILE * 4) > MAX_CLASSIC_BYTES;
        let mut writer = Self { out: BufWriter::new(file), is_big, offset: 0, offsets: Vec::new(), sizes: Vec::new() };
        writer.write_head(0)?;
        writer.offset = if is_big { 16 } else { 8 };
        Ok(writer)
    }

    /// The header with the position of the directory.
    fn write_head(&mut self, directory: u64) -> io::Result<()> {
        if self.is_big {
            self.out.write_all(&[b'I', b'I', 43, 0, 8, 0, 0, 0])?;
            self.out.write_all(&directory.to_le_bytes())
        } else {
            self.out.write_all(&[b'I', b'I', 42, 0])?;
            self.out.write_all(&(directory as u32).to_le_bytes())
        }
    }

    /// Adds the next tile: [`TILE`] rows of as many values. Tiles are in rows from the north, each from the west.
    pub(super) fn add_tile(&mut self, values: &[f32]) -> io::Result<()> {
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::new(6));
        for row in values.chunks(TILE as usize) {
            encoder.write_all(&predict(row))?;
        }
        let packed = encoder.finish()?;
        self.out.write_all(&packed)?;
        self.offsets.push(self.offset);
        self.sizes.push(packed.len() as u64);
        self.offset += packed.len() as u64;
        Ok(())
    }

    /// Writes the directory.
    pub(super) fn finish(mut self, setup: &TiffSetup<'_>) -> io::Result<File> {
        let directory = self.offset.next_multiple_of(8);
        self.out.write_all(&vec![0; (directory - self.offset) as usize])?;
        let entries = self.entries(setup);
        let bytes = encode_directory(&entries, directory, self.is_big);
        self.out.write_all(&bytes)?;
        self.out.seek(SeekFrom::Start(0))?;
        self.write_head(directory)?;
        self.out.into_inner().map_err(io::IntoInnerError::into_error)
    }

    fn entries(&self, setup: &TiffSetup<'_>) -> Vec<(u16, Values)> {
        let [x, y] = setup.north_west;
        let (keys, key_texts) = geo_keys(setup);
        let offsets = |values: &[u64]| match self.is_big {
            true => Values::Long8(values.to_vec()),
            false => Values::Long(values.iter().map(|value| *value as u32).collect()),
        };
        let mut entries = vec![
            (256, Values::Long(vec![setup.size[0]])),
            (257, Values::Long(vec![setup.size[1]])),
            // Bits, compression (Deflate), black is low, title.
            (258, Values::Short(vec![32])),
            (259, Values::Short(vec![8])),
            (262, Values::Short(vec![1])),
            (270, Values::Text(setup.title.to_owned())),
            // Samples of a cell, all in one plane; program; predictor of floats.
            (277, Values::Short(vec![1])),
            (284, Values::Short(vec![1])),
            (305, Values::Text("Insula".to_owned())),
            (317, Values::Short(vec![3])),
            (322, Values::Long(vec![TILE])),
            (323, Values::Long(vec![TILE])),
            (324, offsets(&self.offsets)),
            (325, offsets(&self.sizes)),
            // Floats; copyright; scale, tie point and keys of GeoTIFF; nodata of GDAL.
            (339, Values::Short(vec![3])),
            (33432, Values::Text(setup.attribution.to_owned())),
            (33550, Values::Double(vec![setup.cell_m, setup.cell_m, 0.0])),
            (33922, Values::Double(vec![0.0, 0.0, 0.0, x, y, 0.0])),
            (34735, Values::Short(keys)),
            (34737, Values::Text(key_texts)),
            (42113, Values::Text(setup.nodata.to_string())),
        ];
        entries.retain(|(_, values)| !matches!(values, Values::Text(text) if text.is_empty()));
        entries
    }
}

/// The directory of GeoTIFF keys, and their texts.
fn geo_keys(setup: &TiffSetup<'_>) -> (Vec<u16>, String) {
    let short = |code: Option<u32>| code.and_then(|code| u16::try_from(code).ok()).filter(|code| *code > 0);
    // Values are the areas of cells.
    let mut keys = vec![[1025, 0, 1, 1]];
    let mut texts = String::new();
    if let Some(code) = short(setup.epsg) {
        keys.insert(0, [1024, 0, 1, 1]);
        // The citation is a name for people.
        texts = format!("EPSG:{code}|");
        keys.push([1026, 34737, texts.len() as u16, 0]);
        keys.push([3072, 0, 1, code]);
    }
    if let Some(code) = short(setup.vertical_epsg) {
        keys.push([4096, 0, 1, code]);
        keys.push([4099, 0, 1, 9001]);
    }
    let head = [1, 1, 1, keys.len() as u16];
    (head.into_iter().chain(keys.into_iter().flatten()).collect(), texts)
}

/// Values of an entry of the directory.
enum Values {
    Short(Vec<u16>),
    Long(Vec<u32>),
    Long8(Vec<u64>),
    Double(Vec<f64>),
    /// Written in UTF-8, ended by a zero.
    Text(String),
}

impl Values {
    /// Type, number and bytes.
    fn encode(&self) -> (u16, u64, Vec<u8>) {
        match self {
            Self::Short(values) => (3, values.len() as u64, values.iter().flat_map(|v| v.to_le_bytes()).collect()),
            Self::Long(values) => (4, values.len() as u64, values.iter().flat_map(|v| v.to_le_bytes()).collect()),
            Self::Long8(values) => (16, values.len() as u64, values.iter().flat_map(|v| v.to_le_bytes()).collect()),
            Self::Double(values) => (12, values.len() as u64, values.iter().flat_map(|v| v.to_le_bytes()).collect()),
            Self::Text(text) => {
                let bytes: Vec<u8> = text.bytes().filter(|byte| *byte != 0).chain([0]).collect();
                (2, bytes.len() as u64, bytes)
            }
        }
    }
}

/// A directory that begins at `position`, with the values that do not fit into its entries after it.
fn encode_directory(entries: &[(u16, Values)], position: u64, is_big: bool) -> Vec<u8> {
    let (count_bytes, entry_bytes, field) = if is_big { (8, 20, 8) } else { (2, 12, 4) };
    let put = |out: &mut Vec<u8>, value: u64| out.extend_from_slice(&value.to_le_bytes()[..field]);
    let mut directory = (entries.len() as u64).to_le_bytes()[..count_bytes].to_vec();
    let directory_bytes = count_bytes + entry_bytes * entries.len() + field;
    let mut rest: Vec<u8> = Vec::new();
    for (tag, values) in entries {
        let (kind, count, mut bytes) = values.encode();
        directory.extend_from_slice(&tag.to_le_bytes());
        directory.extend_from_slice(&kind.to_le_bytes());
        put(&mut directory, count);
        if bytes.len() <= field {
            bytes.resize(field, 0);
            directory.extend_from_slice(&bytes);
        } else {
            rest.resize(rest.len().next_multiple_of(8), 0);
            put(&mut directory, position + (directory_bytes + rest.len()) as u64);
            rest.extend_from_slice(&bytes);
        }
    }
    put(&mut directory, 0);
    directory.extend_from_slice(&rest);
    directory
}

/// A row after the floating-point predictor: the bytes of all values from the most to the least significant, each as the difference
/// from the byte before.
fn predict(row: &[f32]) -> Vec<u8> {
    let mut bytes = vec![0; 4 * row.len()];
    for (i, value) in row.iter().enumerate() {
        for (plane, byte) in value.to_be_bytes().into_iter().enumerate() {
            bytes[plane * row.len() + i] = byte;
        }
    }
    for i in (1..bytes.len()).rev() {
        bytes[i] = bytes[i].wrapping_sub(bytes[i - 1]);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use tiff::decoder::{Decoder, DecodingResult};

    fn setup(size: [u32; 2]) -> TiffSetup<'static> {
        TiffSetup {
            size,
            north_west: [0.0; 2],
            cell_m: 1.0,
            nodata: -1.0,
            epsg: None,
            vertical_epsg: None,
            title: "",
            attribution: "",
        }
    }

    #[test]
    fn classic_and_big_files_of_several_tiles_are_read() {
        let setup = setup([600, 300]);
        for is_big in [false, true] {
            let mut writer = TiffWriter::new(tempfile::tempfile().unwrap(), &setup).unwrap();
            if is_big {
                writer.out.seek(SeekFrom::Start(0)).unwrap();
                (writer.is_big, writer.offset) = (true, 16);
                writer.write_head(0).unwrap();
            }
            let value = |x: u32, y: u32| (x as f32).mul_add(0.37, -1000.0 * y as f32);
            for tile in 0..6 {
                let [x, y] = [tile % 3 * TILE, tile / 3 * TILE];
                let values: Vec<f32> = (0..TILE * TILE).map(|i| value(x + i % TILE, y + i / TILE)).collect();
                writer.add_tile(&values).unwrap();
            }
            let mut file = writer.finish(&setup).unwrap();
            file.seek(SeekFrom::Start(0)).unwrap();
            let DecodingResult::F32(values) = Decoder::new(file).unwrap().read_image().unwrap() else {
                panic!("not floats")
            };
            assert_eq!(values.len(), 600 * 300);
            assert!(values.iter().enumerate().all(|(i, v)| *v == value(i as u32 % 600, i as u32 / 600)));
        }
    }
}
