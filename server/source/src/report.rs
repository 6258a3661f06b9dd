//! Reports what was read, and what was skipped and why.

use super::attributes::{AttributeValue, Attributes};
pub use super::made::{FacadeReport, ProposalReport};
use super::object::FeatureKind;
use super::problems::{
    CONTRADICTION, EITHER_ORDER, FAR, GAP, GUESSED, GUESSED_FROM_LEVELS, GUESSES, INEXACT, LOSSES, MIRRORED, NO_CRS,
    NOT_UNDERSTOOD, OPEN_END, OUTSIDE, SWAPPED, TOO_MANY, TOO_WIDE, WIDE,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// More guessed heights than this share of all are worth a warning.
const MAX_GUESSED_SHARE: f64 = 0.05;
/// Further attributes are not named in it.
const MAX_NAMES: usize = 20;
/// Number of examples that are kept of each fault.
const EXAMPLES: usize = 5;
/// Longer texts of a source, such as identifiers, are cut in the report.
const MAX_TEXT_CHARS: usize = 300;
/// Most types of objects that are counted each; the rest is counted together.
const MAX_TYPES: usize = 1000;
/// Stands for all types past [`MAX_TYPES`].
const OTHER_TYPES: &str = "(other types)";
/// Stands for all attributes past [`MAX_TYPES`].
const OTHER_ATTRIBUTES: &str = "(other attributes)";

/// Kinds of problems of places, which are no reason for an empty city while there are others.
const PLACES: [&str; 6] = [INEXACT, NO_CRS, SWAPPED, MIRRORED, OUTSIDE, EITHER_ORDER];

fn is_worth_a_warning(guessed: u64, all: u64) -> bool {
    guessed as f64 > MAX_GUESSED_SHARE * all as f64
}

fn shorten(text: String) -> String {
    match text.char_indices().nth(MAX_TEXT_CHARS) {
        Some((end, _)) => text[..end].to_owned() + "...",
        None => text,
    }
}

/// Number of occurrences of a fault, with the first few examples.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct FaultCount {
    pub count: u64,
    /// Each an object's identifier or a line, with details.
    pub first: Vec<String>,
}

impl FaultCount {
    /// Counts an occurrence.
    pub fn add(&mut self, example: impl FnOnce() -> String) {
        self.count += 1;
        if self.first.len() < EXAMPLES {
            self.first.push(shorten(example()));
        }
    }

    /// The first examples, and how many there are besides.
    fn named(&self) -> String {
        let (first, more) = (self.first.join(", "), self.count.saturating_sub(self.first.len() as u64));
        if more > 0 { format!("{first} and {more} more") } else { first }
    }
}

/// How often an attribute has a value, of which types, and its first different values.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct AttributeCount {
    pub count: u64,
    /// Number of values by type: `text`, `integer`, `float`, `bool`, `date`.
    pub types: BTreeMap<String, u64>,
    pub examples: Vec<String>,
}

impl AttributeCount {
    /// Whether the values are numbers, as far as they are known.
    fn is_numeric(&self) -> bool {
        let is_number = |text: &String| text.trim().replace(',', ".").parse::<f64>().is_ok();
        let numbers = ["integer", "float"].into_iter().filter_map(|name| self.types.get(name)).sum::<u64>();
        numbers * 2 > self.count || self.types.contains_key("text") && self.examples.iter().all(is_number)
    }

    fn add(&mut self, value: &AttributeValue) {
        self.count += 1;
        let name = match value {
            AttributeValue::Text(_) => "text",
            AttributeValue::Integer(_) => "integer",
            AttributeValue::Float(_) => "float",
            AttributeValue::Bool(_) => "bool",
            AttributeValue::Date { .. } => "date",
        };
        match self.types.get_mut(name) {
            Some(count) => *count += 1,
            None => drop(self.types.insert(name.to_owned(), 1)),
        }
        if self.examples.len() < EXAMPLES {
            let text = shorten(value.to_string());
            if !self.examples.contains(&text) {
                self.examples.push(text);
            }
        }
    }
}

