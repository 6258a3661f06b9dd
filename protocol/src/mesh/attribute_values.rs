//! What corners carry, along the conquest.
//!
//! In: a [`Connectivity`] with positions, and values of corners, or symbols. Out: symbols, or values. Next: a mesh's caller.
//!
//! A corner first says whether it has the value that a neighbouring triangle has at the same vertex: where all do, that is
//! next to nothing; a seam is where they do not. A new value is a difference to what its triangle says: on a plane, texture
//! coordinates go on as they began.

use super::{
    attribute::{Attribute, AttributeKind},
    connectivity::Connectivity,
    difference::DifferenceCoder,
    half_edge::{next, prev},
    points::Points,
};
use crate::{
    codec::rans::{SymbolCoder, SymbolModel},
    error::DecodeError,
};

/// Values that a corner may share: across its two edges, and the latest at its vertex.
const SHARED: usize = 3;
/// No value yet.
const UNKNOWN: u32 = u32::MAX;

type Value = [i32; 4];

/// Writes or reads one attribute. A writer's `attribute.corners` lie in the order of conquest; a reader fills them in.
pub(super) fn code<C: SymbolCoder>(
    coder: &mut C,
    mesh: &Connectivity,
    points: &Points,
    attribute: &mut Attribute,
) -> Result<(), DecodeError> {
    let mut shares = [(); 6].map(|()| SymbolModel::<4>::new(|i| [12, 2, 1, 2][i]));
    let mut differences = DifferenceCoder::new([4 * 4, 4]);
    let width = usize::from(attribute.components);
    let (wanted_values, wanted_corners) = if C::WRITES {
        (std::mem::take(&mut attribute.values), std::mem::take(&mut attribute.corners))
    } else {
        (Vec::new(), Vec::new())
    };
    let twins = mesh.twins.as_flattened();
    let corners = mesh.triangles.as_flattened();
    let mut ids = vec![UNKNOWN; corners.len()];
    let mut latest = vec![UNKNOWN; mesh.degree.len()];
    let mut values: Vec<Value> = Vec::new();
    let mut out: Vec<u32> = Vec::with_capacity(corners.len());
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        if !triangle.iter().all(|vertex| points.is_real(*vertex)) {
            continue;
        }
        let mut seam = 0;
        for k in 0..3 {
            let corner = 3 * t + k;
            let wanted: Value = if C::WRITES {
                let id = wanted_corners[out.len()] as usize;
                std::array::from_fn(|c| if c < width { wanted_values[id][c] as i32 } else { 0 })
            } else {
                [0; 4]
            };
            let beside = [
                ids[next(twins[corner]) as usize],
                ids[twins[prev(corner as u32) as usize] as usize],
                latest[corners[corner] as usize],
            ];
            let mut shared = [0u32; SHARED];
            let mut count = 0;
            for id in beside {
                if id != UNKNOWN && !shared[..count].iter().any(|other| values[*other as usize] == values[id as usize])
                {
                    shared[count] = id;
                    count += 1;
                }
            }
            let mut id = UNKNOWN;
            if count > 0 {
                let symbol = shared[..count].iter().position(|id| values[*id as usize] == wanted).unwrap_or(3);
                let symbol = coder.symbol(&mut shares[(count - 1) * 2 + seam], symbol);
                seam = usize::from(symbol != 0);
                if symbol < 3 {
                    if symbol >= count {
                        return Err(DecodeError::Invalid("a mesh's corner shares a value that is not there"));
                    }
                    id = shared[symbol];
                }
            }
            if id == UNKNOWN {
                let (guess, context) = guess(mesh, points, attribute, &ids, &values, corner);
                let mut value = [0; 4];
                for c in 0..width {
                    value[c] = differences.code(coder, [context * 4 + c, context], wanted[c], guess[c]);
                    if value[c] >> attribute.bits != 0 {
                        return Err(DecodeError::Invalid("a mesh's attribute is out of its range"));
                    }
                }
                id = values.len() as u32;
                values.push(value);
            }
            ids[corner] = id;
            latest[corners[corner] as usize] = id;
            out.push(id);
        }
        if t % 1024 == 0 && coder.overrun() {
            return Err(DecodeError::Invalid("a mesh's attributes are cut off"));
        }
    }
    attribute.values = values.into_iter().map(|value| value.map(|v| v as u32)).collect();
    attribute.corners = out;
    Ok(())
}

