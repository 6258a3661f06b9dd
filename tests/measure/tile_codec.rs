//! Compares codecs for V-BlockMaps on the tiles of baked cities: the figures of `docs/decisions/0001-tile-codec.md`.
//!
//! The cities must be baked with `--quality lossless`.
//!
//! `cargo run --release -p insula-measure --bin tile_codec -- CITY...`

use anyhow::{Context, ensure};
use image::{ExtendedColorType, ImageEncoder, codecs};
use insula_protocol::{
    BlockMap, DecodeError, Texel,
    blockmap::{COLUMNS, Quality, flag},
    codec::{
        range::{BitCoder, BitModel, NumberModel},
        zstd,
    },
};
use insula_server::store::CityStore;
use std::{collections::HashMap, io::Cursor, path::Path, time::Instant};

// The allocator of the programs that decode tiles.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Quality of the lossy candidates, as PSNR in dB.
const DB: f32 = 36.0;
/// A timing is the best of this many.
const ROUNDS: usize = 5;

fn main() -> anyhow::Result<()> {
    for city in std::env::args().skip(1) {
        let store = CityStore::open(Path::new(&city))?;
        let depth = store.manifest().depth;
        let (mut leaves, mut parents) = (Vec::new(), Vec::new());
        for (id, bytes) in store.blockmaps().tiles() {
            let map = BlockMap::decode(id, &bytes?).with_context(|| id.to_string())?;
            if id.level() == depth { leaves.push(map) } else { parents.push(map) }
        }
        ensure!(!leaves.is_empty() && !parents.is_empty(), "{city} has no leaves or no parents");
        println!("\n{city}: {} leaves, {} parents", leaves.len(), parents.len());
        println!("{:<44} {:>8} {:>8} {:>7} {:>10}", "", "leaf B", "parent B", "dB", "decode us");
        for candidate in CANDIDATES {
            candidate.measure(&leaves, &parents)?;
        }
    }
    Ok(())
}

/// Result of coding one tile.
struct CodedTile {
    bytes: usize,
    /// The decoded tile; `None` if the candidate only measures the size.
    decoded: Option<BlockMap>,
    decode_us: Option<f64>,
}

struct CodecCandidate {
    name: &'static str,
    code: fn(&BlockMap) -> anyhow::Result<CodedTile>,
}

const CANDIDATES: &[CodecCandidate] = &[
    CodecCandidate { name: "all, lossless: byte planes, zstd 19", code: planes },
    CodecCandidate { name: "all, lossless: range coder", code: |map| tile(map, Quality::Lossless) },
    CodecCandidate { name: "all, 36 dB: same predictions, zstd 19", code: residuals },
    CodecCandidate { name: "all, 36 dB: same predictions, static (bound)", code: statics },
    CodecCandidate { name: "all, 36 dB: range coder (chosen)", code: |map| tile(map, Quality::Decibels(DB)) },
    CodecCandidate { name: "all, 40 dB: range coder", code: |map| tile(map, Quality::Decibels(40.0)) },
    CodecCandidate { name: "colours alone, lossless: PNG", code: |map| image_file(map, png) },
    CodecCandidate { name: "colours alone, lossless: WebP", code: |map| image_file(map, webp) },
    CodecCandidate { name: "colours alone, 36 dB: JPEG", code: jpeg },
    CodecCandidate { name: "colours alone, 36 dB: range coder (chosen)", code: colours_alone },
];

impl CodecCandidate {
    fn measure(&self, leaves: &[BlockMap], parents: &[BlockMap]) -> anyhow::Result<()> {
        let mut squares = 0.0;
        let mut times = Vec::new();
        let mut mean = |maps: &[BlockMap]| -> anyhow::Result<f64> {
            let mut sum = 0;
            for map in maps {
                let coded = (self.code)(map)?;
                sum += coded.bytes;
                times.extend(coded.decode_us);
                squares += coded.decoded.map_or(0.0, |decoded| map.colour_error(&decoded));
            }
            Ok(sum as f64 / maps.len() as f64)
        };
        let (leaf, parent) = (mean(leaves)?, mean(parents)?);
        times.sort_by(f64::total_cmp);
        let squares = squares / (leaves.len() + parents.len()) as f64;
        let db = if squares > 0.0 { format!("{:.1}", 10.0 * (255.0 * 255.0 / squares).log10()) } else { "-".into() };
        let time = times.get(times.len() / 2).map_or("-".into(), |us| format!("{us:.0}"));
        println!("{:<44} {leaf:>8.0} {parent:>8.0} {db:>7} {time:>10}", self.name);
        Ok(())
    }
}

