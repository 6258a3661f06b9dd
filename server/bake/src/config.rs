//! The options of a bake: [`BakeOptions`] as given, `BakeConfig` as validated.

use crate::error::BakeError;
use crate::ground::GroundOption;
use crate::read::{FACADE_ALGORITHM, FacadeOption, NamePatterns, ReadOptions, named_paths};
use crate::release::{BaseCity, check_not_shared};
use crate::sample::SampleSettings;
use crate::scene::grid::BLOCK_LEAVES;
use crate::{ground, hash, mesh};
use insula_objects::Labels;
use insula_protocol::blockmap::Quality;
use insula_protocol::manifest::{self, Attribution, MAX_TEXT_BYTES};
use insula_protocol::name;
use insula_protocol::{NODE_CELLS, tile};
use insula_source::source::read_file;
use rayon::{ThreadPool, ThreadPoolBuilder};
use serde::Serialize;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Increased whenever the same scene and settings would give different tiles than before.
pub const ALGORITHM: u32 = 15;
/// Cells outside this range are taken for typing errors.
const CELL_RANGE_M: std::ops::RangeInclusive<f64> = 0.01..=1000.0;
/// Default memory limit; 192 MiB per thread if that is more.
pub const DEFAULT_MEMORY_BYTES: u64 = 512 << 20;
/// Enough for one dense block.
const MEMORY_BYTES_PER_THREAD: u64 = 192 << 20;
/// The program and a single block need this much.
const MIN_MEMORY_BYTES: u64 = 64 << 20;
/// Memory besides `--memory` for allocations that are not estimated in advance. With the program and the allocator's
/// overhead a bake stays within 512 MiB more than `--memory`. It does not shrink with `--memory`, because blocks, documents and the
/// tiles of the picture do not.
const RESERVE_BYTES: u64 = 384 << 20;
/// The part of the reserve that a single block may need.
const BLOCK_RESERVE_BYTES: usize = 320 << 20;
/// The part of the reserve that a document may need.
const DOCUMENT_RESERVE_BYTES: u64 = 192 << 20;
/// Default limit of the scratch scene: a thousand million copies of triangles.
pub const DEFAULT_SCRATCH_BYTES: u64 = 64 << 30;
/// Memory of a block's entry while the city is partitioned.
const BLOCK_ENTRY_BYTES: usize = 200;
/// Default quality of colours and occlusion.
pub const QUALITY_DB: f32 = 36.0;
/// Below, images show strong artefacts; above, `lossless` is smaller.
const QUALITY_RANGE_DB: std::ops::RangeInclusive<f32> = 20.0..=60.0;
const MAX_THREADS: usize = 1024;
/// A longer landmark file is refused when it is read.
const MAX_LANDMARKS_BYTES: u64 = 1 << 20;
/// Most attributions in the options. Their texts fit into a manifest at any length.
const MAX_OPTION_ATTRIBUTIONS: usize = 8;

/// The options of a bake.
#[derive(Debug, Clone)]
pub struct BakeOptions {
    /// City files, or folders that contain some.
    pub inputs: Vec<PathBuf>,
    /// The city folder to write. An existing city is replaced only after the new one is complete.
    pub out: PathBuf,
    /// Side of a leaf's column in metres.
    pub cell_m: f64,
    /// Worker threads; `None` for one per core. The result does not depend on it.
    pub threads: Option<usize>,
    /// Approximate memory limit; `None` for [`DEFAULT_MEMORY_BYTES`], or more with many threads. The result does not
    /// depend on it.
    pub memory_bytes: Option<u64>,
    /// Limit of triangles and textures in scratch files, which are on the disk of `out`. The result does not depend on it.
    pub scratch_bytes: u64,
    /// Reuse the unchanged blocks of the existing city.
    pub update: bool,
    /// Reuse those of another city instead, which stays as it is.
    pub reuse: Option<PathBuf>,
    /// Reuse those of a city of an earlier day, and share its tiles: the new city has only the others.
    pub version_of: Option<PathBuf>,
    /// Day of which the city is, as in `2024-01-31`.
    pub date: Option<String>,
    /// Continue an interrupted bake: what it made from the same input and settings is not baked again.
    pub resume: bool,
    /// How the inputs are read. The bake sets the size of cells, the level ground, the dropped attributes, and limits by its memory.
    pub read: ReadOptions,
    /// Name in URLs, of a-z, 0-9, `_` and `-`; `None` for the folder's name.
    pub name: Option<String>,
    /// Display name; `None` for the source's title, or else `place`.
    pub title: Option<String>,
    /// Title of a city whose sources have none; `None` for `name` if it is given, else for the name of the folder as it was typed.
    pub place: Option<String>,
    /// Attributions; empty for those of the sources.
    pub attribution: Vec<Attribution>,
    /// Sampling of leaves.
    pub sample: SampleSettings,
    /// Files whose content these options have, such as that of the palette: the bake replaces and removes none of them.
    pub named_files: Vec<PathBuf>,
    /// Allowed loss of colours and occlusion in the tiles.
    pub quality: Quality,
    /// Whether leaves get meshes, for near views.
    pub meshes: bool,
    /// Whether ground is generated where the sources have none. The default is not.
    pub ground: GroundOption,
    /// Patterns of the names of attributes that the city must not have, such as `owner*`.
    pub drop_attributes: Vec<String>,
    /// Names of the attributes whose texts can be searched, besides names, addresses and identifiers.
    pub search_attributes: Vec<String>,
    /// What people read instead of the names of attributes, and units of numbers.
    pub labels: Labels,
    /// Whether to compute what can be seen from streets.
    pub street_sets: bool,
    /// Whether to draw the city's first view for lists and previews of links.
    pub picture: bool,
}

