//! Systems as Arc/Info wrote them into `.prj` files beside grids: lines of a word and its value.

use super::{Crs, CrsError, from_codes};

/// Whether a text is such a description: several lines, the first of which names a projection.
pub(super) fn is_description(text: &str) -> bool {
    let mut words = text.split_ascii_whitespace();
    words.next().is_some_and(|word| word.eq_ignore_ascii_case("projection")) && text.contains('\n')
}

/// The system of a description. Fails if it is neither UTM nor longitude and latitude, in metres or degrees.
pub(super) fn parse(text: &str) -> Result<Crs, CrsError> {
    let value = |wanted: &str| {
        let of_line = |line: &str| {
            let (word, value) = line.trim().split_once(char::is_whitespace)?;
            word.eq_ignore_ascii_case(wanted).then(|| value.trim().to_ascii_uppercase())
        };
        text.lines().find_map(of_line).unwrap_or_default()
    };
    let unsupported = |word: &str| CrsError::Unsupported(format!("its {word} is {}", value(word)));
    let is_shifted = |word: &str| value(word).parse::<f64>().is_ok_and(|shift| shift != 0.0);
    if let Some(word) = ["xshift", "yshift"].into_iter().find(|word| is_shifted(word)) {
        return Err(unsupported(word));
    }
    if !matches!(&*value("zunits"), "" | "NO" | "METERS" | "1" | "1.0") {
        return Err(unsupported("zunits"));
    }
    // Code in degrees, and what the zone is added to for UTM.
    let (degrees, zones) = match &*value("datum") {
        "WGS84" | "WGS_1984" | "WGS 84" => (4326, 32_600),
        "ETRS89" | "ETRS_1989" | "ETRF89" => (4258, 25_800),
        "NAD83" => (4269, 26_900),
        "NAD27" => (4267, 26_700),
        "" | "NONE" if matches!(&*value("spheroid"), "WGS84" | "GRS80" | "GRS1980") => (4326, 32_600),
        _ => return Err(unsupported("datum")),
    };
    match (&*value("projection"), &*value("units")) {
        ("GEOGRAPHIC", "DD" | "DEGREES") => from_codes(degrees, None),
        ("UTM", "METERS" | "METRES" | "1" | "1.0") => {
            let zone = value("zone").parse::<i32>().ok().filter(|zone| (1..=60).contains(&zone.abs()));
            let zone = zone.ok_or_else(|| unsupported("zone"))?;
            // Zones of the south are negative. Only WGS 84 has all of them.
            match (zone < 0, zones) {
                (false, _) => from_codes(zones + zone.unsigned_abs(), None),
                (true, 32_600) => from_codes(32_700 + zone.unsigned_abs(), None),
                (true, _) => Err(unsupported("zone")),
            }
        }
        ("GEOGRAPHIC" | "UTM", _) => Err(unsupported("units")),
        _ => Err(unsupported("projection")),
    }
}

#[cfg(test)]
mod tests {
    use super::super::resolve;
    use super::*;

    #[test]
    fn utm_and_degrees_are_known_by_their_lines() {
        let text = |projection: &str, datum: &str, units: &str, rest: &str| {
            format!(
                "Projection    {projection}\r\nDatum  {datum}\nSpheroid GRS80\nUnits {units}\nZunits NO\n{rest}\nParameters \n"
            )
        };
        let code = |text: &str| resolve(text).map(|crs| crs.horizontal.code.unwrap_or_default());
        for (projection, datum, units, rest, expected) in [
            ("UTM", "WGS84", "METERS", "Zone 32", 32_632),
            ("utm", "WGS84", "meters", "zone -19", 32_719),
            ("UTM", "NAD83", "METERS", "Zone 18\nXshift 0.0", 26_918),
            ("UTM", "ETRS89", "METERS", "Zone 32", 25_832),
            ("UTM", "NONE", "METERS", "Zone 32", 32_632),
            ("GEOGRAPHIC", "WGS84", "DD", "", 4326),
        ] {
            assert_eq!(code(&text(projection, datum, units, rest)), Ok(expected), "{projection} {datum} {rest}");
        }
        let reason = |text: &str| match code(text) {
            Err(CrsError::Unsupported(reason)) => reason,
            other => panic!("{other:?}"),
        };
        assert_eq!(reason(&text("ALBERS", "NAD83", "METERS", "")), "its projection is ALBERS");
        assert_eq!(reason(&text("UTM", "NAD83", "FEET", "Zone 18")), "its units is FEET");
        assert_eq!(reason(&text("UTM", "NAD83", "METERS", "Zone 99")), "its zone is 99");
        assert_eq!(reason(&text("UTM", "NAD83", "METERS", "Zone 18\nYshift 5")), "its yshift is 5");
        assert_eq!(reason(&text("UTM", "CAPE", "METERS", "Zone 35")), "its datum is CAPE");
    }
}
