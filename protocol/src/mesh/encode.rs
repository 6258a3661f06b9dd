//! A mesh to bytes.
//!
//! In: a [`Mesh`]. Out: [`EncodedMesh`]. Next: `decode`.

use super::{
    Attribute, BUILT, MAX_ATTRIBUTES, MAX_TRIANGLES, MAX_VERTICES, Mesh, POSITION_BITS, VERSION, WIDE,
    architectural_positions, attribute_values,
    closed_mesh::ClosedMesh,
    connectivity::{self, Connectivity},
    half_edge::{HalfEdgeMesh, NONE, RepairReport},
    points::Points,
    scan_positions::{self, PLAIN, Weights},
    weld,
};
use crate::{
    codec::{
        rans::{LANES, RansEncoder},
        varint,
    },
    error::DecodeError,
};

/// Meshes of fewer vertices are coded both ways, and the shorter is taken.
const TRY_BOTH: usize = 4096;
/// Edges of larger ones, of which one must stand upright for a mesh to count as built.
const UPRIGHT: usize = 50;

/// A coded mesh.
#[derive(Debug, Clone)]
pub struct EncodedMesh {
    /// The bytes.
    pub bytes: Vec<u8>,
    /// What was mended.
    pub report: RepairReport,
    /// For each vertex that [`Mesh::decode`] gives, the one that was given.
    pub vertices: Vec<u32>,
    /// For each corner `3 t + k` that it gives, the one that was given.
    pub corners: Vec<u32>,
    /// Bits of all that is not positions and attributes, about.
    pub connectivity_bits: f64,
}

impl Mesh {
    /// All triangles but degenerate and duplicate ones, which are counted; positions and attributes exactly.
    ///
    /// # Errors
    /// What is over the format's limits, or off its own grid.
    pub fn encode(&self) -> Result<EncodedMesh, DecodeError> {
        self.check()?;
        let pieces = HalfEdgeMesh::new(&self.triangles, self.positions.len() as u32);
        let closed = ClosedMesh::new(&pieces);
        limit("a mesh's triangles", closed.triangles(), MAX_TRIANGLES)?;
        limit("a mesh's vertices", closed.vertices(), MAX_VERTICES)?;
        let mut writer = RansEncoder::with_capacity(10 * closed.vertices());
        let order = connectivity::write(&mut writer, &closed)?;
        let source = sources(&order, &closed, &pieces);
        let mut points = Points::unknown(order.degree.len(), &order.dummies, u32::from(self.grid.bits));
        let mut earliest = vec![NONE; self.positions.len()];
        let mut first: Vec<u32> = (0..order.degree.len() as u32).collect();
        let mut vertices = Vec::with_capacity(pieces.vertex.len());
        for (vertex, &source) in (0..).zip(&source) {
            if source != NONE {
                points.put(vertex, self.positions[source as usize].map(|v| v as i32))?;
                let earliest = &mut earliest[source as usize];
                if *earliest == NONE {
                    *earliest = vertex;
                    vertices.push(source);
                }
                first[vertex as usize] = *earliest;
            }
        }
        weld::code(&mut writer, &mut first, order.degree.len(), |vertex| points.is_real(vertex))?;
        let connectivity_bits = writer.bits();
        let (mut writer, weights) = geometry(writer, &order, &mut points, &first)?;
        let corners = corners(&order, &pieces);
        for attribute in &self.attributes {
            let along = corners.iter().map(|corner| attribute.corners[*corner as usize]).collect();
            let mut attribute = Attribute { corners: along, ..attribute.clone() };
            attribute_values::code(&mut writer, &order, &points, &mut attribute)?;
        }
        let mut bytes = self.header(weights.is_none(), pieces.vertex.len(), closed.triangles());
        let lanes = if weights.is_some() { LANES } else { 1 };
        if let Some(weights) = weights {
            bytes.extend(weights.as_flattened().iter().map(|weight| *weight as u8));
        }
        bytes.extend(writer.finish(lanes));
        Ok(EncodedMesh { bytes, report: pieces.report, vertices, corners, connectivity_bits })
    }

