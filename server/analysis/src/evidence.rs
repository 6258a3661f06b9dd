//! The evidence of a point: the sky that its rays see as a fisheye picture, with the sun's path, and what a rule counts of it.

use crate::canvas::{Anchor, Color, PictureCanvas};
use crate::clock::clock_text;
use crate::points::{AWAY_M, Point, PointSun};
use crate::rays::CityTriangles;
use crate::rule::{CountMode, DayMode, Measure, Rule};
use crate::sun::{Bearing, Site};
use chrono::NaiveDate;
use glam::DVec3;
use image::{Rgb, RgbImage};
use rayon::prelude::*;

/// Pixels of the sky's radius, of what is around it, and of the lines below.
const RADIUS: f32 = 400.0;
const MARGIN: f32 = 50.0;
const CAPTION: u32 = 190;
const SIDE: u32 = (2.0 * (RADIUS + MARGIN)) as u32;

const PAPER: Color = [255; 3];
const INK: Color = [30; 3];
const SKY: Color = [205, 226, 245];
const OBSTACLE: Color = [120, 116, 112];
const BEHIND: Color = [176, 172, 166];
const GRID: Color = [150, 165, 180];
const SUN: Color = [255, 205, 40];
const SHADE: Color = [40, 30, 80];
/// The sun's path when it does not count.
const UNCOUNTED: Color = [90, 90, 90];

const EXPLANATION: &str =
    "As on a map, true north is up and east to the right; rings are 30 degrees apart; dark grey hides the sky";

/// What pictures are made of.
pub struct Evidence<'a> {
    pub city: &'a CityTriangles,
    pub site: &'a Site,
    pub rule: &'a Rule,
    /// What is shown, if that is not the city as it is.
    pub note: Option<String>,
    /// The city, and who must be named.
    pub credit: String,
}

/// The sun's path on a day: from where to where it goes in each step, and whether it is seen.
type Path = Vec<([f32; 2], [f32; 2], bool)>;