fn best_us<T>(mut work: impl FnMut() -> anyhow::Result<T>) -> anyhow::Result<f64> {
    let mut best = f64::INFINITY;
    for _ in 0..ROUNDS {
        let start = Instant::now();
        std::hint::black_box(work()?);
        best = best.min(start.elapsed().as_secs_f64() * 1e6);
    }
    Ok(best)
}

fn tile(map: &BlockMap, quality: Quality) -> anyhow::Result<CodedTile> {
    let bytes = map.encode_at(quality)?;
    let decoded = BlockMap::decode(map.id, &bytes)?;
    let decode_us = best_us(|| Ok(BlockMap::decode(map.id, &bytes)?))?;
    Ok(CodedTile { bytes: bytes.len(), decoded: Some(decoded), decode_us: Some(decode_us) })
}

/// Every field as byte planes, colours as differences from the previous texel, compressed by zstd.
fn planes(map: &BlockMap) -> anyhow::Result<CodedTile> {
    let occupied: Vec<usize> = (0..COLUMNS).filter(|i| map.flags[*i] & flag::OCCUPIED != 0).collect();
    let mut raw = map.flags.clone();
    for field in [&map.z_max, &map.z_min, &map.roof_normal] {
        raw.extend(occupied.iter().map(|i| field[*i] as u8));
        raw.extend(occupied.iter().map(|i| (field[*i] >> 8) as u8));
    }
    raw.extend(occupied.iter().map(|i| map.wall_azimuth[*i]));
    for clip in &map.clips {
        let (corner, outer) = (clip.corner.unwrap_or_default(), clip.outer.unwrap_or_default());
        raw.extend([clip.offset as u8, corner.azimuth, corner.offset as u8, outer.z as u8, (outer.z >> 8) as u8]);
        raw.extend(outer.roof.0.to_le_bytes());
    }
    let texels: Vec<[u8; 4]> = texels(map).map(|texel| texel.0.to_le_bytes()).collect();
    for part in 0..4 {
        let mut last = 0u8;
        for texel in &texels {
            let now = if part % 2 == 0 { texel[part].wrapping_sub(texel[1]) } else { texel[part] };
            raw.push(now.wrapping_sub(std::mem::replace(&mut last, now)));
        }
    }
    let packed = zstd::compress(&raw)?;
    Ok(CodedTile { bytes: packed.len(), decoded: None, decode_us: None })
}

fn texels(map: &BlockMap) -> impl Iterator<Item = Texel> {
    let occupied = (0..COLUMNS).filter(|i| map.flags[*i] & flag::OCCUPIED != 0);
    occupied.map(|i| map.roof[i]).chain(map.strips.iter().copied())
}

/// Visits the map's values as the encoder does at [`DB`]. Returns the decoded map.
fn walk(map: &BlockMap, coder: &mut impl BitCoder) -> Result<BlockMap, DecodeError> {
    let mut decoded = map.clone();
    decoded.walk(coder, map.quantisation_steps(Quality::Decibels(DB)))?;
    Ok(decoded)
}

/// Records the coder's input as bytes: numbers and bits separately.
#[derive(Default)]
struct RecordingCoder {
    numbers: Vec<u8>,
    bits: Vec<u8>,
}

impl BitCoder for RecordingCoder {
    const WRITES: bool = true;

    fn bit(&mut self, _: &mut BitModel, bit: bool) -> bool {
        self.bits.push(u8::from(bit));
        bit
    }

    fn number(&mut self, _: &mut NumberModel, value: i32) -> i32 {
        insula_protocol::codec::varint::push(&mut self.numbers, insula_protocol::codec::varint::zigzag(value));
        value
    }
}

fn residuals(map: &BlockMap) -> anyhow::Result<CodedTile> {
    let mut record = RecordingCoder::default();
    let decoded = walk(map, &mut record)?;
    let bits: Vec<u8> = record.bits.chunks(8).map(|byte| byte.iter().fold(0, |sum, bit| sum << 1 | bit)).collect();
    let bytes = zstd::compress(&record.numbers)?.len() + zstd::compress(&bits)?.len();
    Ok(CodedTile { bytes, decoded: Some(decoded), decode_us: None })
}

/// Counts each model's bits, to estimate the size with static tables of one byte per model.
#[derive(Default)]
struct CountingCoder {
    models: HashMap<*const BitModel, [u32; 2]>,
}

