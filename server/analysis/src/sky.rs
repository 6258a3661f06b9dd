//! Shares of the sky that roofs, ground and walls see.

use crate::horizon::{Hull, sweep_horizons};
use crate::raster::Raster;
use crate::surface::CitySurface;
use crate::sweep::Heading;
use crate::walls::{WallPoint, WallRows, wall_points};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Directions of the horizon.
pub const AZIMUTHS: usize = 64;

/// Shares of the sky that roofs, ground and walls see.
#[derive(Debug, Clone)]
pub struct SkyView {
    /// Sky view factor of the tops of the surface's cells, 0 to 1: the share of the light of an even sky that a level surface gets. NaN where
    /// nothing was baked.
    pub tops: Vec<f32>,
    pub wall_points: Vec<WallPoint>,
    /// Vertical sky component of each of `wall_points` in percent, 0 to 39.6: the light of a standard overcast sky (CIE) on a wall, beside
    /// that on open level ground.
    pub walls: Vec<f32>,
}

/// What a direction without any horizon adds to a sum: all of them together fit into 16 bits.
const WHOLE: f32 = (u16::MAX as usize / AZIMUTHS) as f32;

/// Sums over some directions.
struct SkySums {
    /// Shares of the sky's light in parts of [`WHOLE`].
    tops: Raster<u16>,
    walls: Vec<f32>,
}

/// Computes sky view factors of all cells, and vertical sky components on walls at heights above the ground in metres. The surface is
/// turned meanwhile. `progress` gets the share of the work that is done, and says whether to go on: values are not complete if it does not.
#[must_use]
pub fn sky_view(surface: &mut CitySurface, wall_heights_m: &[f64], progress: &(dyn Fn(f64) -> bool + Sync)) -> SkyView {
    let points = wall_points(surface, wall_heights_m);
    // Directions of one orientation follow one another, so that the surface is turned once.
    let mut azimuths: Vec<f64> = (0..AZIMUTHS).map(|i| (i as f64 + 0.5) * 360.0 / AZIMUTHS as f64).collect();
    azimuths.sort_by_key(|azimuth| Heading::of_azimuth(*azimuth).is_transposed());
    let (along, over) = azimuths.split_at(azimuths.partition_point(|a| !Heading::of_azimuth(*a).is_transposed()));
    let done = std::sync::atomic::AtomicUsize::new(0);
    let step = || {
        let done = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
        progress(done as f64 / AZIMUTHS as f64)
    };
    let mut all = sums(surface, &points, along, false, &step);
    surface.turn();
    all.tops = all.tops.transposed();
    let turned = sums(surface, &points, over, true, &step);
    all.add(turned);
    surface.turn();
    let tops = all.tops.transposed();
    let of_cell = |(index, sum): (usize, u16)| match surface.is_known(index) {
        true => f32::from(sum) / (WHOLE * AZIMUTHS as f32),
        false => f32::NAN,
    };
    SkyView { tops: tops.values.into_iter().enumerate().map(of_cell).collect(), walls: all.walls, wall_points: points }
}

/// The sums over directions of one orientation.
fn sums(
    surface: &CitySurface,
    points: &[WallPoint],
    azimuths: &[f64],
    is_turned: bool,
    step: &(dyn Fn() -> bool + Sync),
) -> SkySums {
    let rows = WallRows::new(points, surface.size(), is_turned);
    let nothing =
        || SkySums { tops: Raster::filled(surface.tops.width, surface.tops.height, 0), walls: vec![0.0; points.len()] };
    let share = azimuths.len().div_ceil(rayon::current_num_threads()).max(1);
    let part = |azimuths: &[f64]| {
        let mut part = nothing();
        let mut hulls = Vec::new();
        for azimuth in azimuths {
            add_direction(surface, &rows, points, *azimuth, &mut hulls, &mut part);
            if !step() {
                break;
            }
        }
        part
    };
    let parts: Vec<SkySums> = azimuths.par_chunks(share).map(part).collect();
    let mut parts = parts.into_iter();
    let mut all = parts.next().unwrap_or_else(nothing);
    parts.for_each(|next| all.add(next));
    all
}

impl SkySums {
    fn add(&mut self, more: Self) {
        self.tops.values.iter_mut().zip(more.tops.values).for_each(|(a, b)| *a += b);
        self.walls.iter_mut().zip(more.walls).for_each(|(a, b)| *a += b);
    }
}

