//! Shapes: points, lines and polygons with or without heights and measures.

use super::multipatch::{self, Part};
use crate::vector::geometry::{Geometry, MALFORMED, Ring, UNKNOWN_TYPE};
use crate::vector::rings;

const EXTENT_BYTES: usize = 32;

/// Reads a record. Faults that cost a part only are added to `problems`. Fails with the reason for skipping the feature.
pub(crate) fn read(content: &[u8], problems: &mut Vec<&'static str>) -> Result<Geometry, &'static str> {
    let mut reader = ShapeReader { bytes: content };
    let mut geometry = Geometry::default();
    let code = reader.u32()?;
    geometry.has_z = matches!(code, 11 | 13 | 15 | 18 | 31);
    match code {
        0 => return Err("no geometry"),
        1 | 21 => geometry.push_point([reader.f64()?, reader.f64()?, 0.0]),
        11 => geometry.push_point([reader.f64()?, reader.f64()?, reader.f64()?]),
        8 | 18 | 28 => {
            reader.skip(EXTENT_BYTES)?;
            let count = reader.count(16)?;
            reader.positions(count, code == 18)?.into_iter().for_each(|point| geometry.push_point(point));
        }
        3 | 13 | 23 => {
            let parts = reader.parts(false, code == 13)?;
            parts.into_iter().for_each(|part| geometry.push_line(part.ring));
        }
        5 | 15 | 25 => {
            let parts = reader.parts(false, code == 15)?.into_iter().map(|part| part.ring);
            let grouped = rings::group(parts.filter(|ring| !ring.is_empty()).collect());
            if grouped.left_out > 0 {
                problems.push("too many holes to find their outer rings, some left out");
            }
            if grouped.turned_holes > 0 {
                problems.push("ring in another one turns as that does, taken as a hole");
            }
            grouped.polygons.into_iter().for_each(|polygon| geometry.push_polygon(polygon));
        }
        31 => multipatch::add(reader.parts(true, true)?, &mut geometry, problems),
        _ => return Err(UNKNOWN_TYPE),
    }
    Ok(geometry)
}

struct ShapeReader<'a> {
    /// What is not yet read.
    bytes: &'a [u8],
}

impl ShapeReader<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], &'static str> {
        let (taken, rest) = self.bytes.split_first_chunk::<N>().ok_or(MALFORMED)?;
        self.bytes = rest;
        Ok(*taken)
    }

    fn u32(&mut self) -> Result<u32, &'static str> {
        self.take().map(u32::from_le_bytes)
    }

    fn f64(&mut self) -> Result<f64, &'static str> {
        self.take().map(f64::from_le_bytes)
    }

    fn skip(&mut self, bytes: usize) -> Result<(), &'static str> {
        self.bytes = self.bytes.get(bytes..).ok_or(MALFORMED)?;
        Ok(())
    }

    /// A number of items of `item_bytes` each, which the rest of the record can hold.
    fn count(&mut self, item_bytes: usize) -> Result<usize, &'static str> {
        let count = self.u32()? as usize;
        if count > self.bytes.len() / item_bytes { Err(MALFORMED) } else { Ok(count) }
    }

    /// Positions: all x and y, then the range and values of z.
    fn positions(&mut self, count: usize, has_z: bool) -> Result<Ring, &'static str> {
        let mut ring = Ring::with_capacity(count);
        for _ in 0..count {
            ring.push([self.f64()?, self.f64()?, 0.0]);
        }
        if has_z && count > 0 {
            self.skip(16)?;
            for position in &mut ring {
                position[2] = self.f64()?;
            }
        }
        Ok(ring)
    }

    /// Parts of a line, polygon or multipatch.
    fn parts(&mut self, has_kinds: bool, has_z: bool) -> Result<Vec<Part>, &'static str> {
        self.skip(EXTENT_BYTES)?;
        let part_count = self.count(4)?;
        let position_count = self.count(16)?;
        let starts: Result<Vec<u32>, _> = (0..part_count).map(|_| self.u32()).collect();
        let starts = starts?;
        let kinds: Result<Vec<u32>, _> = (0..part_count).map(|_| if has_kinds { self.u32() } else { Ok(0) }).collect();
        let positions = self.positions(position_count, has_z)?;
        let ends = starts.iter().skip(1).map(|start| *start as usize).chain([positions.len()]);
        let mut parts = Vec::with_capacity(part_count);
        for ((start, end), kind) in starts.iter().zip(ends).zip(kinds?) {
            let ring = positions.get(*start as usize..end).ok_or(MALFORMED)?.to_vec();
            parts.push(Part { kind, ring });
        }
        Ok(parts)
    }
}
