//! Numbers of formats in the form of attributes.

use insula_source::attributes::AttributeValue;

/// The date of a number of days after 1970-01-01; `None` outside of years 1 to 9999.
pub(super) fn date_of_days(days: i64) -> Option<AttributeValue> {
    const DAYS_OF_ERA: i64 = 146_097;
    if !(-719_162..=2_932_896).contains(&days) {
        return None;
    }
    // Years begin in March, so that leap days are at the end.
    let days = days + 719_468;
    let (era, day_of_era) = (days.div_euclid(DAYS_OF_ERA), days.rem_euclid(DAYS_OF_ERA));
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let march_month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * march_month + 2) / 5 + 1;
    let month = if march_month < 10 { march_month + 3 } else { march_month - 9 };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    Some(AttributeValue::Date { year: year as i32, month: month as u8, day: day as u8 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_dates() {
        let text = |days: i64| date_of_days(days).map(|date| date.to_string());
        assert_eq!(text(0).as_deref(), Some("1970-01-01"));
        assert_eq!(text(19_782).as_deref(), Some("2024-02-29"));
        assert_eq!(text(-1).as_deref(), Some("1969-12-31"));
        assert_eq!(text(-719_162).as_deref(), Some("0001-01-01"));
        assert_eq!(text(2_932_896).as_deref(), Some("9999-12-31"));
        assert_eq!((text(i64::MIN), text(i64::MAX)), (None, None));
    }
}
