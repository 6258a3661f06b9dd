//! The visible parts of edges.
//!
//! A part of a surface knows which of its borders are edges of the mesh. So the visible parts of edges come with those of surfaces,
//! by the same arithmetic: no line can be hidden where its surface is seen, or the other way round.

use crate::bsp::Eye;
use crate::convex::{Convex, PagePoint};
use crate::face::NO_EDGE;
use crate::scene::{DrawnScene, SceneEdge};
use std::collections::HashMap;

/// Ends of two parts of a line that are this near are one point, in units.
const JOIN_UNITS: f64 = 8.0;
/// Shorter lines where surfaces pass through each other are not drawn, in units: rounding makes such.
const MIN_CUT_UNITS: f64 = 20_000.0;

/// The kind of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum LineRole {
    /// Where a surface turns away from the eye.
    Silhouette,
    /// Between faces at an angle.
    Crease,
    /// Where a surface ends, or another object begins.
    Border,
    /// Where surfaces pass through each other.
    Intersection,
    Hatch,
}

impl LineRole {
    /// All classes with their names in files.
    pub const NAMES: [(&str, Self); 5] = [
        ("hatch", Self::Hatch),
        ("silhouette", Self::Silhouette),
        ("crease", Self::Crease),
        ("border", Self::Border),
        ("intersection", Self::Intersection),
    ];
}

/// A part of an edge, as the border of a visible part of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct EdgePart {
    edge: u32,
    ends: [PagePoint; 2],
    /// The scene's face of which it is a border.
    face: u32,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct VisibleLine {
    pub(crate) class: LineRole,
    /// One of its faces.
    pub(crate) face: u32,
    pub(crate) ends: [PagePoint; 2],
}

/// Adds the named borders of a visible part of a face.
pub(crate) fn collect(shape: &Convex, face: u32, out: &mut Vec<EdgePart>) {
    for (i, &edge) in shape.edges.iter().enumerate() {
        if edge != NO_EDGE {
            out.push(EdgePart { edge, ends: [shape.points[i], shape.points[(i + 1) % shape.points.len()]], face });
        }
    }
}

/// The class of an edge of the mesh; `None` if it is not drawn.
pub(crate) fn class_of(scene: &DrawnScene, edge: &SceneEdge, eye: Eye, crease_deg: f64) -> Option<LineRole> {
    if edge.count == 1 {
        return Some(LineRole::Border);
    }
    let planes = edge.faces.map(|face| scene.faces[face as usize].plane);
    let is_front = planes.map(|plane| eye.is_front(&plane));
    let cosine = planes[0].normal.dot(planes[1].normal);
    if is_front[0] != is_front[1] {
        Some(LineRole::Silhouette)
    } else if scene.face_objects[edge.faces[0] as usize] != scene.face_objects[edge.faces[1] as usize] {
        Some(LineRole::Border)
    } else {
        (cosine < crease_deg.to_radians().cos()).then_some(LineRole::Crease)
    }
}

/// Joins the visible parts of each edge to lines.
///
/// Edges from `first_cut` on are cuts of the BSP tree. Where only one side of a cut is visible, another surface passes through the
/// face or hides its other side. It is drawn where `meetings`, for the index of the cut and the face, has lines in which others
/// pass through the face.
pub(crate) fn visible_lines(
    mut parts: Vec<EdgePart>,
    first_cut: u32,
    class_of: impl Fn(u32) -> Option<LineRole>,
    meetings: impl Fn(u32, u32) -> Vec<[PagePoint; 2]>,
) -> Vec<VisibleLine> {
    parts.sort_by_key(|part| part.edge);
    let mut lines = Vec::new();
    for parts in parts.chunk_by(|a, b| a.edge == b.edge) {
        let edge = parts[0].edge;
        if edge >= first_cut {
            cut_lines(parts, || meetings(edge - first_cut, parts[0].face), &mut lines);
        } else if let Some(class) = class_of(edge) {
            let line = EdgeDirection::of(parts);
            let all = joined(parts.iter().map(|part| line.interval(part).0).collect());
            lines.extend(all.into_iter().map(|[a, b]| VisibleLine { class, face: parts[0].face, ends: [a.1, b.1] }));
        }
    }
    lines
}

/// A position along a line, and the point there.
type At = (f64, PagePoint);

struct EdgeDirection {
    origin: PagePoint,
    x: f64,
    y: f64,
}

impl EdgeDirection {
    /// That of the longest part.
    fn of(parts: &[EdgePart]) -> Self {
        let vector = |part: &EdgePart| {
            let [a, b] = part.ends;
            [f64::from(b.x) - f64::from(a.x), f64::from(b.y) - f64::from(a.y)]
        };
        let length = |part: &&EdgePart| vector(part)[0].hypot(vector(part)[1]);
        let longest = parts.iter().max_by(|a, b| length(a).total_cmp(&length(b))).unwrap_or(&parts[0]);
        let ([x, y], length) = (vector(longest), length(&longest).max(1.0));
        Self { origin: longest.ends[0], x: x / length, y: y / length }
    }

    fn at(&self, point: PagePoint) -> At {
        let (x, y) = (f64::from(point.x) - f64::from(self.origin.x), f64::from(point.y) - f64::from(self.origin.y));
        (self.x * x + self.y * y, point)
    }

    /// Both ends in order, and whether they were in order.
    fn interval(&self, part: &EdgePart) -> ([At; 2], bool) {
        let [a, b] = part.ends.map(|point| self.at(point));
        if a.0 <= b.0 { ([a, b], true) } else { ([b, a], false) }
    }
}

