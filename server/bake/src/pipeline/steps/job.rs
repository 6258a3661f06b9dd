//! A bake in steps: what is baked, how, and in which chunks.

use super::layout::{CityPlan, JOINED, RESULTS};
use super::owned::OwnedStore;
use super::sealed::{Removed, SealedStore};
use super::work::WorkStore;
use crate::config::{ALGORITHM, BakeConfig, BakeOptions};
use crate::error::BakeError;
use crate::hash::short_hex;
use crate::progress::Progress;
use crate::read::{FarModels, ListedInputs};
use crate::write::ownership::{check_inputs, check_place};
use insula_archive::places::KeptFolder;
use insula_source::error::InputError;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Name of the job's object.
pub(super) const JOB: &str = "job.json";
/// Version of the steps and their objects.
const STEPS_VERSION: u32 = 4;
/// A longer job is refused.
const MAX_JOB_BYTES: u64 = 64 << 20;
/// Sources are collected in chunks of this size, unless it is chosen.
pub const DEFAULT_CHUNK_BYTES: u64 = 256 << 20;
/// Leaves along the side of a region, unless it is chosen.
pub const DEFAULT_REGION_LEAVES: u32 = 32;
/// Longest side of a region in leaves.
const MAX_REGION_LEAVES: u32 = 1 << 12;

/// A job, as `job.json` has it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Job {
    /// Version of the steps and their objects.
    steps: u32,
    /// Version of the program.
    program: String,
    /// Hash of the settings of the tiles.
    settings: String,
    algorithm: u32,
    /// The command line's arguments, which every step parses again.
    pub arguments: Vec<String>,
    /// Name of the city.
    pub name: String,
    pub inputs: Vec<PathBuf>,
    /// The city's coordinate system; `None` if no input has one.
    crs: Option<String>,
    /// Leaves along the side of a region: a power of two.
    region_leaves: u32,
    /// Size of the chunks, and of the slices of sequences.
    chunk_bytes: u64,
    /// Numbers of the sources that are read last: in the order of the inputs, without elevation models.
    postponed: Vec<usize>,
    /// Size of each elevation model and picture from above in bytes.
    elevation: Vec<u64>,
    /// Runs of the other sources.
    chunks: Vec<JobChunk>,
    /// Number of the job whose city is updated.
    previous: Option<String>,
}

/// A run of sources.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct JobChunk {
    /// Index of its first source.
    pub(super) first: usize,
    /// Size of each of its sources in bytes, by which a change of the inputs is noticed.
    pub(super) bytes: Vec<u64>,
}

/// What a new job is made of.
#[derive(Debug, Clone)]
pub struct JobRequest {
    /// Kept in the job for the steps.
    pub arguments: Vec<String>,
    /// Least size of a chunk in bytes, except for the last one.
    pub chunk_bytes: u64,
    /// Leaves along the side of a region: a power of two of at least 2.
    pub region_leaves: u32,
    /// Whether the job in the store is replaced by one that updates its city: regions whose input is the same are not baked again.
    pub is_update: bool,
}

/// The steps of a job.
pub struct BakeSteps<'a> {
    pub(super) job: Job,
    id: String,
    store: OwnedStore<'a>,
    pub(super) config: BakeConfig,
    pub(super) progress: &'a dyn Progress,
}

impl Job {
    /// The job of a work store. Fails if there is none, or if another version of the program made it.
    pub fn read(store: &dyn WorkStore) -> Result<Self, BakeError> {
        let failed = |cause| BakeError::work(store.address(), JOB, cause);
        let missing = || BakeError::StepMissing { work: store.address(), name: JOB.to_owned() };
        let damaged = |what| BakeError::StepDamaged { work: store.address(), name: JOB.to_owned(), what };
        let size = store.size(JOB).map_err(failed)?.ok_or_else(missing)?;
        if size > MAX_JOB_BYTES {
            return Err(damaged("it is too large"));
        }
        let bytes = store.range(JOB, 0, size).map_err(failed)?;
        let job: Self = serde_json::from_slice(&bytes).map_err(|_| damaged("its fields are damaged"))?;
        let is_own = job.steps == STEPS_VERSION && job.algorithm == ALGORITHM;
        if !is_own || job.program != env!("CARGO_PKG_VERSION") {
            return Err(damaged("another version of the program made it"));
        }
        let is_region = job.region_leaves.is_power_of_two() && (2..=MAX_REGION_LEAVES).contains(&job.region_leaves);
        if !is_region || job.chunks.is_empty() {
            return Err(damaged("its fields are damaged"));
        }
        Ok(job)
    }

    /// Its number, by which objects of other jobs are told from its own.
    pub(super) fn id(&self) -> Result<String, BakeError> {
        Ok(short_hex(&blake3::hash(&self.json()?)))
    }

    /// Hash of everything that the job says, by which another job in its place is noticed.
    pub fn hash(&self) -> Result<String, BakeError> {
        Ok(blake3::hash(&self.json()?).to_hex().to_string())
    }

    /// Version of the program.
    pub(super) fn program(&self) -> String {
        format!("{} {} {}", self.program, self.algorithm, self.steps)
    }

