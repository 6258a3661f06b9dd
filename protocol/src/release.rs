//! The release of a city, a part of the manifest: of which day it is, and with which earlier ones it shares tiles.

use crate::name::is_name;
use serde::{Deserialize, Serialize};

/// Most cities with which one shares tiles.
pub const MAX_SHARED: usize = 16;

/// A city as it was on a day.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Release {
    /// Name that all releases of a city have in common: that of the first one.
    pub of: String,
    /// The day, as in `2024-01-31`.
    pub date: String,
    /// Place in world metres to which the bake's coordinates were relative. Later releases keep it, so that what has not changed has the
    /// same bytes.
    pub bake_origin: [f64; 3],
    /// Cities in which the bytes of shared tiles are, the nearest first; at most [`MAX_SHARED`], empty if the city has all its tiles. The
    /// folder of each has its name, and is beside that of this city.
    pub shared: Vec<SharedCity>,
}

/// A city that has tiles of later ones.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SharedCity {
    pub name: String,
    pub version: String,
}

impl Release {
    /// Fails if a name, the date or a length is invalid.
    pub(crate) fn check(&self) -> Result<(), String> {
        let are_names = self.shared.iter().all(|city| is_name(&city.name) && is_name(&city.version));
        if !is_name(&self.of) || !are_names {
            return Err("a name or version of its releases is not 1 to 64 characters of a-z, 0-9, _ and -".into());
        }
        if self.shared.len() > MAX_SHARED {
            return Err(format!("it shares tiles with more than {MAX_SHARED} cities"));
        }
        if !is_date(&self.date) {
            return Err("the date of its release is no day as in 2024-01-31".into());
        }
        match self.bake_origin.iter().all(|v| v.is_finite() && v.abs() < 1e10) {
            true => Ok(()),
            false => Err("the origin of its bake is not finite or over 10^10".into()),
        }
    }
}

/// Whether a text is a day of the calendar, as in `2024-01-31`. In the order of such texts, earlier days come first.
#[must_use]
pub fn is_date(text: &str) -> bool {
    let bytes = text.as_bytes();
    let is_shaped = bytes.len() == 10
        && bytes
            .iter()
            .enumerate()
            .all(|(i, byte)| if i == 4 || i == 7 { *byte == b'-' } else { byte.is_ascii_digit() });
    if !is_shaped {
        return false;
    }
    let number = |from: usize, to: usize| bytes[from..to].iter().fold(0, |n, byte| 10 * n + u32::from(byte - b'0'));
    let (year, month, day) = (number(0, 4), number(5, 7), number(8, 10));
    let is_leap = year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400));
    let days = match month {
        2 => 28 + u32::from(is_leap),
        4 | 6 | 9 | 11 => 30,
        1..=12 => 31,
        _ => 0,
    };
    (1..=days).contains(&day)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_days_of_the_calendar() {
        let valid = ["2024-01-31", "2024-02-29", "2000-02-29", "1850-12-01"];
        assert!(valid.into_iter().all(is_date));
        for text in ["2023-02-29", "1900-02-29", "2024-13-01", "2024-00-01", "2024-04-31", "2024-1-31", "24-01-31", ""]
        {
            assert!(!is_date(text), "{text}");
        }
        assert!(!["2024-01-3\u{b2}", "2024/01/31", "2024-01-31 ", "+024-01-31"].into_iter().any(is_date));
    }

    #[test]
    fn releases_have_limits_and_names_of_folders() {
        let city = |name: &str| SharedCity { name: name.into(), version: "0123456789abcdef".into() };
        let release = |shared: Vec<SharedCity>| Release {
            of: "town".into(),
            date: "2024-01-31".into(),
            bake_origin: [1.0, 2.0, 3.0],
            shared,
        };
        assert_eq!(release(vec![city("town"); MAX_SHARED]).check(), Ok(()));
        assert!(release(vec![city("town"); MAX_SHARED + 1]).check().is_err());
        // No way out of the folder beside it.
        for name in ["..", "a/b", "", "/etc", "A"] {
            assert!(release(vec![city(name)]).check().is_err(), "{name}");
            assert!(Release { of: name.into(), ..release(Vec::new()) }.check().is_err(), "{name}");
        }
        assert!(Release { date: "2024".into(), ..release(Vec::new()) }.check().is_err());
        assert!(Release { bake_origin: [f64::NAN; 3], ..release(Vec::new()) }.check().is_err());
    }
}
