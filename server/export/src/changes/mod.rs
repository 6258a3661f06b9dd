//! What was built, demolished and changed between two cities, as a table with footprints.
//!
//! | module | contents |
//! |---|---|
//! | `shapes` | the footprints of the buildings of a city |
//! | `pairs` | buildings of two cities that overlap |
//! | `groups` | which of them are the same, and which were split or merged |
//! | `attributes` | attributes that are others than before |

mod groups;
mod pairs;
mod shapes;
#[cfg(test)]
mod test_shapes;

use crate::format::{Format, Projections};
use crate::source::ExportSource;
use crate::table::city::City;
use crate::table::grid::MapPoint;
use crate::table::record::{Record, own_fields};
use crate::table::{ExportError, ExportReport, write_rows};
use groups::ChangeGroups;
use insula_objects::{FeatureKind, Value, ValueType};
use insula_protocol::Manifest;
use shapes::{BuildingShape, BuildingShapes};
use std::path::Path;

/// Around an area, so far buildings are read that may be one with a building in it.
const AROUND_M: f64 = 200.0;
/// Tiles round heights: so much of a step is one.
const NEARLY: f64 = 0.99;
/// Most identifiers of a cell. Each building of a group has those of all before it.
const MAX_NAMES: usize = 100;

/// The columns: name, type and unit. The last one only if attributes are compared.
const COLUMNS: [(&str, ValueType, Option<&str>); 13] = [
    ("change", ValueType::Text, None),
    ("what", ValueType::Text, None),
    ("height_m", ValueType::Float, Some("m")),
    ("object_before", ValueType::Integer, None),
    ("identifier_before", ValueType::Text, None),
    ("height_before_m", ValueType::Float, Some("m")),
    ("area_before_m2", ValueType::Float, Some("m2")),
    ("object_after", ValueType::Integer, None),
    ("identifier_after", ValueType::Text, None),
    ("height_after_m", ValueType::Float, Some("m")),
    ("area_after_m2", ValueType::Float, Some("m2")),
    ("overlap", ValueType::Float, None),
    ("attributes", ValueType::Text, None),
];

/// What counts as a change.
#[derive(Debug, Clone)]
pub struct ChangeOptions {
    /// Least difference of heights in metres.
    pub height_step_m: f64,
    /// Footprints are the same whose common area is at least this share of the area of both together.
    pub same_footprint: f64,
    /// Only buildings with the middle in this area: as world metres of the earlier city, and of the later one.
    pub areas: Option<[[[f64; 2]; 2]; 2]>,
    /// Unchanged buildings have rows, too.
    pub has_unchanged: bool,
    /// Names of attributes whose values are compared.
    pub attributes: Vec<String>,
}

/// How many buildings changed. Of those that did, each has one or more of the reasons.
#[derive(Debug, Clone, Default)]
pub struct ChangeReport {
    pub built: u64,
    pub demolished: u64,
    pub changed: u64,
    pub unchanged: u64,
    pub higher: u64,
    pub lower: u64,
    /// With another footprint.
    pub footprint: u64,
    /// Parts of an earlier building.
    pub split: u64,
    /// Of several earlier buildings.
    pub merged: u64,
    /// With another value of a compared attribute.
    pub attributes: u64,
    /// What was written.
    pub table: ExportReport,
}

/// The manifest of a table of changes: the later city, with the sources of both.
#[must_use]
pub fn manifest_of_both(before: &Manifest, after: &Manifest) -> Manifest {
    let mut both = after.clone();
    for source in &before.attribution {
        source.clone().add_to(&mut both.attribution);
    }
    both
}

