//! What was asked for, and what it means.
//!
//! In: [`BakeOptions`]. Out: the checked `BakeConfig` that the pipeline obeys. Next: `pipeline`.

use std::path::PathBuf;

use insula_protocol::{
    NODE_CELLS,
    blockmap::Quality,
    manifest::{self, Attribution},
    tile,
};
use serde::Serialize;

use crate::{
    error::BakeError,
    mesh,
    read::{Palette, UpAxis},
    sample::SampleSettings,
    scene::grid::BLOCK_LEAVES,
};

/// Raised whenever the same scene and settings would give other tiles than before.
pub const ALGORITHM: u32 = 6;
/// Cells outside this range are slips of the keyboard.
const CELL_RANGE_M: std::ops::RangeInclusive<f64> = 0.01..=1000.0;
/// What a bake may take unless told otherwise, or 192 MiB for each thread if that is more.
pub const DEFAULT_MEMORY_BYTES: u64 = 512 << 20;
/// Enough for a dense block in each thread.
const MEMORY_BYTES_PER_THREAD: u64 = 192 << 20;
/// Less leaves no room for the program and a single block.
const MIN_MEMORY_BYTES: u64 = 64 << 20;
/// What is asked for when nothing is.
pub const QUALITY_DB: f32 = 36.0;
/// Below, pictures fall apart; above, `lossless` is smaller.
const QUALITY_RANGE_DB: std::ops::RangeInclusive<f32> = 20.0..=60.0;
/// More threads than this help nobody.
const MAX_THREADS: usize = 1024;

/// What a bake is asked to do.
#[derive(Debug, Clone)]
pub struct BakeOptions {
    /// City files, or folders with some.
    pub inputs: Vec<PathBuf>,
    /// The city folder to make; a city that is there already is replaced at the very end.
    pub out: PathBuf,
    /// Side of a leaf's column in metres.
    pub cell_m: f64,
    /// Worker threads; `None` for one a core. The result does not depend on it.
    pub threads: Option<usize>,
    /// About how many bytes of memory the bake may take; `None` for [`DEFAULT_MEMORY_BYTES`], or more where there are many
    /// threads. The result does not depend on it.
    pub memory_bytes: Option<u64>,
    /// Take from the city that is there what did not change.
    pub update: bool,
    /// Go on where an interrupted bake of the same input with the same settings stopped.
    pub resume: bool,
    /// Name in URLs, of a-z, 0-9, `_` and `-`; `None` for the folder's name.
    pub name: Option<String>,
    /// Name for people; `None` for the source's title.
    pub title: Option<String>,
    /// Who must be named; empty for what the sources say.
    pub attribution: Vec<Attribution>,
    /// Which axis is up in OBJ files.
    pub obj_up: UpAxis,
    /// Colours for what has none.
    pub palette: Palette,
    /// How leaves are sampled.
    pub sample: SampleSettings,
    /// What colours and occlusion may lose in the tiles.
    pub quality: Quality,
    /// Whether leaves get meshes, for views from near.
    pub meshes: bool,
}

impl Default for BakeOptions {
    fn default() -> Self {
        Self {
            inputs: Vec::new(),
            out: PathBuf::new(),
            cell_m: 1.0,
            threads: None,
            memory_bytes: None,
            update: false,
            resume: false,
            name: None,
            title: None,
            attribution: Vec::new(),
            obj_up: UpAxis::default(),
            palette: Palette::default(),
            sample: SampleSettings::default(),
            quality: Quality::Decibels(QUALITY_DB),
            meshes: true,
        }
    }
}

/// Options that make sense.
#[derive(Debug, Clone)]
pub(crate) struct BakeConfig {
    pub(crate) out: PathBuf,
    pub(crate) cell_m: f64,
    pub(crate) threads: usize,
    memory_bytes: usize,
    pub(crate) update: bool,
    pub(crate) resume: bool,
    pub(crate) name: String,
    pub(crate) title: Option<String>,
    pub(crate) attribution: Vec<Attribution>,
    pub(crate) sample: SampleSettings,
    pub(crate) quality: Quality,
    pub(crate) meshes: bool,
    /// Hash of all that decides the tiles apart from the scene, 16 hexadecimal digits.
    pub(crate) settings: String,
}

impl BakeConfig {
    /// Checks the options.
    pub(crate) fn new(options: &BakeOptions) -> Result<Self, BakeError> {
        let cell_m = options.cell_m;
        if !CELL_RANGE_M.contains(&cell_m) {
            let advice = format!("a cell is {} to {} metres wide", CELL_RANGE_M.start(), CELL_RANGE_M.end());
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
            let advice = "give the name of a folder to make, for example cities/delft".into();
            return Err(BakeError::Option { option: "--out", value: options.out.display().to_string(), advice });
        };
        let threads = threads(options.threads)?;
        options.sample.visibility.check().map_err(|advice| {
            let value = format!("{:?}", options.sample.visibility).to_lowercase();
            BakeError::Option { option: "--visibility", value, advice }
        })?;
        Ok(Self {
            out: options.out.clone(),
            cell_m,
            threads,
            memory_bytes: memory_bytes(options.memory_bytes, threads)?,
            update: options.update,
            resume: options.resume,
            name: name(options.name.as_deref(), &folder.to_string_lossy())?,
            title: options.title.clone(),
            attribution: options.attribution.clone(),
            sample: options.sample.clone(),
            quality: options.quality,
            meshes: options.meshes,
            settings: settings_hash(options)?,
        })
    }
}