/// File format of a source.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum SourceFormat {
    /// One JSON document.
    #[default]
    CityJson,
    /// A header line, then one feature per line.
    CityJsonSeq,
    /// Footprints with heights: one JSON document, or one feature per line.
    GeoJson,
    /// Wavefront OBJ with MTL.
    Obj,
    CityGml,
    FlatGeobuf,
    GeoPackage,
    Shapefile,
    GeoParquet,
    /// Lines of values, one of them WKT.
    Csv,
    OpenStreetMap,
    Gltf,
    /// A tileset or a single tile.
    Tiles3d,
    I3s,
    Ply,
    Stl,
    Off,
    /// Heights of the ground: GeoTIFF, SRTM or an ASCII grid.
    Elevation,
}

/// Where a surface's colour comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColourOrigin {
    Source,
    /// The source, changed to that of a material.
    Harmonised,
    Palette,
    Texture,
}

/// Number of surfaces by where their colour comes from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ColourCounts {
    /// As in the source.
    pub source: u64,
    /// Those of the source that no material has, changed to that of a material.
    pub harmonised: u64,
    /// Of the palette: the source has none, or plain white.
    pub palette: u64,
    pub textured: u64,
}

impl ColourCounts {
    /// Counts a surface.
    pub fn add(&mut self, origin: ColourOrigin) {
        *match origin {
            ColourOrigin::Source => &mut self.source,
            ColourOrigin::Harmonised => &mut self.harmonised,
            ColourOrigin::Palette => &mut self.palette,
            ColourOrigin::Texture => &mut self.textured,
        } += 1;
    }
}

/// What was read from one source.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SourceReport {
    /// Path as it was given or found.
    pub path: String,
    pub format: SourceFormat,
    /// Size of the file, compressed if the file is.
    pub bytes: u64,
    /// Objects that the source has: CityJSON objects, features, OBJ objects or groups, else the connected parts of an
    /// OBJ. Lines of a source of one object per line count even if they cannot be read.
    pub found: u64,
    /// Objects of the city: with at least one triangle.
    pub objects: u64,
    /// Objects by their kind, as far as the kind is wanted.
    pub objects_by_kind: BTreeMap<FeatureKind, u64>,
    /// Objects by their level of detail, if the source has levels.
    pub objects_by_level: BTreeMap<String, u64>,
    /// Objects of kinds that are not wanted.
    pub left_out_by_kind: u64,
    /// Objects outside of the wanted area.
    pub outside_bbox: u64,
    /// Objects that another source or this one has already.
    pub duplicates: FaultCount,
    /// Attributes by name. Names past the first thousand are counted together.
    pub attributes: BTreeMap<String, AttributeCount>,
    /// All objects by the source's own type, including those without geometry.
    pub objects_by_type: BTreeMap<String, u64>,
    /// Objects left out because a part or the parent has a better level of detail.
    pub coarser_left_out: u64,
    /// Objects that are painted on the terrain.
    pub painted: u64,
    /// Buildings that were made of their plan and a height.
    pub footprints: u64,
    /// Buildings under which the terrain was changed to meet them.
    pub terrain_fitted: u64,
    /// Objects that only group others or have attributes.
    pub without_geometry: u64,
    /// Objects that became part of another one, by reason.
    pub merged: BTreeMap<String, FaultCount>,
    /// Skipped objects by reason.
    pub skipped: BTreeMap<String, FaultCount>,
    /// Faults that cost only a polygon or a texture of an object, by kind.
    pub problems: BTreeMap<String, FaultCount>,
    pub triangles: u64,
    /// The part of `triangles` that is terrain.
    pub terrain_triangles: u64,
    /// Number of images decoded for this source.
    pub textures: u64,
    /// Factor of the textures' linear light, common to the sources of a folder; 1 if they are not changed.
    pub texture_gain: f64,
    /// Surfaces by where their colour comes from.
    pub colours: ColourCounts,
    /// Coordinate system such as `EPSG:7415`.
    pub crs: Option<String>,
    pub titles: Vec<String>,
    /// People, organisations and origins in the metadata.
    pub attributions: Vec<String>,
    pub licences: Vec<String>,
}

