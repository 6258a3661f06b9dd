//! Hours of sun at given points, by rays against the finest triangles: the evidence for a window or a bench.

use crate::clock::clock_text;
use crate::probable::day_weights;
use crate::rays::CityTriangles;
use crate::rule::{CountMode, DayMode, Measure, Rule};
use crate::sun::Site;
use crate::surface::CitySurface;
use chrono::NaiveDate;
use glam::DVec3;
use insula_export::selection::area_around;
use insula_export::table::csv_cell;
use rayon::prelude::*;
use std::io::{self, Write};

const MAX_POINTS: usize = 1_000_000;
/// Rays start this far before their surface, so that it does not hide itself.
pub(crate) const AWAY_M: f64 = 0.05;

/// A point, and what its surface looks at.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// As the file names it, or its number.
    pub id: String,
    /// World metres, on the map.
    pub place: [f64; 2],
    pub height: PointHeight,
    /// Direction that a wall looks at, from true north over east; `None` of a level surface.
    pub azimuth_deg: Option<f64>,
}

/// How a file gives the height of a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PointHeight {
    /// Metres above the highest surface at its place.
    AboveTop(f64),
    /// World metres.
    World(f64),
}

impl Point {
    /// Its place in world metres; `None` if there is no surface to measure its height from. `ground` has the ground that a bake made, which
    /// is no triangle.
    #[must_use]
    pub fn position(&self, city: &CityTriangles, ground: Option<&CitySurface>) -> Option<DVec3> {
        let z = match self.height {
            PointHeight::World(z) => z,
            PointHeight::AboveTop(height) => city.top(self.place).or_else(|| ground?.ground_at(self.place))? + height,
        };
        Some(DVec3::new(self.place[0], self.place[1], z))
    }

    /// What its surface looks at.
    pub(crate) fn normal(&self, site: &Site) -> DVec3 {
        self.azimuth_deg.map_or(DVec3::Z, |azimuth| {
            let (x, y) = (azimuth + site.north_deg).to_radians().sin_cos();
            DVec3::new(x, y, 0.0)
        })
    }
}

/// Reads points from CSV with a header: `x` and `y` in world metres or `lon` and `lat` in degrees; `height` in metres above the ground or
/// roof there, or `z` in world metres; and, if wanted, `azimuth` and `id`. `on_map` gives the place of degrees. Fails with the line and
/// what is wrong.
pub fn parse_points(text: &str, on_map: &dyn Fn([f64; 2]) -> Option<[f64; 2]>) -> Result<Vec<Point>, String> {
    let mut rows = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
    let header = rows.headers().map_err(|error| error.to_string())?.clone();
    let column =
        |name: &str| header.iter().position(|column| column.trim_start_matches('\u{feff}').eq_ignore_ascii_case(name));
    let (metres, degrees) = (column("x").zip(column("y")), column("lon").zip(column("lat")));
    let (height, z) = (column("height"), column("z"));
    if (metres.is_none() && degrees.is_none()) || (height.is_none() && z.is_none()) {
        return Err("the header must have x and y in metres or lon and lat in degrees, and height above the ground or z above sea level".to_owned());
    }
    let mut points = Vec::new();
    for (line, row) in (2usize..).zip(rows.records()) {
        let row = row.map_err(|error| error.to_string())?;
        let number = |at: usize, name: &str| {
            let value = row.get(at).and_then(|cell| cell.parse().ok()).filter(|value: &f64| value.is_finite());
            value.ok_or_else(|| format!("line {line}: {name} is no number"))
        };
        let place = match (metres, degrees) {
            (Some((x, y)), _) => [number(x, "x")?, number(y, "y")?],
            (None, at) => {
                let (lon, lat) = at.unwrap_or_default();
                let degrees = [number(lon, "lon")?, number(lat, "lat")?];
                on_map(degrees)
                    .ok_or_else(|| format!("line {line}: lon and lat are out of the city's coordinate system"))?
            }
        };
        let height = match (height, z) {
            (Some(at), _) => PointHeight::AboveTop(number(at, "height")?),
            (None, at) => PointHeight::World(number(at.unwrap_or_default(), "z")?),
        };
        let azimuth = column("azimuth").filter(|at| row.get(*at).is_some_and(|cell| !cell.is_empty()));
        let azimuth_deg = azimuth.map(|at| number(at, "azimuth")).transpose()?;
        let id = column("id").and_then(|at| row.get(at)).map_or_else(|| (line - 1).to_string(), str::to_owned);
        points.push(Point { id, place, height, azimuth_deg });
        if points.len() > MAX_POINTS {
            return Err(format!("more than {MAX_POINTS} points"));
        }
    }
    if points.is_empty() { Err("no point".to_owned()) } else { Ok(points) }
}

/// The rectangle around points, in world metres.
#[must_use]
pub fn around(points: &[Point], reach_m: f64) -> [[f64; 2]; 2] {
    let [min, max] = area_around(points.iter().map(|point| point.place));
    [min.map(|v| v - reach_m), max.map(|v| v + reach_m)]
}

/// The sun at a point.
#[derive(Debug, Clone, PartialEq)]
pub struct PointSun {
    /// World metres.
    pub position: [f64; 3],
    /// Hours, or percent of probable sunlight.
    pub value: f64,
    /// The day that the value is of; the first of several days together.
    pub day: NaiveDate,
    /// From when to when the sun is seen on that day, in hours of the rule's time.
    pub times: Vec<[f64; 2]>,
}

