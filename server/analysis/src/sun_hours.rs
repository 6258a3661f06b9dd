//! Hours of sun on every roof, on the ground and on the walls of a city, by a rule.
//!
//! For each moment of a day the shadows of the whole city are swept once ([`sweep_shadows`]): as many steps as there are cells, whatever
//! throws the shadows. What the sun reaches is counted for each cell and each point on a wall.

use crate::{
    raster::Raster,
    rule::{CountMode, DayMode, Rule},
    sun::{Bearing, Site},
    surface::{CitySurface, TopKind},
    sweep::{Heading, Shadows, sweep_shadows},
    tally::{Count, LitRun, Tally},
    walls::{WallPoint, WallRows, wall_points},
};
use chrono::NaiveDate;
use insula_protocol::octahedral;
use rayon::prelude::*;
use std::ops::Range;

/// Heights of columns are rounded to a sixteenth of a cell: a top is in shadow when more than this of it is.
const TOLERANCE_M: f32 = 0.1;

/// A light that grazes a wall more than this leaves the cell before it to the side.
const LEAST_FACING: f64 = 0.35;

/// Whether the surface of each octahedral code of a normal faces the sun.
fn facing(sun: Bearing) -> Vec<bool> {
    let direction = sun.direction().to_array();
    let cos = |code: u16| octahedral::decode(code).iter().zip(direction).map(|(n, d)| f64::from(*n) * d).sum::<f64>();
    (0..=u16::MAX).map(|code| cos(code) > 0.0).collect()
}

/// Hours of sun.
#[derive(Debug, Clone)]
pub struct SunHours {
    /// For the tops of the surface's cells; NaN where nothing was baked.
    pub tops: Vec<f32>,
    pub wall_points: Vec<WallPoint>,
    /// For each of `wall_points`.
    pub walls: Vec<f32>,
}

/// Counts the hours of sun by a rule. `progress` gets the share of the work that is done.
#[must_use]
pub fn sun_hours(surface: &CitySurface, site: &Site, rule: &Rule, progress: &(dyn Fn(f64) + Sync)) -> SunHours {
    match rule.mode {
        CountMode::Cumulative => count::<Count>(surface, site, rule, progress),
        CountMode::LongestRun => count::<LitRun>(surface, site, rule, progress),
    }
}

/// The sun in the middle of each step of a day in which it counts, with the hour of the rule's time.
pub(crate) fn suns_of_day(site: &Site, rule: &Rule, day: NaiveDate) -> Vec<(f64, Bearing)> {
    let [from, to] = rule.hours;
    let step = rule.step_minutes / 60.0;
    let steps = ((to - from) / step).round().max(1.0) as usize;
    let hours = (0..steps).map(|i| from + (i as f64 + 0.5) * step);
    let suns = hours.filter_map(|hour| Some((hour, site.sun(day, hour, rule.time)?)));
    // A sun on the horizon itself lights nothing.
    suns.filter(|(_, sun)| sun.altitude_deg >= rule.lowest_sun_deg.max(0.1)).collect()
}

/// Which cells lie in shadow under a sun: their tops. Where nothing was baked, none.
#[must_use]
pub fn shadow(surface: &CitySurface, sun: Bearing) -> Vec<bool> {
    if sun.altitude_deg <= 0.0 {
        return surface.tops.values.iter().map(|top| top.is_finite()).collect();
    }
    let heading = Heading::of_azimuth(sun.azimuth_deg);
    let across = heading.is_transposed().then(|| surface.tops.transposed());
    let tops = across.as_ref().unwrap_or(&surface.tops);
    let mut dark = Raster::filled(tops.width, tops.height, false);
    let slope = sun.altitude_deg.to_radians().tan();
    sweep_shadows(tops, surface.cell_m, heading, slope, &mut Shadows::default(), |row, shadow| {
        let cells = dark.row_mut(row).iter_mut().zip(tops.row(row)).zip(shadow);
        cells.for_each(|((dark, top), shadow)| *dark = top.is_finite() && *shadow > top + TOLERANCE_M);
    });
    let mut dark = if heading.is_transposed() { dark.transposed().values } else { dark.values };
    let faces = facing(sun);
    dark.iter_mut().zip(&surface.normals.values).for_each(|(dark, normal)| *dark |= !faces[usize::from(*normal)]);
    dark
}

