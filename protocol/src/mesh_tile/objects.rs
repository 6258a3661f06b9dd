//! The object of each triangle of a mesh tile, in a section of its own.
//!
//! A triangle most often shows the same object as the last one at one of its vertices, in the order in which the mesh is coded.

use crate::codec::object_names::{Naming, code_list};
use crate::codec::range::BitCoder;
use crate::error::DecodeError;

/// Writes or reads the object of each triangle. Fails if no triangle has an object.
pub(super) fn code<C: BitCoder>(
    coder: &mut C,
    triangles: &[[u32; 3]],
    vertices: usize,
    objects: &[u32],
) -> Result<Vec<u32>, DecodeError> {
    let list = code_list(coder, if C::WRITES { distinct(objects) } else { Vec::new() }, triangles.len())?;
    let mut naming = Naming::new(coder, &list);
    // One more than the last triangle at each vertex.
    let mut last = vec![0usize; vertices];
    let mut out: Vec<u32> = Vec::with_capacity(triangles.len());
    for (t, triangle) in triangles.iter().enumerate() {
        let mut before = triangle.map(|vertex| last[vertex as usize]);
        before.sort_unstable_by(|a, b| b.cmp(a));
        let known = before.iter().filter(|t| **t > 0).count();
        let agree = before[..known].windows(2).all(|pair| out[pair[0] - 1] == out[pair[1] - 1]);
        let context = known + if agree { 4 } else { 0 };
        let candidates: [Option<u32>; 3] = before.map(|t| t.checked_sub(1).map(|t| out[t]));
        let value = objects.get(t).copied().unwrap_or(0);
        out.push(naming.name(0, context, candidates.into_iter().flatten(), value));
        triangle.iter().for_each(|vertex| last[*vertex as usize] = t + 1);
    }
    Ok(out)
}

fn distinct(objects: &[u32]) -> Vec<u32> {
    let mut list: Vec<u32> = objects.iter().copied().filter(|object| *object != super::NO_OBJECT).collect();
    list.sort_unstable();
    list.dedup();
    list
}
