//! `tasks`, `status` and `abort`: how much there is to do, what is done, and an end without a city.

use super::{
    crown,
    job::{JOB, Steps},
    layout::PLAN,
    region_file::index_name,
    work::WorkStore,
};
use crate::error::BakeError;

/// A stage of the steps, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    Scan,
    Plan,
    Shuffle,
    Region,
    Crown,
    Join,
}

/// A stage, and how many of its tasks are done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StageStatus {
    pub stage: Stage,
    /// `None` until the plan is made.
    pub tasks: Option<usize>,
    pub done: usize,
}

impl Stage {
    /// All stages with their names on the command line.
    pub const NAMES: [(&'static str, Self); 6] = [
        ("scan", Self::Scan),
        ("plan", Self::Plan),
        ("shuffle", Self::Shuffle),
        ("region", Self::Region),
        ("crown", Self::Crown),
        ("join", Self::Join),
    ];
}

impl Steps<'_> {
    /// Number of a stage's tasks. Fails if it follows from the plan, and there is none.
    pub fn tasks(&self, stage: Stage) -> Result<usize, BakeError> {
        Ok(match stage {
            Stage::Scan => self.chunks().len(),
            Stage::Plan | Stage::Crown | Stage::Join => 1,
            Stage::Shuffle => self.read_plan()?.chunks,
            Stage::Region => self.read_plan()?.regions.len(),
        })
    }

    /// How many tasks of each stage are done. Fails if the store does not answer.
    pub fn status(&self) -> Result<Vec<StageStatus>, BakeError> {
        let objects = self.objects();
        let has_plan = objects.has(PLAN)?;
        let count = |folder: &str, end: &str| {
            let names = objects.store.list(folder).map_err(|cause| objects.failed(folder, cause))?;
            Ok::<_, BakeError>(names.iter().filter(|name| name.ends_with(end)).count())
        };
        let status = |(_, stage): (&str, Stage)| {
            let done = match stage {
                Stage::Scan => count("scan", "/head")?,
                Stage::Plan => has_plan.into(),
                Stage::Shuffle => count("shuffle", "/index")?,
                Stage::Region => count("region", "/index")?,
                Stage::Crown => objects.has(&index_name(crown::FOLDER))?.into(),
                Stage::Join => objects.has("city/city.json")?.into(),
            };
            let follows = matches!(stage, Stage::Shuffle | Stage::Region);
            let tasks = if follows && !has_plan { None } else { Some(self.tasks(stage)?) };
            Ok(StageStatus { stage, tasks, done })
        };
        Stage::NAMES.into_iter().map(status).collect()
    }
}

/// Removes the job and all results of its steps, but not a finished city. Returns the number of removed objects. Fails if the store does not answer.
pub fn abort(store: &dyn WorkStore) -> Result<usize, BakeError> {
    let failed = |name: &str| {
        let (work, name) = (store.address(), name.to_owned());
        move |cause| BakeError::Work { work, name, cause }
    };
    // First, so that a step that begins now finds no job.
    let mut removed = usize::from(store.size(JOB).map_err(failed(JOB))?.is_some());
    store.remove(JOB).map_err(failed(JOB))?;
    for folder in ["temporary", "scan", "pic", "plan", "shuffle", "region", "crown", "join"] {
        for name in store.list(folder).map_err(failed(folder))? {
            store.remove(&name).map_err(failed(&name))?;
            removed += 1;
        }
    }
    Ok(removed)
}
