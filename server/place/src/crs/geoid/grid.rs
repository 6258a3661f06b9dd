//! Grids of geoid undulations, interpolated as PROJ's `vgridshift` does.

/// Positions this far outside of a grid count as on its edge, because degrees are rounded.
const EDGE_TOLERANCE_DEG: f64 = 1e-9;
/// The geoid is within 110 m of the ellipsoid. Values beyond this mean that there is no value.
pub(super) const MAX_UNDULATION_M: f32 = 1000.0;

/// A rectangle of values, the first row in the north, the first column in the west. NaN where there is no value.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Table {
    pub(super) west_deg: f64,
    pub(super) north_deg: f64,
    pub(super) step_lon_deg: f64,
    pub(super) step_lat_deg: f64,
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) values_m: Vec<f32>,
}

impl Table {
    fn spans_all_longitudes(&self) -> bool {
        self.width as f64 * self.step_lon_deg >= 360.0 - 1e-8
    }

    /// Column and row of a position, with fractions, columns within the table; `None` if it is outside.
    fn place(&self, longitude_deg: f64, latitude_deg: f64) -> Option<[f64; 2]> {
        let row = (self.north_deg - latitude_deg) / self.step_lat_deg;
        let last_row = (self.height - 1) as f64;
        let row_tolerance = EDGE_TOLERANCE_DEG / self.step_lat_deg;
        if !(row >= -row_tolerance && row <= last_row + row_tolerance) {
            return None;
        }
        let turn = 360.0 / self.step_lon_deg;
        let mut column = (longitude_deg - self.west_deg) / self.step_lon_deg;
        let last_column = (self.width - 1) as f64;
        let tolerance = EDGE_TOLERANCE_DEG / self.step_lon_deg;
        if self.spans_all_longitudes() {
            column = column.rem_euclid(turn);
        } else if column < -tolerance {
            column += turn;
        } else if column > last_column + tolerance {
            column -= turn;
        }
        let is_inside = self.spans_all_longitudes() || (column >= -tolerance && column <= last_column + tolerance);
        is_inside.then_some([column.max(0.0), row.clamp(0.0, last_row)])
    }

    fn value(&self, column: usize, row: usize) -> f32 {
        self.values_m.get(row * self.width + column).copied().unwrap_or(f32::NAN)
    }

    /// Bilinear; of corners without a value, the others take the weight.
    fn undulation_m(&self, longitude_deg: f64, latitude_deg: f64) -> Option<f64> {
        let [x, y] = self.place(longitude_deg, latitude_deg)?;
        let (column, row) = ((x as usize).min(self.width - 1), (y as usize).min(self.height - 1));
        let (fx, fy) = (x - column as f64, y - row as f64);
        let next_column = match column + 1 {
            next if next < self.width => next,
            _ if self.spans_all_longitudes() => 0,
            _ => column,
        };
        let next_row = (row + 1).min(self.height - 1);
        let corners = [
            (self.value(column, row), (1.0 - fx) * (1.0 - fy)),
            (self.value(next_column, row), fx * (1.0 - fy)),
            (self.value(column, next_row), (1.0 - fx) * fy),
            (self.value(next_column, next_row), fx * fy),
        ];
        let (mut sum, mut weights, mut missing) = (0.0, 0.0, 0);
        for (value, weight) in corners {
            if value.is_nan() {
                missing += 1;
            } else {
                sum += f64::from(value) * weight;
                weights += weight;
            }
        }
        match missing {
            0 => Some(sum),
            4 => None,
            _ => (weights > 0.0).then(|| sum / weights),
        }
    }
}

/// A geoid model: one table, or several of different density.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// The finest first.
    tables: Vec<Table>,
}

impl Grid {
    pub(super) fn new(mut tables: Vec<Table>) -> Self {
        tables.sort_by(|a, b| a.step_lat_deg.total_cmp(&b.step_lat_deg));
        Self { tables }
    }

    /// Height of the geoid above the ellipsoid in metres; `None` outside of the grid.
    pub fn undulation_m(&self, longitude_deg: f64, latitude_deg: f64) -> Option<f64> {
        if !(longitude_deg.is_finite() && latitude_deg.is_finite()) {
            return None;
        }
        self.tables.iter().find_map(|table| table.undulation_m(longitude_deg, latitude_deg))
    }
}
