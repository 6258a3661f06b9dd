//! Attribute values of corners, coded in traversal order.
//!
//! A corner first codes whether it has the value of a neighbouring triangle at the same vertex. This costs next to
//! nothing except at seams. A new value is coded as a difference from a prediction by its triangle: texture coordinates
//! are continued linearly across a plane.

use super::DifferenceCoder;
use super::attribute::{Attribute, AttributeKind};
use super::connectivity::Connectivity;
use super::half_edge::{next, prev};
use super::points::Points;
use crate::codec::rans::{SymbolCoder, SymbolModel};
use crate::error::{DecodeError, invalid_if};

/// Number of values that a corner may share: across its two edges, and the latest at its vertex.
const SHARED: usize = 3;
/// Symbol of a corner that shares no value.
const NEW_VALUE: usize = 3;
/// Marks a corner or vertex without a value.
const UNKNOWN: u32 = u32::MAX;
/// Number of values of [`PredictedBy`].
const PREDICTIONS: usize = 4;

type Value = [i32; 4];

/// How a value was predicted; selects the models of the difference.
#[derive(Debug, Clone, Copy)]
enum PredictedBy {
    /// The last value, or none.
    LastValue = 0,
    FirstCorner = 1,
    /// The shape of the triangle, or its second corner.
    OwnTriangle = 2,
    /// The triangle beyond the first edge.
    Neighbour = 3,
}

/// Writes or reads one attribute. A writer's `attribute.corners` are in traversal order; a reader fills in values and
/// corners. Fails on values outside the attribute's bits, on shared values that do not exist and on truncated symbols.
pub(super) fn code<C: SymbolCoder>(
    coder: &mut C,
    mesh: &Connectivity,
    points: &Points,
    attribute: &mut Attribute,
) -> Result<(), DecodeError> {
    let (given_values, given_corners) = if C::WRITES {
        (std::mem::take(&mut attribute.values), std::mem::take(&mut attribute.corners))
    } else {
        (Vec::new(), Vec::new())
    };
    let corners = 3 * mesh.triangles.len();
    let mut values = ValueCoder {
        mesh,
        points,
        attribute,
        share_models: [(); 2 * SHARED].map(|()| SymbolModel::new(|i| [12, 2, 1, 2][i])),
        differences: DifferenceCoder::new([PREDICTIONS * 4, PREDICTIONS]),
        ids: vec![UNKNOWN; corners],
        latest: vec![UNKNOWN; mesh.degree.len()],
        values: Vec::new(),
    };
    let mut out: Vec<u32> = Vec::with_capacity(corners);
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        if !triangle.iter().all(|vertex| points.is_real(*vertex)) {
            continue;
        }
        let mut at_seam = false;
        for corner in 3 * t..3 * t + 3 {
            let target =
                if C::WRITES { values.target(&given_values[given_corners[out.len()] as usize]) } else { [0; 4] };
            out.push(values.code_corner(coder, corner, target, &mut at_seam)?);
        }
        invalid_if(t % 1024 == 0 && coder.overrun(), "a mesh's attributes are truncated")?;
    }
    attribute.values = values.values.into_iter().map(|value| value.map(|v| v as u32)).collect();
    attribute.corners = out;
    Ok(())
}

struct ValueCoder<'a> {
    mesh: &'a Connectivity,
    points: &'a Points,
    attribute: &'a Attribute,
    /// By number of values that may be shared, and whether the triangle has a seam.
    share_models: [SymbolModel<4>; 2 * SHARED],
    differences: DifferenceCoder,
    /// For each corner, its value.
    ids: Vec<u32>,
    /// For each vertex, its latest value.
    latest: Vec<u32>,
    /// Values in the order of their first use.
    values: Vec<Value>,
}

