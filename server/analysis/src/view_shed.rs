//! The places that are visible from a point, by rays to the border of an area.
//!
//! A ray runs from the eye to each cell of the border, and keeps the steepest slope to a top so far: what rises above it is seen. Each
//! cell lies on a ray that passes within half a cell of its middle (the method R2 of Franklin and SightLine, Higher isn't necessarily better:
//! visibility algorithms and experiments, 1994).

use crate::surface::CitySurface;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Whether each cell of a surface is seen from an eye in world metres: its top, raised by `target_m`, as a person's head is above the ground.
/// `reach_m` bounds the distance on the map. `None` if the eye is outside of the surface.
#[must_use]
pub fn seen_from(surface: &CitySurface, eye: [f64; 3], target_m: f64, reach_m: f64) -> Option<Vec<bool>> {
    let cell = surface.cell_at([eye[0], eye[1]])?;
    let [width, height] = surface.size();
    let mut seen = vec![false; width * height];
    seen[cell[1] * width + cell[0]] = true;
    let place = [0, 1].map(|k| (eye[k] - surface.corner[k]) / surface.cell_m - 0.5);
    let level = (eye[2] - surface.base_m) as f32;
    let reach = (reach_m / surface.cell_m).min(1e9);
    let bottom = (0..width).flat_map(|x| [(x, 0), (x, height - 1)]);
    let sides = (0..height).flat_map(|y| [(0, y), (width - 1, y)]);
    for (x, y) in bottom.chain(sides) {
        let ray = SightLine { surface, from: place, to: [x as f64, y as f64], own: cell, level, reach };
        ray.mark(target_m as f32, &mut seen);
    }
    Some(seen)
}

/// Points along the outline of a planned building, at heights up to its top.
const OUTLINE_POINTS: usize = 12;
const OUTLINE_HEIGHTS: usize = 6;

/// Which share of the walls of a planned building is seen from each cell, 0 to 1, by an eye `eye_m` above its top. `outline` is on the map
/// in world metres; the building stands on the lowest ground along it and is `height_m` high. The surface is as it is without the
/// building, and existing buildings within its outline are left out. `None` if no point of the outline is on the surface.
/// `progress` gets the share of the work that is done, and says whether to go on: values are not complete if it does not.
#[must_use]
pub fn share_seen(
    surface: &CitySurface,
    outline: &[[f64; 2]],
    height_m: f64,
    eye_m: f64,
    progress: &(dyn Fn(f64) -> bool + Sync),
) -> Option<Vec<f32>> {
    let cleared = surface.without(outline);
    let places = along(outline, OUTLINE_POINTS);
    let ground = |place: &[f64; 2]| {
        let [x, y] = cleared.cell_at(*place)?;
        Some(cleared.top(y * cleared.size()[0] + x)).filter(|top| top.is_finite())
    };
    let lowest = places.iter().filter_map(ground).reduce(f32::min)?;
    let level = |i: usize| f64::from(lowest) + cleared.base_m + height_m * (i as f64 + 1.0) / OUTLINE_HEIGHTS as f64;
    let eyes: Vec<[f64; 3]> =
        places.iter().flat_map(|[x, y]| (0..OUTLINE_HEIGHTS).map(move |i| [*x, *y, level(i)])).collect();
    let done = AtomicUsize::new(0);
    let count_of = |eyes: &[[f64; 3]]| {
        let mut counts = vec![0u16; cleared.tops.values.len()];
        for eye in eyes {
            let seen = seen_from(&cleared, *eye, eye_m, f64::INFINITY).unwrap_or_default();
            counts.iter_mut().zip(seen).for_each(|(count, seen)| *count += u16::from(seen));
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            if !progress(done as f64 / places.len() as f64 / OUTLINE_HEIGHTS as f64) {
                break;
            }
        }
        counts
    };
    let share = eyes.len().div_ceil(rayon::current_num_threads()).max(1);
    let counts = eyes.par_chunks(share).map(count_of).reduce_with(|mut all, more| {
        all.iter_mut().zip(more).for_each(|(a, b)| *a += b);
        all
    })?;
    Some(counts.into_iter().map(|count| f32::from(count) / eyes.len() as f32).collect())
}

/// Places at equal distances along a closed line.
fn along(line: &[[f64; 2]], count: usize) -> Vec<[f64; 2]> {
    let sides: Vec<([f64; 2], [f64; 2])> = line.iter().copied().zip(line.iter().copied().cycle().skip(1)).collect();
    let length = |([ax, ay], [bx, by]): &([f64; 2], [f64; 2])| (bx - ax).hypot(by - ay);
    let total: f64 = sides.iter().map(length).sum();
    let place = |i: usize| {
        let mut left = total * i as f64 / count as f64;
        for side in &sides {
            let long = length(side);
            if left <= long && long > 0.0 {
                let t = left / long;
                return Some([0, 1].map(|k| side.0[k] + t * (side.1[k] - side.0[k])));
            }
            left -= long;
        }
        line.first().copied()
    };
    (0..count).filter_map(place).collect()
}