impl SourceReport {
    /// An empty report of a source.
    pub fn new(path: &str, format: SourceFormat, bytes: u64) -> Self {
        Self { path: path.to_owned(), format, bytes, texture_gain: 1.0, ..Self::default() }
    }

    /// Objects found minus those whose fate is known: 0 unless a reader has lost some.
    #[must_use]
    pub fn unaccounted(&self) -> i64 {
        let counted = |faults: &BTreeMap<String, FaultCount>| faults.values().map(|fault| fault.count).sum::<u64>();
        let left_out = self.left_out_by_kind + self.outside_bbox + self.duplicates.count;
        let known = self.objects + self.painted + self.coarser_left_out + self.without_geometry + left_out;
        self.found as i64 - (known + counted(&self.merged) + counted(&self.skipped)) as i64
    }

    /// Number of heights of buildings of which nothing was known.
    fn guessed(&self) -> u64 {
        self.problems.get(GUESSED).map_or(0, |fault| fault.count)
    }

    /// A warning if more than a few heights of buildings were guessed, with the attributes that may have them.
    fn guessed_heights(&self) -> Option<String> {
        let guessed = self.guessed();
        let by_levels = self.problems.get(GUESSED_FROM_LEVELS).map_or(0, |fault| fault.count);
        if !is_worth_a_warning(guessed, self.footprints) {
            return None;
        }
        let numeric = self.attributes.iter().filter(|(_, count)| count.is_numeric());
        let mut names: Vec<&str> = numeric.map(|(name, _)| name.as_str()).collect();
        let more = names.len().saturating_sub(MAX_NAMES);
        names.truncate(MAX_NAMES);
        let of_levels = if by_levels > 0 { format!(", {by_levels} more from storeys") } else { String::new() };
        let found = match (names.is_empty(), more) {
            (true, _) => "no attribute has numbers".to_owned(),
            (false, 0) => format!("attributes with numbers: {}", names.join(", ")),
            (false, more) => format!("attributes with numbers: {} and {more} more", names.join(", ")),
        };
        // Of the first guess, and of the first value that led to one.
        let first = |kind: &str| self.problems.get(kind).and_then(|fault| fault.first.first());
        let guess = first(GUESSED).map_or(String::new(), |guess| format!(", such as {guess}"));
        let odd = first(NOT_UNDERSTOOD).map_or(String::new(), |value| format!("{NOT_UNDERSTOOD}, such as {value}; "));
        Some(format!(
            "{}: {guessed} of {} heights of buildings are guessed{guess}{of_levels}; {odd}{found}; name the one that has \
             the heights with --height-field",
            self.path, self.footprints
        ))
    }

    /// Counts an object that became a part of another.
    pub fn merge(&mut self, reason: &str, example: impl FnOnce() -> String) {
        count_fault(&mut self.merged, reason, example);
    }

    /// Counts an object that is left out.
    pub fn skip(&mut self, reason: &str, example: impl FnOnce() -> String) {
        count_fault(&mut self.skipped, reason, example);
    }

    /// Counts the attributes of an object.
    pub fn count_attributes(&mut self, attributes: &Attributes) {
        for (name, value) in attributes.iter() {
            if let Some(count) = self.attributes.get_mut(name) {
                count.add(value);
            } else {
                let is_full = self.attributes.len() >= MAX_TYPES;
                let name = if is_full { OTHER_ATTRIBUTES } else { name };
                self.attributes.entry(name.to_owned()).or_default().add(value);
            }
        }
    }

    /// Counts a fault that costs a part of an object.
    pub fn problem(&mut self, kind: &str, example: impl FnOnce() -> String) {
        count_fault(&mut self.problems, kind, example);
    }