impl Default for BakeOptions {
    fn default() -> Self {
        Self {
            inputs: Vec::new(),
            out: PathBuf::new(),
            cell_m: 1.0,
            threads: None,
            memory_bytes: None,
            scratch_bytes: DEFAULT_SCRATCH_BYTES,
            update: false,
            reuse: None,
            version_of: None,
            date: None,
            resume: false,
            read: ReadOptions::default(),
            name: None,
            title: None,
            place: None,
            attribution: Vec::new(),
            sample: SampleSettings::default(),
            named_files: Vec::new(),
            quality: Quality::Decibels(QUALITY_DB),
            meshes: true,
            ground: GroundOption::default(),
            drop_attributes: Vec::new(),
            search_attributes: Vec::new(),
            labels: Labels::default(),
            street_sets: false,
            picture: false,
        }
    }
}

impl BakeOptions {
    /// The paths that the bake reads on this machine, and the addresses. Those that a landmark file names are left out if it cannot be
    /// read, which the bake reports.
    #[must_use]
    pub fn read_paths(&self) -> Vec<PathBuf> {
        let ReadOptions { surroundings, streets, texture_roots, placing, landmarks, proposal, .. } = &self.read;
        let inputs =
            self.inputs.iter().chain(&surroundings.files).chain(streets).chain(&self.reuse).chain(&self.version_of);
        let proposed = proposal.iter().flat_map(|proposal| &proposal.files);
        let others =
            texture_roots.iter().chain(&placing.grids).chain(landmarks).chain(&self.named_files).chain(proposed);
        let meshes = landmarks.iter().flat_map(|file| meshes_of(file).unwrap_or_default());
        inputs.flat_map(|input| named_paths(input)).chain(others.cloned()).chain(meshes).collect()
    }

    /// Memory that a bake with these options allocates at most, in bytes: the requested or default memory, and a
    /// reserve for allocations that are not estimated in advance. A program that sets a limit of its own sets it here.
    #[must_use]
    pub fn memory_limit_bytes(&self) -> u64 {
        let threads = self.threads.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
        self.memory_bytes.unwrap_or(default_memory(threads)).saturating_add(RESERVE_BYTES)
    }
}

/// The meshes that a landmark file names, relative to its folder; `None` if it is none.
fn meshes_of(landmarks: &Path) -> Option<Vec<PathBuf>> {
    let file: Value = serde_json::from_slice(&read_file(landmarks, MAX_LANDMARKS_BYTES).ok()?).ok()?;
    let folder = landmarks.parent().unwrap_or(Path::new(""));
    Some(file["landmarks"].as_array()?.iter().filter_map(|entry| Some(folder.join(entry["mesh"].as_str()?))).collect())
}

fn default_memory(threads: usize) -> u64 {
    DEFAULT_MEMORY_BYTES.max(MEMORY_BYTES_PER_THREAD * threads as u64)
}

/// Validated options.
#[derive(Debug, Clone)]
pub(crate) struct BakeConfig {
    /// With defaults and what follows from others in their places.
    pub(crate) options: BakeOptions,
    pub(crate) threads: usize,
    memory_bytes: usize,
    /// The city whose unchanged blocks are reused, if there is one.
    pub(crate) previous: Option<PathBuf>,
    /// The city with which it shares tiles, if there is one.
    pub(crate) base: Option<BaseCity>,
    pub(crate) name: String,
    pub(crate) place: String,
    /// Hash of everything that determines the tiles except the scene, 16 hexadecimal digits.
    pub(crate) settings: String,
}