impl Evidence<'_> {
    /// The picture of a point: equidistant, as on a map, with true north up and east to the right.
    #[must_use]
    pub fn picture(&self, point: &Point, sun: &PointSun) -> RgbImage {
        let normal = point.normal(self.site);
        let from = DVec3::from(sun.position) + normal * AWAY_M;
        let mut canvas = PictureCanvas::new([SIDE, SIDE + CAPTION], PAPER);
        self.sky(&mut canvas, from, normal);
        grid(&mut canvas);
        let is_seen = |direction: DVec3| normal.dot(direction) > 0.0 && self.city.is_free(from, direction);
        for day in &self.rule.days {
            let is_broad = *day == sun.day && (self.rule.day_mode != DayMode::Sum || self.rule.days.len() == 1);
            let width = if is_broad { 7.0 } else { 2.5 };
            self.uncounted(&mut canvas, *day);
            let path = self.path(*day, &is_seen);
            for (a, b, is_lit) in &path {
                canvas.line([*a, *b], width + 2.0, if *is_lit { SHADE } else { PAPER });
            }
            path.iter().for_each(|(a, b, is_lit)| canvas.line([*a, *b], width, if *is_lit { SUN } else { SHADE }));
        }
        self.hours(&mut canvas, sun.day);
        self.caption(&mut canvas, point, sun);
        canvas.finish()
    }

    /// What each ray meets.
    fn sky(&self, canvas: &mut PictureCanvas, from: DVec3, normal: DVec3) {
        let color = |x: f32, y: f32| {
            let [east, north] = [(x - RADIUS - MARGIN) / RADIUS, (RADIUS + MARGIN - y) / RADIUS];
            let zenith = east.hypot(north);
            if zenith > 1.0 {
                return PAPER;
            }
            let azimuth = f64::from(east.atan2(north)).to_degrees() + self.site.north_deg;
            let altitude_deg = 90.0 * (1.0 - f64::from(zenith));
            let direction = Bearing { azimuth_deg: azimuth.rem_euclid(360.0), altitude_deg }.direction();
            match () {
                () if normal.dot(direction) <= 0.0 => BEHIND,
                () if self.city.is_free(from, direction) => SKY,
                () => OBSTACLE,
            }
        };
        let row = |y: u32| -> Vec<Rgb<u8>> {
            let pixel = |x: u32| {
                let parts = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)];
                let parts = parts.map(|(dx, dy)| color(x as f32 + dx, y as f32 + dy));
                Rgb([0, 1, 2].map(|k| (parts.iter().map(|part| u32::from(part[k])).sum::<u32>() / 4) as u8))
            };
            (0..SIDE).map(pixel).collect()
        };
        let rows: Vec<Vec<Rgb<u8>>> = (0..SIDE).into_par_iter().map(row).collect();
        for (y, row) in rows.iter().enumerate() {
            row.iter().enumerate().for_each(|(x, pixel)| canvas.image.put_pixel(x as u32, y as u32, *pixel));
        }
    }

    /// Where a direction is in the picture.
    fn place(&self, sun: Bearing) -> [f32; 2] {
        let (east, north) = (sun.azimuth_deg - self.site.north_deg).to_radians().sin_cos();
        let radius = RADIUS * (1.0 - sun.altitude_deg / 90.0) as f32;
        [RADIUS + MARGIN + radius * east as f32, RADIUS + MARGIN - radius * north as f32]
    }

    fn at(&self, day: NaiveDate, hour: f64) -> Option<[f32; 2]> {
        let sun = self.site.sun(day, hour, &self.rule.time).filter(|sun| sun.altitude_deg > 0.0)?;
        Some(self.place(sun))
    }

    fn path(&self, day: NaiveDate, is_seen: &dyn Fn(DVec3) -> bool) -> Path {
        let half = self.rule.step_minutes / 120.0;
        let step = |(hour, sun): (f64, Bearing)| {
            let ends = [hour - half, hour + half].map(|hour| self.at(day, hour).unwrap_or(self.place(sun)));
            (ends[0], ends[1], is_seen(sun.direction()))
        };
        self.rule.suns(self.site, day).into_iter().map(step).collect()
    }

    /// Dots along all of the sun's path on a day.
    fn uncounted(&self, canvas: &mut PictureCanvas, day: NaiveDate) {
        let dots = (0..24 * 6).filter_map(|i| self.at(day, f64::from(i) / 6.0));
        dots.for_each(|dot| canvas.disc(dot, 1.0, UNCOUNTED));
    }

    fn hours(&self, canvas: &mut PictureCanvas, day: NaiveDate) {
        for hour in 0..24 {
            let Some(at) = self.at(day, f64::from(hour)) else { continue };
            canvas.disc(at, 11.0, INK);
            canvas.disc(at, 10.0, PAPER);
            canvas.text(at, Anchor::Middle, 13.0, 30.0, INK, &hour.to_string());
        }
    }

    fn caption(&self, canvas: &mut PictureCanvas, point: &Point, sun: &PointSun) {
        let Rule { title, source, asked, mode, time, measure, .. } = self.rule;
        let [x, y, z] = sun.position;
        let facing = point.azimuth_deg.map_or("level".to_owned(), |azimuth| format!("looks at {azimuth} degrees"));
        let unit = match measure {
            Measure::Hours => "h",
            Measure::ProbableSunlight(_) => "%",
        };
        let what = match measure {
            Measure::Hours => "of sun",
            Measure::ProbableSunlight(_) => "of the year's probable sunlight",
        };
        let asked =
            asked.map_or("the rule asks for none".to_owned(), |asked| format!("the rule asks for {asked} {unit}"));
        let counted = match mode {
            CountMode::Cumulative => "",
            CountMode::LongestRun => " without a break",
        };
        let behind = if point.azimuth_deg.is_some() { "; light grey is behind the wall" } else { "" };
        let times: Vec<String> =
            sun.times.iter().map(|[from, to]| format!("{}-{}", clock_text(*from), clock_text(*to))).collect();
        let when = match (measure, self.rule.days.last()) {
            (Measure::ProbableSunlight(_), Some(last)) => {
                format!("{} to {last}; hours are those of the first day", sun.day)
            }
            _ => format!("{} in {time}: sun at {}", sun.day, times.join(" ")),
        };
        let value = format!("{}: {:.2} {unit} {what}{counted}; {asked}", point.id, sun.value);
        let lines = [
            (15.0, format!("x {x:.2}, y {y:.2}, z {z:.2}, {facing}")),
            (15.0, format!("rule: {title}")),
            (13.0, source.clone()),
            (15.0, when),
            (13.0, format!("{EXPLANATION}{behind}")),
            (13.0, self.credit.clone()),
        ];
        let mut top = SIDE as f32;
        let note = self.note.clone().map(|note| (15.0, note));
        for (size, line) in [(20.0, value)].into_iter().chain(note).chain(lines) {
            canvas.text([MARGIN, top], Anchor::Corner, size, 2.0 * RADIUS, INK, &line);
            top += size * 1.5;
        }
        for (i, (color, name)) in [(SUN, "sun"), (SHADE, "shade")].into_iter().enumerate() {
            let at = [MARGIN * 0.5, MARGIN * (0.5 + 0.5 * i as f32)];
            canvas.line([at, [at[0] + 24.0, at[1]]], 9.0, INK);
            canvas.line([at, [at[0] + 24.0, at[1]]], 7.0, color);
            canvas.text([at[0] + 36.0, at[1] - 9.0], Anchor::Corner, 15.0, 90.0, INK, name);
        }
    }
}

