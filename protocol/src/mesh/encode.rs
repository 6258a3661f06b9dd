//! Encoding of meshes.

use super::connectivity::{self, Connectivity};
use super::half_edge::{HalfEdgeMesh, NONE, RepairReport};
use super::points::Points;
use super::scan_prediction::Classes;
use super::scan_weights::Weights;
use super::{
    ARCHITECTURAL, Attribute, CLASSES_SHIFT, ClosedMesh, MAX_ATTRIBUTES, MAX_TRIANGLES, MAX_VERTICES, Mesh,
    POSITION_BITS, VERSION, WIDE_GRID, architectural_positions, attribute_values, scan_positions, weld,
};
use crate::codec::rans::{LANES, RansEncoder};
use crate::codec::varint;
use crate::error::{DecodeError, check_limit, invalid_if};

/// Bits of the states that scan positions have beyond the one of architectural positions.
const MORE_STATES: f64 = 32.0 * (LANES - 1) as f64;

/// If scan positions with typical weights are longer than architectural ones by this factor, no weights are fitted.
const HOPELESS: f64 = 1.4;

/// A coded mesh.
#[derive(Debug, Clone)]
pub struct EncodedMesh {
    pub bytes: Vec<u8>,
    pub report: RepairReport,
    /// For each vertex of the decoded mesh, the vertex of the input.
    pub vertices: Vec<u32>,
    /// For each corner `3 t + k` of the decoded mesh, the corner of the input.
    pub corners: Vec<u32>,
    /// Estimated bits of all but positions and attributes.
    pub connectivity_bits: f64,
}

impl Mesh {
    /// Encodes all triangles except degenerate and duplicate ones, which are counted. Positions and attributes are
    /// exact. Fails if the mesh exceeds the format's limits, if a position is off the grid, or if an attribute is
    /// inconsistent.
    pub fn encode(&self) -> Result<EncodedMesh, DecodeError> {
        self.check()?;
        let mesh = HalfEdgeMesh::new(&self.triangles, self.positions.len() as u32);
        let closed = ClosedMesh::new(&mesh);
        check_limit("the number of a mesh's triangles", closed.triangles(), MAX_TRIANGLES)?;
        check_limit("the number of a mesh's vertices", closed.vertices(), MAX_VERTICES)?;
        let mut encoder = RansEncoder::with_capacity(10 * closed.vertices());
        let order = connectivity::write(&mut encoder, &closed, !self.attributes.is_empty())?;
        let Welded { mut points, mut originals, vertices } = self.weld(&order, &closed, &mesh)?;
        weld::code(&mut encoder, &mut originals, order.degree.len(), |vertex| points.is_real(vertex))?;
        let connectivity_bits = encoder.bits();
        let (mut encoder, coder) = encode_positions(encoder, &order, &mut points, &originals)?;
        let corners = corner_sources(&order, &mesh);
        for attribute in &self.attributes {
            let in_order = corners.iter().map(|corner| attribute.corners[*corner as usize]).collect();
            let mut attribute = Attribute { corners: in_order, ..attribute.clone() };
            attribute_values::code(&mut encoder, &order, &points, &mut attribute)?;
        }
        let mut bytes = self.header(coder, mesh.vertex.len(), closed.triangles());
        let lanes = if coder == PositionCoder::Architectural { 1 } else { LANES };
        bytes.extend(encoder.finish(lanes));
        Ok(EncodedMesh { bytes, report: mesh.report, vertices, corners, connectivity_bits })
    }

    fn check(&self) -> Result<(), DecodeError> {
        invalid_if(!POSITION_BITS.contains(&self.grid.bits), "a mesh's positions must have 8 to 16 bits")?;
        check_limit("the number of a mesh's triangles", self.triangles.len(), MAX_TRIANGLES)?;
        check_limit("the number of a mesh's vertices", self.positions.len(), MAX_VERTICES)?;
        check_limit("the number of a mesh's attributes", self.attributes.len(), MAX_ATTRIBUTES)?;
        for attribute in &self.attributes {
            let components = (1..=4).contains(&attribute.components) && (1..=16).contains(&attribute.bits);
            let corners = attribute.corners.len() == 3 * self.triangles.len();
            let values = attribute.corners.iter().all(|value| (*value as usize) < attribute.values.len());
            if !components || !corners || !values {
                return Err(DecodeError::Invalid(
                    "a mesh's attribute must have a value of 1 to 4 components of 1 to 16 bits for each corner",
                ));
            }
        }
        Ok(())
    }