impl BakeConfig {
    /// Fails with [`BakeError::Option`] if a value is invalid.
    pub(crate) fn new(options: &BakeOptions) -> Result<Self, BakeError> {
        let cell_m = options.cell_m;
        if !CELL_RANGE_M.contains(&cell_m) {
            let advice = format!("give a cell of {} to {} metres", CELL_RANGE_M.start(), CELL_RANGE_M.end());
            return Err(BakeError::Option { option: "--cell", value: cell_m.to_string(), advice });
        }
        if let Quality::Decibels(db) = options.quality
            && !QUALITY_RANGE_DB.contains(&db)
        {
            let (low, high) = (QUALITY_RANGE_DB.start(), QUALITY_RANGE_DB.end());
            let advice = format!("give {low} to {high} dB, or lossless");
            return Err(BakeError::Option { option: "--quality", value: db.to_string(), advice });
        }
        let Some(folder) = options.out.file_name() else {
            let advice = "give the name of the city folder to write, for example cities/delft".into();
            return Err(BakeError::Option { option: "--out", value: options.out.display().to_string(), advice });
        };
        check_texts(options)?;
        let threads = check_threads(options.threads)?;
        options.sample.visibility.check().map_err(|advice| {
            let value = format!("{:?}", options.sample.visibility).to_lowercase();
            BakeError::Option { option: "--visibility", value, advice }
        })?;
        check_not_shared(&options.out)?;
        let mut config = Self {
            options: options.clone(),
            threads,
            memory_bytes: check_memory(options.memory_bytes, threads)?,
            previous: previous(options),
            base: BaseCity::of(options.version_of.as_deref(), options.date.as_deref(), &options.out)?,
            name: check_name(options.name.as_deref(), &folder.to_string_lossy())?,
            place: place(options, &folder.to_string_lossy()),
            settings: hash_settings(options)?,
        };
        // Without the `.` at the end of `city/.`, under which no folder can be renamed.
        config.options.out = options.out.components().collect();
        config.options.read = ReadOptions {
            cell_m,
            level_ground: options.ground == GroundOption::Auto,
            dropped_attributes: check_patterns(&options.drop_attributes)?,
            max_document_bytes: config.max_document_bytes().min(options.read.max_document_bytes),
            max_line_bytes: config.max_line_bytes().min(options.read.max_line_bytes),
            // All allocations of a bake have a limit.
            max_held_bytes: u64::MAX,
            origin: config.base.as_ref().map(BaseCity::origin),
            ..options.read.clone()
        };
        Ok(config)
    }

    /// Threads for the bake's work. Fails if the system cannot start them.
    pub(crate) fn thread_pool(&self) -> Result<ThreadPool, BakeError> {
        let threads = self.threads;
        let built = ThreadPoolBuilder::new().num_threads(threads).thread_name(|i| format!("bake-{i}")).build();
        built.map_err(|cause| BakeError::Threads { threads, cause: cause.to_string() })
    }

    /// Size of the partition's write buffers together.
    pub(crate) fn bucket_bytes(&self) -> usize {
        (self.memory_bytes / 8).min(16 << 20)
    }

    pub(crate) fn texture_cache_bytes(&self) -> usize {
        self.memory_bytes / 4
    }

    /// A block that needs more is refused.
    pub(crate) fn max_block_bytes(&self) -> usize {
        self.block_bytes().saturating_add(BLOCK_RESERVE_BYTES)
    }

    /// Most blocks of leaves that a city may have: each has an entry and a buffer while the city is partitioned.
    pub(crate) fn max_blocks(&self) -> usize {
        self.memory_bytes / 4 / BLOCK_ENTRY_BYTES
    }

    /// Largest document that is held in memory while it is read.
    pub(crate) fn max_document_bytes(&self) -> u64 {
        (self.memory_bytes as u64).saturating_add(DOCUMENT_RESERVE_BYTES)
    }

    /// Longest line of a sequence, or largest feature of a document: its parsed form is several times larger.
    pub(crate) fn max_line_bytes(&self) -> u64 {
        self.max_document_bytes() / 8
    }

    /// Memory of all blocks in progress together. The rest is for the program, textures in use and the allocator's
    /// overhead.
    pub(crate) fn block_bytes(&self) -> usize {
        self.memory_bytes / 2
    }
}

/// The city whose unchanged blocks are reused.
fn previous(options: &BakeOptions) -> Option<PathBuf> {
    let other = options.reuse.as_ref().or(options.version_of.as_ref());
    other.or(options.update.then_some(&options.out)).cloned()
}

