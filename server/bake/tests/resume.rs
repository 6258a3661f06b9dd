//! A bake that is interrupted, and one that goes on.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use std::{
    fs,
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    sync::{
        Mutex,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    thread,
    time::Duration,
};

use insula_bake::{BakeError, BakeOptions, Progress, Silent, report::ResumeStatus};
use support::{Folder, bake, files, options, partial};

/// Panics at the n-th step of a stage.
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
        let here = *self.now.lock().unwrap() == self.stage;
        if here && self.seen.fetch_add(n, Ordering::SeqCst) + n >= self.step {
            panic!("stopped");
        }
    }
}

fn interrupted(out: &Path, stage: &'static str, step: u64) {
    let stop = StopAt::new(stage, step);
    let result = catch_unwind(AssertUnwindSafe(|| bake(&options(out, 2), &stop)));
    assert!(result.is_err(), "{stage} has no step {step}");
    assert!(!out.exists(), "half a city");
    assert!(partial(out).join("state.json").exists());
}

fn resume(out: &Path) -> BakeOptions {
    BakeOptions { resume: true, ..options(out, 2) }
}

#[test]
fn stopped_anywhere_it_goes_on_to_the_same_bytes() {
    let folder = Folder::new("resume");
    bake(&options(&folder.out("whole"), 2), &Silent).unwrap();
    let whole = files(&folder.out("whole"));
    for (stage, step) in [("sample", 3), ("sample", 8), ("level 5", 2), ("level 2", 1), ("write", 1), ("write", 20)] {
        let out = folder.out(&format!("{stage}-{step}"));
        interrupted(&out, stage, step);
        let report = bake(&resume(&out), &Silent).unwrap();
        assert_eq!(report.start, ResumeStatus::Resumed);
        assert!(report.blocks_resumed > 0, "stopped in {stage} at {step}, and nothing was kept");
        assert!(stage == "write" || report.blocks_baked > 0);
        assert!(files(&out) == whole, "other bytes after a stop in {stage} at {step}");
        assert!(!partial(&out).exists());
    }
}

#[test]
fn damaged_work_is_done_again() {
    let folder = Folder::new("damaged");
    bake(&options(&folder.out("whole"), 2), &Silent).unwrap();
    let out = folder.out("damaged");
    interrupted(&out, "level 3", 1);
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
    assert!(files(&out) == files(&folder.out("whole")));
}

#[test]
fn without_resume_or_with_other_settings_it_starts_anew() {
    let folder = Folder::new("anew");
    let out = folder.out("stale");
    interrupted(&out, "sample", 8);
    fs::write(partial(&out).join("packs/foreign"), "x").unwrap();
    let report = bake(&options(&out, 2), &Silent).unwrap();
    assert_eq!((report.start, report.blocks_resumed), (ResumeStatus::Discarded, 0));

    let out = folder.out("mismatch");
    interrupted(&out, "sample", 8);
    let report = bake(&BakeOptions { cell_m: 2.0, ..resume(&out) }, &Silent).unwrap();
    assert_eq!((report.start, report.blocks_resumed), (ResumeStatus::Mismatch, 0));
    bake(&BakeOptions { cell_m: 2.0, ..options(&folder.out("two"), 2) }, &Silent).unwrap();
    assert!(files(&out) == files(&folder.out("two")));

    let report = bake(&resume(&folder.out("fresh")), &Silent).unwrap();
    assert_eq!(report.start, ResumeStatus::Fresh);
}

/// Finishes a few blocks of leaves, says so by a file, and waits to be killed.
struct WaitAt {
    block: u64,
    reached: PathBuf,
    seen: AtomicU64,
    in_leaves: AtomicBool,
}

impl Progress for WaitAt {
    fn stage(&self, name: &str, _total: u64) {
        self.in_leaves.store(name == "sample", Ordering::SeqCst);
    }
    fn advance(&self, _n: u64) {
        // Told once a block, after its packs are written.
        if self.in_leaves.load(Ordering::SeqCst) && self.seen.fetch_add(1, Ordering::SeqCst) + 1 >= self.block {
            fs::write(&self.reached, "").unwrap();
            loop {
                thread::park();
            }
        }
    }
}

const CHILD_OUT: &str = "INSULA_BAKE_TEST_OUT";
const CHILD_BLOCK: &str = "INSULA_BAKE_TEST_BLOCK";

/// The file by which a child says that it waits.
fn reached(out: &Path) -> PathBuf {
    out.with_file_name("reached")
}

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
    std::env::var_os(CHILD_OUT).expect("only other tests start this one").into()
}

#[test]
#[ignore = "started and killed by `killed_it_goes_on`"]
fn child_that_is_killed() {
    let (out, block) = (child_out(), std::env::var(CHILD_BLOCK).unwrap().parse().unwrap());
    let wait = WaitAt { block, reached: reached(&out), seen: AtomicU64::new(0), in_leaves: AtomicBool::new(false) };
    let _ = bake(&resume(&out), &wait);
}

#[test]
fn killed_it_goes_on() {
    let folder = Folder::new("killed");
    bake(&options(&folder.out("whole"), 2), &Silent).unwrap();
    let whole = files(&folder.out("whole"));
    let out = folder.out("killed");
    // The first leaves two or three of five blocks, for there are two threads; the second finds those.
    for block in ["2", "4"] {
        let mut child = child(None, "child_that_is_killed", &out).env(CHILD_BLOCK, block).spawn().unwrap();
        while !reached(&out).exists() {
            assert!(child.try_wait().unwrap().is_none(), "it ended before it was killed");
            thread::sleep(Duration::from_millis(2));
        }
        child.kill().unwrap();
        child.wait().unwrap();
        fs::remove_file(reached(&out)).unwrap();
        assert!(!out.exists());
    }
    let report = bake(&resume(&out), &Silent).unwrap();
    assert_eq!(report.start, ResumeStatus::Resumed);
    assert!(report.blocks_resumed >= 4 && report.blocks_baked > 0, "{report:?}");
    assert!(files(&out) == whole);
}

#[test]
#[ignore = "started under a file size limit by `a_full_disk_leaves_no_city`"]
fn child_on_a_full_disk() {
    let out = child_out();
    let error = bake(&options(&out, 2), &Silent).unwrap_err();
    assert!(matches!(error, BakeError::DiskFull { .. }), "{error}");
    assert!(!error.to_string().contains('\n') && error.to_string().contains("--resume"));
    assert!(!out.exists());
}

#[test]
#[cfg(unix)]
fn a_full_disk_leaves_no_city() {
    let folder = Folder::new("full");
    let out = folder.out("full");
    // Files of at most 8 KiB (16 KiB where the shell counts in KiB): an archive's head alone is larger.
    let script = "trap '' XFSZ; ulimit -f 16; exec \"$0\" \"$@\"";
    let status = child(Some(script), "child_on_a_full_disk", &out).status().unwrap();
    assert!(status.success());
    let report = bake(&resume(&out), &Silent).unwrap();
    assert!(report.start == ResumeStatus::Resumed && out.join("city.json").exists());
}
