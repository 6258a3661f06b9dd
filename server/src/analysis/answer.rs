//! What an analysis answers: values of a surface, and what they say.

use insula_analysis::buildings::PlaceValues;
use insula_analysis::clock::Moment;
use insula_analysis::rule::{DayMode, Measure, Rule};
use insula_analysis::sky::sky_view;
use insula_analysis::solar::{YearOfSky, solar_year};
use insula_analysis::sun::{Bearing, Site};
use insula_analysis::sun_hours::{shadow, sun_hours};
use insula_analysis::surface::CitySurface;
use insula_analysis::walls::WallPoint;
use insula_analysis::weather::WeatherYear;
use insula_export::raster::CellExtent;
use insula_protocol::text::{count, fixed};
use serde_json::{Value, json};

/// Height of an eye above the ground.
pub(crate) const EYE_M: f64 = 1.6;
/// Heights above the ground at which walls look at the sky: an eye.
const SKY_HEIGHTS_M: [f64; 1] = [EYE_M];
/// Heights above the ground at which walls have the sun of a year.
const SOLAR_HEIGHTS_M: [f64; 1] = [5.0];
/// Of Linke: the clear air of a temperate country.
const TURBIDITY: f64 = 3.0;
/// Column of the number of times at which shadow lies somewhere.
pub(crate) const TIMES_IN_SHADOW: &str = "times";
/// Weather from further away has a note.
const NEAR_KM: f64 = 100.0;

/// An area and what lies around it.
pub(crate) fn grown([min, max]: [[f64; 2]; 2], metres: f64) -> [[f64; 2]; 2] {
    [min.map(|v| v - metres), max.map(|v| v + metres)]
}

/// What gets the share of the work that is done, and says whether to go on.
pub(crate) type Progress<'a> = &'a (dyn Fn(f64) -> bool + Sync);

/// Values of a surface, and what they say.
pub(crate) struct Answer {
    pub(crate) tops: Vec<f32>,
    pub(crate) points: Vec<WallPoint>,
    pub(crate) walls: Vec<f32>,
    /// What the rule asks for.
    pub(crate) asked: Option<f64>,
    /// Of the values, for the name of a raster.
    pub(crate) title: String,
    /// A word for the names of columns.
    pub(crate) column: &'static str,
    /// A word for what a roof has in all, if that means something.
    pub(crate) total: Option<&'static str>,
    /// Sentences for people.
    pub(crate) notes: Vec<String>,
    /// Values above this make the areas of polygons.
    pub(crate) area_from: f32,
    /// Whether values are changes: more above 0, less below.
    pub(crate) is_change: bool,
    /// What is written as table of buildings, in place of their values.
    pub(crate) table: Option<Vec<u8>>,
}

impl Default for Answer {
    fn default() -> Self {
        Self {
            tops: Vec::new(),
            points: Vec::new(),
            walls: Vec::new(),
            asked: None,
            title: String::new(),
            column: "",
            total: None,
            notes: Vec::new(),
            area_from: 0.5,
            is_change: false,
            table: None,
        }
    }
}

impl Answer {
    pub(crate) fn of_sun(surface: &mut CitySurface, site: &Site, rule: Rule, progress: Progress<'_>) -> Self {
        let hours = sun_hours(surface, site, &rule, progress);
        let height = rule.ground_height_m;
        let above = (height > 0.0).then(|| format!("hours of the ground are those of planes {height} m above it"));
        Self {
            tops: hours.tops,
            points: hours.wall_points,
            walls: hours.walls,
            asked: rule.asked,
            notes: notes_of(&rule).into_iter().chain(above).collect(),
            title: rule.title,
            column: rule.measure.unit(),
            ..Self::default()
        }
    }

    /// Sky view factors, and vertical sky components of walls at heights above the ground; without any, at that of an eye.
    pub(crate) fn of_sky(surface: &mut CitySurface, heights: &[f64], progress: Progress<'_>) -> Self {
        let sky = sky_view(surface, if heights.is_empty() { &SKY_HEIGHTS_M } else { heights }, progress);
        Self {
            tops: sky.tops,
            points: sky.wall_points,
            walls: sky.walls,
            title: "sky view factor".to_owned(),
            column: "sky",
            notes: vec!["values of walls are vertical sky components in percent, at most 39.6".to_owned()],
            ..Self::default()
        }
    }

    /// Irradiation of a year. Without a sky and heights of walls, those of a usual one without clouds.
    pub(crate) fn of_solar(
        surface: &mut CitySurface,
        site: &Site,
        sky: Option<YearOfSky<'_>>,
        heights: &[f64],
        progress: Progress<'_>,
    ) -> Self {
        let sky = sky.unwrap_or(YearOfSky::Clear(TURBIDITY));
        let heights = if heights.is_empty() { &SOLAR_HEIGHTS_M[..] } else { heights };
        let year = solar_year(surface, site, sky, heights, progress);
        let (title, mut notes) = match sky {
            YearOfSky::Clear(turbidity) => (
                "kWh/m2 a year under a clear sky",
                vec![format!(
                    "sun and sky of a year without clouds (Ineichen and Perez 2002, Linke turbidity {turbidity}), on each surface as it \
                     is inclined; clouds and panels leave less"
                )],
            ),
            YearOfSky::Weather(weather) => {
                ("kWh/m2 a year with the weather of a file", notes_of_weather(weather, site))
            }
        };
        notes.push(format!("open level ground gets {} kWh/m2", fixed(year.open, 0)));
        Self {
            tops: year.tops,
            points: year.wall_points,
            walls: year.walls,
            title: title.to_owned(),
            column: "kwh_m2",
            total: Some("kwh"),
            notes,
            ..Self::default()
        }
    }

