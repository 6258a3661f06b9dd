//! Protected vistas: what rises into the plane between a viewpoint and its target.

use crate::surface::{Building, CitySurface, TopKind};
use insula_export::table::csv_cell;
use std::collections::HashMap;
use std::io::{self, Write};

/// A view that is to stay free: a corridor from a viewpoint to a target, which widens evenly, and a plane from the one's height to the
/// other's.
#[derive(Debug, Clone, PartialEq)]
pub struct Vista {
    pub name: String,
    /// World metres.
    pub viewpoint: [f64; 3],
    /// World metres.
    pub target: [f64; 3],
    /// Of the corridor at the target.
    pub width_m: f64,
}

impl Vista {
    /// Height of the plane at a place on the map, with the distance from the viewpoint along the corridor; `None` outside of it.
    fn plane(&self, place: [f64; 2]) -> Option<(f64, f64)> {
        let along = [0, 1].map(|k| self.target[k] - self.viewpoint[k]);
        let length = along[0].hypot(along[1]);
        let from = [0, 1].map(|k| place[k] - self.viewpoint[k]);
        let ahead = (from[0] * along[0] + from[1] * along[1]) / length;
        let aside = (from[0] * along[1] - from[1] * along[0]) / length;
        let share = ahead / length;
        let is_inside = ahead > 0.0 && share <= 1.0 && aside.abs() <= 0.5 * self.width_m * share;
        is_inside.then(|| (self.viewpoint[2] + share * (self.target[2] - self.viewpoint[2]), ahead))
    }
}

/// By how much a building breaks into a vista.
#[derive(Debug, Clone, PartialEq)]
pub struct Breach<'a> {
    pub vista: &'a Vista,
    pub building: &'a Building,
    /// How far it rises above the plane.
    pub above_m: f64,
    /// Where it does, in world metres.
    pub place: [f64; 3],
    /// Of this place from the viewpoint.
    pub distance_m: f64,
    /// Of its parts that are above the plane.
    pub area_m2: f64,
}

/// What breaks into vistas.
#[derive(Debug, Clone)]
pub struct Breaches<'a> {
    /// How far the top of each cell rises above the lowest plane there, at least 0; NaN outside of all vistas, and where nothing was baked.
    pub tops: Vec<f32>,
    /// The highest first, vista by vista. What a proposal adds is no building.
    pub buildings: Vec<Breach<'a>>,
    /// How far what was added rises above a plane at most; `None` if it does nowhere.
    pub added_m: Option<f64>,
}

/// Finds what breaks into vistas. The building at the target is left out, but not what was added to the surface `before`.
#[must_use]
pub fn breaches<'a>(surface: &'a CitySurface, vistas: &'a [Vista], before: Option<&CitySurface>) -> Breaches<'a> {
    let mut all = Breaches { tops: vec![f32::NAN; surface.tops.values.len()], buildings: Vec::new(), added_m: None };
    let width = surface.size()[0];
    for vista in vistas {
        let target = surface.cell_at([vista.target[0], vista.target[1]]);
        let target = target.map(|[x, y]| surface.kind(y * width + x));
        let mut found: HashMap<u32, Breach> = HashMap::new();
        for (index, known) in all.tops.iter_mut().enumerate() {
            let top = f64::from(surface.top(index)) + surface.base_m;
            let middle = [index % width, index / width].map(|v| v as f64 + 0.5);
            let place = [0, 1].map(|k| surface.corner[k] + middle[k] * surface.cell_m);
            let Some((plane, distance_m)) = vista.plane(place).filter(|_| top.is_finite()) else { continue };
            let kind = surface.kind(index);
            let is_added = before.is_some_and(|before| surface.is_added(before, index));
            let above = if Some(kind) == target && !is_added { 0.0 } else { top - plane };
            *known = known.max(above.max(0.0) as f32);
            if is_added && above > 0.0 {
                all.added_m = Some(all.added_m.map_or(above, |highest| highest.max(above)));
            }
            let (TopKind::Roof(number), true) = (kind, above > 0.0) else { continue };
            let breach = Breach {
                vista,
                building: &surface.buildings[number as usize],
                above_m: above,
                place: [place[0], place[1], top],
                distance_m,
                area_m2: surface.cell_m * surface.cell_m,
            };
            found
                .entry(number)
                .and_modify(|old| {
                    let area_m2 = old.area_m2 + breach.area_m2;
                    *old = if above > old.above_m { breach.clone() } else { old.clone() };
                    old.area_m2 = area_m2;
                })
                .or_insert(breach);
        }
        let mut found: Vec<Breach> = found.into_values().collect();
        found.sort_by(|a, b| b.above_m.total_cmp(&a.above_m).then(a.building.number.cmp(&b.building.number)));
        all.buildings.extend(found);
    }
    all
}