    /// Number of the job whose city is updated.
    pub(super) fn previous(&self) -> Option<&str> {
        self.previous.as_deref()
    }

    /// Whether there are elevation models or pictures from above.
    pub(super) fn has_elevation(&self) -> bool {
        !self.elevation.is_empty()
    }

    /// Number of scans.
    #[must_use]
    pub fn scans(&self) -> usize {
        self.chunks.len()
    }

    fn json(&self) -> Result<Vec<u8>, BakeError> {
        let failed = |cause: serde_json::Error| BakeError::io(JOB.as_ref(), "written", cause.into());
        serde_json::to_vec_pretty(self).map_err(failed)
    }
}

impl<'a> BakeSteps<'a> {
    /// Lists the inputs and writes the job. Does nothing if the same job is there. Fails if another job is, unless it is updated, or if an
    /// input cannot be read in steps.
    pub fn begin(
        store: &dyn WorkStore,
        options: &BakeOptions,
        request: &JobRequest,
        progress: &dyn Progress,
    ) -> Result<Job, BakeError> {
        let config = BakeConfig::new(options)?;
        let leaves = request.region_leaves;
        if !leaves.is_power_of_two() || !(2..=MAX_REGION_LEAVES).contains(&leaves) {
            let advice = format!("give a power of two from 2 to {MAX_REGION_LEAVES}");
            return Err(BakeError::Option { option: "--region", value: leaves.to_string(), advice });
        }
        progress.stage("list", 0);
        refuse_inside(store, options)?;
        let read_options = &config.options.read;
        let mut listed = ListedInputs::new(&options.inputs, read_options, request.chunk_bytes)?;
        let (crs, postponed) = listed.settle(read_options)?;
        listed.postpone(&postponed);
        let (sizes, elevation) = listed.sizes();
        let failed = |cause| BakeError::work(store.address(), JOB, cause);
        let owned = OwnedStore::new(store);
        owned.mark(JOB).map_err(failed)?;
        let found = store.size(JOB).map_err(failed)?.map(|_| Job::read(store)).transpose()?;
        let store = owned;
        // Of a job that has no city yet, the one whose city it updates.
        let previous = match &found {
            Some(old) if request.is_update && has_city(store, old)? => Some(old.id()?),
            Some(old) => old.previous.clone().filter(|_| request.is_update),
            None => None,
        };
        let job = Job {
            steps: STEPS_VERSION,
            program: env!("CARGO_PKG_VERSION").to_owned(),
            settings: config.settings.clone(),
            algorithm: ALGORITHM,
            arguments: request.arguments.clone(),
            name: config.name.clone(),
            inputs: options.inputs.clone(),
            crs,
            region_leaves: leaves,
            chunk_bytes: request.chunk_bytes,
            postponed,
            elevation,
            chunks: chunks(&sizes, request.chunk_bytes),
            previous,
        };
        if found.as_ref() == Some(&job) {
            return Ok(job);
        }
        if found.is_some() && !request.is_update {
            let what = "it is another job; give --update, an empty --work, or remove the job with `bake abort`";
            return Err(BakeError::StepDamaged { work: store.address(), name: JOB.to_owned(), what });
        }
        if request.is_update {
            // What is written for another job would look like a result. Without a job, no step runs meanwhile.
            let mut removed = Removed::default();
            removed.remove(store, &[JOB.to_owned()])?;
            RESULTS.into_iter().try_for_each(|folder| removed.remove_folder(store, folder))?;
            warn_of_kept(&store.address(), &removed, progress);
        }
        store.put(JOB, job.json()?).map_err(failed)?;
        Ok(job)
    }

    /// Opens the steps of a job with the options of its arguments. Fails if the settings differ, or if an input lies in the job's own store.
    pub fn open(
        store: &'a dyn WorkStore,
        job: Job,
        options: &BakeOptions,
        progress: &'a dyn Progress,
    ) -> Result<Self, BakeError> {
        let options = &BakeOptions { name: Some(job.name.clone()), inputs: job.inputs.clone(), ..options.clone() };
        let mut config = BakeConfig::new(options)?;
        if config.settings != job.settings {
            let what = "its settings are others than those of this program";
            return Err(BakeError::StepDamaged { work: store.address(), name: JOB.to_owned(), what });
        }
        refuse_inside(store, options)?;
        let id = job.id()?;
        let placing = &mut config.options.read.placing;
        placing.is_crs_found = placing.crs.is_none();
        placing.crs = job.crs.clone().or(placing.crs.take());
        Ok(Self { job, id, store: OwnedStore::new(store), config, progress })
    }