    /// The shadow at a time; `None` if the sun's place is not known then.
    pub(crate) fn of_shadow(surface: &CitySurface, site: &Site, moment: &Moment) -> Option<Self> {
        let sun = site.sun_at(moment)?;
        let dark = shadow(surface, sun);
        let north = Bearing { azimuth_deg: site.from_true_north(sun), ..sun };
        Some(Self { notes: vec![sun_text(north)], ..Self::of_places(surface, &dark, format!("shadow at {moment}")) })
    }

    /// 1 where something is true, else 0, and no value where nothing was baked.
    pub(crate) fn of_places(surface: &CitySurface, places: &[bool], title: String) -> Self {
        let value = |(index, place): (usize, &bool)| match surface.is_known(index) {
            true => f32::from(u8::from(*place)),
            false => f32::NAN,
        };
        let tops = places.iter().enumerate().map(value).collect();
        Self { tops, title, column: "share", ..Self::default() }
    }

    /// The values of a part of the surface; what lies around it was only there to be in the way.
    pub(crate) fn within(mut self, surface: &CitySurface, part: CellExtent) -> Self {
        let all = surface.extent;
        if part == all {
            return self;
        }
        let has = |index: u32| {
            let cell = [all.min[0] + index % all.size[0], all.min[1] + index / all.size[0]];
            (0..2).all(|k| (part.min[k]..part.min[k] + part.size[k]).contains(&cell[k]))
        };
        for (index, value) in (0u32..).zip(&mut self.tops) {
            if !has(index) {
                *value = f32::NAN;
            }
        }
        let kept: Vec<bool> = self.points.iter().map(|point| has(point.cell)).collect();
        let mut keep = kept.iter();
        self.points.retain(|_| keep.next().is_some_and(|kept| *kept));
        let mut keep = kept.iter();
        self.walls.retain(|_| keep.next().is_some_and(|kept| *kept));
        self
    }

    /// The values of one kind of place in numbers.
    pub(crate) fn numbers(&self, places: &PlaceValues) -> Value {
        let [least, most] = [places.least, places.most].map(|end| (places.count > 0).then_some(end));
        let share = self.asked.and_then(|_| places.share());
        json!({ "count": places.count, "least": least, "mean": places.mean(), "most": most, "share_reaching": share })
    }
}

/// What a rule says, in sentences.
pub(crate) fn notes_of(rule: &Rule) -> Vec<String> {
    let mut notes =
        vec![format!("rule: {} ({})", rule.title, rule.source), format!("the rule's hours are those of {}", rule.time)];
    if rule.left_out > 0 {
        let each = count(rule.days.len() as u64, "day");
        notes.push(format!("{each} of the rule's {} were computed", rule.days.len() + rule.left_out));
    }
    match rule.measure {
        Measure::Hours => {}
        Measure::ProbableSunlight(Some(_)) => notes.push(
            "an hour of sun counts by the mean sunshine of its month, all hours of the month alike; BR 209 has it by hours"
                .to_owned(),
        ),
        Measure::ProbableSunlight(None) => {
            notes.push("all hours of sun count alike: the rule has no sunshine_hours, so clouds are left out".to_owned());
        }
    }
    if rule.days.len() > 1 && rule.measure == Measure::Hours {
        let which = match rule.day_mode {
            DayMode::Least => "hours are those of the day with the least sun",
            DayMode::Most => "hours are those of the day with the most sun",
            DayMode::Sum => "hours are those of all days together",
        };
        notes.push(which.to_owned());
    }
    notes
}

/// Whose weather it is, and what is odd about it.
fn notes_of_weather(weather: &WeatherYear, site: &Site) -> Vec<String> {
    let WeatherYear { place, hours, missing, .. } = weather;
    let mut notes = vec![format!(
        "sun and sky of the weather of \"{place}\" (EPW), the sky even all around, on each surface as it is inclined; panels leave less"
    )];
    if *missing > 0 {
        notes.push(format!(
            "{missing} of its {} have no values (9999) and count as dark",
            count(hours.len() as u64, "hour")
        ));
    }
    let distance_km = weather.distance_km(site);
    if distance_km > NEAR_KM {
        notes.push(format!(
            "the weather is that of a place {} km from the city: take a file from nearer by if there is one",
            fixed(distance_km, 0)
        ));
    }
    notes
}

fn sun_text(sun: Bearing) -> String {
    if sun.altitude_deg <= 0.0 {
        return "the sun is below the horizon: all lies in shadow".to_owned();
    }
    format!("the sun stands at {:.1} degrees, {:.1} above the horizon", sun.azimuth_deg, sun.altitude_deg)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weather_of_elsewhere_has_a_note() {
        let weather = |missing: usize| WeatherYear {
            place: "Delft".to_owned(),
            latitude_deg: 52.0,
            longitude_deg: 4.36,
            zone_hours: 1.0,
            hours: Vec::new(),
            missing,
        };
        let site = |latitude_deg: f64| Site { latitude_deg, longitude_deg: 4.36, north_deg: 0.0 };
        let notes = notes_of_weather(&weather(0), &site(52.5));
        assert!(notes.len() == 1 && notes[0].contains("\"Delft\" (EPW)"), "{notes:?}");
        let notes = notes_of_weather(&weather(7), &site(53.0));
        assert!(notes.len() == 3 && notes[1].starts_with("7 of its") && notes[2].contains("111 km"), "{notes:?}");
    }
}
