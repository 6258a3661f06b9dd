//! A roof seen from above: faces that divide the footprint, with a height at each point.

pub(super) use super::cut::{PlanFace, PlanPoint};
use super::{Outline, RoofFault, cut, simple};
use glam::DVec2;

/// Edges of a face may cross by this much, by rounding.
const OVERLAP_M: f64 = 1e-5;

/// A roof as faces with shared points. The first points are the outline's corners. Every edge between two faces is an edge
/// of both, and all others are parts of the outline.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    pub(super) points: Vec<PlanPoint>,
    pub(super) faces: Vec<PlanFace>,
    /// Whether faces may lie above each other or beyond the outline.
    pub(super) is_overhanging: bool,
}

impl Plan {
    /// One level face at the top.
    pub(super) fn flat(outline: &Outline) -> Self {
        Self::undivided(outline, |_| 1.0)
    }

    /// The outline as one face.
    pub(super) fn undivided(outline: &Outline, rise: impl Fn(DVec2) -> f64) -> Self {
        let points = outline.corners().into_iter().map(|at| PlanPoint { at, rise: rise(at) }).collect();
        Self { points, faces: vec![outline.ring_numbers()], is_overhanging: false }
    }

    /// Cuts all faces where `scalar` is zero. It must be continuous, and linear in each face.
    pub(super) fn cut(&mut self, scalar: impl Fn(&PlanPoint) -> f64) -> Result<(), RoofFault> {
        let scalars: Vec<f64> = self.points.iter().map(scalar).collect();
        self.faces = cut::cut(&mut self.points, &self.faces, &scalars)?;
        Ok(())
    }

    /// Itself, if its faces are simple polygons. Together with the outline, they then cover the footprint exactly once.
    pub(super) fn checked(self) -> Result<Self, RoofFault> {
        let is_valid = |face: &PlanFace| {
            let corners = |ring: &Vec<usize>| ring.iter().map(|&i| self.points[i].at).collect::<Vec<_>>();
            let rings: Vec<Vec<DVec2>> = face.iter().map(corners).collect();
            rings.iter().map(|ring| simple::area(ring)).sum::<f64>() > 0.0 && simple::is_simple(&rings, -OVERLAP_M)
        };
        if self.is_overhanging || self.faces.iter().all(is_valid) { Ok(self) } else { Err(RoofFault::Faces) }
    }

    pub(super) fn set_rise(&mut self, rise: impl Fn(&PlanPoint) -> f64) {
        for point in &mut self.points {
            point.rise = rise(point);
        }
    }

    /// Breaks the slopes: a height of `bends[i].0` becomes `bends[i].1`, linear between the bends, 0 and 1. Bends ascend.
    pub(super) fn bend(mut self, bends: &[(f64, f64)]) -> Result<Self, RoofFault> {
        for (run, _) in bends {
            self.cut(|point| point.rise - run)?;
        }
        let stops: Vec<(f64, f64)> = [(0.0, 0.0)].iter().chain(bends).chain(&[(1.0, 1.0)]).copied().collect();
        self.set_rise(|point| {
            let i = stops[1..stops.len() - 1].iter().take_while(|stop| stop.0 < point.rise).count();
            let [(run, rise), (next_run, next_rise)] = [stops[i], stops[i + 1]];
            rise + (point.rise - run) / (next_run - run) * (next_rise - rise)
        });
        Ok(self)
    }
}
