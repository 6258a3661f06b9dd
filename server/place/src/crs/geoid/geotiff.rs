//! Reads geoid grids in the GeoTIFF form of PROJ-data (<https://proj.org/specifications/geodetictiffgrids.html>).

use super::grid::{Grid, MAX_UNDULATION_M, Table};
use std::io::{Read, Seek};
use tiff::decoder::{ChunkType, Decoder, DecodingResult};
use tiff::tags::Tag;

/// Grids with more values are refused: 200 MB of memory.
const MAX_VALUES: u64 = 50_000_000;
const MAX_IMAGES: usize = 256;
/// Metadata of GDAL: XML with the scale of integers and the meaning of the bands.
const GDAL_METADATA: Tag = Tag::Unknown(42112);
const MODEL_TYPE_KEY: u16 = 1024;
const RASTER_TYPE_KEY: u16 = 1025;
const GEOGRAPHIC: u16 = 2;
const PIXEL_IS_POINT: u16 = 2;
const PLANAR: u32 = 2;

/// Which band of an image has the undulations, and how its numbers become metres.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Band {
    index: usize,
    scale: f64,
    offset: f64,
    nodata: Option<f64>,
}

/// Reads all images of a file. Fails with the reason if it is not a grid in degrees.
pub(super) fn read(source: impl Read + Seek) -> Result<Grid, String> {
    let mut decoder = Decoder::new(source).map_err(|error| error.to_string())?;
    let (mut tables, mut values_left) = (Vec::new(), MAX_VALUES);
    loop {
        let table = read_image(&mut decoder, values_left)?;
        values_left -= table.values_m.len() as u64;
        tables.push(table);
        if !decoder.more_images() {
            return Ok(Grid::new(tables));
        }
        if tables.len() >= MAX_IMAGES {
            return Err(format!("more than {MAX_IMAGES} images"));
        }
        decoder.next_image().map_err(|error| error.to_string())?;
    }
}

fn read_image<R: Read + Seek>(decoder: &mut Decoder<R>, max_values: u64) -> Result<Table, String> {
    let (width, height) = decoder.dimensions().map_err(|error| error.to_string())?;
    if width < 2 || height < 2 {
        return Err("the grid has fewer than two rows or columns".to_owned());
    }
    if u64::from(width) * u64::from(height) > max_values {
        return Err(format!("more than {MAX_VALUES} values"));
    }
    let mut table = place(decoder)?;
    (table.width, table.height) = (width as usize, height as usize);
    table.values_m = vec![f32::NAN; table.width * table.height];
    let band = band(decoder);
    read_values(decoder, &mut table, band)?;
    Ok(table)
}

/// Where the first value is, and the distances between values.
fn place<R: Read + Seek>(decoder: &mut Decoder<R>) -> Result<Table, String> {
    let scale = decoder.get_tag_f64_vec(Tag::ModelPixelScaleTag).map_err(|_| "no pixel scale".to_owned())?;
    let tie = decoder.get_tag_f64_vec(Tag::ModelTiepointTag).map_err(|_| "no tie point".to_owned())?;
    let ([step_lon_deg, step_lat_deg, ..], [column, row, _, longitude, latitude, ..]) = (&scale[..], &tie[..]) else {
        return Err("its pixel scale or tie point is too short".to_owned());
    };
    let numbers = [*step_lon_deg, *step_lat_deg, *column, *row, *longitude, *latitude];
    let is_valid = numbers.iter().all(|number| number.is_finite() && number.abs() < 1e6);
    if !is_valid || *step_lon_deg <= 1e-7 || *step_lat_deg <= 1e-7 {
        return Err("its pixel scale or tie point is invalid".to_owned());
    }
    let keys = decoder.get_tag_u16_vec(Tag::GeoKeyDirectoryTag).unwrap_or_default();
    // Each key has four numbers: its identifier, where its value is (0: here), a count, and the value.
    let key = |wanted| keys.chunks_exact(4).skip(1).find(|key| key[0] == wanted && key[1] == 0).map(|key| key[3]);
    if key(MODEL_TYPE_KEY).is_some_and(|model| model != GEOGRAPHIC) {
        return Err("its positions are not degrees".to_owned());
    }
    let centre = if key(RASTER_TYPE_KEY) == Some(PIXEL_IS_POINT) { 0.0 } else { 0.5 };
    Ok(Table {
        west_deg: longitude + (centre - column) * step_lon_deg,
        north_deg: latitude - (centre - row) * step_lat_deg,
        step_lon_deg: *step_lon_deg,
        step_lat_deg: *step_lat_deg,
        width: 0,
        height: 0,
        values_m: Vec::new(),
    })
}