/// What a new value is likely to be, and how that was guessed: by nothing, by another corner, by the triangle's shape, by
/// the triangle beside it.
fn guess(
    mesh: &Connectivity,
    points: &Points,
    attribute: &Attribute,
    ids: &[u32],
    values: &[Value],
    corner: usize,
) -> (Value, usize) {
    let half = [1 << (attribute.bits - 1); 4];
    let (t, k) = (corner / 3, corner % 3);
    let value = |corner: usize| values[ids[corner] as usize];
    if k == 0 {
        return values.last().map_or((half, 0), |value| (*value, 0));
    }
    if k == 1 {
        return (value(corner - 1), 1);
    }
    let (a, b) = (value(3 * t), value(3 * t + 1));
    // The triangle beside the first edge, if it has the same values there.
    let beyond = mesh.twins[t][0];
    let (at_a, at_b, far) = (next(beyond) as usize, beyond as usize, prev(beyond) as usize);
    let known = [at_a, at_b, far].iter().all(|corner| ids[*corner] != UNKNOWN);
    let goes_on = known && value(at_a) == a && value(at_b) == b;
    let vertices = mesh.triangles[t];
    let place = |vertex: u32| -> [i64; 3] { std::array::from_fn(|axis| i64::from(points.value(vertex, axis))) };
    let (p, q, r) = (place(vertices[0]), place(vertices[1]), place(vertices[2]));
    let clamp = |v: f64| ((v + 0.5).floor() as i32).clamp(0, (1 << attribute.bits) - 1);
    if goes_on {
        let x = value(far);
        let affine = plane(p, q, place(mesh.triangles.as_flattened()[far]), r)
            .filter(|_| attribute.kind == AttributeKind::TexCoord);
        let (s, u) = affine.unwrap_or((1.0, -1.0));
        let along = |c: usize| {
            let [a, b, x] = [a[c], b[c], x[c]].map(f64::from);
            // Without a plane: the parallelogram, from the first corner.
            if affine.is_some() { a + s * (b - a) + u * (x - a) } else { a + b - x }
        };
        return (std::array::from_fn(|c| clamp(along(c))), 3);
    }
    if attribute.kind == AttributeKind::TexCoord && attribute.components == 2 {
        let edge = sub(q, p);
        let side = sub(r, p);
        let (ee, es, ss) = (dot(edge, edge) as f64, dot(edge, side) as f64, dot(side, side) as f64);
        if ee > 0.0 {
            let along = es / ee;
            let across = (ss * ee - es * es).max(0.0).sqrt() / ee;
            let (du, dv) = (f64::from(b[0] - a[0]), f64::from(b[1] - a[1]));
            let u = f64::from(a[0]) + along * du - across * dv;
            let v = f64::from(a[1]) + along * dv + across * du;
            return ([clamp(u), clamp(v), 0, 0], 2);
        }
    }
    (b, 2)
}

fn sub(a: [i64; 3], b: [i64; 3]) -> [i64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

fn dot(a: [i64; 3], b: [i64; 3]) -> i64 {
    (0..3).map(|k| a[k] * b[k]).sum()
}

/// Where `r` lies in the triangle `p q x`'s plane: so much of `q - p`, and so much of `x - p`.
fn plane(p: [i64; 3], q: [i64; 3], x: [i64; 3], r: [i64; 3]) -> Option<(f64, f64)> {
    let (e, f, d) = (sub(q, p), sub(x, p), sub(r, p));
    let [ee, ef, ff, de, df] = [dot(e, e), dot(e, f), dot(f, f), dot(d, e), dot(d, f)].map(|v| v as f64);
    let area = ee * ff - ef * ef;
    (area > 0.0).then(|| ((de * ff - df * ef) / area, (df * ee - de * ef) / area))
}