impl BakeConfig {
    /// How much is gathered before it goes to the files of blocks.
    pub(crate) fn bucket_bytes(&self) -> usize {
        (self.memory_bytes / 8).min(16 << 20)
    }

    /// How many of pictures are kept loaded.
    pub(crate) fn picture_bytes(&self) -> usize {
        self.memory_bytes / 4
    }

    /// How many blocks in work may take together; the rest is for the program, for pictures that are in use, and for what
    /// an allocator keeps.
    pub(crate) fn block_bytes(&self) -> usize {
        self.memory_bytes / 2
    }
}

fn memory_bytes(asked: Option<u64>, threads: usize) -> Result<usize, BakeError> {
    let bytes = asked.unwrap_or(DEFAULT_MEMORY_BYTES.max(MEMORY_BYTES_PER_THREAD * threads as u64));
    if bytes < MIN_MEMORY_BYTES {
        let advice = format!("give at least {} MiB", MIN_MEMORY_BYTES >> 20);
        return Err(BakeError::Option { option: "--memory", value: bytes.to_string(), advice });
    }
    Ok(usize::try_from(bytes).unwrap_or(usize::MAX))
}

fn threads(asked: Option<usize>) -> Result<usize, BakeError> {
    match asked {
        None => Ok(std::thread::available_parallelism().map_or(1, usize::from)),
        Some(n) if (1..=MAX_THREADS).contains(&n) => Ok(n),
        Some(n) => {
            let advice = format!("give 1 to {MAX_THREADS}");
            Err(BakeError::Option { option: "--threads", value: n.to_string(), advice })
        }
    }
}

fn name(asked: Option<&str>, folder: &str) -> Result<String, BakeError> {
    match asked {
        None => Ok(manifest::to_name(folder)),
        Some(name) if manifest::is_name(name) => Ok(name.to_owned()),
        Some(name) => {
            let advice =
                format!("a name has only a-z, 0-9, _ and -, at most 64: for example {}", manifest::to_name(name));
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
    /// None for no loss.
    quality_db: Option<f32>,
    /// How meshes are made; none for no meshes.
    #[serde(skip_serializing_if = "Option::is_none")]
    meshes: Option<u32>,
}

fn settings_hash(options: &BakeOptions) -> Result<String, BakeError> {
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
    };
    let json = serde_json::to_vec(&settings).map_err(|cause| BakeError::Option {
        option: "the sampling",
        value: "settings".into(),
        advice: cause.to_string(),
    })?;
    Ok(short_hex(&blake3::hash(&json)))
}

/// The first 16 hexadecimal digits.
pub(crate) fn short_hex(hash: &blake3::Hash) -> String {
    hash.to_hex().chars().take(16).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options() -> BakeOptions {
        BakeOptions { out: "some/where/Den Haag (2024)".into(), ..BakeOptions::default() }
    }

    #[test]
    fn defaults_make_sense() {
        let config = BakeConfig::new(&options()).unwrap();
        assert_eq!(config.name, "den-haag-2024");
        assert!(config.threads >= 1);
        assert_eq!(config.settings.len(), 16);
    }

    #[test]
    fn what_changes_tiles_changes_the_hash_and_nothing_else_does() {
        let hash = |options: &BakeOptions| BakeConfig::new(options).unwrap().settings;
        let base = hash(&options());
        assert_ne!(hash(&BakeOptions { cell_m: 2.0, ..options() }), base);
        assert_ne!(hash(&BakeOptions { quality: Quality::Lossless, ..options() }), base);
        assert_ne!(hash(&BakeOptions { meshes: false, ..options() }), base);
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
    fn slips_are_refused_with_advice() {
        let wrong = [
            BakeOptions { cell_m: 0.0, ..options() },
            BakeOptions { cell_m: f64::NAN, ..options() },
            BakeOptions { threads: Some(0), ..options() },
            BakeOptions { memory_bytes: Some(1 << 20), ..options() },
            BakeOptions { name: Some("Den Haag".into()), ..options() },
            BakeOptions { quality: Quality::Decibels(f32::NAN), ..options() },
            BakeOptions { out: "..".into(), ..options() },
            BakeOptions { out: "".into(), ..options() },
        ];
        for options in wrong {
            assert!(matches!(BakeConfig::new(&options), Err(BakeError::Option { .. })), "{options:?}");
        }
        let error = BakeConfig::new(&BakeOptions { name: Some("Den Haag".into()), ..options() }).unwrap_err();
        assert!(error.to_string().ends_with("den-haag"), "{error}");
    }
}
