//! PlaceValues of roofs and walls as a row for each building.

use crate::{
    surface::{Building, CitySurface, TopKind},
    walls::WallPoint,
};
use insula_export::table::csv_cell;
use std::io::{self, Write};

/// The values of some cells or points of a building.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaceValues {
    pub count: u32,
    pub least: f32,
    pub most: f32,
    sum: f64,
    /// How many reach what is asked for.
    pub reaching: u32,
}

impl Default for PlaceValues {
    fn default() -> Self {
        Self { count: 0, least: f32::INFINITY, most: f32::NEG_INFINITY, sum: 0.0, reaching: 0 }
    }
}

impl PlaceValues {
    /// Adds a value; `asked` is what it should reach. NaN is no value.
    pub fn add(&mut self, value: f32, asked: Option<f64>) {
        if value.is_nan() {
            return;
        }
        self.count += 1;
        self.least = self.least.min(value);
        self.most = self.most.max(value);
        self.sum += f64::from(value);
        // Half a thousandth: hours are sums of steps.
        self.reaching += u32::from(asked.is_some_and(|asked| f64::from(value) >= asked - 0.0005));
    }

    /// `None` without a value.
    #[must_use]
    pub fn mean(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / f64::from(self.count))
    }

    /// The share that reaches what is asked for; `None` without a value.
    #[must_use]
    pub fn share(&self) -> Option<f64> {
        (self.count > 0).then(|| f64::from(self.reaching) / f64::from(self.count))
    }
}

/// The values of a building.
#[derive(Debug, Clone)]
pub struct BuildingValues<'a> {
    pub building: &'a Building,
    pub roof: PlaceValues,
    pub walls: PlaceValues,
}

/// PlaceValues of a city by what they belong to.
#[derive(Debug, Clone)]
pub struct CityValues<'a> {
    /// Of all buildings of the surface, in the order of their numbers.
    pub buildings: Vec<BuildingValues<'a>>,
    pub ground: PlaceValues,
    pub roofs: PlaceValues,
    pub walls: PlaceValues,
}

/// Names of the columns of [`write_table`], in which `{}` stands for what was computed.
const COLUMNS: [&str; 11] = [
    "object",
    "identifier",
    "roof_cells",
    "roof_{}_least",
    "roof_{}_mean",
    "roof_{}_most",
    "wall_points",
    "wall_{}_least",
    "wall_{}_mean",
    "wall_{}_most",
    "wall_share_reaching",
];

/// Writes a row for each building as CSV. `what` is a word for the names of columns, such as `hours`; `asked` says whether shares count.
/// Fails if `out` cannot be written.
pub fn write_table(city: &CityValues<'_>, what: &str, asked: bool, out: impl Write) -> io::Result<()> {
    let mut rows = csv::Writer::from_writer(out);
    let columns = if asked { &COLUMNS[..] } else { &COLUMNS[..10] };
    rows.write_record(columns.iter().map(|name| name.replace("{}", what)))?;
    for row in &city.buildings {
        let number = |value: Option<f64>| value.map(|value| format!("{value:.3}")).unwrap_or_default();
        let values = |values: &PlaceValues| {
            let end = |value: f32| number((values.count > 0).then_some(f64::from(value)));
            [values.count.to_string(), end(values.least), number(values.mean()), end(values.most)]
        };
        let mut cells = vec![row.building.number.to_string(), csv_cell(row.building.identifier.clone(), false)];
        cells.extend(values(&row.roof));
        cells.extend(values(&row.walls));
        cells.extend(asked.then(|| number(row.walls.share())));
        rows.write_record(cells)?;
    }
    rows.flush()
}

/// Sums up the values of the tops of a surface's cells, and of points on walls.
#[must_use]
pub fn sum_up<'a>(
    surface: &'a CitySurface,
    tops: &[f32],
    points: &[WallPoint],
    walls: &[f32],
    asked: Option<f64>,
) -> CityValues<'a> {
    let row = |building| BuildingValues { building, roof: PlaceValues::default(), walls: PlaceValues::default() };
    let mut city = CityValues {
        buildings: surface.buildings.iter().map(row).collect(),
        ground: PlaceValues::default(),
        roofs: PlaceValues::default(),
        walls: PlaceValues::default(),
    };
    for (index, value) in tops.iter().enumerate() {
        match surface.kind(index) {
            TopKind::Ground => city.ground.add(*value, asked),
            TopKind::Roof(building) => {
                city.roofs.add(*value, asked);
                city.buildings[building as usize].roof.add(*value, asked);
            }
            TopKind::Other | TopKind::Nothing => {}
        }
    }
    for (point, value) in points.iter().zip(walls) {
        city.walls.add(*value, asked);
        city.buildings[point.building as usize].walls.add(*value, asked);
    }
    city.buildings.sort_by_key(|row| row.building.number);
    city
}
