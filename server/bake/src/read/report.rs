//! What was read, and what was not and why.
//!
//! In: counts from the readers. Out: [`ReadReport`], serialisable. Next: the bake's report and the manifest's attribution.

use std::collections::BTreeMap;

use serde::Serialize;

/// How many examples of a fault are kept.
const EXAMPLES: usize = 5;

/// How often something happened, with the first few places.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct FaultCount {
    /// How often.
    pub count: u64,
    /// The first few: an object's identifier or a line, with the detail.
    pub first: Vec<String>,
}

impl FaultCount {
    pub(crate) fn add(&mut self, example: impl FnOnce() -> String) {
        self.count += 1;
        if self.first.len() < EXAMPLES {
            self.first.push(example());
        }
    }
}

/// A source's format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum SourceFormat {
    /// One JSON document.
    CityJson,
    /// A header line and a feature on each following line.
    CityJsonSeq,
    /// Footprints with heights: one JSON document, or a feature on each line.
    GeoJson,
    /// Wavefront OBJ with MTL.
    Obj,
}

/// What one source gave.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct SourceReport {
    /// The path as it was given or found.
    pub path: String,
    /// What it was read as.
    pub format: SourceFormat,
    /// Size of the file, compressed if it is.
    pub bytes: u64,
    /// Objects with at least one triangle.
    pub objects: u64,
    /// All objects met, by the source's own type, those without geometry included.
    pub objects_by_type: BTreeMap<String, u64>,
    /// Objects whose geometry was left out because a part or the whole has a better level of detail.
    pub coarser_left_out: u64,
    /// Objects that were skipped, by reason.
    pub skipped: BTreeMap<String, FaultCount>,
    /// Lesser faults, by kind: the object was kept without the polygon or the texture concerned.
    pub problems: BTreeMap<String, FaultCount>,
    /// Triangles read.
    pub triangles: u64,
    /// Those of them that are terrain.
    pub terrain_triangles: u64,
    /// Pictures decoded for this source.
    pub textures: u64,
    /// Its coordinate system, such as `EPSG:7415`.
    pub crs: Option<String>,
    /// Titles in its metadata.
    pub titles: Vec<String>,
    /// People, bodies and origins named in its metadata.
    pub attributions: Vec<String>,
    /// Licences named in its metadata.
    pub licences: Vec<String>,
}

impl SourceReport {
    pub(crate) fn new(path: &str, format: SourceFormat, bytes: u64) -> Self {
        Self {
            path: path.to_owned(),
            format,
            bytes,
            objects: 0,
            objects_by_type: BTreeMap::new(),
            coarser_left_out: 0,
            skipped: BTreeMap::new(),
            problems: BTreeMap::new(),
            triangles: 0,
            terrain_triangles: 0,
            textures: 0,
            crs: None,
            titles: Vec::new(),
            attributions: Vec::new(),
            licences: Vec::new(),
        }
    }

    pub(crate) fn skip(&mut self, reason: &str, example: impl FnOnce() -> String) {
        tally(&mut self.skipped, reason, example);
    }

    pub(crate) fn problem(&mut self, kind: &str, example: impl FnOnce() -> String) {
        tally(&mut self.problems, kind, example);
    }

    pub(crate) fn count_type(&mut self, object_type: &str) {
        match self.objects_by_type.get_mut(object_type) {
            Some(count) => *count += 1,
            None => {
                self.objects_by_type.insert(object_type.to_owned(), 1);
            }
        }
    }
}

fn tally(map: &mut BTreeMap<String, FaultCount>, key: &str, example: impl FnOnce() -> String) {
    match map.get_mut(key) {
        Some(tally) => tally.add(example),
        None => map.entry(key.to_owned()).or_default().add(example),
    }
}

/// What all sources gave.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct ReadReport {
    /// In the order of reading.
    pub sources: Vec<SourceReport>,
    /// Files of a given folder that look like city files by name and are not.
    pub ignored: Vec<String>,
    /// Objects in the scene.
    pub objects: u64,
    /// Triangles in the scene.
    pub triangles: u64,
    /// The common coordinate system.
    pub crs: Option<String>,
}

impl ReadReport {
    /// Objects skipped in all sources.
    #[must_use]
    pub fn skipped(&self) -> u64 {
        self.sources.iter().flat_map(|source| source.skipped.values()).map(|tally| tally.count).sum()
    }

    /// The most frequent reason for skipping, with its first example.
    pub(crate) fn main_reason(&self) -> Option<String> {
        let all = self.sources.iter().flat_map(|source| source.skipped.iter().chain(source.problems.iter()));
        let (reason, tally) = all.max_by_key(|(_, tally)| tally.count)?;
        let example = tally.first.first().map(|first| format!(", first {first}")).unwrap_or_default();
        Some(format!("{} times {reason}{example}", tally.count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tally_counts_all_and_shows_the_first_few() {
        let mut report = SourceReport::new("a", SourceFormat::Obj, 1);
        for i in 0..9 {
            report.skip("broken", || format!("object {i}"));
        }
        let tally = &report.skipped["broken"];
        assert_eq!(tally.count, 9);
        assert_eq!(tally.first.len(), EXAMPLES);
        assert_eq!(tally.first[0], "object 0");
        let json = serde_json::to_value(ReadReport { sources: vec![report], ..ReadReport::default() }).unwrap();
        assert_eq!(json["sources"][0]["skipped"]["broken"]["count"], 9);
        assert_eq!(json["sources"][0]["format"], "Obj");
    }
}
