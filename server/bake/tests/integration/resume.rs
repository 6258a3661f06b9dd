//! Bakes that are interrupted and resumed.

use super::support::{BakedCity, bake, city, coarse_options, files, options, out_folder, partial};
use super::update::raised;
use insula_bake::read::ReadReport;
use insula_bake::report::ResumeStatus;
use insula_bake::{BakeError, BakeOptions, Progress, Silent, bake_scene};
use insula_test_support::folder::TestFolder;
use std::io::{BufRead, BufReader, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::{fs, thread};

/// Panics at a step of a stage.
struct StopAt {
    stage: &'static str,
    step: u64,
    seen: AtomicU64,
    now: Mutex<String>,
}

impl StopAt {
    fn new(stage: &'static str, step: u64) -> Self {
        Self { stage, step, seen: AtomicU64::new(0), now: Mutex::new(String::new()) }
    }
}

impl Progress for StopAt {
    fn stage(&self, name: &str, _total: u64) {
        *self.now.lock().unwrap() = name.to_owned();
    }
    fn advance(&self, n: u64) {
        let is_in_stage = *self.now.lock().unwrap() == self.stage;
        if is_in_stage && self.seen.fetch_add(n, Ordering::SeqCst) + n >= self.step {
            panic!("stopped");
        }
    }
}

/// Bakes until a step of a stage, and checks that there is no city yet.
fn interrupt(out: &Path, stage: &'static str, step: u64) {
    let stop = StopAt::new(stage, step);
    let result = catch_unwind(AssertUnwindSafe(|| bake(&options(out, 2), &stop)));
    assert!(result.is_err(), "{stage} has no step {step}");
    assert!(!out.exists(), "an incomplete city");
    assert!(partial(out).join("packs").is_dir());
}

fn resume(out: &Path) -> BakeOptions {
    BakeOptions { resume: true, ..options(out, 2) }
}

#[test]
fn resumed_bake_gives_the_same_bytes_wherever_it_was_interrupted() {
    let folder = TestFolder::new("resume");
    for (stage, step) in [("sample", 3), ("sample", 8), ("level 5", 2), ("level 2", 1), ("write", 1), ("write", 20)] {
        let out = out_folder(&folder, &format!("{stage}-{step}"));
        interrupt(&out, stage, step);
        let report = bake(&resume(&out), &Silent).unwrap();
        assert_eq!(report.start, ResumeStatus::Resumed);
        assert!(report.blocks_resumed > 0, "interrupted in {stage} at {step}, and nothing was resumed");
        assert!(stage == "write" || report.blocks_baked > 0);
        assert!(files(&out) == BakedCity::boxes().files, "other bytes after an interruption in {stage} at {step}");
        assert!(!partial(&out).exists());
    }
}

#[test]
fn damaged_packs_are_baked_again() {
    let folder = TestFolder::new("damaged");
    let out = out_folder(&folder, "damaged");
    interrupt(&out, "level 3", 1);
    let packs = partial(&out).join("packs");
    for (i, pack) in fs::read_dir(&packs).unwrap().enumerate() {
        let path = pack.unwrap().path();
        let bytes = fs::read(&path).unwrap();
        match i % 3 {
            0 => fs::write(path, &bytes[..bytes.len() / 2]).unwrap(),
            1 => fs::write(path, []).unwrap(),
            _ => {}
        }
    }
    bake(&resume(&out), &Silent).unwrap();
    assert!(files(&out) == BakedCity::boxes().files);
}

#[test]
fn blocks_without_changes_are_resumed_after_a_change_elsewhere() {
    let folder = TestFolder::new("resume-changed");
    let out = out_folder(&folder, "changed");
    interrupt(&out, "level 3", 1);
    let report = bake_scene(raised(city(), 2), ReadReport::default(), &resume(&out), &Silent).unwrap();
    assert_eq!(report.start, ResumeStatus::Resumed);
    assert!(report.blocks_resumed > 0 && report.blocks_baked > 0, "{report:?}");
    let whole = BakedCity::bake("resume-changed-full", raised(city(), 2), options(Path::new(""), 2));
    assert!(files(&out) == whole.files, "other bytes than a full bake");
}

#[test]
fn packs_are_discarded_without_resume_or_with_different_settings() {
    let folder = TestFolder::new("discard");
    let out = out_folder(&folder, "stale");
    interrupt(&out, "sample", 1);
    // A file that no bake wrote ends it.
    let foreign = partial(&out).join("packs/foreign.pack");
    fs::write(&foreign, "x").unwrap();
    let refused = bake(&coarse_options(&out), &Silent).unwrap_err().to_string();
    assert!(refused.contains("foreign.pack") && foreign.is_file(), "{refused}");
    fs::remove_file(foreign).unwrap();
    let report = bake(&coarse_options(&out), &Silent).unwrap();
    assert_eq!((report.start, report.blocks_resumed), (ResumeStatus::Discarded, 0));
    let expected = files(&out);

    let out = out_folder(&folder, "mismatch");
    interrupt(&out, "sample", 1);
    let report = bake(&BakeOptions { resume: true, ..coarse_options(&out) }, &Silent).unwrap();
    assert_eq!((report.start, report.blocks_resumed), (ResumeStatus::Mismatch, 0));
    assert!(files(&out) == expected);

    let report = bake(&BakeOptions { resume: true, ..coarse_options(&out_folder(&folder, "fresh")) }, &Silent).unwrap();
    assert_eq!(report.start, ResumeStatus::Fresh);
}

/// What a child prints before it waits to be killed.
const REACHED: &str = "reached the block";

/// Finishes a few blocks of leaves, then says so and waits to be killed.
struct WaitAt {
    block: u64,
    seen: AtomicU64,
    in_leaves: AtomicBool,
}

impl Progress for WaitAt {
    fn stage(&self, name: &str, _total: u64) {
        self.in_leaves.store(name == "sample", Ordering::SeqCst);
    }
    fn advance(&self, _n: u64) {
        // Called once per block, after its packs are written.
        if self.in_leaves.load(Ordering::SeqCst) && self.seen.fetch_add(1, Ordering::SeqCst) + 1 >= self.block {
            // Not by `println!`, which the test harness captures.
            let mut out = std::io::stdout();
            writeln!(out, "{REACHED}").and_then(|()| out.flush()).unwrap();
            loop {
                thread::park();
            }
        }
    }
}

const CHILD_OUT: &str = "INSULA_BAKE_TEST_OUT";
const CHILD_BLOCK: &str = "INSULA_BAKE_TEST_BLOCK";

/// This program with one of its ignored tests, by way of a shell script if there is one.
fn child(shell: Option<&str>, test: &str, out: &Path) -> Command {
    let own = std::env::current_exe().unwrap();
    let mut command = match shell {
        Some(script) => {
            let mut command = Command::new("sh");
            command.args(["-c", script]).arg(own);
            command
        }
        None => Command::new(own),
    };
    command.args(["--ignored", "--exact", test]).env(CHILD_OUT, out).stdout(Stdio::null()).stderr(Stdio::null());
    command
}

fn child_out() -> PathBuf {
    std::env::var_os(CHILD_OUT).expect("this test is started by other tests").into()
}

#[test]
#[ignore = "started and killed by `killed_bake_is_resumed`"]
fn child_that_is_killed() {
    let (out, block) = (child_out(), std::env::var(CHILD_BLOCK).unwrap().parse().unwrap());
    let wait = WaitAt { block, seen: AtomicU64::new(0), in_leaves: AtomicBool::new(false) };
    let _ = bake(&resume(&out), &wait);
}

#[test]
fn killed_bake_is_resumed() {
    let folder = TestFolder::new("killed");
    let out = out_folder(&folder, "killed");
    // With two threads, the first child finishes two or three blocks. The second resumes these.
    for block in ["2", "4"] {
        let mut command = child(None, "resume::child_that_is_killed", &out);
        let mut child = command.env(CHILD_BLOCK, block).stdout(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        // The harness may have begun the line.
        let has_reached = lines.any(|line| line.unwrap().ends_with(REACHED));
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(has_reached, "the child ended before it was killed");
        assert!(!out.exists());
    }
    let report = bake(&resume(&out), &Silent).unwrap();
    assert_eq!(report.start, ResumeStatus::Resumed);
    assert!(report.blocks_resumed >= 4 && report.blocks_baked > 0, "{report:?}");
    assert!(files(&out) == BakedCity::boxes().files);
}

#[test]
#[ignore = "started with a file size limit by `full_disk_leaves_no_city`"]
fn child_on_a_full_disk() {
    let out = child_out();
    let error = bake(&coarse_options(&out), &Silent).unwrap_err();
    assert!(matches!(error, BakeError::DiskFull { .. }), "{error}");
    assert!(!error.to_string().contains('\n') && error.to_string().contains("--resume"));
    assert!(!out.exists());
}

#[test]
#[cfg(unix)]
fn full_disk_leaves_no_city() {
    let folder = TestFolder::new("full");
    let out = out_folder(&folder, "full");
    // Files of at most 8 KiB (16 KiB where the shell counts in KiB): the header of an archive is larger.
    let script = "trap '' XFSZ; ulimit -f 16; exec \"$0\" \"$@\"";
    let status = child(Some(script), "resume::child_on_a_full_disk", &out).status().unwrap();
    assert!(status.success());
    let report = bake(&BakeOptions { resume: true, ..coarse_options(&out) }, &Silent).unwrap();
    assert!(report.start == ResumeStatus::Resumed && out.join("city.json").exists());
}
