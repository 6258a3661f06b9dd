//! Attributes of buildings that are others than before.

use crate::table::ExportError;
use crate::table::city::City;

/// Names of attributes, with their indices in the schemas of two cities.
pub(super) struct ComparedAttributes(Vec<(String, [Option<u32>; 2])>);

impl ComparedAttributes {
    /// Of names that one of the cities may not have.
    pub(super) fn new(names: &[String], cities: &[City<'_>; 2]) -> Self {
        let index = |city: &City<'_>, name: &str| city.source.schema().index_of(name).map(|index| index as u32);
        Self(names.iter().map(|name| (name.clone(), [index(&cities[0], name), index(&cities[1], name)])).collect())
    }

    /// What is another value of two objects, as in `year: 1990 to 2001`. Fails if a city cannot be read.
    pub(super) fn others(&self, cities: &[City<'_>; 2], objects: [u32; 2]) -> Result<Vec<String>, ExportError> {
        if self.0.is_empty() {
            return Ok(Vec::new());
        }
        let records = [cities[0].record(objects[0])?, cities[1].record(objects[1])?];
        let value = |city: usize, index: Option<u32>| -> Option<String> {
            let attributes = &records[city].as_ref()?.attributes;
            let at = attributes.binary_search_by_key(&index?, |(known, _)| *known).ok()?;
            attributes.get(at).map(|(_, value)| value.to_string())
        };
        let mut others = Vec::new();
        for (name, indices) in &self.0 {
            let values = [value(0, indices[0]), value(1, indices[1])];
            let [before, after] = values.map(|value| value.unwrap_or_else(|| "none".to_owned()));
            if before != after {
                others.push(format!("{name}: {before} to {after}"));
            }
        }
        Ok(others)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::test_city::{HEDGE, HOUSE, TestCity};

    #[test]
    fn values_are_told_that_are_others() {
        let (before, after) = (TestCity::new(true), TestCity::of_rotated_houses());
        let cities = [City::new(&before), City::new(&after)];
        let compared = ComparedAttributes::new(&["year".to_owned(), "eaves".to_owned()], &cities);
        let others = |object: u32| compared.others(&cities, [object, 0]).unwrap();
        assert_eq!(others(HOUSE), ["year: 1894 to none", "eaves: 7.25 to none"]);
        assert!(others(HEDGE).is_empty());
    }
}