    /// Counts an object of a type in the words of the source.
    pub fn count_type(&mut self, object_type: &str) {
        if let Some(count) = self.objects_by_type.get_mut(object_type) {
            *count += 1;
            return;
        }
        let is_full = self.objects_by_type.len() >= MAX_TYPES;
        let name = if is_full { OTHER_TYPES.to_owned() } else { shorten(object_type.to_owned()) };
        *self.objects_by_type.entry(name).or_default() += 1;
    }
}

fn counted(objects: u64) -> String {
    if objects == 1 { "1 object is".to_owned() } else { format!("{objects} objects are") }
}

fn count_fault(map: &mut BTreeMap<String, FaultCount>, key: &str, example: impl FnOnce() -> String) {
    match map.get_mut(key) {
        Some(fault) => fault.add(example),
        None => map.entry(key.to_owned()).or_default().add(example),
    }
}

/// An input that is left out of the city.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct BadInput {
    /// As it was given or found.
    pub path: String,
    /// What is wrong with it, and what to do.
    pub reason: String,
}

/// What was read from all sources.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ReadReport {
    /// In reading order.
    pub sources: Vec<SourceReport>,
    /// Files of a given folder that have a city file's name but other content.
    pub ignored: Vec<String>,
    /// Inputs that are left out. Empty unless `ReadOptions::skip_bad_inputs` is set: they are errors otherwise.
    pub bad_inputs: Vec<BadInput>,
    pub objects: u64,
    pub triangles: u64,
    /// Coordinate system of the city.
    pub crs: Option<String>,
    /// Datum of the city's heights, if a source or a conversion tells it.
    pub vertical_datum: Option<String>,
    /// Geoid by which heights above the ellipsoid became heights above it; `None` if none were converted.
    pub geoid: Option<String>,
    /// Files in folders and archives whose format is known and not read, one line for each format.
    pub unread: Vec<String>,
    /// Generated facades; `None` without.
    pub facades: Option<FacadeReport>,
    /// Stones of landmarks: the JSON text of the parameters of each.
    pub stones: Vec<String>,
    /// What a proposal changed; `None` without one.
    pub proposal: Option<ProposalReport>,
}

impl ReadReport {
    /// Why places are less exact than they could be, each reason once.
    pub fn placing_warnings(&self) -> impl Iterator<Item = &str> {
        let faults = self.sources.iter().filter_map(|source| source.problems.get(INEXACT));
        let all: std::collections::BTreeSet<&str> =
            faults.flat_map(|fault| fault.first.iter().map(String::as_str)).collect();
        all.into_iter()
    }

    /// Whether an object that was read has an attribute whose name is meant, or may have one.
    pub fn may_have_attribute(&self, is_meant: impl Fn(&str) -> bool) -> bool {
        let mut names = self.sources.iter().flat_map(|source| source.attributes.keys());
        names.any(|name| name == OTHER_ATTRIBUTES || is_meant(name))
    }

    /// All warnings for the user: what was guessed, what lies far from the rest, and what is lost as a whole.
    pub fn warnings(&self) -> impl Iterator<Item = String> {
        let of_objects = self.far_warnings().chain(self.wide_warnings()).chain(self.coast_warnings());
        of_objects.chain(self.guess_warnings()).chain(self.problems_of(LOSSES))
    }

    /// Which objects lie far from the city, of each source with such, what is baked, and what to do.
    fn far_warnings(&self) -> impl Iterator<Item = String> {
        self.sources.iter().filter_map(|source| {
            let far = source.skipped.get(FAR)?;
            let (objects, baked) = (counted(far.count), counted(self.objects));
            let advice = "check the coordinates, or bake each place as a city of its own";
            Some(format!("{}: {objects} {FAR}, left out: {}; {baked} baked; {advice}", source.path, far.named()))
        })
    }

