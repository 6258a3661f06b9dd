//! Chromium as a process group with a folder of its own.

use crate::programs::find_installed;
use anyhow::{Context, Result};
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Duration;
use tempfile::TempDir;

/// Chromium speaks the protocol on descriptors 3 and 4; a shell makes them from its input and output.
const WITH_PIPES: &str = r#"exec "$0" "$@" 3<&0 4>&1 </dev/null >/dev/null"#;
/// Nothing that the browser itself would fetch, and no other process than those of its group.
const FLAGS: [&str; 15] = [
    "--headless=new", "--no-sandbox", "--remote-debugging-pipe", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-breakpad",
    "--disable-crash-reporter", "--disable-dev-shm-usage", "--hide-scrollbars", "--mute-audio",
    "--force-color-profile=srgb",
    // As large as the largest page: each page sets its own size.
    "--window-size=1440,900",
];
/// Without the last one, any WebGPU canvas ends the GPU process, and pages look settled and blank.
const WITH_GPU: [&str; 4] =
    ["--enable-unsafe-webgpu", "--enable-features=Vulkan", "--use-vulkan=swiftshader", "--use-angle=swiftshader"];
const NAMES: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];
/// Tries to remove the folder, into which the ended processes may still write.
const REMOVALS: usize = 20;

pub(super) fn find() -> Option<PathBuf> {
    match std::env::var_os("INSULA_CHROMIUM").filter(|path| !path.is_empty()) {
        Some(path) => Some(path.into()),
        None => NAMES.into_iter().find_map(find_installed),
    }
}

/// Killed with all its children when dropped.
#[derive(Debug)]
pub(super) struct ChromiumProcess {
    child: Child,
    folder: Option<TempDir>,
}

impl ChromiumProcess {
    pub(super) fn start(gpu: bool) -> Result<(Self, ChildStdin, ChildStdout)> {
        let program = find().context("no Chromium: install it, or name it in INSULA_CHROMIUM")?;
        let folder = tempfile::tempdir()?;
        let mut command = Command::new("sh");
        command.args(["-c", WITH_PIPES]).arg(program).args(FLAGS);
        command.args(if gpu { &WITH_GPU[..] } else { &["--disable-gpu"] });
        command.arg(format!("--user-data-dir={}", folder.path().display())).arg("about:blank");
        // The browser writes below the configuration folder, too.
        command.env("XDG_CONFIG_HOME", folder.path()).env("XDG_CACHE_HOME", folder.path());
        let log = std::env::var_os("INSULA_TEST_LOG").map_or_else(Stdio::null, |_| Stdio::inherit());
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(log).process_group(0);
        let mut child = command.spawn().with_context(|| format!("{command:?}"))?;
        let input = child.stdin.take().context("no input")?;
        let output = child.stdout.take().context("no output")?;
        Ok((Self { child, folder: Some(folder) }, input, output))
    }

    pub(super) fn group(&self) -> u32 {
        self.child.id()
    }

    /// Proportional set size of the group's processes in MiB.
    pub(super) fn memory_mib(&self) -> f64 {
        let group = self.child.id().to_string();
        let entries = std::fs::read_dir("/proc").into_iter().flatten().flatten();
        let kib = entries.filter_map(|entry| {
            let stat = std::fs::read_to_string(entry.path().join("stat")).ok()?;
            // After the name in parentheses: state, parent, process group.
            let is_ours = stat.rsplit_once(')')?.1.split_whitespace().nth(2)? == group;
            let rollup = std::fs::read_to_string(entry.path().join("smaps_rollup")).ok().filter(|_| is_ours)?;
            let line = rollup.lines().find(|line| line.starts_with("Pss:"))?;
            line.split_whitespace().nth(1)?.parse::<f64>().ok()
        });
        kib.sum::<f64>() / 1024.0
    }
}

impl Drop for ChromiumProcess {
    fn drop(&mut self) {
        let group = format!("-{}", self.child.id());
        let _ = Command::new("kill").args(["-9", "--", &group]).stderr(Stdio::null()).status();
        let _ = self.child.wait();
        let Some(folder) = self.folder.take().map(TempDir::keep) else { return };
        for _ in 0..REMOVALS {
            if std::fs::remove_dir_all(&folder).is_ok() || !folder.exists() {
                return;
            }
            std::thread::sleep(Duration::from_millis(50));
        }
    }
}