/// Writes a row for each building that was built, demolished or changed from the first city to the second one, on the map of the second.
/// `on_map` gives the place there of one in the world metres of the first. Fails if a city cannot be read or has too many buildings, or if
/// the file cannot be written. Memory holds the footprints of both.
pub fn write_changes(
    cities: [&dyn ExportSource; 2],
    on_map: &dyn Fn([f64; 2]) -> Option<[f64; 2]>,
    options: &ChangeOptions,
    (format, projections): (Format, &Projections<'_>),
    out: &Path,
) -> Result<ChangeReport, ExportError> {
    let [before, after] = cities.map(City::new);
    let [area_before, area_after] = match options.areas {
        Some(areas) => areas.map(|[low, high]| Some([low.map(|v| v - AROUND_M), high.map(|v| v + AROUND_M)])),
        None => [None; 2],
    };
    let shapes = [
        BuildingShapes::read(&before, area_before, &after.grid, on_map)?,
        BuildingShapes::read(&after, area_after, &after.grid, &Some::<[f64; 2]>)?,
    ];
    let groups = ChangeGroups::new(&shapes[0], &shapes[1], options.same_footprint)?;
    let manifest = manifest_of_both(before.manifest, after.manifest);
    let cities = [before, after];
    let attributes = ComparedAttributes::new(&options.attributes, &cities);
    let comparison = CityComparison { cities, shapes, options, attributes };
    let mut changes = ChangeReport::default();
    let fields = own_fields(&COLUMNS[..COLUMNS.len() - usize::from(options.attributes.is_empty())]);
    let mut table = write_rows((format, false), &manifest, &fields, projections, out, &mut |writer, report| {
        for (members, overlap) in groups.iter() {
            for record in comparison.rows(members, overlap, &mut changes)? {
                let record = Record { object: report.objects as u32, ..record };
                match writer.write(&record)? {
                    Some(reason) => report.skip(reason),
                    None => report.objects += 1,
                }
            }
        }
        Ok(())
    })?;
    for _ in 0..comparison.shapes[0].beyond {
        table.skip("an earlier building has no place in the later city's coordinate system");
    }
    Ok(ChangeReport { table, ..changes })
}

/// Two cities, of which the second one has the map.
struct CityComparison<'a> {
    cities: [City<'a>; 2],
    shapes: [BuildingShapes; 2],
    options: &'a ChangeOptions,
    attributes: ComparedAttributes,
}

impl CityComparison<'_> {
    /// The rows of a group: one for each building of the later city, or of the earlier one if all are demolished. Counts them.
    fn rows(
        &self,
        members: [&[(u32, u32)]; 2],
        overlap: f64,
        changes: &mut ChangeReport,
    ) -> Result<Vec<Record>, ExportError> {
        let [before, after] = members.map(|all| all.iter().map(|(_, index)| *index).collect::<Vec<u32>>());
        let (city, shown) = if after.is_empty() { (0, &before) } else { (1, &after) };
        // Once for all rows of the later city, of which there may be as many as buildings before them.
        let mut side_before = None;
        let counts = [&before, &after].map(Vec::len);
        let earlier_m = before.iter().map(|index| self.shapes[0].all[*index as usize].height_m()).fold(0.0, f64::max);
        let mut rows = Vec::new();
        for index in shown {
            let shape = &self.shapes[city].all[*index as usize];
            if !self.is_in_area(shape) {
                continue;
            }
            let (own, none): (&[u32], &[u32]) = (std::slice::from_ref(index), &[]);
            let others = self.other_attributes([&before, &after])?;
            let (change, what, sides) = match (before.is_empty(), after.is_empty()) {
                (true, _) => ("built", String::new(), [none, own]),
                (_, true) => ("demolished", String::new(), [own, none]),
                _ => {
                    let mut what = self.what_changed(counts, shape.height_m() - earlier_m, overlap, changes);
                    if !others.is_empty() {
                        what.push("attributes");
                        changes.attributes += 1;
                    }
                    let what = what.join(", ");
                    (if what.is_empty() { "unchanged" } else { "changed" }, what, [&before[..], own])
                }
            };
            let (number, is_listed) = match change {
                "built" => (&mut changes.built, true),
                "demolished" => (&mut changes.demolished, true),
                "changed" => (&mut changes.changed, true),
                _ => (&mut changes.unchanged, self.options.has_unchanged),
            };
            *number += 1;
            if !is_listed {
                continue;
            }
            let text = |text: &str| Some(Value::Text(text.to_owned())).filter(|_| !text.is_empty());
            let mut values = vec![text(change), text(&what), Some(rounded(shape.height_m()))];
            let known = match side_before.take().filter(|_| city == 1) {
                Some(known) => known,
                None => self.side(0, sides[0])?,
            };
            values.extend(known.iter().cloned());
            side_before = Some(known);
            values.extend(self.side(1, sides[1])?);
            values.push((overlap > 0.0).then(|| rounded(overlap)));
            values.push(text(&others.join("; ")));
            rows.push(self.record(city, shape, values));
        }
        Ok(rows)
    }

    /// What is another of a building than of those before it, in words: of so many in each city, it is `rise` higher than the highest.
    /// Counts it.
    fn what_changed(
        &self,
        [before, after]: [usize; 2],
        rise: f64,
        overlap: f64,
        changes: &mut ChangeReport,
    ) -> Vec<&'static str> {
        let step = NEARLY * self.options.height_step_m;
        let reasons = [
            (rise >= step, "higher", &mut changes.higher),
            (-rise >= step, "lower", &mut changes.lower),
            (overlap < self.options.same_footprint, "footprint", &mut changes.footprint),
            (after > 1, "split", &mut changes.split),
            (before > 1, "merged", &mut changes.merged),
        ];
        let mut words = Vec::new();
        for (is_so, word, number) in reasons {
            if is_so {
                words.push(word);
                *number += 1;
            }
        }
        words
    }

    /// What is another value of a building that is one before and after. Fails if a city cannot be read.
    fn other_attributes(&self, buildings: [&[u32]; 2]) -> Result<Vec<String>, ExportError> {
        let ([before], [after]) = (buildings[0], buildings[1]) else { return Ok(Vec::new()) };
        let number = |city: usize, index: u32| self.shapes[city].all[index as usize].object;
        self.attributes.others(&self.cities, [number(0, *before), number(1, *after)])
    }

    /// Number, identifiers, height of the highest, and area of the buildings of one city.
    fn side(&self, city: usize, buildings: &[u32]) -> Result<[Option<Value>; 4], ExportError> {
        let shapes: Vec<&BuildingShape> =
            buildings.iter().map(|index| &self.shapes[city].all[*index as usize]).collect();
        let mut names = Vec::new();
        for shape in shapes.iter().take(MAX_NAMES) {
            names.push(self.cities[city].identifier(shape.object)?);
        }
        names.retain(|name| !name.is_empty());
        names.sort();
        names.extend(shapes.len().checked_sub(MAX_NAMES).filter(|more| *more > 0).map(|more| format!("{more} more")));
        let number = match shapes[..] {
            [] => return Ok([None, None, None, None]),
            [only] => Some(Value::Integer(i64::from(only.object))),
            _ => None,
        };
        let height_m = shapes.iter().map(|shape| shape.height_m()).fold(0.0, f64::max);
        let area = shapes.iter().map(|shape| shape.area).sum::<f64>() * self.cities[1].grid.unit_area_m2();
        let names = Some(Value::Text(names.join("; "))).filter(|_| !names.is_empty());
        Ok([number, names, Some(rounded(height_m)), Some(rounded(area))])
    }

    fn record(&self, city: usize, shape: &BuildingShape, values: Vec<Option<Value>>) -> Record {
        Record {
            object: 0,
            identifier: String::new(),
            parent: None,
            kind: FeatureKind::Building,
            footprint: Some(self.shapes[city].footprint(shape, &self.cities[1].grid)),
            attributes: Vec::new(),
            added: values,
        }
    }

    /// Whether the middle of a building is in the area that is asked about.
    fn is_in_area(&self, shape: &BuildingShape) -> bool {
        let [low, high] = shape.bounds;
        let [x, y] = [0, 1].map(|k| ((i64::from(low[k]) + i64::from(high[k])) / 2) as i32);
        let middle = self.cities[1].grid.world(MapPoint::new(x, y));
        let is_in = |[_, [low, high]]: [[[f64; 2]; 2]; 2]| (0..2).all(|k| low[k] <= middle[k] && middle[k] <= high[k]);
        self.options.areas.is_none_or(is_in)
    }
}

