//! Proposals: files of what is added to a city and removed from it. Analyses and viewers read the same.

mod change;
mod document;
mod shapes;

pub use change::ProposedChange;
pub(crate) use document::document;
use insula_archive::file::read_text;
use insula_bake::read::named_paths;
use serde::Deserialize;
pub use shapes::{ProposedObject, ProposedObjects};
use std::path::{Path, PathBuf};

const MAX_BYTES: u64 = 1 << 20;
/// Most entries: each may name a file of its own, or the same large one.
const MAX_ENTRIES: usize = 1000;

/// Why a proposal cannot be used: the file, and what is wrong in it.
#[derive(Debug, thiserror::Error)]
#[error("--proposal {}: {reason}", path.display())]
pub struct ProposalError {
    path: PathBuf,
    reason: String,
}

/// A file of `--proposal`. Files that it names are beside it.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Proposal {
    #[serde(default)]
    title: String,
    #[serde(default)]
    add: Vec<AddTable>,
    #[serde(default)]
    remove: Vec<RemoveTable>,
    #[serde(skip)]
    path: PathBuf,
}

/// A model, or all above an outline up to a height.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct AddTable {
    /// A model that `bake` reads.
    file: Option<PathBuf>,
    /// Longitude and latitude of its origin, if it has no coordinates of its own.
    place: Option<Vec<f64>>,
    /// Clockwise from the file's north.
    #[serde(default)]
    heading_deg: f64,
    /// Polygons in a GeoJSON file, and the height above the base.
    outline: Option<PathBuf>,
    height_m: Option<f64>,
    /// Above sea level. By default the ground at the place, or the lowest ground along the outline.
    base_m: Option<f64>,
}

impl AddTable {
    /// Fails with what does not fit together.
    fn check(&self) -> Result<(), &'static str> {
        let Self { file, place, heading_deg, outline, height_m, base_m } = self;
        let is_height = |height: &f64| (0.1..=2000.0).contains(height);
        if base_m.is_some_and(|base| !(-1000.0..=10_000.0).contains(&base)) {
            return Err("base_m is metres above sea level, from -1000 to 10000");
        }
        if !(-360.0..=360.0).contains(heading_deg) {
            return Err("heading_deg is degrees clockwise from north, from -360 to 360");
        }
        match (file, outline) {
            (Some(_), None) if height_m.is_some() => Err("height_m is of an outline: a file has its own height"),
            (Some(_), None) if place.is_none() && (base_m.is_some() || *heading_deg != 0.0) => {
                Err("base_m and heading_deg of a file need its place: a file with coordinates stands where they say")
            }
            (Some(_), None) if place.as_ref().is_some_and(|place| place.len() != 2) => {
                Err("a place is [longitude, latitude]; base_m is the height above sea level")
            }
            (Some(_), None) => Ok(()),
            (None, Some(_)) if place.is_some() || *heading_deg != 0.0 => {
                Err("an outline has its place and direction: place and heading_deg are of a file")
            }
            (None, Some(_)) if height_m.as_ref().is_some_and(is_height) => Ok(()),
            (None, Some(_)) => Err("an outline needs height_m in metres, up to 2000"),
            _ => Err("an [[add]] has a file or an outline"),
        }
    }
}

/// Objects that are removed.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct RemoveTable {
    /// Identifiers of buildings.
    #[serde(default)]
    ids: Vec<String>,
    /// Buildings that pass a filter.
    filter: Option<String>,
    /// All that stands in the polygons of a GeoJSON file.
    polygon: Option<PathBuf>,
}

impl Proposal {
    /// Reads a file. Fails with what is wrong in it.
    pub fn read(path: &Path) -> Result<Self, ProposalError> {
        let wrong = |reason: String| ProposalError { path: path.to_owned(), reason };
        let text = read_text(path, MAX_BYTES).map_err(|error| wrong(error.to_string()))?;
        let mut proposal: Self = toml::from_str(&text).map_err(|error| wrong(error.to_string()))?;
        proposal.path = path.to_owned();
        if proposal.add.is_empty() && proposal.remove.is_empty() {
            return Err(wrong("it has neither an [[add]] nor a [[remove]]".to_owned()));
        }
        if proposal.add.len() + proposal.remove.len() > MAX_ENTRIES {
            return Err(wrong(format!(
                "it has more than {MAX_ENTRIES} entries: join outlines and models in fewer files"
            )));
        }
        for added in &proposal.add {
            added.check().map_err(|reason| wrong(reason.to_owned()))?;
        }
        if proposal.remove.iter().any(|r| r.ids.is_empty() && r.filter.is_none() && r.polygon.is_none()) {
            return Err(wrong("a [[remove]] has ids, a filter or a polygon".to_owned()));
        }
        Ok(proposal)
    }

    /// The files that it names, also by patterns.
    pub fn files(&self) -> Vec<PathBuf> {
        let added = self.add.iter().flat_map(|added| added.file.iter().chain(&added.outline));
        let named = added.chain(self.remove.iter().flat_map(|removed| &removed.polygon));
        named.flat_map(|file| named_paths(&self.beside(file))).collect()
    }

    /// Its title, or a word for it.
    pub fn name(&self) -> &str {
        if self.title.is_empty() { "proposal" } else { &self.title }
    }

    /// Whether it removes anything.
    pub fn removes(&self) -> bool {
        !self.remove.is_empty()
    }

    fn beside(&self, file: &Path) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(file)
    }

    fn wrong(&self, reason: &str) -> ProposalError {
        ProposalError { path: self.path.clone(), reason: reason.to_owned() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_beside_the_proposal_and_contradictions_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plan.toml");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            Proposal::read(&path).map_err(|error| error.to_string())
        };
        let text = "[[add]]\noutline = \"a.geojson\"\nheight_m = 9\n[[remove]]\npolygon = \"b.geojson\"\n";
        let proposal = read(text).unwrap();
        assert_eq!(proposal.files(), ["a.geojson", "b.geojson"].map(|name| folder.path().join(name)));
        assert!(proposal.removes());
        assert_eq!(proposal.name(), "proposal");
        std::fs::write(folder.path().join("a1.fgb"), "").unwrap();
        let pattern = read("[[add]]\nfile = \"*.fgb\"\n").unwrap();
        assert_eq!(pattern.files(), [folder.path().join("a1.fgb")], "an output must not replace it");
        let many = "[[add]]\nfile = \"a.obj\"\n".repeat(1001);
        assert!(read(&many).unwrap_err().contains("more than 1000 entries"));
        assert_eq!(read("title = \"Tower\"\n[[add]]\nfile = \"a.obj\"\n").unwrap().name(), "Tower");
        for (wrong, expected) in [
            ("title = \"x\"\n", "neither"),
            ("[[add]]\n", "a file or an outline"),
            ("[[add]]\nfile = \"a.obj\"\nheight_m = 3\n", "its own height"),
            ("[[remove]]\n", "ids, a filter or a polygon"),
            ("[[add]]\noutline = \"a.geojson\"\nheight_m = 9\nbase_m = 1e5\n", "above sea level"),
            ("[[add]]\noutline = \"a.geojson\"\nheight_m = 9\nbase_m = nan\n", "above sea level"),
            ("[[add]]\nfile = \"a.obj\"\nplace = [4, 52]\nheading_deg = inf\n", "clockwise"),
        ] {
            let error = read(wrong).unwrap_err();
            assert!(error.contains(expected) && error.contains("plan.toml"), "{error}");
        }
    }
}