impl BitCoder for CountingCoder {
    const WRITES: bool = true;

    fn bit(&mut self, model: &mut BitModel, bit: bool) -> bool {
        self.models.entry(model).or_default()[usize::from(bit)] += 1;
        bit
    }
}

fn statics(map: &BlockMap) -> anyhow::Result<CodedTile> {
    let mut count = CountingCoder::default();
    let decoded = walk(map, &mut count)?;
    let bits = |[a, b]: [u32; 2]| {
        let (a, b) = (f64::from(a), f64::from(b));
        let part = |n: f64| if n > 0.0 { n * ((a + b) / n).log2() } else { 0.0 };
        8.0 + part(a) + part(b)
    };
    let bytes = count.models.into_values().map(bits).sum::<f64>() / 8.0;
    Ok(CodedTile { bytes: bytes.ceil() as usize, decoded: Some(decoded), decode_us: None })
}

/// The roofs and wall strips as an image 64 texels wide: pixels and height.
fn atlas(map: &BlockMap) -> (Vec<u8>, u32) {
    let strips = map.strips.iter().filter(|texel| !texel.is_open());
    let mut rgb: Vec<u8> = map.roof.iter().chain(strips).flat_map(|texel| texel.rgb()).collect();
    let height = rgb.len().div_ceil(64 * 3);
    rgb.resize(height * 64 * 3, 0);
    (rgb, height as u32)
}

fn image_file(map: &BlockMap, encode: fn(&[u8], u32) -> anyhow::Result<Vec<u8>>) -> anyhow::Result<CodedTile> {
    let (rgb, height) = atlas(map);
    let bytes = encode(&rgb, height)?;
    let decode_us = best_us(|| Ok(image::load_from_memory(&bytes)?))?;
    Ok(CodedTile { bytes: bytes.len(), decoded: None, decode_us: Some(decode_us) })
}

fn png(rgb: &[u8], height: u32) -> anyhow::Result<Vec<u8>> {
    let mut out = Vec::new();
    let (best, filter) = (codecs::png::CompressionType::Best, codecs::png::FilterType::Adaptive);
    codecs::png::PngEncoder::new_with_quality(&mut out, best, filter).write_image(
        rgb,
        64,
        height,
        ExtendedColorType::Rgb8,
    )?;
    Ok(out)
}

fn webp(rgb: &[u8], height: u32) -> anyhow::Result<Vec<u8>> {
    let mut out = Cursor::new(Vec::new());
    codecs::webp::WebPEncoder::new_lossless(&mut out).encode(rgb, 64, height, ExtendedColorType::Rgb8)?;
    Ok(out.into_inner())
}

/// The smallest JPEG with at least [`DB`], measured over all pixels.
fn jpeg(map: &BlockMap) -> anyhow::Result<CodedTile> {
    let (rgb, height) = atlas(map);
    let worst = 255.0 * 255.0 / 10f64.powf(f64::from(DB) / 10.0);
    for quality in (30..=100).step_by(5) {
        let mut bytes = Vec::new();
        codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, quality).encode(
            &rgb,
            64,
            height,
            ExtendedColorType::Rgb8,
        )?;
        let decoded = image::load_from_memory(&bytes)?.to_rgb8();
        let squares: f64 = rgb.iter().zip(decoded.as_raw()).map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2)).sum();
        if squares / rgb.len() as f64 <= worst || quality == 100 {
            let decode_us = best_us(|| Ok(image::load_from_memory(&bytes)?))?;
            return Ok(CodedTile { bytes: bytes.len(), decoded: None, decode_us: Some(decode_us) });
        }
    }
    anyhow::bail!("no JPEG quality was tried")
}

/// The size of the colours: what a tile loses when all of them are black.
fn colours_alone(map: &BlockMap) -> anyhow::Result<CodedTile> {
    let mut grey = map.clone();
    let one = |texel: &mut Texel| *texel = if texel.is_open() { *texel } else { Texel(texel.0 & 0xff00_0000) };
    grey.roof.iter_mut().chain(&mut grey.strips).for_each(one);
    grey.clips.iter_mut().filter_map(|clip| clip.outer.as_mut()).for_each(|outer| one(&mut outer.roof));
    let whole = tile(map, Quality::Decibels(DB))?;
    let bytes = whole.bytes - grey.encode_at(Quality::Decibels(DB))?.len();
    Ok(CodedTile { bytes, decoded: whole.decoded, decode_us: None })
}
