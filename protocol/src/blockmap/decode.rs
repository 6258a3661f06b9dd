//! A V-BlockMap from bytes that anyone may have made.

use super::{BlockMap, COLUMNS, Clip, Corner, MAX_TEXELS, Outer, Z_SHIFT_MAX, encode::tag, flag, predict, strip_rows};
use crate::{
    codec::varint::Reader,
    error::DecodeError,
    texel::Texel,
    tile::{Kind, TileReader},
};

impl BlockMap {
    /// Reads a tile. Allocates at most what [`COLUMNS`] and [`MAX_TEXELS`] allow.
    pub fn decode(bytes: &[u8]) -> Result<Self, DecodeError> {
        let tile = TileReader::new(bytes, Kind::BlockMap)?;
        let mut map = read_meta(&tile)?;
        map.flags = exact(tile.section(tag::FLAGS, COLUMNS)?, COLUMNS)?;
        let occupied: Vec<usize> = (0..COLUMNS).filter(|i| map.flags[*i] & flag::OCCUPIED != 0).collect();
        let n = occupied.len();
        let residuals = |tag| Ok::<_, DecodeError>(predict::read_planes(&exact(tile.section(tag, n * 2)?, n * 2)?));
        map.z_max = heights(&residuals(tag::Z_MAX)?, &map.flags, &occupied);
        map.z_min = heights(&residuals(tag::Z_MIN)?, &map.flags, &occupied);
        for (i, normal) in occupied.iter().zip(residuals(tag::NORMALS)?) {
            map.roof_normal[*i] = normal;
        }
        let count = |bit: u8| map.flags.iter().filter(|f| **f & bit != 0).count();
        let gaps = exact(tile.section(tag::GAPS, n * 4)?, count(flag::GAP) * 4)?;
        map.gaps = predict::read_planes(&gaps).chunks_exact(2).map(|g| [g[0], g[1]]).collect();
        let azimuths = exact(tile.section(tag::AZIMUTHS, n)?, count(flag::EXPOSED))?;
        let exposed = occupied.iter().filter(|i| map.flags[**i] & flag::EXPOSED != 0);
        for (i, azimuth) in exposed.zip(azimuths) {
            map.wall_azimuth[*i] = azimuth;
        }
        let roof = texels(&tile, tag::ROOF_RGB, tag::ROOF_AO, n)?;
        for (i, texel) in occupied.iter().zip(roof) {
            map.roof[*i] = texel;
        }
        map.strips = texels(&tile, tag::STRIP_RGB, tag::STRIP_AO, strip_texels(&map, &occupied)?)?;
        map.clips = clips(&tile, count(flag::CLIPPED))?;
        map.check()?;
        Ok(map)
    }
}

fn read_meta(tile: &TileReader<'_>) -> Result<BlockMap, DecodeError> {
    let meta = tile.section(tag::META, 9)?;
    let mut reader = Reader::new(&meta);
    let (cell_m, z_base_cells, z_shift) = (reader.f32()?, reader.u32()? as i32, reader.u8()?);
    reader.finish()?;
    if cell_m <= 0.0 || z_shift > Z_SHIFT_MAX {
        return Err(DecodeError::Invalid("cell size or height step out of range"));
    }
    Ok(BlockMap::empty(tile.id, cell_m, z_base_cells, z_shift))
}

fn clips(tile: &TileReader<'_>, n: usize) -> Result<Vec<Clip>, DecodeError> {
    let offsets = exact(tile.section(tag::CLIP_OFFSETS, n)?, n)?;
    let heights = predict::read_planes(&exact(tile.section(tag::OUTER_Z, n * 2)?, n * 2)?);
    let count = heights.iter().filter(|z| **z != 0).count();
    let mut roofs = texels(tile, tag::OUTER_RGB, tag::OUTER_AO, count)?.into_iter();
    let outer = |z: u16| if z == 0 { None } else { Some(Outer { z, roof: roofs.next()? }) };
    let outers: Vec<Option<Outer>> = heights.into_iter().map(outer).collect();
    let corners = corners(tile.section(tag::CORNERS, n * 3)?, n)?;
    let clips = offsets.into_iter().zip(corners).zip(outers);
    Ok(clips.map(|((offset, corner), outer)| Clip { offset: offset as i8, corner, outer }).collect())
}

fn corners(bytes: Vec<u8>, n: usize) -> Result<Vec<Option<Corner>>, DecodeError> {
    let Some((kinds, places)) = bytes.split_at_checked(n) else {
        return Err(DecodeError::Truncated { wanted: n, found: bytes.len() });
    };
    if kinds.iter().any(|kind| *kind > 2) || places.len() != kinds.iter().filter(|kind| **kind != 0).count() * 2 {
        return Err(DecodeError::Invalid("corners do not match the planes"));
    }
    let mut places = places.chunks_exact(2);
    let mut corner = |kind: u8| {
        let place = if kind == 0 { None } else { places.next() }?;
        Some(Corner { azimuth: place[0], offset: place[1] as i8, concave: kind == 2 })
    };
    Ok(kinds.iter().map(|kind| corner(*kind)).collect())
}

fn exact(bytes: Vec<u8>, wanted: usize) -> Result<Vec<u8>, DecodeError> {
    let found = bytes.len();
    if found == wanted { Ok(bytes) } else { Err(DecodeError::Truncated { wanted, found }) }
}

fn heights(residuals: &[u16], flags: &[u8], occupied: &[usize]) -> Vec<u16> {
    let known = |j: usize| flags[j] & flag::OCCUPIED != 0;
    let mut values = vec![0; COLUMNS];
    let mut last = 0;
    for (&i, &residual) in occupied.iter().zip(residuals) {
        last = predict::restore(residual, predict::guess(&values, known, i, last));
        values[i] = last;
    }
    values
}

/// How many texels the strips have; checked before any is allocated.
fn strip_texels(map: &BlockMap, occupied: &[usize]) -> Result<usize, DecodeError> {
    let mut sum = 0;
    for &i in occupied.iter().filter(|i| map.flags[**i] & flag::EXPOSED != 0) {
        if map.z_min[i] >= map.z_max[i] {
            return Err(DecodeError::Invalid("a column's heights are turned around or out of range"));
        }
        sum += usize::from(strip_rows(map.z_min[i], map.z_max[i], map.z_shift).1);
    }
    if sum > MAX_TEXELS {
        let (found, limit) = (sum as u64, MAX_TEXELS as u64);
        return Err(DecodeError::Limit { what: "the number of strip texels", found, limit });
    }
    Ok(sum)
}

fn texels(tile: &TileReader<'_>, rgb_tag: u8, ao_tag: u8, n: usize) -> Result<Vec<Texel>, DecodeError> {
    let rgb = exact(tile.section(rgb_tag, n * 3)?, n * 3)?;
    let ao = exact(tile.section(ao_tag, n)?, n)?;
    let (green, rest) = rgb.split_at(n);
    let (red, blue) = rest.split_at(n);
    let (mut g, mut r, mut b, mut a) = (0u8, 0u8, 0u8, 0u8);
    let mut out = Vec::with_capacity(n);
    for i in 0..n {
        g = g.wrapping_add(green[i]);
        r = r.wrapping_add(red[i]);
        b = b.wrapping_add(blue[i]);
        a = a.wrapping_add(ao[i]);
        out.push(Texel(u32::from_le_bytes([r.wrapping_add(g), g, b.wrapping_add(g), a])));
    }
    Ok(out)
}
