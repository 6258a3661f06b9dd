//! Hours of sun on every roof, on the ground and on the walls of a city, by a rule.

use crate::light::{SunLight, Total, facing, total};
use crate::probable::day_weights;
use crate::raster::Raster;
use crate::rule::{CountMode, DayMode, Rule};
use crate::sun::{Bearing, Site};
use crate::surface::CitySurface;
use crate::sweep::{Heading, Shadows, TOLERANCE_M, sweep_shadows};
use crate::tally::{Count, LitRun, Tally};
use crate::walls::{WallPoint, wall_points};

/// Hours of sun, or what else a rule measures.
#[derive(Debug, Clone)]
pub struct SunHours {
    /// For the tops of the surface's cells; NaN where nothing was baked.
    pub tops: Vec<f32>,
    pub wall_points: Vec<WallPoint>,
    /// For each of `wall_points`.
    pub walls: Vec<f32>,
}

/// Counts the hours of sun by a rule. `progress` gets the share of the work that is done, and says whether to go on: values are not complete
/// if it does not.
#[must_use]
pub fn sun_hours(
    surface: &mut CitySurface,
    site: &Site,
    rule: &Rule,
    progress: &(dyn Fn(f64) -> bool + Sync),
) -> SunHours {
    match rule.mode {
        CountMode::Cumulative => count::<Count>(surface, site, rule, progress),
        CountMode::LongestRun => count::<LitRun>(surface, site, rule, progress),
    }
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
    let faces = facing(&SunLight { sun, strength: 1.0 });
    dark.iter_mut().zip(&surface.normals.values).for_each(|(dark, normal)| *dark |= faces[usize::from(*normal)] <= 0.0);
    dark
}

fn count<T: Tally>(
    surface: &mut CitySurface,
    site: &Site,
    rule: &Rule,
    progress: &(dyn Fn(f64) -> bool + Sync),
) -> SunHours {
    let points = wall_points(surface, &rule.wall_heights_m);
    surface.measure_above_ground(rule.ground_height_m);
    let mut all = DayValues { mode: rule.day_mode, tops: Vec::new(), walls: Vec::new() };
    for (i, (day, weight)) in rule.days.iter().zip(day_weights(site, rule)).enumerate() {
        if i > 0 && !progress(i as f64 / rule.days.len() as f64) {
            break;
        }
        let suns = rule.suns(site, *day).into_iter().map(|(_, sun)| SunLight { sun, strength: 1.0 });
        let of_day = |share: f64| progress((i as f64 + share) / rule.days.len() as f64);
        let Total::<T> { tops, walls } = total(surface, &points, suns.collect(), &of_day);
        let value = |tally: T| (f64::from(tally.value()) * rule.step_minutes / 60.0 * weight) as f32;
        all.add(tops.into_iter().map(value), walls.into_iter().map(value));
    }
    surface.measure_above_ground(0.0);
    let DayValues { mut tops, walls, .. } = all;
    for (index, value) in tops.iter_mut().enumerate() {
        if !surface.is_known(index) {
            *value = f32::NAN;
        }
    }
    SunHours { tops, walls, wall_points: points }
}

/// Values over the days of a rule.
struct DayValues {
    mode: DayMode,
    tops: Vec<f32>,
    walls: Vec<f32>,
}

impl DayValues {
    fn add(&mut self, tops: impl Iterator<Item = f32>, walls: impl Iterator<Item = f32>) {
        join(self.mode, &mut self.tops, tops);
        join(self.mode, &mut self.walls, walls);
    }
}

fn join(mode: DayMode, all: &mut Vec<f32>, day: impl Iterator<Item = f32>) {
    if all.is_empty() {
        all.extend(day);
        return;
    }
    for (known, value) in all.iter_mut().zip(day) {
        *known = match mode {
            DayMode::Least => known.min(value),
            DayMode::Most => known.max(value),
            DayMode::Sum => *known + value,
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_surface::surface;
    use std::sync::atomic::{AtomicUsize, Ordering};

    const DELFT: Site = Site { latitude_deg: 52.0, longitude_deg: 4.36, north_deg: 0.0 };

    fn rule(lines: &str) -> Rule {
        Rule::parse(&format!("title = \"t\"\nsource = \"s\"\nwall_heights_m = [1]\n{lines}")).unwrap()
    }

    /// A house of 12 m on a plain: a cell is lit when the ray to the sun passes above the house, found here step by step.
    #[test]
    fn hours_are_those_of_rays() {
        let house = |x: usize, y: usize| (30..40).contains(&x) && (30..38).contains(&y);
        let mut surface = surface(70, 70, |x, y| if house(x, y) { 12.0 } else { 0.0 });
        let rule = rule("days = [\"03-21\"]\nstep_minutes = 10");
        let hours = sun_hours(&mut surface, &DELFT, &rule, &|_| true);
        let suns = rule.suns(&DELFT, rule.days[0]);
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

    /// North of a wall of 12 m, a plane of 8 m is as far below its top as the ground is below that of a wall of 4 m.
    #[test]
    fn the_ground_is_measured_at_the_height_of_the_rule() {
        let at = |wall_m: f32, lines: &str| {
            let mut surface = surface(60, 60, |_, y| if (20..24).contains(&y) { wall_m } else { 0.0 });
            let rule = rule(&format!("days = [\"12-21\"]\nstep_minutes = 10\n{lines}"));
            let hours = sun_hours(&mut surface, &DELFT, &rule, &|_| true);
            assert!(surface.measured.is_none() && hours.tops[22 * 60 + 30] > 7.0, "roofs have all of the sun");
            [26, 30, 44].map(|y| hours.tops[y * 60 + 30])
        };
        assert_eq!(at(12.0, "ground_height_m = 8"), at(4.0, ""));
        assert!(at(12.0, "")[2] < at(4.0, "")[2]);
    }

    #[test]
    fn what_was_not_baked_has_no_hours() {
        let mut surface = surface(9, 9, |x, _| if x == 0 { f32::NEG_INFINITY } else { 0.0 });
        let hours = sun_hours(&mut surface, &DELFT, &rule("days = [\"06-21\"]\nmode = \"longest-run\""), &|_| true);
        assert!(hours.tops[0].is_nan() && hours.tops[1] > 16.0 && hours.wall_points.is_empty());
    }

    #[test]
    fn what_nobody_waits_for_ends() {
        let mut surface = surface(40, 40, |_, _| 0.0);
        let calls = AtomicUsize::new(0);
        let stop = |_: f64| {
            calls.fetch_add(1, Ordering::Relaxed);
            false
        };
        let hours = sun_hours(&mut surface, &DELFT, &rule("range = [\"01-01\", \"12-31\"]"), &stop);
        assert!(hours.tops.iter().all(|hours| *hours == 0.0));
        assert!(calls.into_inner() < 10, "a question for each of thousands of suns");
    }

    #[test]
    fn days_count_by_the_least_the_most_or_all() {
        for (mode, wanted) in [(DayMode::Least, [1.0, 2.0]), (DayMode::Most, [5.0, 9.0]), (DayMode::Sum, [6.0, 11.0])] {
            let mut all = Vec::new();
            join(mode, &mut all, [1.0, 9.0].into_iter());
            join(mode, &mut all, [5.0, 2.0].into_iter());
            assert_eq!(all, wanted);
        }
    }
}
