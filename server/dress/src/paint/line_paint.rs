//! Waterways, paths, platforms and rails.

use crate::paint::canvas::{Brush, Canvas};
use crate::paint::class::LineClass;
use crate::paint::material::PaintMaterial;
use crate::paint::prepare::ReadyLine;
use crate::paint::road_paint::is_visible;
use crate::paint::stroke::{Stripe, band, stripe};

/// Width of a rail, which is that of its foot.
const RAIL_M: f64 = 0.15;
/// Distances of the rails' middles from that of the track: of standard gauge, and of narrow gauge.
const RAIL_OFFSETS_M: [f64; 2] = [0.75, 0.53];
/// Distance of neighbouring tracks.
const TRACK_DISTANCE_M: f64 = 4.0;
/// Width that a track needs.
const TRACK_M: f64 = 1.8;
/// Width of a sleeper, and from one to the next.
const SLEEPER_DASH_M: [f64; 2] = [0.25, 0.6];
/// Half lengths of sleepers: of standard gauge, and of narrow gauge.
const SLEEPER_HALF_M: [f64; 2] = [1.3, 0.85];
/// Treads of stairs, and from one to the next: twice as far as usual, so that texels show them.
const TREAD_DASH_M: [f64; 2] = [0.35, 0.7];
/// Patterns along a line whose period is shorter than this number of samples are left out.
const MIN_PERIOD_SAMPLES: f64 = 8.0;

/// Paints a waterway, a path, a platform or a pier.
pub(super) fn paint_band(canvas: &mut Canvas, line: &ReadyLine) {
    band(line, line.half_m, &mut canvas.polygons(line.brush(), None));
    if line.class == LineClass::Steps && has_period(canvas, TREAD_DASH_M[1]) {
        let treads = Stripe { edges_m: [-line.half_m, line.half_m], dash_m: Some(TREAD_DASH_M), cuts_m: &[] };
        stripe(line, treads, &mut canvas.polygons(Brush::plain(PaintMaterial::Tread), None));
    }
}

/// Paints the bed of a railway and its sleepers.
pub(super) fn paint_bed(canvas: &mut Canvas, line: &ReadyLine) {
    band(line, line.half_m, &mut canvas.polygons(line.brush(), None));
    if line.class == LineClass::Tram || !has_period(canvas, SLEEPER_DASH_M[1]) {
        return;
    }
    let half_m = SLEEPER_HALF_M[gauge(line)];
    for middle_m in track_middles_m(line) {
        let sleepers =
            Stripe { edges_m: [middle_m - half_m, middle_m + half_m], dash_m: Some(SLEEPER_DASH_M), cuts_m: &[] };
        stripe(line, sleepers, &mut canvas.polygons(Brush::plain(PaintMaterial::Sleeper), None));
    }
}

pub(super) fn paint_rails(canvas: &mut Canvas, line: &ReadyLine) {
    if !is_visible(canvas, RAIL_M) {
        return;
    }
    let material = if line.class == LineClass::Tram { PaintMaterial::StreetRail } else { PaintMaterial::Rail };
    let offset_m = RAIL_OFFSETS_M[gauge(line)];
    for middle_m in track_middles_m(line).flat_map(|middle_m| [middle_m - offset_m, middle_m + offset_m]) {
        let rail = Stripe { edges_m: [middle_m - RAIL_M / 2.0, middle_m + RAIL_M / 2.0], dash_m: None, cuts_m: &[] };
        stripe(line, rail, &mut canvas.polygons(Brush::plain(material), None));
    }
}

fn gauge(line: &ReadyLine) -> usize {
    usize::from(line.class == LineClass::NarrowGauge)
}

/// As many tracks as are known and fit.
fn track_middles_m(line: &ReadyLine) -> impl Iterator<Item = f64> {
    let fitting = 1 + ((2.0 * line.half_m - TRACK_M).max(0.0) / TRACK_DISTANCE_M) as u8;
    let count = line.lanes.unwrap_or(1).min(fitting);
    let first_m = -TRACK_DISTANCE_M * (f64::from(count) - 1.0) / 2.0;
    (0..count).map(move |track| first_m + TRACK_DISTANCE_M * f64::from(track))
}

fn has_period(canvas: &Canvas, period_m: f64) -> bool {
    period_m * canvas.window().samples_per_m >= MIN_PERIOD_SAMPLES
}
