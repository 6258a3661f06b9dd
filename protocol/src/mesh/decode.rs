//! Decoding of meshes from untrusted bytes.

use super::connectivity::{self, Connectivity};
use super::half_edge::NONE;
use super::points::Points;
use super::scan_prediction::Classes;
use super::scan_weights::Weights;
use super::{
    ARCHITECTURAL, Attribute, AttributeKind, CLASSES_SHIFT, MAX_ATTRIBUTES, MAX_TRIANGLES, MAX_VERTICES, Mesh,
    POSITION_BITS, PositionGrid, VERSION, WIDE_GRID, architectural_positions, attribute_values, scan_positions, weld,
};
use crate::codec::byte_reader::ByteReader;
use crate::codec::rans::{LANES, RansDecoder};
use crate::error::{DecodeError, check_limit, invalid_if};

/// What precedes the coded symbols.
struct MeshHeader {
    grid: PositionGrid,
    vertices: usize,
    triangles: usize,
    /// Attributes without values.
    attributes: Vec<Attribute>,
    /// Classes of the position coder for scans, if that is used.
    scan_classes: Option<Classes>,
}

impl Mesh {
    /// The inverse of [`Mesh::encode`]. Vertices and triangles are in traversal order. Fails on any bytes that are not
    /// a coded mesh. Memory is bounded by the header's counts, and those by the format's limits.
    pub fn decode(bytes: &[u8]) -> Result<Self, DecodeError> {
        Self::decode_within(bytes, MAX_TRIANGLES)
    }

    /// [`Mesh::decode`] with a lower limit on triangles and on vertices, checked before memory is allocated for them.
    pub(crate) fn decode_within(bytes: &[u8], max_triangles: usize) -> Result<Self, DecodeError> {
        let mut reader = ByteReader::new(bytes);
        let MeshHeader { grid, vertices, triangles, mut attributes, scan_classes } =
            read_header(&mut reader, max_triangles)?;
        let coded = reader.rest();
        let mut symbols = RansDecoder::new(coded, if scan_classes.is_some() { LANES } else { 1 });
        // A triangle rarely takes less than a bit, so more triangles are not likely.
        let likely_triangles = triangles.min(8 * coded.len());
        let order = connectivity::read(&mut symbols, triangles, likely_triangles, !attributes.is_empty())?;
        let all_vertices = order.degree.len();
        if order.triangles.len() != triangles || all_vertices - order.dummies.len() != vertices {
            return Err(DecodeError::Invalid("a mesh's numbers of triangles and vertices differ from its header"));
        }
        let mut points = Points::new(all_vertices, &order.dummies, u32::from(grid.bits));
        let mut originals = Vec::new();
        weld::code(&mut symbols, &mut originals, all_vertices, |vertex| points.is_real(vertex))?;
        if let Some(classes) = scan_classes {
            scan_positions::code(&mut symbols, &order, &mut points, &Weights::new(classes), &originals)?;
        } else {
            architectural_positions::code(&mut symbols, &order, &mut points, &originals)?;
        }
        for attribute in &mut attributes {
            attribute_values::code(&mut symbols, &order, &points, attribute)?;
        }
        symbols.finish()?;
        let (positions, triangles) = remove_copies_and_dummies(order, &points, &originals);
        Ok(Self { grid, positions, triangles, attributes })
    }
}

fn read_header(reader: &mut ByteReader<'_>, max_triangles: usize) -> Result<MeshHeader, DecodeError> {
    let version = reader.u8()?;
    if version != VERSION {
        return Err(DecodeError::Version { found: version.into(), known: VERSION.into() });
    }
    let flags = reader.u8()?;
    let classes = usize::from(flags >> CLASSES_SHIFT);
    let scan_classes = Classes::ALL.get(classes).copied();
    let is_architectural = flags & ARCHITECTURAL != 0;
    invalid_if(scan_classes.is_none() || is_architectural && classes != 0, "a mesh has unknown flags")?;
    let scan_classes = scan_classes.filter(|_| !is_architectural);
    let bits = reader.u8()?;
    invalid_if(!POSITION_BITS.contains(&bits), "a mesh's positions must have 8 to 16 bits")?;
    let attributes = usize::from(reader.u8()?);
    check_limit("the number of a mesh's attributes", attributes, MAX_ATTRIBUTES)?;
    let grid = read_grid(reader, flags & WIDE_GRID != 0, bits)?;
    let vertices = reader.varint()? as usize;
    check_limit("the number of a mesh's vertices", vertices, max_triangles.min(MAX_VERTICES))?;
    let triangles = reader.varint()? as usize;
    check_limit("the number of a mesh's triangles", triangles, max_triangles.min(MAX_TRIANGLES))?;
    let attributes = (0..attributes).map(|_| read_attribute(reader)).collect::<Result<Vec<_>, _>>()?;
    Ok(MeshHeader { grid, vertices, triangles, attributes, scan_classes })
}

fn read_grid(reader: &mut ByteReader<'_>, is_wide: bool, bits: u8) -> Result<PositionGrid, DecodeError> {
    let mut numbers = [0f64; 4];
    for number in &mut numbers {
        *number = if is_wide { f64::from_le_bytes(reader.array()?) } else { reader.f32()?.into() };
        invalid_if(!number.is_finite(), "a number is not finite")?;
    }
    let [x, y, z, step] = numbers;
    invalid_if(step <= 0.0, "a mesh's grid step is not positive")?;
    Ok(PositionGrid { min: [x, y, z], step, bits })
}

fn read_attribute(reader: &mut ByteReader<'_>) -> Result<Attribute, DecodeError> {
    let [kind, components, bits] = reader.array()?;
    let unknown = DecodeError::Invalid("a mesh's attribute is of an unknown kind");
    let kind = *AttributeKind::ALL.get(usize::from(kind)).ok_or(unknown)?;
    if !(1..=4).contains(&components) || !(1..=16).contains(&bits) {
        return Err(DecodeError::Invalid("a mesh's attribute must have 1 to 4 components of 1 to 16 bits"));
    }
    let range = [reader.f32()?, reader.f32()?];
    Ok(Attribute { kind, components, bits, range, values: Vec::new(), corners: Vec::new() })
}

/// Positions of real vertices that are not copies, and the triangles of real vertices.
fn remove_copies_and_dummies(
    order: Connectivity,
    points: &Points,
    originals: &[u32],
) -> (Vec<[u32; 3]>, Vec<[u32; 3]>) {
    let position = |vertex: u32| points.coordinates(vertex).map(|v| v as u32);
    if !points.has_dummies() && originals.iter().copied().eq(0..originals.len() as u32) {
        return ((0..originals.len() as u32).map(position).collect(), order.triangles);
    }
    let mut new_index = Vec::with_capacity(originals.len());
    let mut positions = Vec::with_capacity(originals.len());
    for (vertex, &original) in (0..).zip(originals) {
        if !points.is_real(vertex) {
            new_index.push(NONE);
        } else if original != vertex {
            new_index.push(new_index[original as usize]);
        } else {
            new_index.push(positions.len() as u32);
            positions.push(position(vertex));
        }
    }
    let mut triangles = order.triangles;
    let mut kept = 0;
    for t in 0..triangles.len() {
        let [a, b, c] = triangles[t];
        let [a, b, c] = [new_index[a as usize], new_index[b as usize], new_index[c as usize]];
        triangles[kept] = [a, b, c];
        kept += usize::from(a.max(b).max(c) != NONE);
    }
    triangles.truncate(kept);
    (positions, triangles)
}