/// The union of intervals.
fn joined(mut intervals: Vec<[At; 2]>) -> Vec<[At; 2]> {
    intervals.sort_by(|a, b| a[0].0.total_cmp(&b[0].0));
    let mut joined: Vec<[At; 2]> = Vec::new();
    for interval in intervals {
        match joined.last_mut() {
            Some(last) if interval[0].0 <= last[1].0 + JOIN_UNITS => {
                if interval[1].0 > last[1].0 {
                    last[1] = interval[1];
                }
            }
            _ => joined.push(interval),
        }
    }
    joined
}

/// Subtracts `others` from `intervals`. Both are sorted and disjoint.
fn without(intervals: &[[At; 2]], others: &[[At; 2]]) -> Vec<[At; 2]> {
    let mut left = Vec::new();
    for interval in intervals {
        let mut start = interval[0];
        for other in others.iter().filter(|other| other[1].0 > interval[0].0 && other[0].0 < interval[1].0) {
            if other[0].0 > start.0 {
                left.push([start, other[0]]);
            }
            if other[1].0 > start.0 {
                start = other[1];
            }
        }
        if start.0 < interval[1].0 {
            left.push([start, interval[1]]);
        }
    }
    left.retain(|[a, b]| b.0 - a.0 > MIN_CUT_UNITS);
    left
}

/// What `intervals` and `others` have in common. `others` are sorted and disjoint.
fn within(intervals: &[[At; 2]], others: &[[At; 2]]) -> Vec<[At; 2]> {
    let common = |a: &[At; 2], b: &[At; 2]| {
        let start = if a[0].0 >= b[0].0 { a[0] } else { b[0] };
        let end = if a[1].0 <= b[1].0 { a[1] } else { b[1] };
        (end.0 - start.0 > MIN_CUT_UNITS).then_some([start, end])
    };
    intervals.iter().flat_map(|a| others.iter().filter_map(move |b| common(a, b))).collect()
}

fn cut_lines(parts: &[EdgePart], meetings: impl FnOnce() -> Vec<[PagePoint; 2]>, lines: &mut Vec<VisibleLine>) {
    let line = EdgeDirection::of(parts);
    let mut sides = [Vec::new(), Vec::new()];
    for part in parts {
        let (interval, is_forward) = line.interval(part);
        sides[usize::from(is_forward)].push(interval);
    }
    let [backward, forward] = sides.map(joined);
    let one_sided = [without(&forward, &backward), without(&backward, &forward)].concat();
    if one_sided.is_empty() {
        return;
    }
    let meetings = meetings().into_iter().map(|ends| {
        let [a, b] = ends.map(|point| line.at(point));
        if a.0 <= b.0 { [a, b] } else { [b, a] }
    });
    for [a, b] in within(&one_sided, &joined(meetings.collect())) {
        lines.push(VisibleLine { class: LineRole::Intersection, face: parts[0].face, ends: [a.1, b.1] });
    }
}

/// Joins lines that meet at their ends to chains. Each line is in one chain.
pub(crate) fn chains(lines: &[[PagePoint; 2]]) -> Vec<Vec<PagePoint>> {
    let mut at: HashMap<PagePoint, Vec<usize>> = HashMap::new();
    for (index, ends) in lines.iter().enumerate() {
        ends.iter().for_each(|end| at.entry(*end).or_default().push(index));
    }
    let mut is_used = vec![false; lines.len()];
    let mut follow = |chain: &mut Vec<PagePoint>, is_used: &mut Vec<bool>| {
        while let Some(end) = chain.last().copied() {
            let next = at.get_mut(&end).and_then(|found| {
                while let Some(index) = found.pop() {
                    if !is_used[index] {
                        return Some(index);
                    }
                }
                None
            });
            let Some(index) = next else { return };
            is_used[index] = true;
            chain.push(if lines[index][0] == end { lines[index][1] } else { lines[index][0] });
        }
    };
    let mut chains = Vec::new();
    for first in 0..lines.len() {
        if is_used[first] {
            continue;
        }
        is_used[first] = true;
        let mut chain = vec![lines[first][1], lines[first][0]];
        follow(&mut chain, &mut is_used);
        chain.reverse();
        follow(&mut chain, &mut is_used);
        chains.push(chain);
    }
    chains
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(edge: u32, a: i32, b: i32) -> EdgePart {
        EdgePart { edge, ends: [PagePoint::new(a, 0), PagePoint::new(b, 0)], face: 0 }
    }

    #[test]
    fn parts_of_an_edge_are_joined_and_cuts_show_where_one_side_is_hidden() {
        let k = 100_000;
        let parts = vec![
            part(1, 0, k),
            part(2, 0, k),
            part(1, 3 * k, 2 * k),
            part(1, k, 2 * k),
            part(5, 0, 3 * k),
            part(5, k, 0),
        ];
        let meetings = |_, _| {
            vec![
                [PagePoint::new(9 * k, 0), PagePoint::new(2 * k, 0)],
                [PagePoint::new(-k, 0), PagePoint::new(k / 2, 0)],
            ]
        };
        let lines = visible_lines(parts, 5, |edge| (edge == 1).then_some(LineRole::Crease), meetings);
        let ends: Vec<_> = lines.iter().map(|line| (line.class, line.ends.map(|end| end.x))).collect();
        assert_eq!(ends, [(LineRole::Crease, [0, 3 * k]), (LineRole::Intersection, [2 * k, 3 * k])]);
    }

    #[test]
    fn lines_become_chains() {
        let at = |x: i32| PagePoint::new(x, 0);
        let chains = chains(&[[at(1), at(2)], [at(3), at(2)], [at(0), at(1)], [at(7), at(8)]]);
        assert_eq!(chains.iter().map(Vec::len).collect::<Vec<_>>(), [4, 2]);
    }
}