    pub(super) fn objects(&self) -> SealedStore<'_> {
        SealedStore { store: self.store, job: &self.id }
    }

    /// The inputs as they were listed. Fails if they have changed since.
    pub(super) fn list_inputs(&self) -> Result<ListedInputs, BakeError> {
        let mut listed = ListedInputs::new(&self.job.inputs, &self.config.options.read, self.job.chunk_bytes)?;
        listed.postpone(&self.job.postponed);
        let (sizes, elevation) = listed.sizes();
        if elevation != self.job.elevation || !sizes.iter().eq(self.chunks().iter().flat_map(|chunk| &chunk.bytes)) {
            let what = "they have changed since they were listed; begin a new job";
            return Err(InputError::unsupported("the inputs", what).into());
        }
        Ok(listed)
    }

    /// The land around the city; `None` if there is none. Fails if the inputs have changed, or if a model cannot be read.
    pub(super) fn land(&self, plan: &CityPlan) -> Result<Option<FarModels>, BakeError> {
        let Some(facts) = plan.land else { return Ok(None) };
        Ok(Some(self.list_inputs()?.land(&self.config.options.read, facts)?))
    }

    pub(super) fn chunks(&self) -> &[JobChunk] {
        &self.job.chunks
    }

    pub(super) fn region_leaves(&self) -> u32 {
        self.job.region_leaves
    }

    /// Warns of objects that were not removed.
    pub(super) fn warn_of_kept(&self, removed: &Removed) {
        warn_of_kept(&self.store.address(), removed, self.progress);
    }

    /// Fails if there is no task of this number.
    pub(super) fn check_task(&self, stage: &'static str, task: usize, tasks: usize) -> Result<(), BakeError> {
        if task < tasks { Ok(()) } else { Err(BakeError::StepTask { stage, task, tasks }) }
    }
}

/// Warns of objects that were not removed.
fn warn_of_kept(work: &str, removed: &Removed, progress: &dyn Progress) {
    for name in &removed.kept {
        progress.warn(&format!("{work}/{name}: no step wrote it as it is, so it stays"));
    }
}

/// Fails if something that the bake reads lies in its work store.
fn refuse_inside(store: &dyn WorkStore, options: &BakeOptions) -> Result<(), BakeError> {
    if let Some(folder) = store.folder() {
        check_place(folder, "--work", KeptFolder::WorkStore)?;
        return check_inputs(&[folder.to_owned()], "--work", options);
    }
    let below = store.address() + "/";
    let is_inside = |path: &PathBuf| path.to_str().is_some_and(|address| address.starts_with(&below));
    match options.read_paths().into_iter().find(is_inside) {
        Some(input) => Err(BakeError::Inside { input, place: store.address().into(), option: "--work" }),
        None => Ok(()),
    }
}

/// Whether the city of a job is complete.
fn has_city(store: OwnedStore<'_>, job: &Job) -> Result<bool, BakeError> {
    SealedStore { store, job: &job.id()? }.has(JOINED)
}

/// Collects sources of these sizes in chunks.
fn chunks(sizes: &[u64], chunk_bytes: u64) -> Vec<JobChunk> {
    let mut chunks: Vec<JobChunk> = Vec::new();
    for (first, size) in sizes.iter().enumerate() {
        match chunks.last_mut() {
            Some(chunk) if chunk.bytes.iter().sum::<u64>() < chunk_bytes => chunk.bytes.push(*size),
            _ => chunks.push(JobChunk { first, bytes: vec![*size] }),
        }
    }
    if chunks.is_empty() {
        // A city of elevation models alone.
        chunks.push(JobChunk { first: 0, bytes: Vec::new() });
    }
    chunks
}

#[cfg(test)]
mod tests {
    use super::super::work::WorkFolder;
    use super::*;
    use crate::progress::Silent;
    use insula_test_support::folder::TestFolder;

    #[test]
    fn chunks_have_the_sources_in_order() {
        let of = |chunk_bytes| chunks(&[5, 1, 2, 9, 1], chunk_bytes).into_iter().map(|c| c.bytes).collect::<Vec<_>>();
        assert_eq!(of(1), [vec![5], vec![1], vec![2], vec![9], vec![1]]);
        assert_eq!(of(6), [vec![5, 1], vec![2, 9], vec![1]]);
        assert_eq!(of(100), [vec![5, 1, 2, 9, 1]]);
        assert_eq!(chunks(&[5, 1, 2], 6)[1].first, 2);
        assert_eq!(chunks(&[], 6), [JobChunk { first: 0, bytes: Vec::new() }]);
    }

    #[test]
    fn a_job_that_reads_its_own_work_store_is_not_opened() {
        let folder = TestFolder::new("job-inside");
        let options = BakeOptions { out: folder.path.join("town"), ..BakeOptions::default() };
        let config = BakeConfig::new(&options).unwrap();
        let job = |input: &str| Job {
            steps: STEPS_VERSION,
            program: env!("CARGO_PKG_VERSION").to_owned(),
            settings: config.settings.clone(),
            algorithm: ALGORITHM,
            arguments: Vec::new(),
            name: config.name.clone(),
            inputs: vec![folder.path.join(input)],
            crs: None,
            region_leaves: 4,
            chunk_bytes: 1,
            postponed: Vec::new(),
            elevation: Vec::new(),
            chunks: chunks(&[1], 1),
            previous: None,
        };
        let store = WorkFolder::new(&folder.path.join("work"));
        let opened = |input| BakeSteps::open(&store, job(input), &options, &Silent).err();
        assert!(opened("a.geojson").is_none());
        assert!(matches!(opened("work/x/a.geojson"), Some(BakeError::Inside { .. })));
    }
}
