//! The manifest of a city (`city.json`): what a client needs before its first tile.

use crate::name::is_name;
use crate::release::{Release, SharedCity};
use crate::sea::SeaEnds;
use crate::text::count;
use serde::{Deserialize, Serialize};

/// Version of the manifest and of the city folder's layout.
pub const FORMAT_VERSION: u32 = 1;

/// Longest text of a manifest in bytes: title, coordinate system, and each text of an attribution.
pub const MAX_TEXT_BYTES: usize = 4096;
/// Most attributions.
pub const MAX_ATTRIBUTIONS: usize = 256;
/// Most stones of a city.
pub const MAX_STONES: usize = 16;
/// Most bytes of all texts together, so that a manifest stays below a megabyte however its characters are escaped.
pub const MAX_ALL_TEXT_BYTES: usize = 128 << 10;

/// A baked city. JSON on disk and over HTTP, or bincode over HTTP for `Accept: application/x-bincode`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// [`FORMAT_VERSION`].
    pub format_version: u32,
    /// Name in URLs and of the folder; see [`is_name`].
    pub name: String,
    /// Name for people.
    pub title: String,
    /// Hash of the content, 16 hexadecimal digits; the `{version}` of URLs.
    pub version: String,
    /// For example `EPSG:7415`; `None` for local metres.
    pub crs: Option<String>,
    /// South-west corner of the root's area, and the height to which nodes' heights are relative; world metres.
    pub origin: [f64; 3],
    /// Side of the root in metres: `node_cells * cell_m * 2^depth`.
    pub root_side_m: f64,
    /// Level of the leaves.
    pub depth: u8,
    /// Columns along a node's side.
    pub node_cells: u16,
    /// Side of a leaf's column in metres.
    pub cell_m: f64,
    /// World bounds of the city in metres, `[min, max]`.
    pub bounds: [[f64; 3]; 2],
    /// World x and y of the part where most of the city stands, `[min, max]`, in metres: the initial view. A tenth of
    /// the bytes of the leaves in which something stands lies beyond each side.
    pub focus: [[f64; 2]; 2],
    /// World height in metres of the ground plane that clients draw where there is no column.
    pub ground_z_m: f64,
    /// Whether the source has terrain. If so, the ground plane is rarely visible.
    pub has_terrain: bool,
    /// Whether the bake generated ground where the source has none. Older manifests do not have the field.
    #[serde(default)]
    pub generated_ground: bool,
    pub counts: CityCounts,
    /// Sources that must be named wherever the city is shown.
    pub attribution: Vec<Attribution>,
    pub tile_version: u16,
    /// Hash of the bake's settings. A bake with other settings is not resumed.
    pub settings: String,
    /// Where the middle of its focus lies on Earth, if the bake knows the coordinate system.
    #[serde(default)]
    pub location: Option<GeoLocation>,
    /// Whether windows are generated, on walls of which the source has no picture. Older manifests do not have the field if it
    /// is false.
    #[serde(default)]
    pub generated_facades: bool,
    /// What heights are measured from, if the bake knows it. Older manifests do not have the field if it does not.
    #[serde(default)]
    pub heights: Option<HeightReference>,
    /// Stones of landmarks, which mesh tiles refer to by index; at most [`MAX_STONES`]. Each is the JSON text of its parameters.
    /// Older manifests do not have the field if there are none.
    #[serde(default)]
    pub stones: Vec<String>,
    /// Whether the city has visibility tiles. Older manifests do not have the field.
    #[serde(default)]
    pub street_sets: bool,
    /// By what its other files are known as those of its bake; `None` in older manifests, whose files may have no marks.
    #[serde(default)]
    pub marks: Option<CityMarks>,
    /// Where the city ends in the sea, if the sources tell the sea from other water. Older manifests do not have the field.
    #[serde(default)]
    pub sea: Option<SeaEnds>,
    /// Of which day the city is, and with which earlier ones it shares tiles. Older manifests do not have the field.
    #[serde(default)]
    pub release: Option<Release>,
}

/// What tells the files of a city from those of other bakes. Each archive has the mark of the version besides.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct CityMarks {
    /// Checksum of the search index; `None` if the city has none.
    pub search_index: Option<u32>,
}