fn check_texts(options: &BakeOptions) -> Result<(), BakeError> {
    let title = options.title.iter().map(|text| ("--title", text));
    let attributions = options.attribution.iter().flat_map(|attribution| {
        let Attribution { text, licence, url } = attribution;
        let [licence, url] = [("--licence", licence), ("--source-url", url)]
            .map(|(name, text)| text.iter().map(move |text| (name, text)));
        std::iter::once(("--attribution", text)).chain(licence).chain(url)
    });
    for (option, text) in title.chain(attributions) {
        if text.len() > MAX_TEXT_BYTES {
            let (value, advice) =
                (text.chars().take(60).collect::<String>() + "...", format!("give at most {MAX_TEXT_BYTES} bytes"));
            return Err(BakeError::Option { option, value, advice });
        }
    }
    if options.attribution.len() > MAX_OPTION_ATTRIBUTIONS {
        let value = options.attribution.len().to_string();
        return Err(BakeError::Option {
            option: "--attribution",
            value,
            advice: format!("give at most {MAX_OPTION_ATTRIBUTIONS}"),
        });
    }
    Ok(())
}

fn check_patterns(patterns: &[String]) -> Result<NamePatterns, BakeError> {
    NamePatterns::parse(patterns).map_err(|value| {
        let advice = "give names of attributes with * and ?, such as owner*".to_owned();
        BakeError::Option { option: "--drop", value, advice }
    })
}

fn check_memory(requested: Option<u64>, threads: usize) -> Result<usize, BakeError> {
    let bytes = requested.unwrap_or(default_memory(threads));
    if bytes < MIN_MEMORY_BYTES {
        let advice = format!("give at least {} MiB", MIN_MEMORY_BYTES >> 20);
        return Err(BakeError::Option { option: "--memory", value: bytes.to_string(), advice });
    }
    Ok(usize::try_from(bytes).unwrap_or(usize::MAX))
}

fn check_threads(requested: Option<usize>) -> Result<usize, BakeError> {
    match requested {
        None => Ok(std::thread::available_parallelism().map_or(1, usize::from)),
        Some(n) if (1..=MAX_THREADS).contains(&n) => Ok(n),
        Some(n) => {
            let advice = format!("give 1 to {MAX_THREADS}");
            Err(BakeError::Option { option: "--threads", value: n.to_string(), advice })
        }
    }
}

/// The title of a city whose sources have none.
fn place(options: &BakeOptions, folder: &str) -> String {
    let place = options.place.as_deref().or(options.name.as_deref()).unwrap_or(folder);
    manifest::shorten_text(place).to_owned()
}

fn check_name(requested: Option<&str>, folder: &str) -> Result<String, BakeError> {
    match requested {
        None => Ok(name::to_name(folder)),
        Some(name) if name::is_name(name) => Ok(name.to_owned()),
        Some(name) => {
            let advice =
                format!("a name has at most 64 characters of a-z, 0-9, _ and -, for example {}", name::to_name(name));
            Err(BakeError::Option { option: "--name", value: name.to_owned(), advice })
        }
    }
}

#[derive(Serialize)]
struct HashedSettings<'a> {
    algorithm: u32,
    tile_version: u16,
    node_cells: usize,
    block_leaves: u32,
    cell_m: f64,
    sample: &'a SampleSettings,
    quality_db: Option<f32>,
    /// Version of the mesh algorithm; `None` without meshes.
    #[serde(skip_serializing_if = "Option::is_none")]
    meshes: Option<u32>,
    /// Version of the generated ground; `None` without.
    #[serde(skip_serializing_if = "Option::is_none")]
    ground: Option<u32>,
    /// Version of the generated facades; `None` without.
    #[serde(skip_serializing_if = "Option::is_none")]
    facades: Option<u32>,
}

