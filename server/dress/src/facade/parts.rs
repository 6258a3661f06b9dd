//! The rectangles of a wall that are whole, and their storeys and bays.

use super::FacadeZone;
use glam::DVec2;

/// Corners nearer along the wall count as one.
const WELD_M: f64 = 0.1;
/// A wall with more corners stays plain.
const MAX_STOPS: usize = 256;
/// Most heights at one place at which a wall begins and ends.
const MAX_SPANS: usize = 8;
/// Gaps of less height between faces are closed.
const MAX_GAP_M: f64 = 0.05;
/// Lower and narrower parts stay plain.
const MIN_HEIGHT_M: f64 = 2.0;
const MIN_WIDTH_M: f64 = 2.0;
/// Share of a storey that a part may lack at its top or bottom: the pattern is plain there.
const SLACK: f64 = 0.15;
/// Share of a storey below the first one, in which there is only wall: generated ground, and terrain that is made of triangles, may be
/// that much above a building's foot, and would cut windows. As in the slack, the pattern is plain there: no face is cut for it.
pub(super) const PLINTH: f64 = SLACK;
/// Share of the storey above the last one that is plain in the pattern.
const PLAIN_ABOVE: f64 = 0.25;

/// The ground along a wall is looked up at places with this distance, and at no more than so many of a part.
const GROUND_STEP_M: f64 = 8.0;
const MAX_GROUND_STEPS: u32 = 64;

/// A rectangle in which the wall has no hole: along the wall and up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct WallPart {
    pub(super) along_m: [f64; 2],
    pub(super) z_m: [f64; 2],
}

/// Finds the rectangles between neighbouring corners of a wall, from its triangles (along the wall, up). The rectangle
/// below a sloping edge ends at its lower end.
pub(super) fn find_parts(triangles: &[[DVec2; 3]]) -> Vec<WallPart> {
    let mut stops: Vec<f64> = triangles.iter().flatten().map(|p| p.x).collect();
    stops.sort_unstable_by(f64::total_cmp);
    stops.dedup_by(|next, kept| *next - *kept < WELD_M);
    let mut parts = Vec::new();
    if stops.len() > MAX_STOPS {
        return parts;
    }
    for pair in stops.windows(2) {
        let along_m = [pair[0], pair[1]];
        let width_m = along_m[1] - along_m[0];
        // Corners that were welded to the left end are up to there inside.
        let left = spans_at(triangles, along_m[0] + WELD_M.min(width_m / 2.0));
        let right = spans_at(triangles, along_m[1] - width_m * 1e-3);
        for [low, high] in left {
            let common = right.iter().map(|other| [low.max(other[0]), high.min(other[1])]);
            let z_m = common.filter(|z| z[1] - z[0] >= MIN_HEIGHT_M);
            parts.extend(z_m.map(|z_m| WallPart { along_m, z_m }));
        }
    }
    parts
}

/// Lifts the lower ends of parts out of the ground, of which `ground_m` gives the height at a place along the wall: in pieces, because it
/// slopes. Pieces that are too low then are left out.
pub(super) fn above_ground(parts: Vec<WallPart>, ground_m: &mut dyn FnMut(f64) -> Option<f64>) -> Vec<WallPart> {
    let mut lifted = Vec::with_capacity(parts.len());
    for part in parts {
        let [left, right] = part.along_m;
        let steps = ((right - left) / GROUND_STEP_M).ceil().clamp(1.0, f64::from(MAX_GROUND_STEPS)) as u32;
        let place = |step: u32| match step == steps {
            true => right,
            false => left + (right - left) * f64::from(step) / f64::from(steps),
        };
        let low = part.z_m[0];
        let lows: Vec<f64> = (0..=steps).map(|step| ground_m(place(step)).map_or(low, |z_m| z_m.max(low))).collect();
        if lows.iter().all(|z_m| *z_m <= low) {
            lifted.push(part);
            continue;
        }
        for (step, ends) in (0..steps).zip(lows.windows(2)) {
            let z_m = [ends[0].max(ends[1]), part.z_m[1]];
            if z_m[1] - z_m[0] >= MIN_HEIGHT_M {
                lifted.push(WallPart { along_m: [place(step), place(step + 1)], z_m });
            }
        }
    }
    lifted
}