struct SightLine<'a> {
    surface: &'a CitySurface,
    /// Cells; middles are whole numbers.
    from: [f64; 2],
    to: [f64; 2],
    /// The cell of the eye: it hides nothing.
    own: [usize; 2],
    /// Of the eye above the surface's base.
    level: f32,
    /// Cells.
    reach: f64,
}

impl SightLine<'_> {
    fn mark(&self, target_m: f32, seen: &mut [bool]) {
        let [width, height] = self.surface.size();
        let delta = [0, 1].map(|k| self.to[k] - self.from[k]);
        let main = usize::from(delta[1].abs() > delta[0].abs());
        if delta[main].abs() < 0.5 {
            return;
        }
        let slope = delta[1 - main] / delta[main];
        let length = slope.hypot(1.0);
        let forwards = if delta[main] > 0.0 { 1.0 } else { -1.0 };
        let mut steepest = f32::NEG_INFINITY;
        // From one row of middles to the next, so that the ray ends in the middle of the border's cell.
        let mut at = self.own[main] as f64 + forwards;
        while (at - self.to[main]) * forwards <= 0.0 {
            let ahead = at - self.from[main];
            let distance = ahead.abs() * length;
            if distance > self.reach {
                return;
            }
            let aside = (self.from[1 - main] + ahead * slope).round();
            let [x, y] = if main == 0 { [at, aside] } else { [aside, at] };
            at += forwards;
            if x < 0.0 || y < 0.0 || x >= width as f64 || y >= height as f64 {
                continue;
            }
            let index = y as usize * width + x as usize;
            let above = self.surface.top(index) - self.level;
            seen[index] |= above + target_m >= steepest * distance as f32;
            steepest = steepest.max(above / distance as f32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_surface::surface;

    #[test]
    fn a_house_hides_what_is_behind_it() {
        let surface = surface(61, 41, |x, y| if (20..24).contains(&x) && (10..30).contains(&y) { 10.0 } else { 0.0 });
        // An eye of 2 m at cell 10, 20: behind the house, what is lower than a line over its first wall is hidden.
        let seen = seen_from(&surface, [1010.5, 2020.5, 52.0], 1.6, 1e4).unwrap();
        let at = |x: usize, y: usize| seen[y * 61 + x];
        assert!(at(15, 20) && at(20, 20) && at(10, 20) && at(23, 5) && at(12, 40));
        assert!(!at(24, 20) && !at(40, 20) && !at(60, 25));
        // From 30 m, the line over the far edge of the roof comes down 7 m behind it.
        let above = seen_from(&surface, [1010.5, 2020.5, 80.0], 0.0, 1e4).unwrap();
        let at = |x: usize, y: usize| above[y * 61 + x];
        assert!(at(22, 20) && !at(27, 20) && at(32, 20));
        let near = seen_from(&surface, [1010.5, 2020.5, 52.0], 1.6, 6.0).unwrap();
        assert!(near[20 * 61 + 15] && !near[20 * 61 + 18]);
        assert_eq!(seen_from(&surface, [0.0, 0.0, 52.0], 1.6, 1e4), None);
    }

    #[test]
    fn a_tower_is_seen_over_what_is_lower() {
        let surface = surface(81, 41, |x, y| if (20..24).contains(&x) && (5..36).contains(&y) { 10.0 } else { 0.0 });
        let outline = [[1058.0, 2018.0], [1062.0, 2018.0], [1062.0, 2022.0], [1058.0, 2022.0]];
        let share = |height: f64| share_seen(&surface, &outline, height, 1.6, &|_| true).unwrap();
        let at = |share: &[f32], x: usize| share[20 * 81 + x];
        let (low, high) = (share(9.0), share(60.0));
        assert_eq!([at(&low, 40), at(&low, 5)], [1.0, 0.0], "a house of 10 m hides one of 9 m");
        assert!((0.4..0.9).contains(&at(&high, 5)), "its upper part is seen: {}", at(&high, 5));
        assert_eq!(share_seen(&surface, &[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], 9.0, 1.6, &|_| true), None);
    }

    /// An area that a person can see is one that sees the person.
    #[test]
    fn every_cell_lies_on_a_ray() {
        let surface = surface(50, 33, |_, _| 0.0);
        for eye in [[1000.1, 2000.1], [1049.9, 2032.9], [1025.0, 2016.0], [1007.3, 2030.2]] {
            let seen = seen_from(&surface, [eye[0], eye[1], 51.5], 0.0, 1e4).unwrap();
            assert!(seen.iter().all(|seen| *seen), "{eye:?}");
        }
    }
}
