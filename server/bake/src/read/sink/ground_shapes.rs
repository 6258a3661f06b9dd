//! Lines with a width: roads and rails.

use super::SceneSink;
use super::footprints::layer_m;
use crate::read::scene_builder::{OpenObject, WorldTriangle};
use crate::scene::ObjectKind;
use insula_dress::facade::FacadeUse;
use insula_source::error::InputError;
use insula_source::object::{FeatureKind, SourceObject, Strip};

/// Lines are drawn with this width at least.
const MIN_WIDTH_M: f64 = 0.5;
const MAX_WIDTH_M: f64 = 200.0;
/// The miter of a bend is at most this many half widths long; sharper bends are cut.
const MAX_MITER: f64 = 2.0;

impl SceneSink<'_, '_, '_> {
    /// Adds lines as strips: at their own heights, else on the ground. Those of plants are hedges. Fails if the ground's height
    /// cannot be read.
    pub(super) fn add_strips(&mut self, object: &SourceObject, strips: &[Strip]) -> Result<(), InputError> {
        if object.kind == FeatureKind::Vegetation {
            return self.add_hedges(object, strips);
        }
        let material = self.flat_material(object.kind);
        let mut open = OpenObject::new(ObjectKind::Terrain);
        let mut fault = None;
        for strip in strips {
            let Some(points) = self.placed_line(strip) else {
                fault = Some("coordinate not a number or out of range");
                continue;
            };
            let own = self.own_heights(object, strip);
            let z = layer_m(object);
            let height = |i: usize| z + own.as_ref().map_or(0.0, |own| own[i]);
            let line: Vec<[f64; 3]> = points.iter().enumerate().map(|(i, [x, y])| [*x, *y, height(i)]).collect();
            widen(&line, half_width_m(strip), |[a, b, c, d]| {
                let face = |corners| WorldTriangle { corners, uv: [[0.0; 2]; 3], material, is_facade: false };
                self.faces.extend([face([a, b, c]), face([a, c, d])]);
            });
            if own.is_some() {
                self.lift_over_paint();
            } else {
                self.drape(None)?;
            }
            self.context.push(&mut open, &mut self.faces, FacadeUse::Windowless);
        }
        self.finish_areas(object, open, fault);
        Ok(())
    }

    /// World heights of a line's points; `None` if the source does not tell all of them.
    fn own_heights(&mut self, object: &SourceObject, strip: &Strip) -> Option<Vec<f64>> {
        if strip.heights.is_empty() || strip.heights.len() != strip.points.len() {
            return None;
        }
        let points = strip.points.iter().zip(&strip.heights);
        points.map(|(point, height)| self.base_m(object, *point, Some(*height))).collect()
    }

    /// The placed points of a line; `None` if one is invalid.
    pub(super) fn placed_line(&self, strip: &Strip) -> Option<Vec<[f64; 2]>> {
        strip.points.iter().map(|point| self.place_on_map(*point)).collect()
    }
}

/// Half of the width with which a line is drawn.
pub(super) fn half_width_m(strip: &Strip) -> f64 {
    let width_m = if strip.width_m.is_finite() { strip.width_m } else { MIN_WIDTH_M };
    width_m.clamp(MIN_WIDTH_M, MAX_WIDTH_M) / 2.0
}

/// Calls `quad` with the corners of each segment of a widened line, counter-clockwise. Neighbours share their corners
/// at bends. Both sides of a line are at its height.
pub(super) fn widen(points: &[[f64; 3]], half_m: f64, mut quad: impl FnMut([[f64; 3]; 4])) {
    let mut line: Vec<[f64; 3]> = Vec::with_capacity(points.len());
    for point in points {
        if line.last().is_none_or(|last| libm::hypot(last[0] - point[0], last[1] - point[1]) > 1e-3) {
            line.push(*point);
        }
    }
    let normal = |a: [f64; 3], b: [f64; 3]| {
        let length = libm::hypot(b[0] - a[0], b[1] - a[1]);
        [(a[1] - b[1]) / length, (b[0] - a[0]) / length]
    };
    // The offset to the left of each point.
    let offset = |i: usize| {
        let before = i.checked_sub(1).map(|before| normal(line[before], line[i]));
        let after = line.get(i + 1).map(|next| normal(line[i], *next));
        let (a, b) = (before.or(after).unwrap_or_default(), after.or(before).unwrap_or_default());
        let sum = [a[0] + b[0], a[1] + b[1]];
        let square = sum[0] * sum[0] + sum[1] * sum[1];
        // The miter is `2 / |a + b|` half widths long.
        let scale =
            if square > (2.0 / MAX_MITER).powi(2) { 2.0 / square } else { return [a[0] * half_m, a[1] * half_m] };
        [sum[0] * scale * half_m, sum[1] * scale * half_m]
    };
    for i in 1..line.len() {
        let (from, to) = (offset(i - 1), offset(i));
        let (a, b) = (line[i - 1], line[i]);
        let moved = |p: [f64; 3], by: [f64; 2], sign: f64| [p[0] + sign * by[0], p[1] + sign * by[1], p[2]];
        quad([moved(a, from, -1.0), moved(b, to, -1.0), moved(b, to, 1.0), moved(a, from, 1.0)]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quads(points: &[[f64; 2]]) -> Vec<[[f64; 2]; 4]> {
        let mut found = Vec::new();
        let line: Vec<[f64; 3]> = points.iter().map(|[x, y]| [*x, *y, 7.0]).collect();
        widen(&line, 2.0, |quad| {
            assert!(quad.iter().all(|corner| corner[2] == 7.0));
            found.push(quad.map(|[x, y, _]| [x, y]));
        });
        found
    }

    #[test]
    fn a_line_has_its_width_and_no_gap_at_bends() {
        assert_eq!(quads(&[[0.0, 0.0], [10.0, 0.0]]), [[[0.0, -2.0], [10.0, -2.0], [10.0, 2.0], [0.0, 2.0]]]);
        let bent = quads(&[[0.0, 0.0], [10.0, 0.0], [10.0, 0.0], [10.0, 10.0]]);
        assert_eq!(bent.len(), 2);
        assert_eq!((bent[0][1], bent[0][2]), (bent[1][0], bent[1][3]), "the bend is shared");
        assert!((bent[0][1][0] - 12.0).abs() < 1e-9 && (bent[0][1][1] + 2.0).abs() < 1e-9, "{bent:?}");
        assert!(quads(&[[1.0, 1.0], [1.0, 1.0]]).is_empty());
        // A hairpin has no endless miter.
        let hairpin = quads(&[[0.0, 0.0], [10.0, 0.0], [0.0, 0.1]]);
        assert!(hairpin.iter().flatten().all(|point| point[0].abs() < 13.0), "{hairpin:?}");
    }
}