/// Hours of sun at points by a rule; `None` for a point at which there is no surface to measure its height from. `ground` has the ground
/// that a bake made, which is no triangle and hides nothing; points above the ground need it.
#[must_use]
pub fn sun_at_points(
    city: &CityTriangles,
    ground: Option<&CitySurface>,
    points: &[Point],
    site: &Site,
    rule: &Rule,
) -> Vec<Option<PointSun>> {
    let day = |(day, weight): (&NaiveDate, f64)| Day { day: *day, suns: directions(site, rule, *day), weight };
    let days: Vec<Day> = rule.days.iter().zip(day_weights(site, rule)).map(day).collect();
    let sun = |point: &Point| sun_at(city, point.position(city, ground)?, point.normal(site), rule, &days);
    points.par_iter().map(sun).collect()
}

struct Day {
    day: NaiveDate,
    /// Hours in the middle of each step, with the directions to the sun.
    suns: Vec<(f64, DVec3)>,
    /// What an hour of sun counts.
    weight: f64,
}

/// Hours in the middle of each step, with the directions to the sun.
fn directions(site: &Site, rule: &Rule, day: NaiveDate) -> Vec<(f64, DVec3)> {
    let suns = rule.suns(site, day).into_iter();
    suns.map(|(hour, sun)| (hour, sun.direction())).collect()
}

fn sun_at(city: &CityTriangles, position: DVec3, normal: DVec3, rule: &Rule, days: &[Day]) -> Option<PointSun> {
    let from = position + normal * AWAY_M;
    let half = rule.step_minutes / 120.0;
    let of_day = |Day { day, suns, weight }: &Day| {
        let mut times: Vec<[f64; 2]> = Vec::new();
        for (hour, direction) in suns {
            if normal.dot(*direction) <= 0.0 || !city.is_free(from, *direction) {
                continue;
            }
            match times.last_mut() {
                Some(time) if (hour - half - time[1]).abs() < 1e-6 => time[1] = hour + half,
                _ => times.push([hour - half, hour + half]),
            }
        }
        let lengths = times.iter().map(|[from, to]| to - from);
        let hours = match rule.mode {
            // A sum of nothing would be -0.
            CountMode::Cumulative => lengths.fold(0.0, |sum, length| sum + length),
            CountMode::LongestRun => lengths.fold(0.0, f64::max),
        };
        PointSun { position: position.to_array(), value: hours * weight, day: *day, times }
    };
    days.iter().map(of_day).reduce(|a, b| match rule.day_mode {
        DayMode::Least if b.value < a.value => b,
        DayMode::Most if b.value > a.value => b,
        DayMode::Sum => PointSun { value: a.value + b.value, ..a },
        DayMode::Least | DayMode::Most => a,
    })
}

/// Writes a row for each point as CSV. Fails if `out` cannot be written.
pub fn write_table(points: &[Point], suns: &[Option<PointSun>], rule: &Rule, out: impl Write) -> io::Result<()> {
    let mut rows = csv::Writer::from_writer(out);
    let unit = rule.measure.unit();
    rows.write_record(["id", "x", "y", "z", unit, &format!("asked_{unit}"), "day", "times"])?;
    let asked = rule.asked.map(|hours| hours.to_string()).unwrap_or_default();
    for (point, sun) in points.iter().zip(suns) {
        let id = csv_cell(point.id.clone(), false);
        let place = |[x, y]: [f64; 2]| [format!("{x:.2}"), format!("{y:.2}")];
        let [x, y] = place(point.place);
        let Some(sun) = sun else {
            let nothing = String::new;
            rows.write_record([id, x, y, nothing(), nothing(), asked.clone(), nothing(), nothing()])?;
            continue;
        };
        let times: Vec<String> =
            sun.times.iter().map(|[from, to]| format!("{}-{}", clock_text(*from), clock_text(*to))).collect();
        let [z, value] = [sun.position[2], sun.value].map(|value| format!("{value:.2}"));
        // A share of the year has no day.
        let of_day = rule.measure == Measure::Hours;
        let [day, times] = if of_day { [sun.day.to_string(), times.join(" ")] } else { Default::default() };
        rows.write_record([id, x, y, z, value, asked.clone(), day, times])?;
    }
    rows.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_read_in_metres_or_degrees() {
        let on_map = |[lon, lat]: [f64; 2]| (lat < 80.0).then_some([lon * 10.0, lat * 10.0]);
        let points = parse_points("id,x,y,z,azimuth\na, 1,2.5 ,3,180\nb,1,2,3,\n", &on_map).unwrap();
        let first =
            Point { id: "a".to_owned(), place: [1.0, 2.5], height: PointHeight::World(3.0), azimuth_deg: Some(180.0) };
        assert_eq!((&points[0], points[1].azimuth_deg), (&first, None));
        let points = parse_points("\u{feff}lat,LON,Height\n52,4,1.5\n", &on_map).unwrap();
        assert_eq!((points[0].place, points[0].height), ([40.0, 520.0], PointHeight::AboveTop(1.5)));
        assert_eq!(points[0].id, "1");
        assert_eq!(around(&points, 5.0), [[35.0, 515.0], [45.0, 525.0]]);
        for (text, word) in [
            ("", "header"),
            ("x,y\n1,2", "height"),
            ("x,height\n1,2", "header"),
            ("x,y,z\n", "no point"),
            ("x,y,z\n1,2,3\n1,b,3", "line 3: y"),
            ("x,y,z\n1,nan,3", "line 2: y"),
            ("lon,lat,z\n1,85,3", "line 2: lon"),
            ("x,y,z\n1,2", "line"),
        ] {
            let error = parse_points(text, &on_map).unwrap_err();
            assert!(error.contains(word), "{text}: {error}");
        }
    }
}
