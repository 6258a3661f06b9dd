//! Lines of sight between points: whether each is free, its first obstacle, and its clearance.

use crate::points::Point;
use crate::rays::CityTriangles;
use crate::surface::CitySurface;
use glam::DVec3;
use insula_export::leaves::LeafObjects;
use insula_export::selection::ObjectSelection;
use insula_export::source::ExportSource;
use insula_export::table::{ExportError, csv_cell};
use insula_protocol::mesh_tile::NO_OBJECT;
use rayon::prelude::*;
use std::collections::{BTreeSet, HashMap};
use std::io::{self, Write};

/// Most lines of one analysis.
pub const MAX_LINES: usize = 1_000_000;
/// A line is measured above what it passes at places so far apart.
const STEP_M: f64 = 0.5;
/// What is nearer to an end is what the end is fixed to.
const END_M: f64 = 0.05;

/// Something in the way of a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Obstacle {
    /// World metres.
    pub position: DVec3,
    /// [`NO_OBJECT`] of what belongs to none, such as terrain.
    pub object: u32,
}

/// Where a line passes the nearest above something.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clearance {
    /// Metres straight down; of a line that is not free, by how much what stands highest above it does, as a negative number.
    pub metres: f64,
    /// World metres.
    pub place: [f64; 2],
}

/// A line between two points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    pub length_m: f64,
    /// What stands in the way first; `None` if the line is free.
    pub obstacle: Option<Obstacle>,
    /// `None` of upright lines, and if nothing lies below.
    pub clearance: Option<Clearance>,
}

/// The line between two places in world metres. `ground` has the ground that a bake made, which is no triangle.
#[must_use]
pub fn sight(city: &CityTriangles, ground: Option<&CitySurface>, from: DVec3, to: DVec3) -> Sight {
    let way = to - from;
    let length_m = way.length();
    let obstacle = (length_m > 2.0 * END_M).then(|| way / length_m).and_then(|direction| {
        let (distance, object) = city.first(from + direction * END_M, direction)?;
        let position = from + direction * (END_M + distance);
        (distance < length_m - 2.0 * END_M).then_some(Obstacle { position, object })
    });
    let steps = (way.truncate().length() / STEP_M).ceil() as usize;
    let below = |at: DVec3| {
        let place = [at.x, at.y];
        let ground = ground.and_then(|ground| ground.ground_at(place));
        // Under a bridge, what counts is what lies below the line; of a line that is not free, what stands above it.
        let top = if obstacle.is_some() { city.top(place) } else { city.top_below(at) };
        let top = [top, ground].into_iter().flatten().reduce(f64::max)?;
        Some(Clearance { metres: at.z - top, place })
    };
    let places = (1..steps).map(|i| from + way * (i as f64 / steps as f64));
    let places = places.chain(obstacle.map(|obstacle| obstacle.position));
    let clearance = places.filter_map(below).min_by(|a, b| a.metres.total_cmp(&b.metres));
    Sight { length_m, obstacle, clearance }
}

/// The points of a list with their places in world metres: those of which there is no surface to measure the height from have none.
pub type Ends<'a> = [(&'a Point, Option<DVec3>)];

/// The lines from each point to each other one, in this order; `None` where an end has no place.
#[must_use]
pub fn sights(
    city: &CityTriangles,
    ground: Option<&CitySurface>,
    from: &Ends<'_>,
    to: &Ends<'_>,
) -> Vec<Option<Sight>> {
    let line = |i: usize| Some(sight(city, ground, from[i / to.len()].1?, to[i % to.len()].1?));
    (0..from.len() * to.len()).into_par_iter().map(line).collect()
}