/// Thousandths.
fn rounded(value: f64) -> Value {
    Value::Float((value * 1000.0).round() / 1000.0)
}

/// Names of attributes, with their indices in the schemas of two cities.
struct ComparedAttributes(Vec<(String, [Option<u32>; 2])>);

impl ComparedAttributes {
    /// Of names that one of the cities may not have.
    fn new(names: &[String], cities: &[City<'_>; 2]) -> Self {
        let index = |city: &City<'_>, name: &str| city.source.schema().index_of(name).map(|index| index as u32);
        Self(names.iter().map(|name| (name.clone(), [index(&cities[0], name), index(&cities[1], name)])).collect())
    }

    /// What is another value of two objects, as in `year: 1990 to 2001`. Fails if a city cannot be read.
    fn others(&self, cities: &[City<'_>; 2], objects: [u32; 2]) -> Result<Vec<String>, ExportError> {
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
    use crate::table::test_city::{BUILDING, COURT, HEDGE, HOUSE, ORIGIN, TestCity};
    use std::collections::BTreeMap;

    const OPTIONS: ChangeOptions = ChangeOptions {
        height_step_m: 1.0,
        same_footprint: 0.9,
        areas: None,
        has_unchanged: true,
        attributes: Vec::new(),
    };

    /// Of a city of meshes and one of columns, of which the first is moved to the east.
    fn compare(east_m: f64, options: &ChangeOptions) -> (ChangeReport, Vec<BTreeMap<String, String>>) {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("changes.csv");
        let (before, after) = (TestCity::new(true), TestCity::new(false));
        let on_map = |[x, y]: [f64; 2]| Some([x + east_m, y]);
        let formats = (Format::Csv, &Projections::default());
        let report = write_changes([&before, &after], &on_map, options, formats, &out).unwrap();
        let rows = csv::Reader::from_path(&out).unwrap().deserialize().collect::<Result<_, _>>().unwrap();
        (report, rows)
    }

    fn counts(report: &ChangeReport) -> [u64; 4] {
        [report.built, report.demolished, report.changed, report.unchanged]
    }

    #[test]
    fn buildings_stay_the_same_with_their_parts() {
        let (report, rows) = compare(0.0, &OPTIONS);
        assert_eq!((counts(&report), report.table.objects), ([0, 0, 0, 3], 3));
        let numbers = |name: &str| rows.iter().map(|row| row[name].clone()).collect::<Vec<_>>();
        let mut buildings = numbers("object_after");
        assert_eq!(numbers("object_before"), buildings);
        buildings.sort();
        assert_eq!(buildings, [HOUSE, BUILDING, COURT].map(|number| number.to_string()));
        let building = rows.iter().find(|row| row["identifier_after"] == "b-b").unwrap();
        let columns = ["change", "what", "height_m", "area_before_m2", "area_after_m2", "overlap"];
        assert_eq!(columns.map(|name| &building[name][..]), ["unchanged", "", "12", "128", "128", "1"]);
        let (_, rows) = compare(0.0, &ChangeOptions { has_unchanged: false, ..OPTIONS });
        assert!(rows.is_empty());
    }

    #[test]
    fn what_is_elsewhere_is_built_or_demolished() {
        let (report, rows) = compare(300.0, &OPTIONS);
        assert_eq!(counts(&report), [3, 3, 0, 0]);
        let demolished = rows.iter().find(|row| row["change"] == "demolished").unwrap();
        assert!(demolished["object_after"].is_empty() && !demolished["wkt"].is_empty(), "{demolished:?}");
        // A house moved by a metre has another footprint; the larger ones keep theirs.
        let (report, rows) = compare(1.0, &OPTIONS);
        assert_eq!((counts(&report), report.footprint), ([0, 0, 2, 1], 2), "{rows:?}");
        let [x, y, _] = ORIGIN;
        let area = [[x, y], [x + 20.0, y + 20.0]];
        let (report, _) = compare(300.0, &ChangeOptions { areas: Some([area; 2]), ..OPTIONS });
        assert_eq!(counts(&report), [1, 0, 0, 0]);
    }

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