/// What the heights of a city are measured from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct HeightReference {
    /// Vertical datum, such as `EPSG:5709`.
    pub datum: String,
    /// Model of the geoid by which heights above the ellipsoid were converted; `None` if none were.
    pub geoid: Option<String>,
}

/// A place on Earth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GeoLocation {
    /// North, -90 to 90.
    pub latitude_deg: f64,
    /// East, -180 to 180.
    pub longitude_deg: f64,
    /// From the grid's north to true north, clockwise.
    pub north_deg: f64,
}

impl GeoLocation {
    fn is_on_earth(&self) -> bool {
        // Comparisons with NaN are false.
        self.latitude_deg.abs() <= 90.0 && self.longitude_deg.abs() <= 180.0 && self.north_deg.abs() <= 360.0
    }
}

/// Sizes of a city.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct CityCounts {
    /// City objects of the sources, of which a building may have several: see `buildings`.
    pub objects: u64,
    pub triangles: u64,
    /// Number of nodes per level, root first.
    pub nodes_per_level: Vec<u64>,
    /// Bytes of V-BlockMap tiles per level, root first.
    pub bytes_per_level: Vec<u64>,
    /// Buildings, each once with all its parts. Older manifests do not have the field.
    #[serde(default)]
    pub buildings: Option<u64>,
}

impl CityCounts {
    /// The size of the city in words: `1116 buildings`, or `3 objects` of a city without buildings. All programs and pages say it in
    /// these words, so that a city has one number.
    pub fn words(&self) -> String {
        match self.buildings {
            Some(buildings) if buildings > 0 => count(buildings, "building"),
            _ => count(self.objects, "object"),
        }
    }
}

/// Before the licence in a line of sources.
const LICENCE_MARK: &str = ", licence: ";
/// Between the sources of a line.
const SOURCE_MARK: &str = "; ";

/// A source that must be named.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Attribution {
    /// The name that the source asks for.
    pub text: String,
    /// For example `CC BY 4.0`.
    pub licence: Option<String>,
    pub url: Option<String>,
}

impl Attribution {
    /// All texts.
    pub fn texts(&self) -> impl Iterator<Item = &String> + Clone {
        std::iter::once(&self.text).chain(&self.licence).chain(&self.url)
    }

    /// Sources as one line, for files that have one text of them. [`Self::of_line`] gives them back.
    pub fn line(all: &[Self]) -> String {
        let line = |source: &Self| {
            let licence = source.licence.iter().map(|licence| format!("{LICENCE_MARK}{licence}"));
            let url = source.url.iter().map(|url| format!(", {url}"));
            let line = std::iter::once(source.text.clone()).chain(licence).chain(url).collect::<String>();
            line.split_whitespace().collect::<Vec<_>>().join(" ")
        };
        all.iter().map(line).collect::<Vec<_>>().join(SOURCE_MARK)
    }

    /// The sources that a line of [`Self::line`] has. Any other text is the name of one source.
    pub fn of_line(text: &str) -> Vec<Self> {
        let all: Vec<Self> = text.split(SOURCE_MARK).map(Self::of_part).filter(|one| !one.text.is_empty()).collect();
        match all.iter().any(Self::is_told) {
            true => all,
            false => vec![Self { text: text.trim().to_owned(), licence: None, url: None }],
        }
    }

    fn of_part(part: &str) -> Self {
        let is_url = |text: &str| {
            (text.starts_with("https://") || text.starts_with("http://")) && !text.contains(char::is_whitespace)
        };
        let (rest, url) = match part.trim().rsplit_once(", ") {
            Some((rest, url)) if is_url(url) => (rest, Some(url)),
            _ => (part.trim(), None),
        };
        let (text, licence) = rest.rsplit_once(LICENCE_MARK).map_or((rest, None), |(text, known)| (text, Some(known)));
        Self { text: text.to_owned(), licence: licence.map(str::to_owned), url: url.map(str::to_owned) }
    }

    /// Whether more than the name is known.
    pub fn is_told(&self) -> bool {
        self.licence.is_some() || self.url.is_some()
    }