/// Writes a row for each line of [`sights`] as CSV. Fails if objects cannot be read.
pub fn write_table(
    source: &dyn ExportSource,
    [from, to]: [&Ends<'_>; 2],
    sights: &[Option<Sight>],
    out: impl Write,
) -> Result<io::Result<()>, ExportError> {
    let obstacles = sights.iter().flatten().filter_map(|sight| sight.obstacle);
    let names = names(source, obstacles.map(|obstacle| obstacle.object).collect())?;
    Ok(write_rows([from, to], sights, &names, out))
}

/// Numbers and identifiers of the wholes that objects belong to.
fn names(source: &dyn ExportSource, numbers: BTreeSet<u32>) -> Result<HashMap<u32, (u32, String)>, ExportError> {
    let everything = ObjectSelection::default();
    let mut objects = LeafObjects::new(source, &everything);
    let mut names = HashMap::new();
    for number in numbers.into_iter().filter(|number| *number != NO_OBJECT) {
        let whole = objects.whole(number)?;
        names.insert(number, (whole, objects.get(whole)?.identifier.clone()));
    }
    Ok(names)
}

const COLUMNS: [&str; 12] = [
    "from", "to", "length_m", "visible", "obstacle_x", "obstacle_y", "obstacle_z", "obstacle_object",
    "obstacle_identifier", "clearance_m", "clearance_x", "clearance_y",
];

fn write_rows(
    [from, to]: [&Ends<'_>; 2],
    sights: &[Option<Sight>],
    names: &HashMap<u32, (u32, String)>,
    out: impl Write,
) -> io::Result<()> {
    let mut rows = csv::Writer::from_writer(out);
    rows.write_record(COLUMNS)?;
    let pairs = from.iter().flat_map(|(from, _)| to.iter().map(move |(to, _)| (from, to)));
    for ((from, to), sight) in pairs.zip(sights) {
        let mut cells: Vec<String> = [from, to].map(|point| csv_cell(point.id.clone(), false)).to_vec();
        if let Some(sight) = sight {
            let metres = |metres: f64| format!("{metres:.2}");
            cells.extend([metres(sight.length_m), if sight.obstacle.is_none() { "yes" } else { "no" }.to_owned()]);
            let position = sight.obstacle.map(|obstacle| obstacle.position.to_array().map(metres));
            cells.extend(position.unwrap_or_default());
            let name = sight.obstacle.and_then(|obstacle| names.get(&obstacle.object));
            let name = name.map(|(number, name)| [number.to_string(), csv_cell(name.clone(), false)]);
            cells.extend(name.unwrap_or_default());
            let clearance = sight.clearance.map(|Clearance { metres: m, place: [x, y] }| [m, x, y].map(metres));
            cells.extend(clearance.unwrap_or_default());
        }
        cells.resize(COLUMNS.len(), String::new());
        rows.write_record(cells)?;
    }
    rows.flush()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rays::tests::block;

    /// A block of 10 x 10 x 9 m with its corner at (20, 0) on ground that is no triangle.
    #[test]
    fn lines_pass_above_what_they_do_not_hit() {
        let city = block([20.0, 0.0, 0.0], [30.0, 10.0, 9.0], 5);
        let line = |from: [f64; 3], to: [f64; 3]| sight(&city, None, from.into(), to.into());
        let over = line([0.0, 5.0, 12.0], [60.0, 5.0, 12.0]);
        let clearance = over.clearance.unwrap();
        assert!(over.obstacle.is_none() && (clearance.metres - 3.0).abs() < 1e-3, "{over:?}");
        assert!((20.0..=30.0).contains(&clearance.place[0]) && over.length_m == 60.0, "{over:?}");
        let into = line([0.0, 5.0, 2.0], [60.0, 5.0, 2.0]);
        let obstacle = into.obstacle.unwrap();
        assert!((obstacle.position - DVec3::new(20.0, 5.0, 2.0)).length() < 1e-3 && obstacle.object == 5, "{into:?}");
        assert!((into.clearance.unwrap().metres + 7.0).abs() < 1e-3, "{into:?}");
        // Beside it, before it, from its roof, and up from there.
        for (from, to) in [
            ([0.0, 11.0, 2.0], [60.0, 11.0, 2.0]),
            ([0.0, 5.0, 2.0], [19.0, 5.0, 2.0]),
            ([25.0, 5.0, 9.0], [60.0, 5.0, 9.5]),
            ([25.0, 5.0, 9.0], [25.0, 5.0, 50.0]),
        ] {
            assert_eq!(line(from, to).obstacle, None, "{from:?} {to:?}");
        }
        assert!(line([0.0, 11.0, 2.0], [60.0, 11.0, 2.0]).clearance.is_none(), "nothing lies below");
    }

    /// Below a bridge, the line is free, and what counts is the street.
    #[test]
    fn a_line_below_a_bridge_is_free() {
        let bridge = block([20.0, 0.0, 6.0], [30.0, 10.0, 7.0], 5);
        let found = sight(&bridge, None, [0.0, 5.0, 2.0].into(), [60.0, 5.0, 2.0].into());
        assert_eq!((found.obstacle, found.clearance), (None, None));
    }
}