fn add_direction(
    surface: &CitySurface,
    rows: &WallRows,
    points: &[WallPoint],
    azimuth_deg: f64,
    hulls: &mut Vec<Hull>,
    part: &mut SkySums,
) {
    let SkySums { tops, walls } = part;
    let per_metre = (1.0 / surface.cell_m) as f32;
    let on_walls = |row: usize, line: &[Hull], at: f32| {
        for (number, place) in rows.row(row, points) {
            let point = &points[number];
            let facing = (f64::from(point.azimuth_deg) - azimuth_deg).to_radians().cos();
            if facing > 0.0 {
                let slope = line[place].slope_from(at, point.height_m) * per_metre;
                walls[number] += vertical_component(f64::from(slope.max(0.0)), facing) as f32;
            }
        }
    };
    let heading = Heading::of_azimuth(azimuth_deg);
    sweep_horizons(&surface.tops, heading, surface.cell_m, hulls, on_walls, |row, slopes| {
        for (sum, slope) in tops.row_mut(row).iter_mut().zip(slopes) {
            // The squared cosine of the horizon's altitude: the share of an even sky's light above it.
            let slope = slope.max(0.0);
            *sum += (WHOLE / (1.0 + slope * slope) + 0.5) as u16;
        }
    });
}

/// What the sky above a horizon of a direction's sector adds to the vertical sky component, in percent. The luminance of the standard
/// overcast sky is (1 + 2 sin altitude) / 3 of that of the zenith (ISO 15469), and open ground gets 7/9 pi of it.
fn vertical_component(slope: f64, facing: f64) -> f64 {
    let altitude = slope.atan();
    // The integrals of cos^2 and sin cos^2 from the horizon to the zenith.
    let even = 0.5 * (PI / 2.0 - altitude - altitude.sin() * altitude.cos());
    let graded = altitude.cos().powi(3) / 3.0;
    let sector = 2.0 * PI / AZIMUTHS as f64;
    100.0 * sector * facing * (even + 2.0 * graded) / 3.0 / (7.0 / 9.0 * PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_surface::surface;

    /// On the middle of a long street, the sky view factor is the cosine of the altitude of its roofs (Oke, Boundary Layer Climates).
    #[test]
    fn a_street_sees_the_sky_between_its_roofs() {
        let is_street = |x: usize| (40..61).contains(&x);
        let mut surface = surface(101, 1001, |x, _| if is_street(x) { 0.0 } else { 15.0 });
        let sky = sky_view(&mut surface, &[], &|_| true);
        let wanted = (15.0f64 / 11.0).atan().cos();
        let found = f64::from(sky.tops[500 * 101 + 50]);
        // Walls begin at the middle of their cells.
        assert!((found - wanted).abs() < 0.02, "{found}, not {wanted}");
        assert_eq!(sky.tops[500 * 101 + 20], 1.0, "roofs see all of it");
    }

    #[test]
    fn walls_of_a_lonely_house_see_half_of_the_sky() {
        let mut surface =
            surface(41, 41, |x, y| if (15..25).contains(&x) && (15..25).contains(&y) { 9.0 } else { 0.0 });
        let sky = sky_view(&mut surface, &[1.5, 20.0], &|_| true);
        assert_eq!(sky.walls.len(), 40, "20 m is above the roof");
        assert!(sky.walls.iter().all(|share| (share - 39.6).abs() < 0.3), "{:?}", sky.walls);
    }

    /// BR 209 gives just under 40% for a wall without anything before it, and 27% behind an obstruction of 25 degrees.
    #[test]
    fn walls_see_the_sky_as_the_guide_says() {
        let of_horizon = |degrees: f64| -> f64 {
            let slope = degrees.to_radians().tan();
            let azimuths = (0..AZIMUTHS).map(|i| ((i as f64 + 0.5) / AZIMUTHS as f64 * 360.0).to_radians());
            // A long obstruction: its horizon sinks to the sides.
            azimuths.filter(|a| a.cos() > 0.0).map(|a| vertical_component(slope * a.cos(), a.cos())).sum()
        };
        assert!((of_horizon(0.0) - 39.6).abs() < 0.1, "{}", of_horizon(0.0));
        assert!((of_horizon(25.0) - 27.0).abs() < 0.7, "{}", of_horizon(25.0));
    }
}
