//! Systems by the names that the EPSG registry and Esri have for them, such as `WGS 84 / UTM zone 32N`.

use super::registry::{name_key, vertical_by_name};
use std::ops::RangeInclusive;

/// Systems by their names as [`name_key`] has them, without Esri's years.
const SYSTEMS: [(&str, u32); 33] = [
    ("wgs84", 4326),
    ("etrs89", 4258),
    ("wgs84pseudomercator", 3857),
    ("wgs84webmercator", 3857),
    ("wgs84webmercatorauxiliarysphere", 3857),
    ("etrs89laeaeurope", 3035),
    ("etrs89extendedlaeaeurope", 3035),
    ("etrs89laea", 3035),
    ("amersfoortrdnew", 28992),
    ("rdnew", 28992),
    ("bd72belgianlambert72", 31370),
    ("belgianlambert72", 31370),
    ("bd72belgelambert72", 31300),
    ("etrs89belgianlambert2008", 3812),
    ("rgf93lambert93", 2154),
    ("rgf93v1lambert93", 2154),
    ("osgb36britishnationalgrid", 27700),
    ("britishnationalgrid", 27700),
    ("ch1903+lv95", 2056),
    ("ch1903lv03", 21781),
    ("mgiaustrialambert", 31287),
    ("mgiaustriagkwest", 31254),
    ("mgiaustriagkcentral", 31255),
    ("mgiaustriagkeast", 31256),
    ("sjtskkrovakeastnorth", 5514),
    ("dhdnsoldnerberlin", 3068),
    ("sweref99tm", 3006),
    ("etrs89tm35fin", 3067),
    ("etrs89tm35finen", 3067),
    ("etrs89polandcs92", 2180),
    ("lks94lithuaniatm", 3346),
    ("nzgd2000newzealandtransversemercator2000", 2193),
    ("svy21singaporetm", 3414),
];
/// Systems with a number between two parts of their names, and what the code exceeds it by.
const ZONES: [(&str, &str, RangeInclusive<u32>, u32); 12] = [
    ("wgs84utmzone", "n", 1..=60, 32600),
    ("wgs84utmzone", "s", 1..=60, 32700),
    ("etrs89utmzone", "n", 28..=37, 25800),
    ("nad83utmzone", "n", 1..=23, 26900),
    ("ed50utmzone", "n", 28..=38, 23000),
    ("dhdn3degreegausskrugerzone", "", 2..=5, 31464),
    ("dhdn3degreegausszone", "", 2..=5, 31464),
    ("rgf93cc", "", 42..=50, 3900),
    ("rgf93v1cc", "", 42..=50, 3900),
    ("gda94mgazone", "", 48..=58, 28300),
    ("gda2020mgazone", "", 46..=59, 7800),
    ("jgd2011japanplanerectangularcs", "", 1..=19, 6668),
];
/// Years as Esri writes them in names, and as the registry does.
const YEARS: [(&str, &str); 5] =
    [("wgs1984", "wgs84"), ("etrs1989", "etrs89"), ("rgf1993", "rgf93"), ("nad1983", "nad83"), ("osgb1936", "osgb36")];
const ROMAN: [&str; 19] = [
    "i", "ii", "iii", "iv", "v", "vi", "vii", "viii", "ix", "x", "xi", "xii", "xiii", "xiv", "xv", "xvi", "xvii",
    "xviii", "xix",
];

/// Codes of the horizontal and, behind a ` + `, the vertical system with a name.
pub(super) fn codes(name: &str) -> Option<(u32, Option<u32>)> {
    match name.split_once(" + ") {
        Some((horizontal, vertical)) => Some((horizontal_code(horizontal)?, Some(vertical_by_name(vertical)?))),
        None => Some((horizontal_code(name)?, None)),
    }
}

fn horizontal_code(name: &str) -> Option<u32> {
    let mut key = name_key(name).replace('\u{fc}', "u");
    for (esri, registry) in YEARS {
        if let Some(rest) = key.strip_prefix(esri) {
            key = format!("{registry}{rest}");
        }
    }
    let known = SYSTEMS.iter().find(|(name, _)| *name == key).map(|(_, code)| *code);
    let zoned = || {
        ZONES.iter().find_map(|(start, end, zones, base)| {
            let text = key.strip_prefix(start)?.strip_suffix(end)?;
            let roman = || Some(ROMAN.iter().position(|number| *number == text)? as u32 + 1);
            let zone = text.parse().ok().or_else(roman)?;
            zones.contains(&zone).then_some(base + zone)
        })
    };
    known.or_else(zoned)
}