fn count<T: Tally>(surface: &CitySurface, site: &Site, rule: &Rule, progress: &(dyn Fn(f64) + Sync)) -> SunHours {
    let points = wall_points(surface, &rule.wall_heights_m);
    let (across, normals_across) = (surface.tops.transposed(), surface.normals.transposed());
    let field = Field {
        normals: [&surface.normals, &normals_across],
        rows: [false, true].map(|is_transposed| WallRows::new(&points, &surface.tops, is_transposed)),
        tops: [&surface.tops, &across],
        points: &points,
        cell_m: surface.cell_m,
    };
    let mut best = DayBest { mode: rule.day_mode, tops: Vec::new(), walls: Vec::new() };
    for (i, day) in rule.days.iter().enumerate() {
        let suns: Vec<Bearing> = suns_of_day(site, rule, *day).into_iter().map(|(_, sun)| sun).collect();
        let total = field.day::<T>(&suns);
        best.add(total.tops.values.iter().map(|tally| tally.steps()), total.walls.iter().map(|tally| tally.steps()));
        progress((i + 1) as f64 / rule.days.len() as f64);
    }
    let hours = |steps: u32| (f64::from(steps) * rule.step_minutes / 60.0) as f32;
    let of_cell = |(index, steps): (usize, u32)| match surface.kind(index) {
        TopKind::Nothing => f32::NAN,
        _ => hours(steps),
    };
    SunHours {
        tops: best.tops.into_iter().enumerate().map(of_cell).collect(),
        walls: best.walls.into_iter().map(hours).collect(),
        wall_points: points,
    }
}

/// Steps of sun over the days of a rule.
struct DayBest {
    mode: DayMode,
    tops: Vec<u32>,
    walls: Vec<u32>,
}

impl DayBest {
    fn add(&mut self, tops: impl Iterator<Item = u32>, walls: impl Iterator<Item = u32>) {
        join(self.mode, &mut self.tops, tops);
        join(self.mode, &mut self.walls, walls);
    }
}

fn join(mode: DayMode, all: &mut Vec<u32>, day: impl Iterator<Item = u32>) {
    if all.is_empty() {
        all.extend(day);
        return;
    }
    for (known, steps) in all.iter_mut().zip(day) {
        *known = match mode {
            DayMode::Least => (*known).min(steps),
            DayMode::Most => (*known).max(steps),
            DayMode::Sum => known.saturating_add(steps),
        };
    }
}