fn hash_settings(options: &BakeOptions) -> Result<String, BakeError> {
    let settings = HashedSettings {
        algorithm: ALGORITHM,
        tile_version: tile::VERSION,
        node_cells: NODE_CELLS,
        block_leaves: BLOCK_LEAVES,
        cell_m: options.cell_m,
        sample: &options.sample,
        quality_db: match options.quality {
            Quality::Lossless => None,
            Quality::Decibels(db) => Some(db),
        },
        meshes: options.meshes.then_some(mesh::ALGORITHM),
        ground: (options.ground == GroundOption::Auto).then_some(ground::ALGORITHM),
        facades: (options.read.facades == FacadeOption::Windows).then_some(FACADE_ALGORITHM),
    };
    let json = serde_json::to_vec(&settings).map_err(|cause| BakeError::Option {
        option: "the sampling",
        value: "settings".into(),
        advice: cause.to_string(),
    })?;
    Ok(hash::short_hex(&blake3::hash(&json)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read::ProposalOptions;
    use insula_test_support::folder::TestFolder;

    fn options() -> BakeOptions {
        BakeOptions { out: "some/where/Den Haag (2024)".into(), ..BakeOptions::default() }
    }

    #[test]
    fn default_options_are_valid() {
        let config = BakeConfig::new(&options()).unwrap();
        assert_eq!(config.name, "den-haag-2024");
        assert!(config.threads >= 1);
        assert_eq!(config.settings.len(), 16);
    }

    #[test]
    fn all_paths_that_are_read_are_known() {
        let folder = TestFolder::new("read-paths");
        let path = |name: &str| folder.path.join(name);
        std::fs::write(path("l.json"), r#"{"landmarks":[{"mesh":"work/a.obj"},{"mesh":"b.ply"},{}]}"#).unwrap();
        let landmarks = |name: &str| ReadOptions { landmarks: Some(path(name)), ..ReadOptions::default() };
        let proposal = Some(ProposalOptions { files: vec![path("m.obj")], ..ProposalOptions::default() });
        let options = BakeOptions {
            inputs: vec![path("a.gml")],
            read: ReadOptions { proposal, ..landmarks("l.json") },
            named_files: vec![path("p.json")],
            ..options()
        };
        let expected = ["a.gml", "l.json", "p.json", "m.obj", "work/a.obj", "b.ply"].map(path);
        assert_eq!(options.read_paths(), expected);
        let missing = BakeOptions { read: landmarks("none.json"), ..options };
        assert_eq!(missing.read_paths(), ["a.gml", "none.json", "p.json"].map(path));
    }

    #[test]
    fn settings_hash_depends_only_on_what_changes_tiles() {
        let hash = |options: &BakeOptions| BakeConfig::new(options).unwrap().settings;
        let base = hash(&options());
        assert_ne!(hash(&BakeOptions { cell_m: 2.0, ..options() }), base);
        assert_ne!(hash(&BakeOptions { quality: Quality::Lossless, ..options() }), base);
        assert_ne!(hash(&BakeOptions { meshes: false, ..options() }), base);
        assert_ne!(hash(&BakeOptions { ground: GroundOption::Auto, ..options() }), base);
        let read = ReadOptions { facades: FacadeOption::Windows, ..ReadOptions::default() };
        assert_ne!(hash(&BakeOptions { read, ..options() }), base);
        let title = Some("Den Haag".to_owned());
        assert_eq!(
            hash(&BakeOptions {
                threads: Some(7),
                resume: true,
                update: true,
                memory_bytes: Some(1 << 30),
                title,
                ..options()
            }),
            base
        );
    }

    #[test]
    fn the_limit_of_allocations_is_1_25_times_the_memory_of_8_threads() {
        let limit = |threads, memory| {
            let options = BakeOptions { threads: Some(threads), memory_bytes: memory, ..options() };
            options.memory_limit_bytes() as f64 / memory.unwrap_or(default_memory(threads)) as f64
        };
        for (threads, memory) in [(8, None), (64, None), (1, Some(1536 << 20)), (1, Some(8 << 30))] {
            assert!(limit(threads, memory) <= 1.25, "{threads} threads, {memory:?}");
        }
        assert!(limit(1, None) > 1.25, "the largest block and document are the same for little memory");
    }

    #[test]
    fn invalid_options_are_refused_with_advice() {
        let wrong = [
            BakeOptions { cell_m: 0.0, ..options() },
            BakeOptions { cell_m: f64::NAN, ..options() },
            BakeOptions { threads: Some(0), ..options() },
            BakeOptions { memory_bytes: Some(1 << 20), ..options() },
            BakeOptions { name: Some("Den Haag".into()), ..options() },
            BakeOptions { quality: Quality::Decibels(f32::NAN), ..options() },
            BakeOptions { out: "..".into(), ..options() },
            BakeOptions { title: Some("x".repeat(5000)), ..options() },
            BakeOptions { out: "".into(), ..options() },
        ];
        for options in wrong {
            assert!(matches!(BakeConfig::new(&options), Err(BakeError::Option { .. })), "{options:?}");
        }
        let error = BakeConfig::new(&BakeOptions { name: Some("Den Haag".into()), ..options() }).unwrap_err();
        assert!(error.to_string().ends_with("den-haag"), "{error}");
    }
}