    /// Adds the source to others, unless one of them says as much; one that says less is replaced. Returns whether there is something new.
    pub fn add_to(self, all: &mut Vec<Self>) -> bool {
        if all.iter().any(|known| self.is_said_by(known)) {
            return false;
        }
        match all.iter_mut().find(|known| known.is_said_by(&self)) {
            Some(known) => *known = self,
            None => all.push(self),
        }
        true
    }

    /// Whether another source has the same name, and as much of the rest.
    pub fn is_said_by(&self, other: &Self) -> bool {
        self.text.eq_ignore_ascii_case(&other.text)
            && (self.licence.is_none() || self.licence == other.licence)
            && (self.url.is_none() || self.url == other.url)
    }
}

impl Manifest {
    /// Checks a manifest from an untrusted source. Fails with the first rule that it breaks.
    pub fn check(&self) -> Result<(), String> {
        if self.format_version != FORMAT_VERSION {
            let found = self.format_version;
            return Err(format!("city format {found}, this program reads {FORMAT_VERSION}: bake again, or update"));
        }
        if usize::from(self.node_cells) != crate::NODE_CELLS {
            return Err(format!(
                "nodes have {} columns per side, this program reads {}",
                self.node_cells,
                crate::NODE_CELLS
            ));
        }
        if self.depth > crate::tile_id::MAX_LEVEL {
            return Err(format!("depth is {}, the limit is {}", self.depth, crate::tile_id::MAX_LEVEL));
        }
        let numbers = self.origin.iter().chain(&self.bounds[0]).chain(&self.bounds[1]);
        let numbers = numbers.chain(self.sea.iter().flat_map(SeaEnds::lengths));
        let all = numbers
            .chain(&self.focus[0])
            .chain(&self.focus[1])
            .chain([&self.root_side_m, &self.cell_m, &self.ground_z_m]);
        if !all.clone().all(|v| v.is_finite() && v.abs() < 1e10) || self.cell_m <= 0.0 || self.root_side_m <= 0.0 {
            return Err("a length is not finite, not positive or over 10^10".into());
        }
        let side = self.cell_m * f64::from(self.node_cells) * f64::from(1u32 << self.depth);
        if ((side - self.root_side_m) / side).abs() > 1e-9 {
            return Err("root_side_m is not node_cells * cell_m * 2^depth".into());
        }
        if !self.location.is_none_or(|location| location.is_on_earth()) {
            return Err("its location is not on Earth".into());
        }
        if !is_name(&self.name) || !is_name(&self.version) {
            return Err("name or version is not 1 to 64 characters of a-z, 0-9, _ and -".into());
        }
        self.sea.as_ref().map_or(Ok(()), SeaEnds::check)?;
        self.release.as_ref().map_or(Ok(()), Release::check)?;
        self.check_texts()
    }

    /// The cities in which the bytes of shared tiles are, the nearest first.
    pub fn shared(&self) -> &[SharedCity] {
        self.release.as_ref().map_or(&[][..], |release| &release.shared[..])
    }

    /// The name that all releases of the city have in common; its own if it is none.
    pub fn release_name(&self) -> &str {
        self.release.as_ref().map_or(self.name.as_str(), |release| release.of.as_str())
    }

    /// Fails if a text or a list is longer than the limits.
    fn check_texts(&self) -> Result<(), String> {
        let attributions = self.attribution.iter().flat_map(Attribution::texts);
        let heights = self.heights.iter().flat_map(|heights| [&heights.datum].into_iter().chain(&heights.geoid));
        let texts = [&self.title, &self.settings]
            .into_iter()
            .chain(&self.crs)
            .chain(heights)
            .chain(&self.stones)
            .chain(attributions);
        let lengths = || texts.clone().map(String::len);
        if lengths().any(|length| length > MAX_TEXT_BYTES) {
            return Err(format!("a text is longer than {MAX_TEXT_BYTES} bytes"));
        }
        if lengths().sum::<usize>() > MAX_ALL_TEXT_BYTES || self.attribution.len() > MAX_ATTRIBUTIONS {
            return Err(format!("more than {MAX_ATTRIBUTIONS} attributions or {MAX_ALL_TEXT_BYTES} bytes of texts"));
        }
        if self.stones.len() > MAX_STONES {
            return Err(format!("more than {MAX_STONES} stones"));
        }
        let levels = usize::from(self.depth) + 1;
        if self.counts.nodes_per_level.len() > levels || self.counts.bytes_per_level.len() > levels {
            return Err("it counts more levels than the city has".into());
        }
        Ok(())
    }

