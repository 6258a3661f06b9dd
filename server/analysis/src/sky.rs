//! Shares of the sky that roofs, ground and walls see.

use crate::{
    horizon::{Hull, sweep_horizons},
    raster::Raster,
    surface::{CitySurface, TopKind},
    sweep::Heading,
    walls::{WallPoint, WallRows, wall_points},
};
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

/// Sums over some directions.
struct SkySums {
    tops: Raster<f32>,
    walls: Vec<f32>,
}

/// Computes sky view factors of all cells, and vertical sky components on walls at heights above the ground in metres.
#[must_use]
pub fn sky_view(surface: &CitySurface, wall_heights_m: &[f64], progress: &(dyn Fn(f64) + Sync)) -> SkyView {
    let points = wall_points(surface, wall_heights_m);
    let across = surface.tops.transposed();
    // Directions of one orientation follow one another, so that sums are turned once.
    let mut azimuths: Vec<f64> = (0..AZIMUTHS).map(|i| (i as f64 + 0.5) * 360.0 / AZIMUTHS as f64).collect();
    azimuths.sort_by_key(|azimuth| Heading::of_azimuth(*azimuth).is_transposed());
    let (along, over) = azimuths.split_at(azimuths.partition_point(|a| !Heading::of_azimuth(*a).is_transposed()));
    let rows = [false, true].map(|is_transposed| WallRows::new(&points, &surface.tops, is_transposed));
    let done = std::sync::atomic::AtomicUsize::new(0);
    let threads = rayon::current_num_threads().clamp(1, AZIMUTHS / 2);
    let sum = |heights: &Raster<f32>, rows: &WallRows, azimuths: &[f64]| {
        let share = azimuths.len().div_ceil(threads).max(1);
        let parts: Vec<SkySums> = azimuths
            .par_chunks(share)
            .map(|azimuths| {
                let mut part = SkySums {
                    tops: Raster::filled(heights.width, heights.height, 0.0f32),
                    walls: vec![0.0; points.len()],
                };
                let mut hulls = Vec::new();
                for azimuth in azimuths {
                    add_direction(heights, rows, &points, surface.cell_m, *azimuth, &mut hulls, &mut part);
                    let done = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
                    progress(done as f64 / AZIMUTHS as f64);
                }
                part
            })
            .collect();
        let mut parts = parts.into_iter();
        let first = parts
            .next()
            .unwrap_or_else(|| SkySums { tops: Raster::filled(heights.width, heights.height, 0.0), walls: Vec::new() });
        parts.fold(first, |mut all, next| {
            add_all(&mut all.tops.values, &next.tops.values);
            add_all(&mut all.walls, &next.walls);
            all
        })
    };
    let mut all = sum(&surface.tops, &rows[0], along);
    let turned = sum(&across, &rows[1], over);
    add_all(&mut all.tops.values, &turned.tops.transposed().values);
    add_all(&mut all.walls, &turned.walls);
    let of_cell = |(index, sum): (usize, f32)| match surface.kind(index) {
        TopKind::Nothing => f32::NAN,
        _ => sum / AZIMUTHS as f32,
    };
    SkyView {
        tops: all.tops.values.into_iter().enumerate().map(of_cell).collect(),
        walls: all.walls,
        wall_points: points,
    }
}

fn add_all(all: &mut [f32], more: &[f32]) {
    all.iter_mut().zip(more).for_each(|(a, b)| *a += b);
}

fn add_direction(
    heights: &Raster<f32>,
    rows: &WallRows,
    points: &[WallPoint],
    cell_m: f64,
    azimuth_deg: f64,
    hulls: &mut Vec<Hull>,
    part: &mut SkySums,
) {
    let SkySums { tops, walls } = part;
    let per_metre = (1.0 / cell_m) as f32;
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
    sweep_horizons(heights, Heading::of_azimuth(azimuth_deg), cell_m, hulls, on_walls, |row, slopes| {
        for (sum, slope) in tops.row_mut(row).iter_mut().zip(slopes) {
            // The squared cosine of the horizon's altitude: the share of an even sky's light above it.
            let slope = slope.max(0.0);
            *sum += 1.0 / (1.0 + slope * slope);
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
        let surface = surface(101, 1001, |x, _| if is_street(x) { 0.0 } else { 15.0 });
        let sky = sky_view(&surface, &[], &|_| {});
        let wanted = (15.0f64 / 11.0).atan().cos();
        let found = f64::from(sky.tops[500 * 101 + 50]);
        // Walls begin at the middle of their cells.
        assert!((found - wanted).abs() < 0.02, "{found}, not {wanted}");
        assert_eq!(sky.tops[500 * 101 + 20], 1.0, "roofs see all of it");
    }

    #[test]
    fn walls_of_a_lonely_house_see_half_of_the_sky() {
        let surface = surface(41, 41, |x, y| if (15..25).contains(&x) && (15..25).contains(&y) { 9.0 } else { 0.0 });
        let sky = sky_view(&surface, &[1.5, 20.0], &|_| {});
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
