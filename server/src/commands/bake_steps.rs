//! `bake STEP --work URL`: one step of a bake that many machines run.

use super::bake_progress::BakeProgress;
use super::error::CommandError;
use super::output::print;
use super::{bake, work_store};
use crate::args::{Args, BakeArgs, ServerCommand};
use crate::memory;
use clap::Parser;
use insula_archive::file::read_text;
use insula_archive::new_file;
use insula_archive::places::canonical;
use insula_bake::{
    AbortedJob, BakeError, BakeOptions, BakeStage, BakeSteps, DEFAULT_CHUNK_BYTES, DEFAULT_REGION_LEAVES, Job,
    JobRequest, WorkStore, abort,
};
use insula_source::remote::is_address;
use std::path::{Path, PathBuf};

/// Longest file with the hash of a job.
const MAX_HASH_BYTES: u64 = 1024;

/// A step as it is typed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum BakeStep {
    Begin,
    Run(BakeStage, usize),
    Tasks(BakeStage),
    Status,
    Abort,
}

/// Runs the step that the inputs of the command line name. Fails if there is no such step, or if it fails.
pub(super) fn run(args: &BakeArgs, work: &str) -> Result<(), CommandError> {
    let words: Vec<String> = args.inputs.iter().map(|word| word.to_string_lossy().into_owned()).collect();
    let step = parse(&words.iter().map(String::as_str).collect::<Vec<_>>(), !args.step_inputs.is_empty())?;
    let store = work_store::open(work)?;
    match step {
        BakeStep::Begin => begin(args, &*store),
        BakeStep::Abort => {
            let AbortedJob { objects, uploads, kept } = abort(&*store).map_err(of_step)?;
            kept.iter().for_each(|name| print(&format!("{work}/{name}: no step wrote it as it is, so it stays\n")));
            uploads
                .iter()
                .for_each(|name| print(&format!("{work}/{name}: an upload that was not completed is ended\n")));
            print(&format!("{work}: {objects} objects removed, {} uploads ended\n", uploads.len()));
            Ok(())
        }
        BakeStep::Run(..) | BakeStep::Tasks(_) | BakeStep::Status => in_job(args, &*store, step),
    }
}

/// The step of these words. Fails with all steps if there is none.
fn parse(words: &[&str], has_inputs: bool) -> Result<BakeStep, CommandError> {
    let stage = |word: &str| BakeStage::NAMES.iter().find(|(name, _)| *name == word).map(|(_, stage)| *stage);
    let number = |word: &str| word.parse::<usize>().ok();
    let found = match words {
        ["plan"] if has_inputs => Some(BakeStep::Begin),
        ["status"] => Some(BakeStep::Status),
        ["abort"] => Some(BakeStep::Abort),
        ["join", step] => {
            stage(&format!("join-{step}")).filter(|stage| stage.is_single()).map(|stage| BakeStep::Run(stage, 0))
        }
        ["join", "part", task] => number(task).map(|task| BakeStep::Run(BakeStage::JoinPart, task)),
        ["tasks", "join", step] => stage(&format!("join-{step}")).map(BakeStep::Tasks),
        ["tasks", name] => stage(name).map(BakeStep::Tasks),
        [name] => stage(name).filter(|stage| stage.is_single()).map(|stage| BakeStep::Run(stage, 0)),
        [name, task] => stage(name).zip(number(task)).map(|(stage, task)| BakeStep::Run(stage, task)),
        _ => None,
    };
    found.filter(|_| !has_inputs || words == ["plan"]).ok_or_else(|| {
        let steps = "plan --inputs FILE..., scan I, plan, shuffle I, region R, crown, join plan, join part P, join finish, \
                     tasks STAGE, status, abort";
        CommandError::Usage(format!("{}: no step of a bake; the steps are {steps}", words.join(" ")))
    })
}