/// The heights between which a wall has faces at a place, from the bottom up.
fn spans_at(triangles: &[[DVec2; 3]], along_m: f64) -> Vec<[f64; 2]> {
    let mut spans: Vec<[f64; 2]> = triangles.iter().filter_map(|triangle| span_at(triangle, along_m)).collect();
    spans.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    spans.dedup_by(|next, kept| {
        let touches = next[0] <= kept[1] + MAX_GAP_M;
        if touches {
            kept[1] = kept[1].max(next[1]);
        }
        touches
    });
    spans.truncate(MAX_SPANS);
    spans
}

fn span_at(triangle: &[DVec2; 3], along_m: f64) -> Option<[f64; 2]> {
    let mut span: Option<[f64; 2]> = None;
    for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(a, b)| (triangle[a], triangle[b])) {
        if a.x != b.x && (a.x - along_m) * (b.x - along_m) <= 0.0 {
            let z = a.y + (b.y - a.y) * ((along_m - a.x) / (b.x - a.x));
            span = Some(span.map_or([z; 2], |[low, high]| [low.min(z), high.max(z)]));
        }
    }
    span
}

/// The storeys of an object, equal in all its walls.
#[derive(Debug, Clone, Copy)]
pub(super) struct Storeys {
    /// Height of the floor of storey 0, above the plinth.
    base_m: f64,
    height_m: f64,
}

impl Storeys {
    /// Divides the height of most of the walls into a plinth and whole storeys of about `usual_m`; `None` without walls.
    pub(super) fn of(walls: &[Vec<WallPart>], base_m: f64, usual_m: f64) -> Option<Self> {
        let width = |part: &WallPart| part.along_m[1] - part.along_m[0];
        let mut parts: Vec<&WallPart> = walls.iter().flatten().collect();
        parts.sort_by(|a, b| a.z_m[1].total_cmp(&b.z_m[1]));
        let half_m = parts.iter().map(|part| width(part)).sum::<f64>() / 2.0;
        let mut sum_m = 0.0;
        let eave = parts.iter().find(|part| {
            sum_m += width(part);
            sum_m >= half_m
        });
        let eave_m = eave?.z_m[1] - base_m;
        let height_m = eave_m / ((eave_m / usual_m).round().max(1.0) + PLINTH);
        (eave_m >= MIN_HEIGHT_M).then_some(Self { base_m: base_m + PLINTH * height_m, height_m })
    }

    /// Joins neighbouring parts with the same storeys, and divides them into bays of about `bay_m`.
    pub(super) fn zones(&self, parts: Vec<WallPart>, bay_m: f64) -> Vec<FacadeZone> {
        let mut counted: Vec<([u32; 2], WallPart)> =
            parts.into_iter().filter_map(|part| Some((self.within(part.z_m)?, part))).collect();
        counted.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.along_m[0].total_cmp(&b.1.along_m[0])));
        counted.dedup_by(|next, kept| {
            let is_next = next.0 == kept.0 && next.1.along_m[0] == kept.1.along_m[1];
            if is_next {
                kept.1.along_m[1] = next.1.along_m[1];
                kept.1.z_m = [kept.1.z_m[0].min(next.1.z_m[0]), kept.1.z_m[1].max(next.1.z_m[1])];
            }
            is_next
        });
        counted.retain(|(_, part)| part.along_m[1] - part.along_m[0] >= MIN_WIDTH_M);
        counted.into_iter().map(|(storeys, part)| self.zone(storeys, part, bay_m)).collect()
    }

    /// The storeys between two heights: the first, and the one after the last; `None` if there is none.
    fn within(&self, z_m: [f64; 2]) -> Option<[u32; 2]> {
        let [low, high] = z_m.map(|z_m| (z_m - self.base_m) / self.height_m);
        let storeys = [(low - SLACK).ceil().max(0.0) as u32, (high + SLACK).floor().max(0.0) as u32];
        (storeys[0] < storeys[1]).then_some(storeys)
    }

    fn zone(&self, storeys: [u32; 2], part: WallPart, bay_m: f64) -> FacadeZone {
        let Self { base_m, height_m } = *self;
        let at = |storeys: f64| base_m + storeys * height_m;
        FacadeZone {
            along_m: part.along_m,
            z_m: [
                part.z_m[0].max(at(f64::from(storeys[0]) - SLACK)),
                part.z_m[1].min(at(f64::from(storeys[1]) + PLAIN_ABOVE)),
            ],
            bays: ((part.along_m[1] - part.along_m[0]) / bay_m).round().max(1.0) as u32,
            storeys,
            base_m,
            storey_m: height_m,
        }
    }
}
