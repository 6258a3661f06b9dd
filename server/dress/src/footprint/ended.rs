//! What is no longer there, or never was, by the attributes of registers: demolished objects, permits that came to nothing, and versions of
//! an object that a newer one has replaced.

use insula_source::attributes::{AttributeValue, Attributes};
use std::ops::RangeInclusive;

/// Why an object that has ended is left out.
pub const ENDED: &str = "demolished, not built, or replaced by a newer version";

/// Names of attributes with the day on which an object, or its version, ended: of CityGML, INSPIRE and the Dutch registers. In
/// lower case, without marks between words.
const ENDS: &[&str] = &[
    "terminationdate", "endlifespanversion", "validto", "dateofdemolition", "yearofdemolition", "demolitiondate",
    "eindregistratie", "tijdstipeindregistratie", "tijdstipeindregistratielv", "objecteindtijd", "eindgeldigheid",
    "einddatumtijdvakgeldigheid",
];
/// Names of attributes with the state of an object, spelt alike.
const STATES: &[&str] = &[
    "status", "buildingstatus", "bldgstatus", "lifecyclestatus", "conditionofconstruction", "pandstatus", "bgtstatus",
    "plusstatus", "valorcondicaoconst", "etat", "stato", "estado",
];
/// States of what is not there, in lower case.
const GONE: &[&str] = &[
    "demolished", "razed", "destroyed", "removed", "collapsed", "projected", "gesloopt", "pand gesloopt",
    "niet gerealiseerd pand", "bouwvergunning verleend", "historie", "demolido", "demolida", "demolito", "démoli",
    "démolie", "détruit", "en projet", "constructionproject", "canceledconstructionproject", "abgerissen",
    "abgebrochen",
];
/// Earlier and later years are marks of objects that have not ended, such as 9999-12-31.
const YEARS: RangeInclusive<u32> = 1901..=2089;
/// A mark, too: the first day of many clocks.
const FIRST_DAY: &str = "1970-01-01";
/// Length to which Shapefiles cut names.
const CUT_BYTES: usize = 10;

/// Whether attributes say that an object is not there, or is no longer valid.
pub fn has_ended(attributes: &Attributes) -> bool {
    attributes.iter().any(|(name, value)| {
        let is_one_of = |names: &[&str]| names.iter().any(|known| fits(name, known));
        is_one_of(ENDS) && is_end(value) || is_one_of(STATES) && is_gone(value)
    })
}

/// Whether a name is a known one in any spelling, or its beginning as Shapefiles cut it.
fn fits(name: &str, known: &str) -> bool {
    let first = |text: &str| text.bytes().next().map(|byte| byte.to_ascii_lowercase());
    if first(name) != first(known) {
        return false;
    }
    let is_mark = |byte: u8| matches!(byte, b'_' | b'-' | b':' | b' ');
    let letters = name.bytes().filter(|byte| !is_mark(*byte)).map(|byte| byte.to_ascii_lowercase());
    let count = letters.clone().count();
    // Shorter beginnings may be those of any name.
    let is_cut = name.len() == CUT_BYTES && count + 1 >= CUT_BYTES && known.len() > count;
    (count == known.len() || is_cut) && letters.eq(known.bytes().take(count))
}

/// Whether a value is a date or a year that may be an end.
fn is_end(value: &AttributeValue) -> bool {
    let text = value.to_string();
    let year = |digits: &str| match digits.len() {
        4 | 8.. => digits.get(..4).and_then(|year| year.parse::<u32>().ok()),
        _ => None,
    };
    let first = text.split(|c: char| !c.is_ascii_digit()).find_map(year);
    !text.starts_with(FIRST_DAY) && first.is_some_and(|year| YEARS.contains(&year))
}

/// Whether a value, possibly the address of one in a list of codes, is a state of what is not there.
fn is_gone(value: &AttributeValue) -> bool {
    let text = value.as_str().unwrap_or_default().trim().to_lowercase();
    let code = text.rsplit(['/', '#']).next().unwrap_or_default();
    GONE.contains(&code)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ended(name: &str, value: &str) -> bool {
        let mut attributes = Attributes::default();
        attributes.push("id", AttributeValue::Integer(20_160_805));
        attributes.push(name, AttributeValue::from_untyped(value));
        has_ended(&attributes)
    }

    #[test]
    fn ends_and_states_are_known_in_every_spelling() {
        for (name, value) in [
            ("terminationDate", "2016-08-05"),
            ("termination_date", "2016-08-05T13:37:00.000+02:00"),
            ("TERMINATIO", "20160805"),
            ("endLifespanVersion", "05.08.2016 00:00"),
            ("eindRegistratie", "2016-08-05 13:37:00"),
            ("EIND_REGIS", "2016-08-05"),
            ("yearOfDemolition", "1998"),
            ("validTo", "20160805133700"),
            ("status", "Pand gesloopt"),
            ("STATUS", "demolished"),
            ("bgt-status", "historie"),
            ("bldg_statu", "DEMOLISHED"),
            ("ETAT", "En projet"),
            ("status", "canceledConstructionProject"),
            ("CONDITIONO", "demolished"),
            ("conditionOfConstruction", "http://inspire.ec.europa.eu/codelist/ConditionOfConstructionValue/demolished"),
        ] {
            assert!(ended(name, value), "{name} {value}");
        }
    }

    #[test]
    fn marks_of_no_end_and_other_names_tell_nothing() {
        for (name, value) in [
            ("terminationDate", ""),
            ("terminationDate", "9999-12-31"),
            ("validTo", "0001-01-01"),
            ("validTo", "1970-01-01"),
            ("validTo", "2999-12-31T00:00:00"),
            ("eindregistratie", "nil"),
            ("yearOfDemolition", "0"),
            ("yearOfConstruction", "1998"),
            ("creationDate", "2016-08-05"),
            ("valid", "2016-08-05"),
            ("address.validTo", "2016-08-05"),
            ("status", "Pand in gebruik"),
            ("status", "Sloopvergunning verleend"),
            ("status", "planned"),
            ("bldg_statu", "ACTIVE"),
            ("status", "ongoingConstruction"),
            ("roof_status", "removed"),
            ("conditionOfConstruction", "functional"),
        ] {
            assert!(!ended(name, value), "{name} {value}");
        }
    }
}
