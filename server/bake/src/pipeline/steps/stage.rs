//! `tasks`, `status` and `abort`: how much there is to do, what is done, and an end without a city.

use super::job::{BakeSteps, JOB};
use super::join::{CITY, JOIN_PLAN};
use super::layout::{FOLDERS, JOINED, PLAN};
use super::owned::OwnedStore;
use super::region_file::index_name;
use super::scan::head_name;
use super::sealed::Removed;
use super::work::WorkStore;
use super::{crown, region, shuffle};
use crate::error::BakeError;

/// A stage of the steps, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BakeStage {
    Scan,
    Plan,
    Shuffle,
    Region,
    Crown,
    JoinPlan,
    JoinPart,
    JoinFinish,
}

/// A stage, and how many of its tasks are done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StageStatus {
    pub stage: BakeStage,
    /// `None` until the plan is made.
    pub tasks: Option<usize>,
    pub done: usize,
}

impl BakeStage {
    /// All stages with their names on the command line.
    pub const NAMES: [(&'static str, Self); 8] = [
        ("scan", Self::Scan),
        ("plan", Self::Plan),
        ("shuffle", Self::Shuffle),
        ("region", Self::Region),
        ("crown", Self::Crown),
        ("join-plan", Self::JoinPlan),
        ("join-part", Self::JoinPart),
        ("join-finish", Self::JoinFinish),
    ];

    /// Whether the stage has one task.
    #[must_use]
    pub fn is_single(self) -> bool {
        matches!(self, Self::Plan | Self::Crown | Self::JoinPlan | Self::JoinFinish)
    }
}

impl BakeSteps<'_> {
    /// Number of a stage's tasks. Fails if it follows from the plan, and there is none.
    pub fn tasks(&self, stage: BakeStage) -> Result<usize, BakeError> {
        Ok(match stage {
            BakeStage::Scan => self.chunks().len(),
            BakeStage::Plan | BakeStage::Crown | BakeStage::JoinPlan | BakeStage::JoinFinish => 1,
            BakeStage::Shuffle => self.read_plan()?.chunks,
            BakeStage::Region => self.read_plan()?.regions.len(),
            BakeStage::JoinPart => self.join_parts()?,
        })
    }

    /// Runs a task of a stage, unless its result is there. Fails if there is no such task, or as the stage does.
    pub fn run(&self, stage: BakeStage, task: usize) -> Result<(), BakeError> {
        if self.has_result(stage, task)? {
            return Ok(());
        }
        match stage {
            BakeStage::Scan => self.scan(task),
            BakeStage::Plan => self.plan(),
            BakeStage::Shuffle => self.shuffle(task),
            BakeStage::Region => self.region(task),
            BakeStage::Crown => self.crown(),
            BakeStage::JoinPlan => self.join_plan(),
            BakeStage::JoinPart => self.join_part(task),
            BakeStage::JoinFinish => self.join_finish(),
        }
    }

    fn has_result(&self, stage: BakeStage, task: usize) -> Result<bool, BakeError> {
        let name = match stage {
            BakeStage::Scan => head_name(task),
            BakeStage::Plan => PLAN.to_owned(),
            BakeStage::Shuffle => shuffle::index_name(task),
            BakeStage::Region => index_name(&region::folder_name(task)),
            BakeStage::Crown => index_name(crown::FOLDER),
            BakeStage::JoinPlan => JOIN_PLAN.to_owned(),
            // Its receipt may be that of another upload, which the stage looks at.
            BakeStage::JoinPart => return Ok(false),
            BakeStage::JoinFinish => JOINED.to_owned(),
        };
        self.objects().has(&name)
    }