    /// World bounds in metres of the part where most of the city stands.
    pub fn focus_bounds(&self) -> [[f64; 3]; 2] {
        [0, 1].map(|end| [self.focus[end][0], self.focus[end][1], self.bounds[end][2]])
    }

    /// Side of a node in metres.
    pub fn node_side_m(&self, level: u8) -> f64 {
        self.root_side_m / f64::from(1u32 << level.min(crate::tile_id::MAX_LEVEL))
    }

    /// Side of a column in metres at `level`.
    pub fn cell_m_at(&self, level: u8) -> f64 {
        self.node_side_m(level) / f64::from(self.node_cells)
    }

    /// World position in metres of a node's south-west corner, at the height of `origin`.
    pub fn node_corner(&self, id: crate::TileId) -> [f64; 3] {
        let side = self.node_side_m(id.level());
        [self.origin[0] + f64::from(id.x()) * side, self.origin[1] + f64::from(id.y()) * side, self.origin[2]]
    }
}

/// The text's beginning, if it is longer than [`MAX_TEXT_BYTES`].
pub fn shorten_text(text: &str) -> &str {
    &text[..text.floor_char_boundary(MAX_TEXT_BYTES)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_come_back_from_one_line() {
        let source = |text: &str, licence: Option<&str>, url: Option<&str>| Attribution {
            text: text.into(),
            licence: licence.map(Into::into),
            url: url.map(Into::into),
        };
        let osm =
            source("OpenStreetMap contributors", Some("ODbL 1.0"), Some("https://www.openstreetmap.org/copyright"));
        let all =
            [osm.clone(), source("Office of Maps, Japan", None, Some("http://a.b/c,d")), source("me", None, None)];
        let line = Attribution::line(&all);
        assert_eq!(
            line,
            "OpenStreetMap contributors, licence: ODbL 1.0, https://www.openstreetmap.org/copyright; \
             Office of Maps, Japan, http://a.b/c,d; me"
        );
        assert_eq!(Attribution::of_line(&line), all);
        for other in ["\u{a9} OpenStreetMap contributors; somebody, CC BY 4.0", "me"] {
            assert_eq!(Attribution::of_line(other), [source(other, None, None)]);
        }
        // What says no more is not added, and what says more replaces it.
        let mut found = vec![source("OpenStreetMap contributors", None, None)];
        assert!(osm.clone().add_to(&mut found) && !source("openstreetmap contributors", None, None).add_to(&mut found));
        assert_eq!(found, std::slice::from_ref(&osm));
        assert!(source("OpenStreetMap contributors", Some("CC0"), None).add_to(&mut found));
        assert_eq!(found.len(), 2);
    }

    fn manifest() -> Manifest {
        Manifest {
            format_version: FORMAT_VERSION,
            name: "town".into(),
            title: "x".repeat(MAX_TEXT_BYTES),
            version: "0123456789abcdef".into(),
            root_side_m: 64.0,
            node_cells: crate::NODE_CELLS as u16,
            cell_m: 1.0,
            tile_version: 1,
            ..Manifest::default()
        }
    }

    #[test]
    fn long_texts_and_lists_are_refused() {
        assert_eq!(manifest().check(), Ok(()));
        let attribution = |length: usize| Attribution { text: "x".repeat(length), licence: None, url: None };
        let nowhere = GeoLocation { latitude_deg: 91.0, longitude_deg: 0.0, north_deg: 0.0 };
        let sea = |east: f64, digit: &str| {
            Some(SeaEnds { ends: [[0.0; 2], [east, 1.0]], step_m: 1.0, sides: digit.repeat(256), rgb: [0; 3] })
        };
        assert_eq!(Manifest { sea: sea(2.0, "f"), ..manifest() }.check(), Ok(()));
        let changes: [&dyn Fn(&mut Manifest); 9] = [
            &|manifest| manifest.sea = sea(2.0, "x"),
            &|manifest| manifest.sea = sea(1e10, "f"),
            &|manifest| manifest.location = Some(nowhere),
            &|manifest| manifest.title.push('x'),
            &|manifest| manifest.crs = Some("x".repeat(MAX_TEXT_BYTES + 1)),
            &|manifest| manifest.attribution = vec![attribution(MAX_TEXT_BYTES + 1)],
            &|manifest| manifest.attribution = vec![attribution(1); MAX_ATTRIBUTIONS + 1],
            &|manifest| manifest.attribution = vec![attribution(MAX_TEXT_BYTES); 32],
            &|manifest| manifest.counts.nodes_per_level = vec![1; 2],
        ];
        for (i, change) in changes.into_iter().enumerate() {
            let mut manifest = manifest();
            change(&mut manifest);
            assert!(manifest.check().is_err(), "change {i}");
        }
    }

    #[test]
    fn largest_manifest_has_less_than_a_megabyte_however_it_is_escaped() {
        let text = "\u{1}".repeat(MAX_TEXT_BYTES);
        let attribution = Attribution { text: text.clone(), licence: None, url: None };
        let manifest = Manifest { title: text, attribution: vec![attribution; 31], ..manifest() };
        assert_eq!(manifest.check(), Ok(()));
        assert!(serde_json::to_vec_pretty(&manifest).unwrap().len() < crate::codec::bincode::LIMIT);
    }

    #[test]
    fn generated_facades_and_heights_are_labelled() {
        let heights = HeightReference { datum: "EPSG:5709".into(), geoid: Some("EGM96".into()) };
        for (generated_facades, heights) in [(false, None), (true, None), (false, Some(heights))] {
            let manifest = Manifest { generated_facades, heights, ..manifest() };
            let json = serde_json::to_string(&manifest).unwrap();
            assert_eq!(json.contains("\"generated_facades\":true"), generated_facades);
            assert_eq!(serde_json::from_str::<Manifest>(&json).unwrap(), manifest);
            let packed = crate::codec::bincode::to_bytes(&manifest).unwrap();
            assert_eq!(crate::codec::bincode::from_bytes::<Manifest>(&packed).unwrap(), manifest);
        }
        assert!(serde_json::from_str::<Manifest>("{\"generated_facades\":7}").is_err());
    }

    #[test]
    fn cut_manifests_are_refused_and_stones_have_limits() {
        let with = |count: usize| Manifest { stones: vec!["{}".into(); count], street_sets: true, ..manifest() };
        let packed = crate::codec::bincode::to_bytes(&with(2)).unwrap();
        assert_eq!(crate::codec::bincode::from_bytes::<Manifest>(&packed).unwrap(), with(2));
        let packed = crate::codec::bincode::to_bytes(&manifest()).unwrap();
        for length in 0..packed.len() {
            assert!(crate::codec::bincode::from_bytes::<Manifest>(&packed[..length]).is_err(), "cut at {length}");
        }
        assert_eq!(with(MAX_STONES).check(), Ok(()));
        assert!(with(MAX_STONES + 1).check().is_err());
    }

    #[test]
    fn buildings_are_counted_in_words_and_older_manifests_count_objects() {
        let counts = |json: &str| serde_json::from_str::<CityCounts>(json).unwrap();
        let old = r#"{"objects":2231,"triangles":9,"nodes_per_level":[],"bytes_per_level":[]"#;
        assert_eq!(counts(&format!("{old}}}")).words(), "2231 objects");
        assert_eq!(counts(&format!("{old},\"buildings\":1116}}")).words(), "1116 buildings");
        assert_eq!(counts(&format!("{old},\"buildings\":1}}")).words(), "1 building");
        assert_eq!(counts(&format!("{old},\"buildings\":0}}")).words(), "2231 objects");
    }

    #[test]
    fn text_is_cut_between_characters() {
        assert_eq!(shorten_text("short"), "short");
        let odd = "x".to_owned() + &"\u{e4}".repeat(MAX_TEXT_BYTES);
        assert_eq!(shorten_text(&odd).len(), MAX_TEXT_BYTES - 1);
    }
}