/// Writes a row for each building in each vista as CSV. Fails if `out` cannot be written.
pub fn write_table(breaches: &[Breach<'_>], out: impl Write) -> io::Result<()> {
    let mut rows = csv::Writer::from_writer(out);
    rows.write_record(["vista", "object", "identifier", "above_m", "x", "y", "z", "distance_m", "area_m2"])?;
    for Breach { vista, building, above_m, place, distance_m, area_m2 } in breaches {
        let mut cells = vec![
            csv_cell(vista.name.clone(), false),
            building.number.to_string(),
            csv_cell(building.identifier.clone(), false),
            format!("{above_m:.2}"),
        ];
        cells.extend(place.map(|metres| format!("{metres:.2}")));
        cells.extend([distance_m, area_m2].map(|value| format!("{value:.1}")));
        rows.write_record(cells)?;
    }
    rows.flush()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proposal::Addition;
    use crate::test_surface::surface;

    /// From 30 m at (1000, 2020) to 10 m at (1200, 2020): the plane sinks by 1 m in 10. A house of 25 m at half of the way, where the plane is
    /// at 20 m, and the corridor 10 m wide.
    #[test]
    fn houses_break_into_a_corridor_by_what_is_above_its_plane() {
        let house = |x: usize, y: usize| (98..103).contains(&x) && (10..22).contains(&y);
        let surface = surface(220, 41, |x, y| if house(x, y) { 25.0 } else { 0.0 });
        let base = surface.base_m;
        let vista = |target: f64| Vista {
            name: "dome".to_owned(),
            viewpoint: [1000.0, 2020.0, base + 30.0],
            target: [1200.0, 2020.0, base + target],
            width_m: 20.0,
        };
        let vistas = [vista(10.0), vista(60.0)];
        let found = breaches(&surface, &vistas, None);
        let [breach] = &found.buildings[..] else { panic!("{found:?}") };
        // Its last column is the farthest, at 102.5 m.
        assert!((breach.above_m - (25.0 - (30.0 - 10.25))).abs() < 1e-6, "{breach:?}");
        assert!((breach.distance_m - 102.5).abs() < 1e-6 && (breach.place[2] - base - 25.0).abs() < 1e-6);
        // Rows 15 to 21 are within 5 m of the middle of the corridor at 2020, and none of the house is north of it.
        assert!((32.0..=37.0).contains(&breach.area_m2), "{breach:?}");
        let at = |x: usize, y: usize| found.tops[y * 220 + x];
        assert!((at(100, 20) - (25.0 - (30.0 - 10.05))).abs() < 1e-4 && at(150, 20) == 0.0);
        assert!(at(100, 12).is_nan() && at(210, 20).is_nan() && at(3, 25).is_nan(), "outside of the corridor");
        let mut text = Vec::new();
        write_table(&found.buildings, &mut text).unwrap();
        assert!(String::from_utf8(text).unwrap().contains("dome,7,house,5.25,1102.50,"));
    }

    #[test]
    fn the_target_does_not_break_into_its_own_vista() {
        let surface = surface(120, 41, |x, _| if x >= 95 { 50.0 } else { 0.0 });
        let vista = Vista {
            name: String::new(),
            viewpoint: [1000.0, 2020.0, surface.base_m + 2.0],
            target: [1100.0, 2020.0, surface.base_m + 20.0],
            width_m: 30.0,
        };
        assert!(breaches(&surface, &[vista], None).buildings.is_empty());
    }

    #[test]
    fn what_is_added_breaks_into_a_vista_without_a_row() {
        let before = surface(120, 41, |x, _| if x >= 95 { 50.0 } else { 0.0 });
        let ring = [[1040.0, 2015.0], [1050.0, 2015.0], [1050.0, 2025.0], [1040.0, 2025.0], [1040.0, 2015.0]];
        let block = |height: f64| Addition::Block { outline: vec![ring.to_vec()], top_m: before.base_m + height };
        let vistas = [Vista {
            name: String::new(),
            viewpoint: [1000.0, 2020.0, before.base_m + 2.0],
            target: [1100.0, 2020.0, before.base_m + 20.0],
            width_m: 30.0,
        }];
        let [low, high] = [5.0, 40.0].map(|height| before.with_additions(&[block(height)]));
        let found = breaches(&high, &vistas, Some(&before));
        // Its first column is the nearest, at 40.5 m, where the plane is at 9.29 m.
        assert!((found.added_m.unwrap() - 30.71).abs() < 1e-4 && found.buildings.is_empty(), "{:?}", found.added_m);
        assert_eq!(breaches(&high, &vistas, None).added_m, None);
        assert_eq!(breaches(&low, &vistas, Some(&before)).added_m, None);
    }
}
