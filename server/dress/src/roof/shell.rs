//! The closed surface of a building: the faces of its roof, the walls below their border, and the floor.

use super::plan::Plan;
use super::{Outline, RoofFault, RoofSpec, cut};
use insula_source::object::{Surface, SurfaceRole};
use std::collections::HashMap;

/// Roofs that come nearer than this to the floor meet it.
const MEET_M: f64 = 1e-6;

/// Closes a roof. Fails if its faces leave gaps.
pub(super) fn close(outline: &Outline, plan: &Plan, spec: &RoofSpec) -> Result<Vec<Surface>, RoofFault> {
    let shell = Shell::new(outline, plan, spec);
    let border = border(plan)?;
    let mut surfaces: Vec<Surface> = plan.faces.iter().map(|face| shell.roof_face(face)).collect();
    let mut floor = Vec::new();
    let mut walked = 0;
    for ring in outline.ring_numbers() {
        let mut ground = Vec::new();
        for (i, &corner) in ring.iter().enumerate() {
            let wall = walk(&border, corner, ring[(i + 1) % ring.len()])?;
            walked += wall.len() - 1;
            // The floor shares the points at which the roof meets it.
            ground
                .extend(wall[..wall.len() - 1].iter().copied().filter(|&point| point == corner || shell.is_low(point)));
            shell.add_walls(&wall, &mut surfaces);
        }
        ground.reverse();
        floor.push(ground);
    }
    if walked != border.len() {
        return Err(RoofFault::Faces);
    }
    let low = |ring: &Vec<usize>| ring.iter().map(|&point| shell.ground(point)).collect();
    surfaces.push(surface(floor.iter().map(low), SurfaceRole::Ground));
    Ok(surfaces)
}

/// Edges of faces without a neighbour, by their first points.
fn border(plan: &Plan) -> Result<HashMap<usize, usize>, RoofFault> {
    let mut open = HashMap::new();
    for edge in plan.faces.iter().flat_map(|face| cut::edges(face)) {
        if edge.0 == edge.1 || open.insert(edge, ()).is_some() {
            return Err(RoofFault::Faces);
        }
    }
    let mut border = HashMap::new();
    for &(from, to) in open.keys().filter(|&&(from, to)| !open.contains_key(&(to, from))) {
        if border.insert(from, to).is_some() {
            return Err(RoofFault::Faces);
        }
    }
    Ok(border)
}

/// Points of the border from a corner to the next one.
fn walk(border: &HashMap<usize, usize>, from: usize, to: usize) -> Result<Vec<usize>, RoofFault> {
    let mut points = vec![from];
    let mut at = from;
    while at != to {
        at = *border.get(&at).ok_or(RoofFault::Faces)?;
        points.push(at);
        if points.len() > border.len() + 1 {
            return Err(RoofFault::Faces);
        }
    }
    Ok(points)
}

/// Points of a roof in space.
struct Shell {
    base_m: f64,
    points: Vec<[f64; 3]>,
}

impl Shell {
    fn new(outline: &Outline, plan: &Plan, spec: &RoofSpec) -> Self {
        let height_m = |rise: f64| {
            let height_m = (spec.eaves_m + rise * (spec.top_m - spec.eaves_m)).clamp(spec.base_m, spec.top_m);
            if height_m - spec.base_m < MEET_M { spec.base_m } else { height_m }
        };
        let points = plan.points.iter().enumerate().map(|(i, point)| {
            // Corners keep every digit, so that neighbours and parts of a building fit.
            let [x, y] = outline.given.get(i).copied().unwrap_or_else(|| (point.at + outline.centre).to_array());
            [x, y, height_m(point.rise)]
        });
        Self { base_m: spec.base_m, points: points.collect() }
    }

    /// The floor below a point.
    fn ground(&self, point: usize) -> [f64; 3] {
        let [x, y, _] = self.points[point];
        [x, y, self.base_m]
    }

    /// Whether the roof meets the floor at a point.
    fn is_low(&self, point: usize) -> bool {
        self.points[point][2] == self.base_m
    }

    fn roof_face(&self, face: &[Vec<usize>]) -> Surface {
        surface(face.iter().map(|ring| ring.iter().map(|&point| self.points[point]).collect()), SurfaceRole::Roof)
    }

    /// Adds the wall below a part of the border, in several pieces if the roof meets the floor between its ends.
    fn add_walls(&self, border: &[usize], surfaces: &mut Vec<Surface>) {
        let mut start = 0;
        for end in 1..border.len() {
            if end + 1 < border.len() && !self.is_low(border[end]) {
                continue;
            }
            let top = &border[start..=end];
            start = end;
            if top.iter().all(|&point| self.is_low(point)) {
                continue;
            }
            let [first, last] = [top[0], top[top.len() - 1]];
            let mut ring = vec![self.ground(first), self.ground(last)];
            ring.extend(top.iter().rev().filter(|&&point| !self.is_low(point)).map(|&point| self.points[point]));
            surfaces.push(surface([ring], SurfaceRole::Wall));
        }
    }
}

/// A surface of rings: the outer one, then holes.
fn surface(rings: impl IntoIterator<Item = Vec<[f64; 3]>>, role: SurfaceRole) -> Surface {
    let mut surface = Surface { role, ..Surface::default() };
    for ring in rings {
        if !surface.points.is_empty() {
            surface.hole_starts.push(surface.points.len() as u32);
        }
        surface.points.extend(ring);
    }
    surface
}
