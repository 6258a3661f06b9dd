//! Values of roofs and walls as a row for each building.

use crate::surface::{Building, CitySurface, TopKind};
use crate::walls::WallPoint;
use insula_export::selection::{SelectedArea, area_around};
use insula_export::table::{AddedValues, csv_cell};
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

    /// Count, least, most, sum, and how many reach what is asked for; zeros without a value.
    pub(crate) fn to_numbers(self) -> [f64; 5] {
        if self.count == 0 {
            return [0.0; 5];
        }
        [self.count.into(), self.least.into(), self.most.into(), self.sum, self.reaching.into()]
    }

    /// The values of such numbers.
    pub(crate) fn of_numbers([count, least, most, sum, reaching]: [f64; 5]) -> Self {
        if count < 1.0 {
            return Self::default();
        }
        Self { count: count as u32, least: least as f32, most: most as f32, sum, reaching: reaching as u32 }
    }

    /// Adds those of other places.
    pub(crate) fn join(&mut self, other: Self) {
        self.count = self.count.saturating_add(other.count);
        self.least = self.least.min(other.least);
        self.most = self.most.max(other.most);
        self.sum += other.sum;
        self.reaching = self.reaching.saturating_add(other.reaching);
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
    /// Of its roofs as they are inclined, in square metres.
    pub roof_area_m2: f64,
    /// The roof's values times their areas.
    pub roof_total: f64,
}

/// Values of a city by what they belong to.
#[derive(Debug, Clone)]
pub struct CityValues<'a> {
    /// Of all buildings of the surface, in the order of their numbers.
    pub buildings: Vec<BuildingValues<'a>>,
    pub ground: PlaceValues,
    pub roofs: PlaceValues,
    pub walls: PlaceValues,
}

/// Names of the columns of [`write_table`], in which `{}` stands for what was computed.
const COLUMNS: [&str; 12] = [
    "object", "identifier", "roof_cells", "roof_{}_least", "roof_{}_mean", "roof_{}_most", "wall_points",
    "wall_{}_least", "wall_{}_mean", "wall_{}_most", "wall_share_reaching", "roof_share_reaching",
];

/// What is written of buildings.
#[derive(Debug, Clone, Copy)]
pub struct Columns<'a> {
    /// A word for the names of columns, such as `hours`.
    pub what: &'a str,
    /// Whether something is asked for, so that shares count.
    pub has_asked: bool,
    /// A word for the sum over the area of the roof, if it means something.
    pub total: Option<&'a str>,
}

impl Columns<'_> {
    fn names(&self) -> Vec<String> {
        let names = if self.has_asked { &COLUMNS[..] } else { &COLUMNS[..10] };
        let names = names.iter().map(|name| name.replace("{}", self.what));
        let of_area = self.total.map(|total| ["roof_area_m2".to_owned(), format!("roof_{total}")]);
        names.chain(of_area.into_iter().flatten()).collect()
    }
}

/// The same columns and rows as numbers of the buildings' objects, but for buildings without any value.
#[must_use]
pub fn added_values(city: &CityValues<'_>, columns: Columns<'_>) -> AddedValues {
    let with_values = city.buildings.iter().filter(|row| row.roof.count + row.walls.count > 0);
    let of_row = |row: &BuildingValues<'_>| {
        let of_places = |places: &PlaceValues| {
            let [least, most] = [places.least, places.most].map(|end| (places.count > 0).then_some(f64::from(end)));
            [Some(f64::from(places.count)), least, places.mean(), most]
        };
        let shares = columns.has_asked.then(|| [row.walls.share(), row.roof.share()]);
        let of_area = columns.total.map(|_| [row.roof_area_m2, row.roof_total].map(Some));
        let values = of_places(&row.roof).into_iter().chain(of_places(&row.walls)).chain(shares.into_iter().flatten());
        let values = values.chain(of_area.into_iter().flatten());
        // Thousandths, as the table has them.
        (row.building.number, values.map(|value| value.map(|value| (value * 1000.0).round() / 1000.0)).collect())
    };
    // The number and the identifier are columns of the city's own.
    AddedValues { names: columns.names().split_off(2), values: with_values.map(of_row).collect() }
}