/// Lists the inputs and writes the job.
fn begin(args: &BakeArgs, store: &dyn WorkStore) -> Result<(), CommandError> {
    let options = options_of(args)?;
    memory::set_limit(options.memory_limit_bytes());
    let request = JobRequest {
        arguments: std::env::args().skip(1).collect(),
        chunk_bytes: args.chunk.unwrap_or(DEFAULT_CHUNK_BYTES),
        region_leaves: args.region.unwrap_or(DEFAULT_REGION_LEAVES),
        is_update: args.update,
    };
    check_hash_file(store)?;
    let progress = BakeProgress::start(Path::new(&store.address()));
    let job = BakeSteps::begin(store, &options, &request, &progress);
    progress.clear();
    let job = job.map_err(of_step)?;
    let hash = job.hash().map_err(of_step)?;
    let kept = hash_file(store).is_some_and(|path| new_file::replace(&path, format!("{hash}\n").as_bytes()).is_ok());
    print(&format!("{}: {} scans\njob {hash}\n", store.address(), job.scans()));
    if !kept {
        eprintln!("note: steps of this job need --job {hash}, or INSULA_JOB");
    }
    Ok(())
}

/// The file beside a folder of results that has the hash of its job: who can write results only cannot change it.
fn hash_file(store: &dyn WorkStore) -> Option<PathBuf> {
    let folder = canonical(store.folder()?);
    let mut name = folder.file_name()?.to_owned();
    name.push(".job");
    Some(folder.with_file_name(name))
}

/// Fails if another file has the name of the one with the hash.
fn check_hash_file(store: &dyn WorkStore) -> Result<(), CommandError> {
    let foreign = hash_file(store).filter(|path| path.symlink_metadata().is_ok() && read_hash(path).is_none());
    foreign.map_or(Ok(()), |path| {
        let reason =
            "the hash of the job goes into a file of this name, and this is none; move it, or give another --work";
        Err(CommandError::Usage(format!("{}: {reason}", path.display())))
    })
}

fn read_hash(path: &Path) -> Option<String> {
    let text = read_text(path, MAX_HASH_BYTES).ok()?;
    let is_hash = |text: &&str| text.len() == 64 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
    Some(text.trim()).filter(is_hash).map(str::to_owned)
}

/// Fails if the job in the store is not the one that was begun, or if it names files of this machine and nothing says that it is. Who can
/// write to the store could name any file.
fn check_job(args: &BakeArgs, store: &dyn WorkStore, job: &Job, of_job: &BakeArgs) -> Result<(), CommandError> {
    let wrong = |what: &str| Err(CommandError::Final(format!("{}/job.json: {what}", store.address())));
    let known =
        args.job.clone().filter(|job| !job.is_empty()).or_else(|| hash_file(store).and_then(|path| read_hash(&path)));
    match known {
        Some(known) if known.trim() == job.hash().map_err(of_step)? => Ok(()),
        Some(_) => wrong(
            "it is not the job that `bake plan` began; begin it again, or give the --job that `bake plan` printed",
        ),
        None if names_files(job, of_job) => wrong(
            "it names files of this machine, and nothing says that `bake plan` did; give the --job that `bake plan` printed",
        ),
        None => Ok(()),
    }
}

/// Whether a job reads anything but addresses.
fn names_files(job: &Job, args: &BakeArgs) -> bool {
    let mut inputs = args.step_inputs.iter().chain(&job.inputs).chain(&args.streets).chain(&args.surroundings);
    // The rule by which the bake reads them: `a://../b` is a file.
    let is_address = |path: &PathBuf| path.to_str().is_some_and(is_address);
    // The folder of grids may also be one that this machine's environment names.
    let has_grids = args.read.grids.is_some() && job.arguments.iter().any(|word| word.starts_with("--grids"));
    let has_others = !args.texture_root.is_empty() || args.landmarks.is_some() || has_grids;
    !inputs.all(is_address) || !bake::named_files(args).is_empty() || has_others
}

