//! A year of weather from an EPW file, as energy models of buildings read it.
//!
//! Its first lines begin with words, `LOCATION` the first and `DATA PERIODS` the last of them. Then each hour of the year has a line of
//! values (EnergyPlus, Auxiliary Programs, "EnergyPlus Weather File (EPW) Data Dictionary").

use crate::sun::Site;
use chrono::{Datelike, NaiveDate};

/// Lines of a year, and a year that is as long: files put the months of different years together.
const YEARS: [(usize, i32); 2] = [(8760, 2025), (8784, 2024)];
const MAX_HOURS: usize = 8784;
/// Most lines before those of hours. There are eight.
const MAX_HEADER_LINES: usize = 20;
/// Columns of an hour: month, day and hour.
const TIME: [usize; 3] = [1, 2, 3];
const DIRECT: usize = 14;
const DIFFUSE: usize = 15;
/// Columns of the place.
const LATITUDE: usize = 6;
const LONGITUDE: usize = 7;
const ZONE: usize = 8;
/// More than the sun gives beyond the air.
const MAX_WH: f64 = 1500.0;
/// This and all above stands for no value.
const NO_VALUE: f64 = 9999.0;
/// One in so many hours may lack its values.
const MISSING_ONE_IN: usize = 10;
/// Most letters of a text of the file in a sentence.
const MAX_LETTERS: usize = 40;
const EARTH_RADIUS_KM: f64 = 6371.0;

/// A year of weather.
#[derive(Debug, Clone, PartialEq)]
pub struct WeatherYear {
    /// Name of the place, of at most 40 letters.
    pub place: String,
    /// North of the equator, -90 to 90.
    pub latitude_deg: f64,
    /// East of Greenwich, -180 to 180.
    pub longitude_deg: f64,
    /// By how many hours the file's time is ahead of universal time, -14 to 14. It has no summer time.
    pub zone_hours: f64,
    /// All hours of the year, from that which begins with 1 January.
    pub hours: Vec<WeatherHour>,
    /// How many of them have no values, and count as dark.
    pub missing: usize,
}

/// An hour of weather.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WeatherHour {
    pub date: NaiveDate,
    /// When it begins, 0 to 23.
    pub begin: u32,
    /// From the sun on a surface that faces it, in Wh/m2, 0 to 1500.
    pub direct_wh: f64,
    /// From the sky on open level ground, in Wh/m2, 0 to 1500.
    pub diffuse_wh: f64,
}

impl WeatherYear {
    /// Reads the text of an EPW file. Fails with what is wrong with it, and in which line.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut lines = (1usize..).zip(text.trim_start_matches('\u{feff}').lines());
        let first = lines.next().map(|(_, line)| line).unwrap_or_default();
        let (place, [latitude_deg, longitude_deg, zone_hours]) = location(first)?;
        let mut header = lines.by_ref().take(MAX_HEADER_LINES);
        if !header.any(|(_, line)| word(line).eq_ignore_ascii_case("DATA PERIODS")) {
            return Err("no line begins with DATA PERIODS, after which the hours of an EPW file follow".to_owned());
        }
        let rows: Vec<(usize, &str)> = lines.filter(|(_, line)| !line.trim().is_empty()).take(MAX_HOURS + 1).collect();
        let year = YEARS.into_iter().find(|(hours, _)| *hours == rows.len());
        let first = year.and_then(|(_, year)| NaiveDate::from_ymd_opt(year, 1, 1));
        let first = first.ok_or_else(|| {
            let more = if rows.len() > MAX_HOURS { "more than 8784".to_owned() } else { rows.len().to_string() };
            format!("{more} lines of hours, where a year has 8760 or 8784")
        })?;
        let times = first.iter_days().flat_map(|date| (0..24).map(move |begin| (date, begin)));
        let (mut hours, mut missing) = (Vec::with_capacity(rows.len()), 0);
        for ((number, line), (date, begin)) in rows.into_iter().zip(times) {
            let found = irradiation(line, date, begin).map_err(|reason| format!("line {number}: {reason}"))?;
            missing += usize::from(found.is_none());
            let [direct_wh, diffuse_wh] = found.unwrap_or_default();
            hours.push(WeatherHour { date, begin, direct_wh, diffuse_wh });
        }
        if missing > hours.len() / MISSING_ONE_IN {
            return Err(format!("{missing} of {} hours have no direct or diffuse irradiation (9999)", hours.len()));
        }
        Ok(Self { place, latitude_deg, longitude_deg, zone_hours, hours, missing })
    }

    /// Kilometres from its place to a city.
    #[must_use]
    pub fn distance_km(&self, site: &Site) -> f64 {
        let [from, to] = [self.latitude_deg, site.latitude_deg].map(f64::to_radians);
        let east = (site.longitude_deg - self.longitude_deg).to_radians();
        let square = ((to - from) / 2.0).sin().powi(2) + from.cos() * to.cos() * (east / 2.0).sin().powi(2);
        2.0 * EARTH_RADIUS_KM * square.sqrt().min(1.0).asin()
    }
}