    /// Positions in traversal order, with copies of one input vertex welded together.
    fn weld(&self, order: &Connectivity, closed: &ClosedMesh, mesh: &HalfEdgeMesh) -> Result<Welded, DecodeError> {
        let mut points = Points::new(order.degree.len(), &order.dummies, u32::from(self.grid.bits));
        let mut earliest = vec![NONE; self.positions.len()];
        let mut originals: Vec<u32> = (0..order.degree.len() as u32).collect();
        let mut vertices = Vec::with_capacity(mesh.vertex.len());
        for (vertex, &source) in (0..).zip(&vertex_sources(order, closed, mesh)) {
            if source != NONE {
                points.set_coordinates(vertex, self.positions[source as usize].map(|v| v as i32))?;
                let earliest = &mut earliest[source as usize];
                if *earliest == NONE {
                    *earliest = vertex;
                    vertices.push(source);
                }
                originals[vertex as usize] = *earliest;
            }
        }
        Ok(Welded { points, originals, vertices })
    }

    fn header(&self, coder: PositionCoder, vertices: usize, triangles: usize) -> Vec<u8> {
        let is_narrow = self.grid.fits_f32();
        let coder = match coder {
            PositionCoder::Architectural => ARCHITECTURAL,
            PositionCoder::Scan(classes) => (classes as u8) << CLASSES_SHIFT,
        };
        let flags = coder | if is_narrow { 0 } else { WIDE_GRID };
        let mut bytes = vec![VERSION, flags, self.grid.bits, self.attributes.len() as u8];
        for number in self.grid.min.into_iter().chain([self.grid.step]) {
            if is_narrow {
                bytes.extend((number as f32).to_le_bytes());
            } else {
                bytes.extend(number.to_le_bytes());
            }
        }
        varint::push(&mut bytes, vertices as u32);
        varint::push(&mut bytes, triangles as u32);
        for attribute in &self.attributes {
            bytes.extend([attribute.kind as u8, attribute.components, attribute.bits]);
            attribute.range.iter().for_each(|number| bytes.extend(number.to_le_bytes()));
        }
        bytes
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PositionCoder {
    Architectural,
    Scan(Classes),
}

struct Welded {
    points: Points,
    /// For each vertex in traversal order, the earliest vertex with the same input vertex.
    originals: Vec<u32>,
    /// The input vertices of those that are their own original.
    vertices: Vec<u32>,
}

/// Codes positions with the shortest coder.
fn encode_positions(
    encoder: RansEncoder,
    order: &Connectivity,
    points: &mut Points,
    originals: &[u32],
) -> Result<(RansEncoder, PositionCoder), DecodeError> {
    let mut best = encoder.clone();
    architectural_positions::code(&mut best, order, points, originals)?;
    let mut coder = PositionCoder::Architectural;
    let mut least = best.bits();
    let mut untuned = encoder.clone();
    scan_positions::code(&mut untuned, order, points, &Weights::new(Classes::Edges), originals)?;
    let before = encoder.bits();
    if untuned.bits() - before > HOPELESS * (least - before) {
        return Ok((best, coder));
    }
    for classes in Classes::ALL {
        let weights = Weights::fit(order, points, classes);
        let mut scan = encoder.clone();
        scan_positions::code(&mut scan, order, points, &weights, originals)?;
        let bits = scan.bits() + MORE_STATES;
        if bits < least {
            (best, coder, least) = (scan, PositionCoder::Scan(classes), bits);
        }
    }
    Ok((best, coder))
}

/// For each vertex in traversal order, the input vertex; [`NONE`] for dummies.
fn vertex_sources(order: &Connectivity, closed: &ClosedMesh, mesh: &HalfEdgeMesh) -> Vec<u32> {
    let mut sources = vec![NONE; order.degree.len()];
    for (triangle, &half_edge) in order.triangles.iter().zip(&order.source) {
        for (k, &vertex) in triangle.iter().enumerate() {
            let source = closed.origin[advance(half_edge, k) as usize];
            if source < closed.first_dummy {
                sources[vertex as usize] = mesh.vertex[source as usize];
            }
        }
    }
    sources
}

/// For each corner of the decoded mesh, the input corner.
fn corner_sources(order: &Connectivity, mesh: &HalfEdgeMesh) -> Vec<u32> {
    let real = order.source.iter().filter(|half_edge| (**half_edge as usize) < mesh.corner.len());
    real.flat_map(|&half_edge| (0..3).map(move |k| mesh.corner[advance(half_edge, k) as usize])).collect()
}

/// The half-edge `k` steps after a half-edge in its triangle.
fn advance(half_edge: u32, k: usize) -> u32 {
    let first = half_edge - half_edge % 3;
    first + (half_edge % 3 + k as u32) % 3
}
