//! Roofs from the straight skeleton: hipped, or with gables at the ends of ridges.

use super::plan::{Plan, PlanPoint};
use super::simplify::{self, Side};
use super::skeleton::skeleton;
use super::{HALF_HIP_RISE, Outline, RoofFault};
use glam::DVec2;

/// The walls beside a gable are antiparallel but for an angle of this cosine.
const PARALLEL_COSINE: f64 = 0.85;
/// The walls beside a gable make an angle with it of at least this sine.
const CORNER_SINE: f64 = 0.7;
/// Least distance of a gable's top from the ends of its wall, as a share of the wall.
const GABLE_MARGIN: f64 = 0.1;
/// Points of a wall that are nearer than this to a corner are that corner.
const SAME_M: f64 = 1e-4;
/// Heights of a gable's top, as shares of the ridge's height behind it.
const GABLE_RISE: std::ops::RangeInclusive<f64> = 0.4..=1.4;

/// A roof with equal slopes from all walls.
pub(super) fn hipped(outline: &Outline) -> Result<Plan, RoofFault> {
    with_either(outline, |is_exact| SkeletonRoof::new(outline, is_exact)?.into_plan())
}

/// A hipped roof whose triangles at the ends of ridges are replaced by gables, or by half-hips.
pub(super) fn gabled(outline: &Outline, is_half_hipped: bool) -> Result<Plan, RoofFault> {
    with_either(outline, |is_exact| {
        let mut roof = SkeletonRoof::new(outline, is_exact)?;
        let length = |side: &Side| roof.points[side.from].at.distance(roof.points[side.to].at);
        let mut order: Vec<(f64, usize)> = roof.sides.iter().enumerate().map(|(i, side)| (length(side), i)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for (_, side) in order {
            if let Some(gable) = roof.gable(side) {
                roof.raise(side, &gable, is_half_hipped);
            }
        }
        roof.into_plan()
    })
}

/// A roof over straight walls, or over all edges if that fails.
fn with_either(outline: &Outline, plan: impl Fn(bool) -> Result<Plan, RoofFault>) -> Result<Plan, RoofFault> {
    let checked = |is_exact: bool| plan(is_exact).and_then(Plan::checked);
    let straight = simplify::sides(outline, false).len();
    match checked(false) {
        Err(_) if straight < outline.given.len() => checked(true),
        result => result,
    }
}

/// A skeleton's faces over the sides of an outline. Rises are in metres.
struct SkeletonRoof {
    sides: Vec<Side>,
    points: Vec<PlanPoint>,
    /// For each side the parts of its face; the first begins with the side's corners. None for a gable.
    faces: Vec<Vec<Vec<usize>>>,
    has_gable: Vec<bool>,
}

/// A vertical end of a ridge.
struct Gable {
    /// Where the ridge ends in the hipped roof.
    ridge_end: usize,
    /// Where it meets the wall.
    top: PlanPoint,
}

impl SkeletonRoof {
    fn new(outline: &Outline, is_exact: bool) -> Result<Self, RoofFault> {
        let sides = simplify::sides(outline, is_exact);
        let corners = outline.corners();
        let mut rings: Vec<Vec<DVec2>> = Vec::new();
        for (i, side) in sides.iter().enumerate() {
            // The first side of a ring has the last one before it.
            if side.previous >= i {
                rings.push(Vec::new());
            }
            if let Some(ring) = rings.last_mut() {
                ring.push(corners[side.from]);
            }
        }
        let skeleton = skeleton(&rings)?;
        let mut points: Vec<PlanPoint> = corners.iter().map(|&at| PlanPoint { at, rise: 0.0 }).collect();
        points.extend(&skeleton.nodes[sides.len()..]);
        let number = |node: usize| sides.get(node).map_or(corners.len() + node - sides.len(), |side| side.from);
        let mut faces = skeleton.faces;
        faces.iter_mut().flatten().flatten().for_each(|node| *node = number(*node));
        let mut roof = Self { has_gable: vec![false; sides.len()], sides, points, faces };
        roof.add_between();
        Ok(roof)
    }

    /// Adds the corners on straight walls to the faces above, in their planes.
    fn add_between(&mut self) {
        for side in 0..self.sides.len() {
            for corner in self.sides[side].between.clone() {
                self.points[corner].rise = self.height_above(side, self.points[corner].at);
            }
            let between = self.sides[side].between.iter().copied();
            if let Some(face) = self.faces[side].first_mut() {
                face.splice(1..1, between);
            }
        }
    }

    fn direction(&self, side: usize) -> DVec2 {
        let Side { from, to, .. } = self.sides[side];
        (self.points[to].at - self.points[from].at).normalize_or_zero()
    }

    /// Height of the plane that rises from a side, which is the distance from its line.
    fn height_above(&self, side: usize, at: DVec2) -> f64 {
        self.direction(side).perp_dot(at - self.points[self.sides[side].from].at)
    }

    /// Corners of a side's wall, with its ends.
    fn wall(&self, side: usize) -> Vec<usize> {
        let Side { from, to, ref between, .. } = self.sides[side];
        [from].iter().chain(between).chain(&[to]).copied().collect()
    }

    /// The gable that may replace the face of a side.
    fn gable(&self, side: usize) -> Option<Gable> {
        let Side { from, to, ref between, previous, next } = self.sides[side];
        let [face] = &self.faces[side][..] else { return None };
        let &[.., last, ridge_end] = &face[..] else { return None };
        if self.has_gable[previous] || self.has_gable[next] || last != to || face.len() != between.len() + 3 {
            return None;
        }
        let [along, before, after] = [side, previous, next].map(|side| self.direction(side));
        let is_end = before.dot(after) < -PARALLEL_COSINE
            && before.perp_dot(along) > CORNER_SINE
            && along.perp_dot(after) > CORNER_SINE;
        let is_between = has_edge(&self.faces[previous], from, ridge_end) && has_edge(&self.faces[next], ridge_end, to);
        if !is_end || !is_between {
            return None;
        }
        // Points of the ridge are equally far from both walls.
        let ridge = (before - after).try_normalize()?;
        let end = self.points[ridge_end];
        let at = self.wall_crossing(side, |corner| ridge.perp_dot(corner - end.at))?;
        let top = PlanPoint { at, rise: self.height_above(previous, at) };
        let share = (at - self.points[from].at).dot(along) / self.points[from].at.distance(self.points[to].at);
        let is_within = (GABLE_MARGIN..=1.0 - GABLE_MARGIN).contains(&share);
        (is_within && GABLE_RISE.contains(&(top.rise / end.rise))).then_some(Gable { ridge_end, top })
    }

    /// Where the wall of a side crosses a line. `distance` gives the distance of a corner from the line.
    fn wall_crossing(&self, side: usize, distance: impl Fn(DVec2) -> f64) -> Option<DVec2> {
        let crossing = |pair: &[usize]| {
            let [a, b] = [self.points[pair[0]].at, self.points[pair[1]].at];
            let [s, t] = [a, b].map(&distance);
            (s * t <= 0.0 && s != t).then(|| a.lerp(b, s / (s - t)))
        };
        self.wall(side).windows(2).find_map(crossing)
    }

    /// Replaces the face of a side by a gable.
    fn raise(&mut self, side: usize, gable: &Gable, is_half_hipped: bool) {
        self.has_gable[side] = true;
        self.faces[side].clear();
        if !is_half_hipped || !self.raise_half(side, gable) {
            let top = self.wall_point(side, gable.top);
            let (mut right, mut left) = self.wall_parts(side, gable.top.at, gable.top.at);
            right.push(top);
            left.insert(0, top);
            self.replace_edges(side, gable.ridge_end, right, left);
        }
    }

    /// Ends both neighbouring faces at a gable. `right` leads from the side's first corner to the ridge, `left` from there to
    /// the last corner.
    fn replace_edges(&mut self, side: usize, ridge_end: usize, right: Vec<usize>, left: Vec<usize>) {
        let Side { from, to, previous, next, .. } = self.sides[side];
        self.lift(previous, &right);
        self.lift(next, &left);
        // The end of the ridge is needed only if it is a corner of other faces too.
        let others = self.faces.iter().enumerate().filter(|&(i, _)| i != previous && i != next);
        let is_needed = others.flat_map(|(_, face)| face).any(|ring| ring.contains(&ridge_end));
        let dropped = (!is_needed).then_some(ridge_end);
        replace_edge(&mut self.faces[previous], (from, ridge_end), &right[1..], dropped);
        replace_edge(&mut self.faces[next], (ridge_end, to), &left[..left.len() - 1], dropped);
    }

    /// Lifts the straight corners of a wall into the plane of a side.
    fn lift(&mut self, plane: usize, corners: &[usize]) {
        let count = self.corner_count();
        for &corner in corners.iter().filter(|&&corner| corner < count) {
            let is_end = [self.sides[plane].from, self.sides[plane].to].contains(&corner);
            self.points[corner].rise = if is_end { 0.0 } else { self.height_above(plane, self.points[corner].at) };
        }
    }

    fn corner_count(&self) -> usize {
        self.sides.iter().map(|side| side.between.len() + 1).sum()
    }

    /// Corners of a wall before one point and after another.
    fn wall_parts(&self, side: usize, before: DVec2, after: DVec2) -> (Vec<usize>, Vec<usize>) {
        let along = self.direction(side);
        let place = |at: DVec2| at.dot(along);
        let wall = self.wall(side);
        let at = |&i: &usize| place(self.points[i].at);
        let right = wall.iter().copied().filter(|i| at(i) < place(before) - SAME_M).collect();
        let left = wall.iter().copied().filter(|i| at(i) > place(after) + SAME_M).collect();
        (right, left)
    }

    /// Replaces the face of a side by the lower part of a gable, and a small face above it. Returns whether there is room.
    fn raise_half(&mut self, side: usize, gable: &Gable) -> bool {
        let Side { previous, next, .. } = self.sides[side];
        let rise = gable.top.rise * HALF_HIP_RISE;
        let end = self.points[gable.ridge_end];
        let share = 1.0 - HALF_HIP_RISE;
        let tip = PlanPoint {
            at: gable.top.at.lerp(end.at, share),
            rise: gable.top.rise + share * (end.rise - gable.top.rise),
        };
        let (Some(first), Some(last)) =
            (self.wall_at_height(side, previous, rise), self.wall_at_height(side, next, rise))
        else {
            return false;
        };
        let along = self.direction(side);
        if first.dot(along) >= last.dot(along) || tip.rise <= rise {
            return false;
        }
        let (mut right, mut left) = self.wall_parts(side, first, last);
        let [first, last] = [first, last].map(|at| self.wall_point(side, PlanPoint { at, rise }));
        let is_between = |i: &usize| !right.contains(i) && !left.contains(i) && *i != first && *i != last;
        let between: Vec<usize> = self.wall(side).into_iter().filter(is_between).collect();
        let low = self.points[first].at;
        let across = (self.points[last].at - low).perp();
        let slope = (tip.rise - rise) / across.dot(tip.at - low);
        for &corner in &between {
            self.points[corner].rise = rise + slope * across.dot(self.points[corner].at - low);
        }
        let tip = self.add_point(tip);
        let small = [&[first][..], &between, &[last, tip]].concat();
        right.extend([first, tip]);
        left.splice(0..0, [tip, last]);
        self.faces[side] = vec![small];
        self.replace_edges(side, gable.ridge_end, right, left);
        true
    }

    /// Where the plane of another side has a height above the wall of a side.
    fn wall_at_height(&self, side: usize, plane: usize, rise: f64) -> Option<DVec2> {
        self.wall_crossing(side, |corner| self.height_above(plane, corner) - rise)
    }

    /// A point on the wall of a side: the corner that is there, or a new one.
    fn wall_point(&mut self, side: usize, point: PlanPoint) -> usize {
        let along = self.direction(side);
        let is_there = |&&corner: &&usize| (self.points[corner].at - point.at).dot(along).abs() <= SAME_M;
        match self.sides[side].between.iter().find(is_there) {
            Some(&corner) => {
                self.points[corner].rise = point.rise;
                corner
            }
            None => self.add_point(point),
        }
    }

    fn add_point(&mut self, point: PlanPoint) -> usize {
        self.points.push(point);
        self.points.len() - 1
    }

    /// The plan, with heights as shares of the highest point's.
    fn into_plan(self) -> Result<Plan, RoofFault> {
        let faces: Vec<_> = self.faces.into_iter().flatten().map(|ring| vec![ring]).collect();
        let used = faces.iter().flatten().flatten().map(|&i| self.points[i].rise);
        let top_m = used.fold(0.0, f64::max);
        if top_m <= 0.0 {
            return Err(RoofFault::Skeleton);
        }
        let mut plan = Plan { points: self.points, faces, is_overhanging: false };
        plan.set_rise(|point| point.rise / top_m);
        Ok(plan)
    }
}

fn has_edge(face: &[Vec<usize>], from: usize, to: usize) -> bool {
    face.iter().any(|ring| super::cut::edges(std::slice::from_ref(ring)).any(|edge| edge == (from, to)))
}

/// Puts points between the ends of an edge of a face, and drops a point.
fn replace_edge(face: &mut [Vec<usize>], (from, to): (usize, usize), points: &[usize], dropped: Option<usize>) {
    for ring in face {
        let count = ring.len();
        let edge = (0..count).find(|&i| ring[i] == from && ring[(i + 1) % count] == to);
        if let Some(i) = edge {
            ring.splice(i + 1..i + 1, points.iter().copied());
            ring.retain(|&point| Some(point) != dropped);
            return;
        }
    }
}