    fn check(&self) -> Result<(), DecodeError> {
        if !POSITION_BITS.contains(&self.grid.bits) {
            return Err(DecodeError::Invalid("a mesh's positions have 8 to 16 bits"));
        }
        limit("a mesh's triangles", self.triangles.len(), MAX_TRIANGLES)?;
        limit("a mesh's vertices", self.positions.len(), MAX_VERTICES)?;
        limit("a mesh's attributes", self.attributes.len(), MAX_ATTRIBUTES)?;
        for attribute in &self.attributes {
            let components = (1..=4).contains(&attribute.components) && (1..=16).contains(&attribute.bits);
            let corners = attribute.corners.len() == 3 * self.triangles.len();
            let values = attribute.corners.iter().all(|value| (*value as usize) < attribute.values.len());
            if !components || !corners || !values {
                return Err(DecodeError::Invalid("a mesh's attribute has a value of 1 to 4 numbers for each corner"));
            }
        }
        Ok(())
    }

    fn header(&self, is_built: bool, vertices: usize, triangles: usize) -> Vec<u8> {
        let narrow = self.grid.is_narrow();
        let kind = if is_built { BUILT } else { 0 } | if narrow { 0 } else { WIDE };
        let mut bytes = vec![VERSION, kind, self.grid.bits, self.attributes.len() as u8];
        for number in self.grid.min.into_iter().chain([self.grid.step]) {
            if narrow {
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

pub(super) fn limit(what: &'static str, found: usize, limit: usize) -> Result<(), DecodeError> {
    if found > limit {
        return Err(DecodeError::Limit { what, found: found as u64, limit: limit as u64 });
    }
    Ok(())
}

/// Codes positions the shorter way; no weights where that is the way of what is built.
fn geometry(
    writer: RansEncoder,
    order: &Connectivity,
    points: &mut Points,
    first: &[u32],
) -> Result<(RansEncoder, Option<Weights>), DecodeError> {
    let both = points.len() < TRY_BOTH;
    if both || is_built(order, points) {
        let mut as_built = writer.clone();
        architectural_positions::code(&mut as_built, order, points, first)?;
        let mut as_smooth = writer;
        if !both {
            return Ok((as_built, None));
        }
        let weights = scan_positions::fit(order, points);
        scan_positions::code(&mut as_smooth, order, points, &weights, first)?;
        let weights_bits = 8.0 * size_of::<Weights>() as f64;
        return Ok(if as_built.bits() <= as_smooth.bits() + weights_bits {
            (as_built, None)
        } else {
            (as_smooth, Some(weights))
        });
    }
    let mut writer = writer;
    let weights = if points.len() < 64 { PLAIN } else { scan_positions::fit(order, points) };
    scan_positions::code(&mut writer, order, points, &weights, first)?;
    Ok((writer, Some(weights)))
}

/// Whether enough edges stand upright.
fn is_built(order: &Connectivity, points: &Points) -> bool {
    let mut upright = 0;
    for triangle in &order.triangles {
        let column = |k: usize| [points.value(triangle[k], 0), points.value(triangle[k], 1)];
        let real = triangle.iter().all(|vertex| points.is_real(*vertex));
        upright += usize::from(real && (0..3).any(|k| column(k) == column((k + 1) % 3)));
    }
    upright * UPRIGHT > order.triangles.len()
}

/// For each vertex of the conquest the one that was given; none for dummies.
fn sources(order: &Connectivity, closed: &ClosedMesh, pieces: &HalfEdgeMesh) -> Vec<u32> {
    let mut sources = vec![NONE; order.degree.len()];
    for (triangle, &half_edge) in order.triangles.iter().zip(&order.source) {
        for (k, &vertex) in triangle.iter().enumerate() {
            let source = closed.origin[turn(half_edge, k) as usize];
            if source < closed.dummies_from {
                sources[vertex as usize] = pieces.vertex[source as usize];
            }
        }
    }
    sources
}

/// For each corner that will be decoded the one that was given.
fn corners(order: &Connectivity, pieces: &HalfEdgeMesh) -> Vec<u32> {
    let real = order.source.iter().filter(|half_edge| (**half_edge as usize) < pieces.corner.len());
    real.flat_map(|&half_edge| (0..3).map(move |k| pieces.corner[turn(half_edge, k) as usize])).collect()
}

/// The half-edge `k` after one in its triangle.
fn turn(half_edge: u32, k: usize) -> u32 {
    let first = half_edge - half_edge % 3;
    first + (half_edge % 3 + k as u32) % 3
}