/// Writes a row for each building with a value as CSV. Fails if `out` cannot be written.
pub fn write_table(city: &CityValues<'_>, columns: Columns<'_>, out: impl Write) -> io::Result<()> {
    let mut rows = csv::Writer::from_writer(out);
    let Columns { has_asked, total, .. } = columns;
    rows.write_record(columns.names())?;
    for row in city.buildings.iter().filter(|row| row.roof.count + row.walls.count > 0) {
        let number = |value: Option<f64>| value.map(|value| format!("{value:.3}")).unwrap_or_default();
        let values = |values: &PlaceValues| {
            let end = |value: f32| number((values.count > 0).then_some(f64::from(value)));
            [values.count.to_string(), end(values.least), number(values.mean()), end(values.most)]
        };
        let mut cells = vec![row.building.number.to_string(), csv_cell(row.building.identifier.clone(), false)];
        cells.extend(values(&row.roof));
        cells.extend(values(&row.walls));
        let shares = has_asked.then(|| [row.walls.share(), row.roof.share()].map(number));
        cells.extend(shares.into_iter().flatten());
        let of_area = total.map(|_| [row.roof_area_m2, row.roof_total].map(|value| format!("{value:.1}")));
        cells.extend(of_area.into_iter().flatten());
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
    let row = |building| BuildingValues {
        building,
        roof: PlaceValues::default(),
        walls: PlaceValues::default(),
        roof_area_m2: 0.0,
        roof_total: 0.0,
    };
    let mut city = CityValues {
        buildings: surface.buildings.iter().map(row).collect(),
        ground: PlaceValues::default(),
        roofs: PlaceValues::default(),
        walls: PlaceValues::default(),
    };
    let kinds = (0..surface.size()[1]).flat_map(|row| surface.kinds_of_row(row));
    for (index, (value, kind)) in tops.iter().zip(kinds).enumerate() {
        match kind {
            TopKind::Ground => city.ground.add(*value, asked),
            TopKind::Roof(building) => {
                city.roofs.add(*value, asked);
                let row = &mut city.buildings[building as usize];
                row.roof.add(*value, asked);
                if !value.is_nan() {
                    let area = surface.area_m2(index);
                    row.roof_area_m2 += area;
                    row.roof_total += area * f64::from(*value);
                }
            }
            // What was made up around the terrain is in no average.
            TopKind::Generated | TopKind::Other | TopKind::Nothing => {}
        }
    }
    for (point, value) in points.iter().zip(walls) {
        city.walls.add(*value, asked);
        city.buildings[point.building as usize].walls.add(*value, asked);
    }
    city.buildings.sort_by_key(|row| row.building.number);
    city
}

/// The values of the ground in an area, whose cells have their middles there.
#[must_use]
pub fn ground_within(surface: &CitySurface, tops: &[f32], area: &SelectedArea, asked: Option<f64>) -> PlaceValues {
    let [low, high] = area_around(area.polygons().iter().flatten().flatten().copied());
    let cells = |k: usize| {
        let cell = |at: f64| ((at - surface.corner[k]) / surface.cell_m).clamp(0.0, surface.size()[k] as f64);
        cell(low[k]).floor() as usize..cell(high[k]).ceil() as usize
    };
    let middle = |k: usize, cell: usize| surface.corner[k] + (cell as f64 + 0.5) * surface.cell_m;
    let mut values = PlaceValues::default();
    for (y, x) in cells(1).flat_map(|y| cells(0).map(move |x| (y, x))) {
        let index = y * surface.size()[0] + x;
        if surface.kind(index).is_ground() && area.contains([middle(0, x), middle(1, y)]) {
            values.add(tops[index], asked);
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ground_around_the_terrain_is_in_no_average() {
        let kinds = [TopKind::Ground, TopKind::Generated, TopKind::Roof(0)];
        let surface = CitySurface::of_cells([3, 1], [0.0; 2], 0.0, vec![0.0, 0.0, 9.0], &kinds);
        let values = sum_up(&surface, &[1.0, 5.0, 7.0], &[], &[], None);
        assert_eq!((values.ground.count, values.ground.mean(), values.roofs.mean()), (1, Some(1.0), Some(7.0)));
    }

    #[test]
    fn a_garden_has_the_ground_in_its_polygon() {
        let mut kinds = vec![TopKind::Ground; 12];
        (kinds[5], kinds[6]) = (TopKind::Roof(0), TopKind::Generated);
        let surface = CitySurface::of_cells([4, 3], [100.0, 200.0], 0.0, vec![0.0; 12], &kinds);
        let tops: Vec<f32> = (0..12u8).map(f32::from).collect();
        let within = |ring: [[f64; 2]; 4]| {
            ground_within(&surface, &tops, &SelectedArea::new(vec![vec![ring.to_vec()]]), Some(2.0))
        };
        // The two lower rows but for their last cells: a roof is no garden.
        let values = within([[99.0, 199.0], [103.0, 199.0], [103.0, 202.0], [99.0, 202.0]]);
        assert_eq!((values.count, values.mean(), values.share()), (5, Some((1.0 + 2.0 + 4.0 + 6.0) / 5.0), Some(0.6)));
        assert_eq!(within([[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0]]).count, 0);
    }
}