    /// How many tasks of each stage are done. Fails if the store does not answer.
    pub fn status(&self) -> Result<Vec<StageStatus>, BakeError> {
        let objects = self.objects();
        let (has_plan, has_join) = (objects.has(PLAN)?, objects.has(JOIN_PLAN)?);
        let names = |folder: &str| objects.store.list(folder).map_err(|cause| objects.failed(folder, cause));
        let count = |folder: &str, end: &str| {
            Ok::<_, BakeError>(names(folder)?.iter().filter(|name| name.ends_with(end)).count())
        };
        let status = |(_, stage): (&str, BakeStage)| {
            let done = match stage {
                BakeStage::Scan => count("scan", "/head")?,
                BakeStage::Shuffle => count("shuffle", "/index")?,
                BakeStage::Region => count("region", "/index")?,
                BakeStage::JoinPart => names("join")?.iter().filter(|name| name.starts_with("join/receipt-")).count(),
                _ => self.has_result(stage, 0)?.into(),
            };
            let is_known = match stage {
                BakeStage::Shuffle | BakeStage::Region => has_plan,
                BakeStage::JoinPart => has_join,
                _ => true,
            };
            let tasks = if is_known { Some(self.tasks(stage)?) } else { None };
            Ok(StageStatus { stage, tasks, done })
        };
        BakeStage::NAMES.into_iter().map(status).collect()
    }
}

/// What [`abort`] has removed.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct AbortedJob {
    /// Number of objects.
    pub objects: usize,
    /// Names of the objects whose upload was begun and not completed.
    pub uploads: Vec<String>,
    /// Names of the objects that stay because no step wrote them as they are.
    pub kept: Vec<String>,
}

/// Most requests for uploads that were not completed: of up to a thousand each.
const MAX_LISTS: usize = 1000;

/// Removes the job and all results of its steps as they were written, but not a finished city, and ends all uploads of steps that were not
/// completed, of whatever job. No step may run meanwhile. Fails if no bake made the store, or if it does not answer.
pub fn abort(store: &dyn WorkStore) -> Result<AbortedJob, BakeError> {
    let store = OwnedStore::new(store);
    let failed = |name: &str| {
        let (work, name) = (store.address(), name.to_owned());
        move |cause| BakeError::work(work, &name, cause)
    };
    if !store.is_marked().map_err(failed(JOB))? {
        return match store.size(JOB) {
            Ok(None) => Ok(AbortedJob::default()),
            _ => {
                let what = "no bake made this work store, so nothing is removed; check --work";
                Err(BakeError::StepDamaged { work: store.address(), name: JOB.to_owned(), what })
            }
        };
    }
    let mut removed = Removed::default();
    // First, so that a step that begins now finds no job.
    removed.remove(store, &[JOB.to_owned()])?;
    let uploads = end_uploads(store)?;
    let is_complete = store.size(&format!("{CITY}/city.json")).map_err(failed(CITY))?.is_some();
    let is_left = |name: &str| is_complete && name.starts_with("city/");
    // What is recorded and was never written is forgotten, too.
    let mut names: Vec<String> = store.recorded().map_err(failed("list"))?;
    for folder in FOLDERS.into_iter().filter(|folder| !(is_complete && *folder == CITY)) {
        names.extend(store.list(folder).map_err(failed(folder))?);
    }
    names.retain(|name| name != JOB && !is_left(name));
    names.sort_unstable();
    names.dedup();
    removed.remove(store, &names)?;
    names.push(JOB.to_owned());
    store.remove_folders(&names);
    let Removed { objects, kept } = removed;
    if kept.is_empty() && !is_complete {
        store.unmark().map_err(failed("insula-work"))?;
    }
    Ok(AbortedJob { objects, uploads, kept })
}

/// Ends the uploads that steps began. Fails if the store does not answer.
fn end_uploads(store: OwnedStore<'_>) -> Result<Vec<String>, BakeError> {
    let failed = |name: &str| {
        let (work, name) = (store.address(), name.to_owned());
        move |cause| BakeError::work(work, &name, cause)
    };
    let mut ended = Vec::new();
    for _ in 0..MAX_LISTS {
        let before = ended.len();
        for (name, ticket) in store.begun_parts().map_err(failed("uploads"))? {
            // The folder's files that are not complete have names of their own; in a bucket, others may upload, too.
            if name == ticket || store.has_record(&name).map_err(failed(&name))? {
                store.abort_parts(&name, &ticket).map_err(failed(&name))?;
                ended.push(name);
            }
        }
        if ended.len() == before {
            break;
        }
    }
    Ok(ended)
}
