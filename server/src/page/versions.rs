//! The versions of a city in time, between which its page switches.

use insula_protocol::Manifest;

/// A version of a city.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct CityVersion {
    /// As in `2024-01-31`.
    pub(crate) date: String,
    /// Address of its page.
    pub(crate) page: String,
}

/// The versions of a city among all cities, the earliest first; empty if there is no other. `page` gives the address of the page of a city
/// by its name.
pub(crate) fn versions_of<'a>(
    city: &Manifest,
    all: impl Iterator<Item = &'a Manifest>,
    page: impl Fn(&str) -> String,
) -> Vec<CityVersion> {
    let Some(own) = &city.release else { return Vec::new() };
    let version = |other: &Manifest| {
        let release = other.release.as_ref().filter(|release| release.of == own.of)?;
        Some(CityVersion { date: release.date.clone(), page: page(&other.name) })
    };
    let mut versions: Vec<CityVersion> = all.filter_map(version).collect();
    versions.sort();
    if versions.len() > 1 { versions } else { Vec::new() }
}

/// The versions as the page's script reads them: the day and the address of each. Neither has a blank.
pub(super) fn versions_text(versions: &[CityVersion]) -> String {
    let words = versions.iter().flat_map(|version| [version.date.as_str(), version.page.as_str()]);
    words.collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_protocol::release::Release;

    #[test]
    fn versions_are_those_of_one_city_by_their_days() {
        let city = |name: &str, of: &str, date: Option<&str>| {
            let release =
                |date: &str| Release { of: of.into(), date: date.into(), bake_origin: [0.0; 3], shared: Vec::new() };
            Manifest { name: name.into(), release: date.map(release), ..Manifest::default() }
        };
        let all = [
            city("b", "a", Some("2024-01-31")),
            city("a", "a", Some("2020-01-01")),
            city("c", "c", Some("2021-01-01")),
            city("d", "d", None),
        ];
        let of = |city: &Manifest| versions_text(&versions_of(city, all.iter(), |name| format!("../{name}")));
        assert_eq!(of(&all[0]), "2020-01-01 ../a 2024-01-31 ../b");
        assert_eq!([of(&all[2]), of(&all[3])], ["", ""]);
    }
}