/// What the shadows are swept over: rows, and columns as rows.
struct Field<'a> {
    tops: [&'a Raster<f32>; 2],
    normals: [&'a Raster<u16>; 2],
    rows: [WallRows; 2],
    points: &'a [WallPoint],
    cell_m: f64,
}

/// Tallies of some moments in sequence.
struct DayPart<T> {
    steps: u16,
    tops: Raster<T>,
    walls: Vec<T>,
}

impl Field<'_> {
    /// All moments of a day, divided among the threads.
    fn day<T: Tally>(&self, suns: &[Bearing]) -> DayPart<T> {
        let threads = rayon::current_num_threads().clamp(1, suns.len().max(1));
        let range = |i: usize| suns.len() * i / threads..suns.len() * (i + 1) / threads;
        let ranges: Vec<Range<usize>> = (0..threads).map(range).collect();
        let parts: Vec<DayPart<T>> = ranges.into_par_iter().map(|range| self.part(&suns[range])).collect();
        let mut parts = parts.into_iter();
        let first = parts.next().unwrap_or_else(|| self.part(&[]));
        parts.fold(first, |mut all, next| {
            let steps = [all.steps, next.steps];
            all.tops.values.par_iter_mut().zip(next.tops.values).for_each(|(a, b)| *a = a.then(b, steps));
            all.walls.iter_mut().zip(next.walls).for_each(|(a, b)| *a = a.then(b, steps));
            all.steps += next.steps;
            all
        })
    }

    fn part<T: Tally>(&self, suns: &[Bearing]) -> DayPart<T> {
        let mut is_transposed = false;
        let mut tops = Raster::filled(self.tops[0].width, self.tops[0].height, T::default());
        let mut walls = vec![T::default(); self.points.len()];
        let mut shadows = Shadows::default();
        for (step, sun) in (0u16..).zip(suns) {
            let heading = Heading::of_azimuth(sun.azimuth_deg);
            if heading.is_transposed() != is_transposed {
                tops = tops.transposed();
                is_transposed = !is_transposed;
            }
            let way = usize::from(is_transposed);
            let (heights, normals, points) = (self.tops[way], self.normals[way], &self.rows[way]);
            let faces = facing(*sun);
            let slope = sun.altitude_deg.to_radians().tan();
            sweep_shadows(heights, self.cell_m, heading, slope, &mut shadows, |row, shadow| {
                let cells = tops.row_mut(row).iter_mut().zip(heights.row(row).iter().zip(normals.row(row))).zip(shadow);
                cells.for_each(|((tally, (top, normal)), shadow)| {
                    tally.add(*shadow <= top + TOLERANCE_M && faces[usize::from(*normal)], step);
                });
                for (number, place) in points.row(row, self.points) {
                    let point = &self.points[number];
                    let facing = (f64::from(point.azimuth_deg) - sun.azimuth_deg).to_radians().cos();
                    // The wall stands half a cell behind the middle of the cell before it; the shadow has sunk there.
                    let behind = 0.5 * self.cell_m / facing.max(LEAST_FACING) * slope;
                    let is_lit = facing > 0.0 && shadow[place] - behind as f32 <= point.height_m;
                    walls[number].add(is_lit, step);
                }
            });
        }
        if is_transposed {
            tops = tops.transposed();
        }
        DayPart { steps: suns.len() as u16, tops, walls }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_surface::surface;

    const DELFT: Site = Site { latitude_deg: 52.0, longitude_deg: 4.36, north_deg: 0.0 };

    fn rule(lines: &str) -> Rule {
        Rule::parse(&format!("title = \"t\"\nsource = \"s\"\nwall_heights_m = [1]\n{lines}")).unwrap()
    }

    /// A house of 12 m on a plain: a cell is lit when the ray to the sun passes above the house, found here step by step.
    #[test]
    fn hours_are_those_of_rays() {
        let house = |x: usize, y: usize| (30..40).contains(&x) && (30..38).contains(&y);
        let surface = surface(70, 70, |x, y| if house(x, y) { 12.0 } else { 0.0 });
        let rule = rule("days = [\"03-21\"]\nstep_minutes = 10");
        let hours = sun_hours(&surface, &DELFT, &rule, &|_| {});
        let suns = suns_of_day(&DELFT, &rule, rule.days[0]);
        assert!((70..=73).contains(&suns.len()), "an equinox has 12 hours: {}", suns.len());
        let by_ray = |x: usize, y: usize| {
            let is_lit = |(_, sun): &&(f64, Bearing)| {
                let heading = Heading::of_azimuth(sun.azimuth_deg);
                let rise = sun.altitude_deg.to_radians().tan();
                // The ray leaves the house's height within 12 / rise metres.
                !(1..4000).map(|i| f64::from(i) * 0.05).take_while(|t| t * rise < 12.0).any(|t| {
                    let [x, y] = [x as f64 + heading.x * t, y as f64 + heading.y * t].map(f64::round);
                    x >= 0.0 && y >= 0.0 && house(x as usize, y as usize)
                })
            };
            suns.iter().filter(is_lit).count() as f32 / 6.0
        };
        // Lines pass within half a cell of a cell's middle: 4 degrees, a quarter of an hour, where the house is 7 m away.
        let places =
            [(35, 45, 0.25), (35, 40, 0.7), (28, 34, 0.4), (50, 40, 0.2), (35, 20, 0.0), (20, 50, 0.2), (60, 60, 0.1)];
        for (x, y, tolerance) in places {
            let (found, wanted) = (hours.tops[y * 70 + x], by_ray(x, y));
            assert!((found - wanted).abs() <= tolerance, "{x} {y}: {found}, not {wanted}");
        }
        let most = suns.len() as f32 / 6.0;
        assert!(hours.tops[34 * 70 + 35] == most, "a roof has all of the sun");
        assert!(by_ray(35, 40) < most - 3.0, "the test has shadow");
        // The southern wall has the sun while it stands south of east and west; the northern one none.
        let of_side = |azimuth: f32| {
            let points = hours.wall_points.iter().zip(&hours.walls);
            points.filter(|(point, _)| point.azimuth_deg == azimuth).map(|(_, hours)| *hours).collect::<Vec<f32>>()
        };
        assert!(of_side(0.0).len() == 10 && of_side(0.0).iter().all(|hours| *hours < 0.4), "{:?}", of_side(0.0));
        assert!(of_side(180.0).iter().all(|hours| *hours > 11.0), "{:?}", of_side(180.0));
        assert!(of_side(90.0).len() == 8 && of_side(90.0).iter().all(|hours| (5.0..7.0).contains(hours)));
    }

    #[test]
    fn what_was_not_baked_has_no_hours() {
        let surface = surface(9, 9, |x, _| if x == 0 { f32::NEG_INFINITY } else { 0.0 });
        let hours = sun_hours(&surface, &DELFT, &rule("days = [\"06-21\"]\nmode = \"longest-run\""), &|_| {});
        assert!(hours.tops[0].is_nan() && hours.tops[1] > 16.0 && hours.wall_points.is_empty());
    }

    #[test]
    fn days_count_by_the_least_the_most_or_all() {
        for (mode, wanted) in [(DayMode::Least, [1, 2]), (DayMode::Most, [5, 9]), (DayMode::Sum, [6, 11])] {
            let mut all = Vec::new();
            join(mode, &mut all, [1, 9].into_iter());
            join(mode, &mut all, [5, 2].into_iter());
            assert_eq!(all, wanted);
        }
    }
}