    /// Which few objects make the city wide, of each source with such, and what to do.
    fn wide_warnings(&self) -> impl Iterator<Item = String> {
        self.sources.iter().filter_map(|source| {
            let wide = source.problems.get(WIDE)?;
            let advice = "remove them from the source, or leave them out with --bbox";
            Some(format!("{}: {WIDE}: {}; {advice}", source.path, wide.named()))
        })
    }

    /// Where coastlines were guessed, or why there is no sea, of each source with such.
    pub fn coast_warnings(&self) -> impl Iterator<Item = String> {
        self.problems_of(&[GAP, OPEN_END, CONTRADICTION, TOO_WIDE, TOO_MANY])
    }

    /// What was guessed of heights and places, of each source with such.
    pub fn guess_warnings(&self) -> impl Iterator<Item = String> {
        self.problems_of(GUESSES).chain(self.sources.iter().filter_map(SourceReport::guessed_heights))
    }

    /// A line for each problem of some kinds in each source, also of what is left out.
    fn problems_of(&self, kinds: &'static [&'static str]) -> impl Iterator<Item = String> {
        self.sources.iter().flat_map(move |source| {
            kinds.iter().filter_map(move |kind| {
                let found = source.problems.get(*kind).or_else(|| source.skipped.get(*kind))?;
                Some(format!("{}: {kind}: {}", source.path, found.named()))
            })
        })
    }

    /// Number of heights of buildings that were guessed, and of all that were made of a plan; `None` if few were guessed.
    #[must_use]
    pub fn guessed_heights(&self) -> Option<[u64; 2]> {
        let guessed = self.sources.iter().map(SourceReport::guessed).sum();
        let all = self.sources.iter().map(|source| source.footprints).sum();
        is_worth_a_warning(guessed, all).then_some([guessed, all])
    }

    /// Number of duplicates left out in all sources.
    #[must_use]
    pub fn duplicates(&self) -> u64 {
        self.sources.iter().map(|source| source.duplicates.count).sum()
    }

    /// Number of objects skipped in all sources.
    #[must_use]
    pub fn skipped(&self) -> u64 {
        self.sources.iter().flat_map(|source| source.skipped.values()).map(|fault| fault.count).sum()
    }

    /// Number of objects that became part of another one in all sources.
    #[must_use]
    pub fn merged(&self) -> u64 {
        self.sources.iter().flat_map(|source| source.merged.values()).map(|fault| fault.count).sum()
    }

    /// The most frequent fault, with its first example: of what is left out, else of parts, else of places.
    pub fn main_reason(&self) -> Option<String> {
        let rank = |kind: &String| u8::from(!PLACES.contains(&kind.as_str()));
        let skipped = self.sources.iter().flat_map(|source| &source.skipped).map(|(kind, fault)| (2, kind, fault));
        let problems = self.sources.iter().flat_map(|source| &source.problems);
        let all = skipped.chain(problems.map(|(kind, fault)| (rank(kind), kind, fault)));
        let (_, reason, fault) = all.max_by_key(|(rank, _, fault)| (*rank, fault.count))?;
        let example = fault.first.first().map(|first| format!(", first {first}")).unwrap_or_default();
        Some(format!("{} times {reason}{example}", fault.count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problems::{DAMAGED_ATTRIBUTES, TILE_UNREADABLE};

    #[test]
    fn texts_and_types_of_a_hostile_source_stay_few_and_short() {
        let mut report = SourceReport::new("a", SourceFormat::Obj, 1);
        report.skip("broken", || "x".repeat(1 << 20));
        assert_eq!(report.skipped["broken"].first[0].len(), MAX_TEXT_CHARS + 3);
        (0..2000).for_each(|i| report.count_type(&format!("{i} {}", "y".repeat(1000))));
        assert_eq!((report.objects_by_type.len(), report.objects_by_type[OTHER_TYPES]), (MAX_TYPES + 1, 1000));
        assert!(report.objects_by_type.keys().all(|name| name.len() <= MAX_TEXT_CHARS + 3));
    }

    #[test]
    fn the_main_reason_is_what_is_left_out() {
        let mut report = SourceReport::new("a", SourceFormat::GeoJson, 1);
        (0..3).for_each(|_| report.problem(EITHER_ORDER, || "x".to_owned()));
        let reason = |report: &SourceReport| {
            ReadReport { sources: vec![report.clone()], ..ReadReport::default() }.main_reason().unwrap()
        };
        assert!(reason(&report).starts_with("3 times order"));
        report.problem("polygon without area", || "y".to_owned());
        assert_eq!(reason(&report), "1 times polygon without area, first y");
        (0..2).for_each(|_| report.skip("no geometry", || "z".to_owned()));
        assert_eq!(reason(&report), "2 times no geometry, first z");
        // What is far is told with what is baked.
        report.skip(FAR, || "tokyo: 9000 km away".to_owned());
        let read = ReadReport { sources: vec![report], objects: 1, ..ReadReport::default() };
        let warnings: Vec<String> = read.warnings().collect();
        let expected = "a: 1 object is far from the city, left out: tokyo: 9000 km away; 1 object is baked; check the coordinates, \
            or bake each place as a city of its own";
        assert_eq!(warnings, [expected]);
    }

    #[test]
    fn a_table_that_is_lost_is_a_warning() {
        let mut report = SourceReport::new("a.shp", SourceFormat::Shapefile, 1);
        report.problem(DAMAGED_ATTRIBUTES, || "a.dbf: the file ends within its header".to_owned());
        report.skip(TILE_UNREADABLE, || "b.glb: not found".to_owned());
        let read = ReadReport { sources: vec![report], ..ReadReport::default() };
        let expected =
            ["damaged attributes: a.dbf: the file ends within its header", "tile cannot be read: b.glb: not found"];
        assert_eq!(read.warnings().collect::<Vec<_>>(), expected.map(|text| format!("a.shp: {text}")));
    }

    #[test]
    fn guessed_heights_are_told_with_the_attributes_that_have_numbers() {
        let mut report = SourceReport::new("a", SourceFormat::GeoJson, 1);
        report.footprints = 100;
        let mut attributes = Attributes::default();
        attributes.push("NUT_H", AttributeValue::Float(4.5));
        attributes.push("nombre", AttributeValue::Text("x".to_owned()));
        attributes.push("text_h", AttributeValue::Text("12,5".to_owned()));
        report.count_attributes(&attributes);
        (0..5).for_each(|_| report.problem(GUESSED, || "b: 6 m".to_owned()));
        assert_eq!(report.guessed_heights(), None);
        report.problem(GUESSED, || "b: 6 m".to_owned());
        report.problem(NOT_UNDERSTOOD, || "b: height is tall".to_owned());
        report.problem(GUESSED_FROM_LEVELS, || "b".to_owned());
        let report = ReadReport { sources: vec![report], ..ReadReport::default() };
        let warnings: Vec<String> = report.guess_warnings().collect();
        let expected = "a: 6 of 100 heights of buildings are guessed, such as b: 6 m, 1 more from storeys; \
            height not understood, such as b: height is tall; attributes with numbers: NUT_H, text_h; name the one that has the heights with --height-field";
        assert_eq!(warnings, [expected]);
    }

    #[test]
    fn fault_count_keeps_the_first_examples() {
        let mut report = SourceReport::new("a", SourceFormat::Obj, 1);
        for i in 0..9 {
            report.skip("broken", || format!("object {i}"));
        }
        let fault = &report.skipped["broken"];
        assert_eq!(fault.count, 9);
        assert_eq!(fault.first.len(), EXAMPLES);
        assert_eq!(fault.first[0], "object 0");
        let json = serde_json::to_value(ReadReport { sources: vec![report], ..ReadReport::default() }).unwrap();
        assert_eq!(json["sources"][0]["skipped"]["broken"]["count"], 9);
        assert_eq!(json["sources"][0]["format"], "Obj");
    }
}
