//! What many positions of a light reach: the tops of all cells, and points on walls.
//!
//! For each position the shadows of the whole city are swept once ([`sweep_shadows`]): as many steps as there are cells, whatever throws
//! the shadows. Positions are divided among the threads, each with counts of its own, which are as small as can be. Sweeps read rows, so
//! that the surface is turned for lights from east and west; both ways together would not fit into the memory of small machines.

use crate::raster::Raster;
use crate::sun::Bearing;
use crate::surface::CitySurface;
use crate::sweep::{Heading, Shadows, TOLERANCE_M, sweep_shadows};
use crate::tally::{MAX_PART, Tally};
use crate::walls::{WallPoint, WallRows};
use insula_protocol::octahedral;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A light that grazes a wall more than this leaves the cell before it to the side.
const LEAST_FACING: f64 = 0.35;

/// A position of the sun, and how strong it is there on a surface that faces it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SunLight {
    pub(crate) sun: Bearing,
    pub(crate) strength: f64,
}

/// What is counted of all lights.
pub(crate) struct Total<T> {
    /// For the tops of the surface's cells.
    pub(crate) tops: Vec<T>,
    /// For each point on a wall.
    pub(crate) walls: Vec<T>,
}

/// The light on the surface of each octahedral code of a normal; 0 on those that do not face it.
pub(crate) fn facing(light: &SunLight) -> Vec<f32> {
    let direction = light.sun.direction().to_array();
    let cos = |code: u16| octahedral::decode(code).iter().zip(direction).map(|(n, d)| f64::from(*n) * d).sum::<f64>();
    (0..=u16::MAX).map(|code| (cos(code).max(0.0) * light.strength) as f32).collect()
}

fn is_transposed(light: &SunLight) -> bool {
    Heading::of_azimuth(light.sun.azimuth_deg).is_transposed()
}

/// Counts lights above the horizon. The surface is turned meanwhile. `progress` gets the share of the work that is done, and says whether to
/// go on: what is counted is not complete if it does not.
pub(crate) fn total<T: Tally>(
    surface: &mut CitySurface,
    points: &[WallPoint],
    mut lights: Vec<SunLight>,
    progress: &(dyn Fn(f64) -> bool + Sync),
) -> Total<T> {
    if !T::HAS_SEQUENCE {
        lights.sort_by_key(is_transposed);
    }
    let [width, height] = surface.size();
    let mut tops = Raster::filled(width, height, T::default());
    let mut walls = vec![T::default(); points.len()];
    let (mut is_turned, mut before) = (false, 0u16);
    let done = AtomicUsize::new(0);
    let count = lights.len();
    let step = || progress((done.fetch_add(1, Ordering::Relaxed) + 1) as f64 / count as f64);
    let goes_on = || progress(done.load(Ordering::Relaxed) as f64 / count as f64);
    for run in lights.chunk_by(|a, b| is_transposed(a) == is_transposed(b)) {
        if is_transposed(&run[0]) != is_turned {
            is_turned = !is_turned;
            surface.turn();
            tops = tops.transposed();
        }
        let field = Field { surface, rows: &WallRows::new(points, [width, height], is_turned), points, step: &step };
        let parts = rayon::current_num_threads().clamp(1, run.len()).max(run.len().div_ceil(MAX_PART));
        let range = |i: usize| run.len() * i / parts..run.len() * (i + 1) / parts;
        let ranges: Vec<Range<usize>> = (0..parts).map(range).collect();
        for ranges in ranges.chunks(rayon::current_num_threads().max(1)) {
            if !goes_on() {
                break;
            }
            let parts: Vec<_> = ranges.par_iter().map(|range| field.part::<T>(&run[range.clone()])).collect();
            for (part, range) in parts.into_iter().zip(ranges) {
                let moments = [before, range.len() as u16];
                tops.values.par_iter_mut().zip(part.tops).for_each(|(all, next)| *all = all.then(next, moments));
                walls.iter_mut().zip(part.walls).for_each(|(all, next)| *all = all.then(next, moments));
                before = before.saturating_add(range.len() as u16);
            }
        }
    }
    if is_turned {
        surface.turn();
        tops = tops.transposed();
    }
    Total { tops: tops.values, walls }
}

/// A surface that is turned as the lights need it.
struct Field<'a> {
    surface: &'a CitySurface,
    rows: &'a WallRows,
    points: &'a [WallPoint],
    /// Called after each light. Says whether to go on.
    step: &'a (dyn Fn() -> bool + Sync),
}

impl Field<'_> {
    fn part<T: Tally>(&self, lights: &[SunLight]) -> Total<T::Part> {
        let CitySurface { tops: heights, normals, cell_m, measured, .. } = self.surface;
        let (places, normals) = measured.as_ref().map_or((heights, normals), |planes| (&planes.tops, &planes.normals));
        let mut tops = Raster::filled(heights.width, heights.height, T::Part::default());
        let mut walls = vec![T::Part::default(); self.points.len()];
        let mut shadows = Shadows::default();
        for (moment, light) in (0u16..).zip(lights) {
            let Bearing { azimuth_deg, altitude_deg } = light.sun;
            let faces = facing(light);
            let on_walls = light.strength * altitude_deg.to_radians().cos();
            let slope = altitude_deg.to_radians().tan();
            let heading = Heading::of_azimuth(azimuth_deg);
            sweep_shadows(heights, *cell_m, heading, slope, &mut shadows, |row, shadow| {
                let cells = tops.row_mut(row).iter_mut().zip(places.row(row).iter().zip(normals.row(row))).zip(shadow);
                cells.for_each(|((part, (top, normal)), shadow)| {
                    let light = if *shadow <= top + TOLERANCE_M { faces[usize::from(*normal)] } else { 0.0 };
                    T::add(part, light, moment);
                });
                for (number, place) in self.rows.row(row, self.points) {
                    let point = &self.points[number];
                    let facing = (f64::from(point.azimuth_deg) - azimuth_deg).to_radians().cos();
                    // The wall stands half a cell behind the middle of the cell before it; the shadow has sunk there.
                    let behind = 0.5 * cell_m / facing.max(LEAST_FACING) * slope;
                    let is_lit = facing > 0.0 && shadow[place] - behind as f32 <= point.height_m;
                    T::add(&mut walls[number], if is_lit { (facing * on_walls) as f32 } else { 0.0 }, moment);
                }
            });
            if !(self.step)() {
                break;
            }
        }
        Total { tops: tops.values, walls }
    }
}