/// The options of a job, with the inputs in their place.
fn options_of(args: &BakeArgs) -> Result<BakeOptions, CommandError> {
    let mut of_inputs = args.clone();
    of_inputs.inputs = args.step_inputs.clone();
    bake::options(&of_inputs, bake::palette(&of_inputs)?)
}

/// Runs a step of the job in the store, with its options. Threads and memory of this command line take precedence.
fn in_job(args: &BakeArgs, store: &dyn WorkStore, step: BakeStep) -> Result<(), CommandError> {
    let job = Job::read(store).map_err(of_step)?;
    let damaged = || CommandError::Final(format!("{}/job.json: its arguments are damaged", store.address()));
    let line = ["insula-server".to_owned()].into_iter().chain(job.arguments.iter().cloned());
    let ServerCommand::Bake(of_job) = Args::try_parse_from(line).map_err(|_| damaged())?.command else {
        return Err(damaged());
    };
    check_job(args, store, &job, &of_job)?;
    let mut options = options_of(&of_job)?;
    options.threads = args.threads.map(usize::from).or(options.threads);
    options.memory_bytes = args.memory.or(options.memory_bytes);
    memory::set_limit(options.memory_limit_bytes());
    let progress = BakeProgress::start(Path::new(&store.address()));
    let steps = BakeSteps::open(store, job, &options, &progress).map_err(of_step)?;
    let text = match step {
        BakeStep::Run(stage, task) => steps.run(stage, task).map(|()| String::new()),
        BakeStep::Tasks(stage) => steps.tasks(stage).map(|tasks| format!("{tasks}\n")),
        _ => steps.status().map(|all| all.iter().map(status_line).collect()),
    };
    progress.clear();
    let text = text.map_err(of_step)?;
    if !text.is_empty() {
        print(&text);
    }
    Ok(())
}

fn status_line(status: &insula_bake::StageStatus) -> String {
    let name = BakeStage::NAMES.iter().find(|(_, stage)| *stage == status.stage).map_or("", |(name, _)| name);
    let tasks = status.tasks.map_or("?".to_owned(), |tasks| tasks.to_string());
    format!("{name} {} of {tasks}\n", status.done)
}

/// The error of a step: its exit code tells whether a retry may help.
fn of_step(error: BakeError) -> CommandError {
    if error.is_final() { CommandError::Final(error.to_string()) } else { CommandError::Bake(error.to_string()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_words_and_numbers() {
        for (words, step) in [
            (&["plan"][..], BakeStep::Run(BakeStage::Plan, 0)),
            (&["scan", "7"], BakeStep::Run(BakeStage::Scan, 7)),
            (&["region", "10000"], BakeStep::Run(BakeStage::Region, 10_000)),
            (&["join", "finish"], BakeStep::Run(BakeStage::JoinFinish, 0)),
            (&["join-plan"], BakeStep::Run(BakeStage::JoinPlan, 0)),
            (&["join", "part", "3"], BakeStep::Run(BakeStage::JoinPart, 3)),
            (&["tasks", "join-part"], BakeStep::Tasks(BakeStage::JoinPart)),
            (&["tasks", "shuffle"], BakeStep::Tasks(BakeStage::Shuffle)),
            (&["status"], BakeStep::Status),
            (&["abort"], BakeStep::Abort),
        ] {
            assert_eq!(parse(words, false).unwrap(), step, "{words:?}");
        }
        assert_eq!(parse(&["plan"], true).unwrap(), BakeStep::Begin);
        for words in [&["scan"][..], &["scan", "-1"], &["scan", "1", "2"], &["city.json"], &["tasks", "all"], &[]] {
            assert!(matches!(parse(words, false), Err(CommandError::Usage(_))), "{words:?}");
        }
        assert!(parse(&["scan", "1"], true).is_err(), "only the plan takes inputs");
    }
}
