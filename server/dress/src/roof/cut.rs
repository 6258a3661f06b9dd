//! Cuts faces with shared points along the zeros of a function that is linear in each face.

use super::{RoofFault, simple};
use glam::DVec2;
use std::collections::HashMap;

/// A point of a roof.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PlanPoint {
    /// In metres from the outline's centre.
    pub(super) at: DVec2,
    /// Height, from 0 at the eaves to 1 at the top. Less than 0 only where a corner is slightly outside of its wall's line.
    pub(super) rise: f64,
}

/// A face: its outer ring counter-clockwise, then its holes clockwise, as numbers of points.
pub(super) type PlanFace = Vec<Vec<usize>>;

/// Values nearer to zero than these shares of the largest are zero. If faces are so narrow that the pieces do not fit, the
/// next one is tried.
const ZERO_SHARES: [f64; 3] = [1e-6, 1e-9, 1e-12];
/// Points on a line that are nearer than this to each other end no cut.
const MIN_CUT_M: f64 = 1e-9;

/// Cuts all faces where the function is zero and returns the pieces. `scalars` has its value at each point. Adds the points
/// where edges cross the zeros; faces with a common edge share them.
pub(super) fn cut(
    points: &mut Vec<PlanPoint>,
    faces: &[PlanFace],
    scalars: &[f64],
) -> Result<Vec<PlanFace>, RoofFault> {
    let largest = scalars.iter().fold(0.0_f64, |largest, scalar| largest.max(scalar.abs()));
    for share in ZERO_SHARES {
        let rounded = |&scalar: &f64| if scalar.abs() <= share * largest { 0.0 } else { scalar };
        let pieces = cut_rounded(points, faces, scalars.iter().map(rounded).collect());
        if pieces.is_ok() {
            return pieces;
        }
        points.truncate(scalars.len());
    }
    Err(RoofFault::Faces)
}

fn cut_rounded(
    points: &mut Vec<PlanPoint>,
    faces: &[PlanFace],
    mut scalars: Vec<f64>,
) -> Result<Vec<PlanFace>, RoofFault> {
    let mut crossings = HashMap::new();
    let mut pieces = Vec::with_capacity(faces.len() + 8);
    for face in faces {
        let has = |sign: f64| face.iter().flatten().any(|&i| scalars[i] * sign > 0.0);
        if !(has(1.0) && has(-1.0)) {
            // Neighbours may be cut through a common edge only if that has both signs, so this face stays as it is.
            pieces.push(face.clone());
            continue;
        }
        let rings: PlanFace =
            face.iter().map(|ring| with_crossings(ring, points, &mut scalars, &mut crossings)).collect();
        pieces.extend(FaceCut { points, scalars: &scalars, rings }.pieces()?);
    }
    Ok(pieces)
}

/// A ring with the points where its edges cross the zeros.
fn with_crossings(
    ring: &[usize],
    points: &mut Vec<PlanPoint>,
    scalars: &mut Vec<f64>,
    crossings: &mut HashMap<(usize, usize), usize>,
) -> Vec<usize> {
    let mut expanded = Vec::with_capacity(ring.len() + 4);
    for (i, &a) in ring.iter().enumerate() {
        let b = ring[(i + 1) % ring.len()];
        expanded.push(a);
        if scalars[a] * scalars[b] < 0.0 {
            let (low, high) = (a.min(b), a.max(b));
            expanded.push(*crossings.entry((low, high)).or_insert_with(|| {
                let share = scalars[low] / (scalars[low] - scalars[high]);
                let [from, to] = [points[low], points[high]];
                points.push(PlanPoint {
                    at: from.at.lerp(to.at, share),
                    rise: from.rise + share * (to.rise - from.rise),
                });
                scalars.push(0.0);
                points.len() - 1
            }));
        }
    }
    expanded
}

/// A face with points on both sides of the zeros, and with points on them where its edges cross.
struct FaceCut<'a> {
    points: &'a [PlanPoint],
    scalars: &'a [f64],
    rings: PlanFace,
}