impl ValueCoder<'_> {
    /// A given value, reduced to the used components.
    fn target(&self, value: &[u32; 4]) -> Value {
        let width = usize::from(self.attribute.components);
        std::array::from_fn(|c| if c < width { value[c] as i32 } else { 0 })
    }

    /// Codes the value of one corner and returns its index. Sets `at_seam` to whether the corner shares its first
    /// candidate, if there is a candidate.
    #[inline]
    fn code_corner<C: SymbolCoder>(
        &mut self,
        coder: &mut C,
        corner: usize,
        target: Value,
        at_seam: &mut bool,
    ) -> Result<u32, DecodeError> {
        let vertex = self.mesh.triangles.as_flattened()[corner] as usize;
        let (shared, count) = self.candidates(corner, vertex);
        let mut id = UNKNOWN;
        if count > 0 {
            let symbol = shared[..count].iter().position(|id| self.values[*id as usize] == target).unwrap_or(NEW_VALUE);
            let model = &mut self.share_models[(count - 1) * 2 + usize::from(*at_seam)];
            let symbol = coder.symbol(model, symbol);
            *at_seam = symbol != 0;
            if symbol != NEW_VALUE {
                invalid_if(symbol >= count, "a mesh's corner shares a value that does not exist")?;
                id = shared[symbol];
            }
        }
        if id == UNKNOWN {
            id = self.code_new_value(coder, corner, target)?;
        }
        self.ids[corner] = id;
        self.latest[vertex] = id;
        Ok(id)
    }

    /// The distinct values that a corner may share, and their number.
    #[inline]
    fn candidates(&self, corner: usize, vertex: usize) -> ([u32; SHARED], usize) {
        let twins = self.mesh.twins.as_flattened();
        let neighbours = [
            self.ids[next(twins[corner]) as usize],
            self.ids[twins[prev(corner as u32) as usize] as usize],
            self.latest[vertex],
        ];
        let mut shared = [0u32; SHARED];
        let mut count = 0;
        for id in neighbours {
            let is_equal = |other: &u32| self.values[*other as usize] == self.values[id as usize];
            if id != UNKNOWN && !shared[..count].iter().any(is_equal) {
                shared[count] = id;
                count += 1;
            }
        }
        (shared, count)
    }

    fn code_new_value<C: SymbolCoder>(
        &mut self,
        coder: &mut C,
        corner: usize,
        target: Value,
    ) -> Result<u32, DecodeError> {
        let (prediction, by) = self.predict(corner);
        let mut value = [0; 4];
        for c in 0..usize::from(self.attribute.components) {
            let contexts = [by as usize * 4 + c, by as usize];
            value[c] = self.differences.code(coder, contexts, target[c], prediction[c]);
            invalid_if(value[c] >> self.attribute.bits != 0, "a mesh's attribute has a value outside its bits")?;
        }
        self.values.push(value);
        Ok(self.values.len() as u32 - 1)
    }

    fn value(&self, corner: usize) -> Value {
        self.values[self.ids[corner] as usize]
    }

    /// Predicts a new value of a corner.
    fn predict(&self, corner: usize) -> (Value, PredictedBy) {
        let first = corner - corner % 3;
        match corner % 3 {
            0 => {
                let half = [1 << (self.attribute.bits - 1); 4];
                (self.values.last().copied().unwrap_or(half), PredictedBy::LastValue)
            }
            1 => (self.value(first), PredictedBy::FirstCorner),
            _ => {
                let (a, b) = (self.value(first), self.value(first + 1));
                if let Some(value) = self.predict_across_edge(first, a, b) {
                    (value, PredictedBy::Neighbour)
                } else {
                    (self.predict_by_shape(first, a, b).unwrap_or(b), PredictedBy::OwnTriangle)
                }
            }
        }
    }

    /// Predicts the third corner from the triangle beyond the first edge, if that has the values `a` and `b` there.
    fn predict_across_edge(&self, first: usize, a: Value, b: Value) -> Option<Value> {
        let twin = self.mesh.twins[first / 3][0];
        let (at_a, at_b, far) = (next(twin) as usize, twin as usize, prev(twin) as usize);
        let is_known = [at_a, at_b, far].iter().all(|corner| self.ids[*corner] != UNKNOWN);
        if !is_known || self.value(at_a) != a || self.value(at_b) != b {
            return None;
        }
        let far_value = self.value(far);
        let [p, q, r] = self.positions(first);
        let affine = if self.attribute.kind == AttributeKind::TexCoord {
            affine_coordinates(p, q, self.position(far), r)
        } else {
            None
        };
        Some(std::array::from_fn(|c| {
            let [a, b, x] = [a[c], b[c], far_value[c]].map(f64::from);
            self.round(match affine {
                Some((s, u)) => a + s * (b - a) + u * (x - a),
                // The parallelogram.
                None => a + b - x,
            })
        }))
    }

    /// Predicts the third texture coordinate from the triangle's edge lengths and angles in space.
    fn predict_by_shape(&self, first: usize, a: Value, b: Value) -> Option<Value> {
        if self.attribute.kind != AttributeKind::TexCoord || self.attribute.components != 2 {
            return None;
        }
        let [p, q, r] = self.positions(first);
        let edge = sub(q, p);
        let side = sub(r, p);
        let (ee, es, ss) = (dot(edge, edge) as f64, dot(edge, side) as f64, dot(side, side) as f64);
        if ee <= 0.0 {
            return None;
        }
        let along = es / ee;
        let across = (ss * ee - es * es).max(0.0).sqrt() / ee;
        let (du, dv) = (f64::from(b[0] - a[0]), f64::from(b[1] - a[1]));
        let u = f64::from(a[0]) + along * du - across * dv;
        let v = f64::from(a[1]) + along * dv + across * du;
        Some([self.round(u), self.round(v), 0, 0])
    }

    fn round(&self, v: f64) -> i32 {
        ((v + 0.5).floor() as i32).clamp(0, (1 << self.attribute.bits) - 1)
    }

    fn position(&self, corner: usize) -> [i64; 3] {
        self.points.coordinates(self.mesh.triangles.as_flattened()[corner]).map(i64::from)
    }

    fn positions(&self, first: usize) -> [[i64; 3]; 3] {
        [first, first + 1, first + 2].map(|corner| self.position(corner))
    }
}

fn sub(a: [i64; 3], b: [i64; 3]) -> [i64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

fn dot(a: [i64; 3], b: [i64; 3]) -> i64 {
    (0..3).map(|k| a[k] * b[k]).sum()
}

/// The factors of `q - p` and of `x - p` that give `r - p`, projected to their plane. `None` if the vectors are
/// parallel.
fn affine_coordinates(p: [i64; 3], q: [i64; 3], x: [i64; 3], r: [i64; 3]) -> Option<(f64, f64)> {
    let (e, f, d) = (sub(q, p), sub(x, p), sub(r, p));
    let [ee, ef, ff, de, df] = [dot(e, e), dot(e, f), dot(f, f), dot(d, e), dot(d, f)].map(|v| v as f64);
    let area = ee * ff - ef * ef;
    (area > 0.0).then(|| ((de * ff - df * ef) / area, (df * ee - de * ef) / area))
}
