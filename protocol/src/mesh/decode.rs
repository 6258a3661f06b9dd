//! Bytes to a mesh.
//!
//! In: bytes that anyone may have made. Out: a [`Mesh`], or what is wrong. Next: `insula-client`.

use super::{
    Attribute, AttributeKind, BUILT, MAX_ATTRIBUTES, MAX_TRIANGLES, MAX_VERTICES, Mesh, POSITION_BITS, PositionGrid,
    VERSION, WIDE, architectural_positions, attribute_values,
    connectivity::{self, Connectivity},
    encode::limit,
    half_edge::NONE,
    points::Points,
    scan_positions::{self, CLASSES, WEIGHTS},
    weld,
};
use crate::{
    codec::{
        byte_reader::ByteReader,
        rans::{LANES, RansDecoder},
    },
    error::DecodeError,
};

impl Mesh {
    /// Undoes [`Mesh::encode`]; vertices and triangles come in the order of conquest.
    ///
    /// # Errors
    /// Anything that is no coded mesh. Memory is bounded by what the bytes announce, and that by the format's limits.
    pub fn decode(bytes: &[u8]) -> Result<Self, DecodeError> {
        Self::decode_within(bytes, MAX_TRIANGLES)
    }

    /// The same, and refuses what announces more than `most` triangles (or as many vertices) before it takes memory for them.
    pub fn decode_within(bytes: &[u8], most: usize) -> Result<Self, DecodeError> {
        let mut reader = ByteReader::new(bytes);
        let version = reader.u8()?;
        if version != VERSION {
            return Err(DecodeError::Version { found: version.into(), known: VERSION.into() });
        }
        let kind = reader.u8()?;
        if kind & !(BUILT | WIDE) != 0 {
            return Err(DecodeError::Invalid("a mesh of an unknown kind"));
        }
        let bits = reader.u8()?;
        if !POSITION_BITS.contains(&bits) {
            return Err(DecodeError::Invalid("a mesh's positions have 8 to 16 bits"));
        }
        let attributes = usize::from(reader.u8()?);
        limit("a mesh's attributes", attributes, MAX_ATTRIBUTES)?;
        let grid = grid(&mut reader, kind & WIDE != 0, bits)?;
        let vertices = reader.varint()? as usize;
        limit("a mesh's vertices", vertices, most.min(MAX_VERTICES))?;
        let triangles = reader.varint()? as usize;
        limit("a mesh's triangles", triangles, most.min(MAX_TRIANGLES))?;
        let mut attributes = (0..attributes).map(|_| attribute(&mut reader)).collect::<Result<Vec<_>, _>>()?;
        let mut weights = scan_positions::PLAIN;
        if kind & BUILT == 0 {
            let read = reader.array::<{ CLASSES * WEIGHTS }>()?;
            weights.as_flattened_mut().iter_mut().zip(read).for_each(|(weight, byte)| *weight = byte as i8);
        }
        let coded = reader.rest();
        let mut symbols = RansDecoder::new(coded, if kind & BUILT == 0 { LANES } else { 1 });
        // A triangle rarely takes less than a bit: what is announced is not believed beyond that.
        let likely = triangles.min(8 * coded.len());
        let order = connectivity::read(&mut symbols, triangles, likely)?;
        if order.triangles.len() != triangles || order.degree.len() - order.dummies.len() != vertices {
            return Err(DecodeError::Invalid("a mesh has not as many triangles and vertices as it announces"));
        }
        let mut points = Points::unknown(order.degree.len(), &order.dummies, u32::from(bits));
        let mut first = Vec::new();
        weld::code(&mut symbols, &mut first, order.degree.len(), |vertex| points.is_real(vertex))?;
        if kind & BUILT != 0 {
            architectural_positions::code(&mut symbols, &order, &mut points, &first)?;
        } else {
            scan_positions::code(&mut symbols, &order, &mut points, &weights, &first)?;
        }
        for attribute in &mut attributes {
            attribute_values::code(&mut symbols, &order, &points, attribute)?;
        }
        symbols.finish()?;
        let (positions, triangles) = finish(order, &points, &first);
        Ok(Self { grid, positions, triangles, attributes })
    }
}

/// Positions of real vertices that are no copies, and triangles of real vertices.
fn finish(order: Connectivity, points: &Points, first: &[u32]) -> (Vec<[u32; 3]>, Vec<[u32; 3]>) {
    let place = |vertex: u32| std::array::from_fn(|axis| points.value(vertex, axis) as u32);
    if points.all_real() && first.iter().copied().eq(0..first.len() as u32) {
        return ((0..first.len() as u32).map(place).collect(), order.triangles);
    }
    let mut numbers = Vec::with_capacity(first.len());
    let mut positions = Vec::with_capacity(first.len());
    for (vertex, &first) in (0..).zip(first) {
        numbers.push(match first == vertex {
            _ if !points.is_real(vertex) => NONE,
            true => positions.len() as u32,
            false => numbers[first as usize],
        });
        if first == vertex && points.is_real(vertex) {
            positions.push(place(vertex));
        }
    }
    let mut triangles = order.triangles;
    triangles.retain_mut(|corners| {
        *corners = corners.map(|vertex| numbers[vertex as usize]);
        !corners.contains(&NONE)
    });
    (positions, triangles)
}

fn grid(reader: &mut ByteReader<'_>, wide: bool, bits: u8) -> Result<PositionGrid, DecodeError> {
    let mut numbers = [0f64; 4];
    for number in &mut numbers {
        *number = if wide { f64::from_le_bytes(reader.array()?) } else { reader.f32()?.into() };
        if !number.is_finite() {
            return Err(DecodeError::Invalid("a number is not finite"));
        }
    }
    let [x, y, z, step] = numbers;
    if step <= 0.0 {
        return Err(DecodeError::Invalid("a mesh's grid has no step"));
    }
    Ok(PositionGrid { min: [x, y, z], step, bits })
}

fn attribute(reader: &mut ByteReader<'_>) -> Result<Attribute, DecodeError> {
    let [kind, components, bits] = reader.array()?;
    let kind =
        *AttributeKind::ALL.get(usize::from(kind)).ok_or(DecodeError::Invalid("an attribute of an unknown kind"))?;
    if !(1..=4).contains(&components) || !(1..=16).contains(&bits) {
        return Err(DecodeError::Invalid("a mesh's attribute has 1 to 4 numbers of 1 to 16 bits"));
    }
    let range = [reader.f32()?, reader.f32()?];
    Ok(Attribute { kind, components, bits, range, values: Vec::new(), corners: Vec::new() })
}