impl FaceCut<'_> {
    fn pieces(&self) -> Result<Vec<PlanFace>, RoofFault> {
        let Some((along, on_line)) = self.line() else { return Ok(vec![self.rings.clone()]) };
        let is_left_positive = self.is_left_positive(along, on_line[0]);
        let [mut positive, mut negative] = [Vec::new(), Vec::new()];
        for (a, b) in edges(&self.rings) {
            let sign = self.scalars[a] + self.scalars[b];
            let is_forward = (self.at(b) - self.at(a)).dot(along) > 0.0;
            if sign > 0.0 || sign == 0.0 && is_forward == is_left_positive {
                positive.push((a, b));
            } else {
                negative.push((a, b));
            }
        }
        for (a, b) in self.chords(&on_line) {
            let (a, b) = if is_left_positive { (a, b) } else { (b, a) };
            positive.push((a, b));
            negative.push((b, a));
        }
        let mut pieces = trace_faces(self.points, &positive)?;
        pieces.extend(trace_faces(self.points, &negative)?);
        Ok(pieces)
    }

    fn at(&self, i: usize) -> DVec2 {
        self.points[i].at
    }

    /// Direction of the zeros, and the points on them in its order. `None` if they are all in one place.
    fn line(&self) -> Option<(DVec2, Vec<usize>)> {
        let mut on_line: Vec<usize> =
            self.rings.iter().flatten().copied().filter(|&i| self.scalars[i] == 0.0).collect();
        let first = self.at(*on_line.first()?);
        let far = |a: &usize, b: &usize| self.at(*a).distance(first).total_cmp(&self.at(*b).distance(first));
        let farthest = on_line.iter().copied().max_by(far)?;
        let along =
            (self.at(farthest) - first).try_normalize().filter(|_| self.at(farthest).distance(first) > MIN_CUT_M)?;
        on_line.sort_by(|&a, &b| self.at(a).dot(along).total_cmp(&self.at(b).dot(along)).then(a.cmp(&b)));
        on_line.dedup();
        Some((along, on_line))
    }

    /// Whether positive values are to the left of the line.
    fn is_left_positive(&self, along: DVec2, on_line: usize) -> bool {
        let side = |&i: &usize| along.perp_dot(self.at(i) - self.at(on_line)) * self.scalars[i].signum();
        let clearest = self.rings.iter().flatten().filter(|&&i| self.scalars[i] != 0.0).map(side);
        clearest.max_by(|a, b| a.abs().total_cmp(&b.abs())).is_some_and(|side| side > 0.0)
    }

    /// Parts of the line that are inside of the face.
    fn chords(&self, on_line: &[usize]) -> Vec<(usize, usize)> {
        let known: std::collections::HashSet<(usize, usize)> = edges(&self.rings).collect();
        let rings: Vec<Vec<DVec2>> = self.rings.iter().map(|ring| ring.iter().map(|&i| self.at(i)).collect()).collect();
        let pairs = on_line.windows(2).map(|pair| (pair[0], pair[1]));
        let is_edge = |&(a, b): &(usize, usize)| known.contains(&(a, b)) || known.contains(&(b, a));
        pairs
            .filter(|pair| !is_edge(pair))
            .filter(|&(a, b)| simple::contains(&rings, (self.at(a) + self.at(b)) / 2.0))
            .collect()
    }
}

pub(super) fn edges(rings: &[Vec<usize>]) -> impl Iterator<Item = (usize, usize)> + '_ {
    rings.iter().flat_map(|ring| ring.iter().enumerate().map(|(i, &a)| (a, ring[(i + 1) % ring.len()])))
}

/// Joins directed edges with the interior to their left to faces. Fails if they are not closed.
pub(super) fn trace_faces(points: &[PlanPoint], edges: &[(usize, usize)]) -> Result<Vec<PlanFace>, RoofFault> {
    let mut faces = Vec::new();
    let mut holes = Vec::new();
    for ring in trace_rings(points, edges)? {
        let corners: Vec<DVec2> = ring.iter().map(|&i| points[i].at).collect();
        if simple::area(&corners) > 0.0 { faces.push((vec![ring], vec![corners])) } else { holes.push((ring, corners)) }
    }
    for (ring, corners) in holes {
        let around = faces
            .iter_mut()
            .find(|(_, outer)| simple::contains(outer, (corners[0] + corners[1 % corners.len()]) / 2.0));
        around.ok_or(RoofFault::Faces)?.0.push(ring);
    }
    Ok(faces.into_iter().map(|(face, _)| face).collect())
}

/// Joins directed edges to rings, with the sharpest turn to the left where there is a choice.
fn trace_rings(points: &[PlanPoint], edges: &[(usize, usize)]) -> Result<Vec<Vec<usize>>, RoofFault> {
    let mut starts: HashMap<usize, Vec<usize>> = HashMap::new();
    for (i, (from, _)) in edges.iter().enumerate() {
        starts.entry(*from).or_default().push(i);
    }
    let mut is_used = vec![false; edges.len()];
    let mut rings = Vec::new();
    for first in 0..edges.len() {
        if is_used[first] {
            continue;
        }
        let mut ring = Vec::new();
        let mut edge = first;
        loop {
            is_used[edge] = true;
            let (from, to) = edges[edge];
            ring.push(from);
            let back = points[from].at - points[to].at;
            let choices = starts.get(&to).into_iter().flatten().copied();
            edge = choices
                .filter(|&next| !is_used[next] || next == first)
                .min_by(|&a, &b| clockwise(points, back, edges[a]).total_cmp(&clockwise(points, back, edges[b])))
                .ok_or(RoofFault::Faces)?;
            if edge == first {
                break;
            }
        }
        rings.push(ring);
    }
    Ok(rings)
}

/// Angle by which an edge is clockwise of a direction, from 0 (excluded) to a full turn.
fn clockwise(points: &[PlanPoint], back: DVec2, (from, to): (usize, usize)) -> f64 {
    let angle = -back.angle_to(points[to].at - points[from].at);
    if angle <= 0.0 { angle + std::f64::consts::TAU } else { angle }
}