/// Rings of altitude, and the points of the compass.
fn grid(canvas: &mut PictureCanvas) {
    let middle = [RADIUS + MARGIN; 2];
    for ring in 1..=3u8 {
        canvas.circle(middle, RADIUS * f32::from(ring) / 3.0, 1.2, if ring == 3 { INK } else { GRID });
    }
    let names = ["N", "30", "60", "E", "120", "150", "S", "210", "240", "W", "300", "330"];
    for (i, name) in names.into_iter().enumerate() {
        let (east, north) = (i as f32 * 30.0).to_radians().sin_cos();
        let at = |radius: f32| [middle[0] + radius * east, middle[1] - radius * north];
        canvas.line([at(RADIUS), at(RADIUS + 8.0)], 1.5, INK);
        let size = if i % 3 == 0 { 24.0 } else { 14.0 };
        canvas.text(at(RADIUS + 26.0), Anchor::Middle, size, 60.0, INK, name);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::points::{PointHeight, sun_at_points};
    use crate::rays::tests::block;

    /// A wall of 20 m stands 10 m south of a point, from 20 m west to 10 m east: the south is dark up to 63 degrees, the rest is sky.
    #[test]
    fn the_picture_shows_sky_obstacles_and_the_path() {
        let city = block([-20.0, -12.0, 0.0], [10.0, -10.0, 20.0], 1);
        let site = Site { latitude_deg: 52.0, longitude_deg: 4.36, north_deg: 0.0 };
        let rule = Rule::parse("title = \"t\"\nsource = \"s\"\ndays = [\"06-21\"]\nasked_hours = 2").unwrap();
        let point = Point { id: "a".into(), place: [0.0, 0.0], height: PointHeight::World(0.0), azimuth_deg: None };
        let suns = sun_at_points(&city, None, std::slice::from_ref(&point), &site, &rule);
        let sun = suns[0].as_ref().unwrap();
        let mut evidence = Evidence { city: &city, site: &site, rule: &rule, note: None, credit: "c".to_owned() };
        let image = evidence.picture(&point, sun);
        let at = |azimuth_deg: f64, altitude_deg: f64| {
            let [x, y] = evidence.place(Bearing { azimuth_deg, altitude_deg });
            image.get_pixel(x as u32, y as u32).0
        };
        assert_eq!([at(5.0, 40.0), at(185.0, 50.0), at(185.0, 75.0)], [SKY, OBSTACLE, SKY]);
        assert_eq!([at(130.0, 20.0), at(230.0, 10.0)], [SKY, OBSTACLE], "east is to the right");
        // At half past an hour there is no mark: the sun of noon is at 61 degrees, behind the wall.
        let sun_at =
            |hour: f64| site.sun(rule.days[0], hour, &rule.time).map(|sun| at(sun.azimuth_deg, sun.altitude_deg));
        assert_eq!([sun_at(8.5), sun_at(11.5)], [Some(SUN), Some(SHADE)]);
        // A note is a line more, and all lines have a place.
        evidence.note = Some("planned".to_owned());
        let noted = evidence.picture(&point, sun);
        let last = |image: &RgbImage| {
            image.enumerate_pixels().filter(|(_, _, pixel)| pixel.0 != PAPER).map(|(_, y, _)| y).max()
        };
        let [without, with] = [&image, &noted].map(|image| last(image).unwrap());
        assert!(with > without + 10 && with < SIDE + CAPTION - 1, "{without} {with}");
    }
}