/// What a line begins with.
fn word(line: &str) -> &str {
    line.split(',').next().unwrap_or_default().trim()
}

/// What may be shown of a text of the file.
fn shown(text: &str) -> String {
    text.chars().filter(|c| !c.is_control()).take(MAX_LETTERS).collect()
}

/// Name, latitude, longitude and hours ahead of universal time. Fails if the line has none.
fn location(line: &str) -> Result<(String, [f64; 3]), String> {
    let fields: Vec<&str> = line.split(',').take(ZONE + 1).map(str::trim).collect();
    let number = |column: usize, most: f64| -> Option<f64> {
        fields.get(column)?.parse().ok().filter(|value: &f64| value.abs() <= most)
    };
    let place = number(LATITUDE, 90.0).zip(number(LONGITUDE, 180.0)).zip(number(ZONE, 14.0));
    match place {
        Some(((latitude, longitude), zone)) if word(line).eq_ignore_ascii_case("LOCATION") => {
            Ok((shown(fields[1]), [latitude, longitude, zone]))
        }
        _ => Err(
            "line 1: an EPW file begins with LOCATION, and has latitude, longitude and time zone as the 7th to 9th \
                  value of that line"
                .to_owned(),
        ),
    }
}

/// Direct normal and diffuse horizontal irradiation of the hour that begins then; `None` if one of them is missing. Fails if it is another
/// hour's line, or if a value is none.
fn irradiation(line: &str, date: NaiveDate, begin: u32) -> Result<Option<[f64; 2]>, String> {
    let fields: Vec<&str> = line.split(',').take(DIFFUSE + 1).map(str::trim).collect();
    if fields.len() <= DIFFUSE {
        return Err(format!("{} values, where the 15th and 16th are direct and diffuse irradiation", fields.len()));
    }
    let [month, day, hour] = [date.month(), date.day(), begin + 1];
    if TIME.map(|column| fields[column].parse::<u32>().ok()) != [month, day, hour].map(Some) {
        return Err(format!(
            "month {month}, day {day}, hour {hour} expected: hours of an EPW file are 1 to 24, in order from 1 January"
        ));
    }
    let value = |column: usize, name: &str| match fields[column].parse::<f64>() {
        Ok(value) if (0.0..=MAX_WH).contains(&value) => Ok(Some(value)),
        Ok(value) if value >= NO_VALUE => Ok(None),
        _ => Err(format!("{name} irradiation \"{}\": write Wh/m2, 0 to 1500, or 9999 for none", shown(fields[column]))),
    };
    let (direct, diffuse) = (value(DIRECT, "direct normal")?, value(DIFFUSE, "diffuse horizontal")?);
    Ok(direct.zip(diffuse).map(|(direct, diffuse)| [direct, diffuse]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file of a year with so many days, in which each hour has the values of a text.
    fn file(days: usize, values: impl Fn(usize) -> String) -> String {
        let year = if days == 366 { 2024 } else { 2025 };
        let first = NaiveDate::from_ymd_opt(year, 1, 1).unwrap();
        let mut text = "LOCATION,Delft,-,NLD,made,1,52.0,4.36,1.0,0.0\r\nDESIGN CONDITIONS,0\r\n".to_owned();
        text += "COMMENTS 1,none\r\nDATA PERIODS,1,1,Data,Sunday, 1/ 1,12/31\r\n";
        for (day, date) in first.iter_days().take(days).enumerate() {
            for hour in 0..24 {
                let (month, of_month) = (date.month(), date.day());
                let values = values(day * 24 + hour);
                text += &format!("1999,{month},{of_month},{},60,?9,1,1,50,101325,0,0,300,0,{values},0\r\n", hour + 1);
            }
        }
        text
    }

    #[test]
    fn files_have_a_place_and_the_hours_of_a_year() {
        let values = |hour: usize| match hour {
            12 => "800.5,90".to_owned(),
            13 => "9999,90".to_owned(),
            14 => "0,99999".to_owned(),
            _ => "0,0".to_owned(),
        };
        let year = WeatherYear::parse(&file(365, values)).unwrap();
        assert_eq!((year.place.as_str(), year.latitude_deg, year.longitude_deg), ("Delft", 52.0, 4.36));
        assert_eq!((year.zone_hours, year.hours.len(), year.missing), (1.0, 8760, 2));
        let noon = year.hours[12];
        assert_eq!((noon.date.ordinal(), noon.begin, noon.direct_wh, noon.diffuse_wh), (1, 12, 800.5, 90.0));
        assert_eq!((year.hours[13].direct_wh, year.hours[13].diffuse_wh), (0.0, 0.0), "both count, or none");
        let leap = WeatherYear::parse(&format!("\u{feff}{}\n\n", file(366, values))).unwrap();
        let last = leap.hours.last().unwrap();
        assert_eq!((leap.hours.len(), last.date.month(), last.date.day(), last.begin), (8784, 12, 31, 23));
        // A degree of latitude has 111.2 km.
        let site = |latitude_deg: f64| Site { latitude_deg, longitude_deg: 4.36, north_deg: 0.0 };
        assert!(year.distance_km(&site(52.0)) < 1e-6 && (year.distance_km(&site(53.0)) - 111.2).abs() < 0.1);
    }

    #[test]
    fn files_that_are_none_say_what_is_wrong() {
        let good = file(365, |_| "0,0".to_owned());
        let hours: Vec<&str> = good.split_inclusive("\r\n").collect();
        let without_last = hours[..hours.len() - 1].concat();
        for (text, word) in [
            (String::new(), "LOCATION"),
            ("{\"type\":\"FeatureCollection\"}".to_owned(), "LOCATION"),
            (",".repeat(100_000), "LOCATION"),
            ("LOCATION,Delft".to_owned(), "time zone"),
            (good.replace("52.0,4.36", "520,4.36"), "latitude"),
            (good.replace("52.0,4.36", "NaN,4.36"), "latitude"),
            (good.replace("DATA PERIODS", "DATA"), "DATA PERIODS"),
            (without_last.clone(), "8759 lines of hours"),
            (format!("{without_last}{}{}", hours[100], hours[101]), "8761 lines of hours"),
            (good.clone() + &hours[100].repeat(100), "more than 8784 lines"),
            // The fifth line is that of the first hour.
            (format!("{without_last}{}", hours[100]), "line 8764: month 12, day 31, hour 24"),
            (good.replacen("0,300,0,0,0,0", "0,300,0,-5,0,0", 1), "line 5: direct normal irradiation \"-5\""),
            (good.replacen("0,300,0,0,0,0", "0,300,0,0,2000,0", 1), "line 5: diffuse horizontal irradiation \"2000\""),
            (good.replacen("0,300,0,0,0,0", "0,300,0,NaN,0,0", 1), "line 5: direct normal"),
            (good.replacen(",60,?9,1,1,50,101325,0,0,300,0,0,0,0", "", 1), "line 5: 4 values"),
            (file(365, |hour| if hour % 5 == 0 { "9999,0" } else { "0,0" }.to_owned()), "1752 of 8760 hours"),
        ] {
            let error = WeatherYear::parse(&text).unwrap_err();
            assert!(error.contains(word) && error.len() < 200, "{word}: {error}");
        }
        let long = good.replacen("0,300,0,0,0,0", &format!("0,300,0,{},0,0", "x".repeat(9999)), 1);
        assert!(WeatherYear::parse(&long).unwrap_err().len() < 200);
    }
}
