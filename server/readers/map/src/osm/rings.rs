//! Rings of a multipolygon from its member ways: in any order and direction, touching, sharing stretches.
//!
//! Segments that two ways share cancel out, so that neighbouring holes become one. What is left has an even number of
//! segments at each node, or a ring is not closed. Where more than two meet, neighbours by angle are joined: rings then touch
//! but do not cross.

use super::classes::NOT_CLOSED;
use super::nesting::{self, Polygon};
use super::nodes::NodeStore;
use std::collections::HashMap;

pub(super) const OUTSIDE: &str = "outside of the extract";
pub(super) const TOO_FEW: &str = "ring has fewer than three points";

/// The polygons of ways. Fails with the reason if they make none.
pub(super) fn polygons<'w>(
    ways: impl Iterator<Item = &'w [i64]>,
    nodes: &NodeStore,
) -> Result<Vec<Polygon>, &'static str> {
    let mut segments = Vec::new();
    for way in ways {
        let (mut near, mut before) = (0, None);
        for id in way {
            let node = nodes.place(*id, &mut near).ok_or(OUTSIDE)?;
            if let Some(before) = before.filter(|before| *before != node) {
                segments.push([node.min(before), node.max(before)]);
            }
            before = Some(node);
        }
    }
    cancel_pairs(&mut segments);
    if segments.is_empty() {
        return Err(TOO_FEW);
    }
    let joined = join(&segments, nodes)?;
    let rings = walk(&segments, &joined);
    let rings = rings.into_iter().map(|ring| ring.into_iter().map(|node| nodes.at(node)).collect()).collect();
    nesting::group(rings)
}

/// Leaves one of each segment that is there an odd number of times.
fn cancel_pairs(segments: &mut Vec<[u32; 2]>) {
    segments.sort_unstable();
    let mut kept = 0;
    let mut i = 0;
    while i < segments.len() {
        let run = segments[i..].iter().take_while(|segment| **segment == segments[i]).count();
        if run % 2 == 1 {
            segments[kept] = segments[i];
            kept += 1;
        }
        i += run;
    }
    segments.truncate(kept);
}

/// For each end of a segment (`2 * segment + end`) the end that goes on from there. Fails if an end has none.
fn join(segments: &[[u32; 2]], nodes: &NodeStore) -> Result<Vec<u32>, &'static str> {
    let mut ends: Vec<(u32, u32)> = Vec::with_capacity(segments.len() * 2);
    for (i, [a, b]) in segments.iter().enumerate() {
        ends.extend([(*a, 2 * i as u32), (*b, 2 * i as u32 + 1)]);
    }
    ends.sort_unstable();
    let mut joined = vec![0; ends.len()];
    let mut i = 0;
    while i < ends.len() {
        let node = ends[i].0;
        let count = ends[i..].iter().take_while(|(other, _)| *other == node).count();
        if count % 2 == 1 {
            return Err(NOT_CLOSED);
        }
        let meeting = &mut ends[i..i + count];
        if count > 2 {
            let [x, y] = nodes.at(node).map(f64::from);
            let angle = |end: u32| {
                let [a, b] = segments[end as usize / 2];
                let other = nodes.at(if end & 1 == 0 { b } else { a });
                libm::atan2(f64::from(other[1]) - y, f64::from(other[0]) - x)
            };
            meeting.sort_by(|(_, a), (_, b)| angle(*a).total_cmp(&angle(*b)));
        }
        for pair in meeting.chunks_exact(2) {
            let (a, b) = (pair[0].1, pair[1].1);
            (joined[a as usize], joined[b as usize]) = (b, a);
        }
        i += count;
    }
    Ok(joined)
}

/// The closed walks along joined segments, cut where they meet themselves, each closed by its first node.
fn walk(segments: &[[u32; 2]], joined: &[u32]) -> Vec<Vec<u32>> {
    let mut is_walked = vec![false; segments.len()];
    let mut rings = Vec::new();
    for first in 0..segments.len() {
        if is_walked[first] {
            continue;
        }
        let mut path: Vec<u32> = vec![segments[first][0]];
        let mut place_on_path = HashMap::from([(segments[first][0], 0_usize)]);
        let mut end = 2 * first as u32;
        while !is_walked[end as usize / 2] {
            is_walked[end as usize / 2] = true;
            let far_end = end ^ 1;
            let node = segments[far_end as usize / 2][far_end as usize % 2];
            if let Some(place) = place_on_path.get(&node).copied() {
                let mut ring: Vec<u32> = path.drain(place + 1..).collect();
                ring.iter().for_each(|node| {
                    place_on_path.remove(node);
                });
                ring.insert(0, node);
                ring.push(node);
                rings.push(ring);
            } else {
                place_on_path.insert(node, path.len());
                path.push(node);
            }
            end = joined[far_end as usize];
        }
    }
    rings
}