fn band<R: Read + Seek>(decoder: &mut Decoder<R>) -> Band {
    let metadata = decoder.get_tag_ascii_string(GDAL_METADATA).unwrap_or_default();
    let nodata = decoder.get_tag_ascii_string(Tag::GdalNodata).ok();
    let nodata = nodata.and_then(|text| text.trim_matches(['\0', ' ', '\n']).parse().ok());
    let items = || metadata.split("<Item ").skip(1);
    let sample = |item: &str| text_between(item, "sample=\"", "\"").and_then(|text| text.parse::<usize>().ok());
    let index = items()
        .find(|item| item.contains("role=\"description\"") && item.contains(">geoid_undulation<"))
        .and_then(sample)
        .unwrap_or(0);
    let number = |role: &str| {
        let item = items().find(|item| item.contains(role) && sample(item) == Some(index))?;
        text_between(item, ">", "<")?.trim().parse::<f64>().ok().filter(|number| number.is_finite())
    };
    let scale = number("role=\"scale\"").unwrap_or(1.0);
    Band { index, scale, offset: number("role=\"offset\"").unwrap_or(0.0), nodata }
}

fn text_between<'t>(text: &'t str, before: &str, after: &str) -> Option<&'t str> {
    let (_, rest) = text.split_once(before)?;
    rest.split_once(after).map(|(inner, _)| inner)
}

fn read_values<R: Read + Seek>(decoder: &mut Decoder<R>, table: &mut Table, band: Band) -> Result<(), String> {
    let (chunk_width, chunk_height) = decoder.chunk_dimensions();
    let (chunk_width, chunk_height) = (chunk_width.max(1) as usize, chunk_height.max(1) as usize);
    let samples = decoder.find_tag_unsigned::<u32>(Tag::SamplesPerPixel).ok().flatten().unwrap_or(1).max(1) as usize;
    let planar = decoder.find_tag_unsigned::<u32>(Tag::PlanarConfiguration).ok().flatten();
    let is_planar = samples > 1 && planar == Some(PLANAR);
    if band.index >= samples {
        return Err("the band of the undulations does not exist".to_owned());
    }
    let across = match decoder.get_chunk_type() {
        ChunkType::Strip => 1,
        ChunkType::Tile => table.width.div_ceil(chunk_width),
    };
    let chunks = across * table.height.div_ceil(chunk_height);
    let (stride, first) = if is_planar { (1, 0) } else { (samples, band.index) };
    for chunk in 0..chunks {
        let index = if is_planar { band.index * chunks + chunk } else { chunk };
        let index = u32::try_from(index).map_err(|_| "too many tiles".to_owned())?;
        let values = decoder.read_chunk(index).map_err(|error| error.to_string())?;
        let (column, row) = ((chunk % across) * chunk_width, (chunk / across) * chunk_height);
        let width = if across == 1 { table.width } else { chunk_width.min(table.width - column) };
        let height = chunk_height.min(table.height - row);
        for y in 0..height {
            for x in 0..width {
                let value = metres(&values, (y * width + x) * stride + first, band);
                table.values_m[(row + y) * table.width + column + x] = value;
            }
        }
    }
    Ok(())
}

/// Value of a cell; NaN if there is none.
fn metres(values: &DecodingResult, index: usize, band: Band) -> f32 {
    let raw = match values {
        DecodingResult::F32(values) => values.get(index).map(|value| f64::from(*value)),
        DecodingResult::F64(values) => values.get(index).copied(),
        DecodingResult::I16(values) => values.get(index).map(|value| f64::from(*value)),
        DecodingResult::U16(values) => values.get(index).map(|value| f64::from(*value)),
        DecodingResult::I32(values) => values.get(index).map(|value| f64::from(*value)),
        DecodingResult::U32(values) => values.get(index).map(|value| f64::from(*value)),
        _ => None,
    };
    let Some(raw) = raw.filter(|raw| band.nodata.is_none_or(|nodata| *raw != nodata && *raw as f32 != nodata as f32))
    else {
        return f32::NAN;
    };
    let value = (raw * band.scale + band.offset) as f32;
    if value.abs() <= MAX_UNDULATION_M { value } else { f32::NAN }
}
