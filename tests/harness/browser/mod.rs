//! Chromium without a window, driven by the DevTools protocol over a pair of pipes.
//!
//! `INSULA_CHROMIUM` names the program; without it, it is searched on the path. A test that finds none must be reported as
//! ignored.

pub mod city_page;
mod connection;
mod input;
mod page;
pub mod page_log;
pub mod same_picture;

use crate::programs::find_installed;
use anyhow::{Context, Result};
use connection::Connection;
pub use input::Button;
pub use page::Page;
use serde_json::{Value, json};
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;
use tempfile::TempDir;

/// What a page is at first.
#[derive(Debug, Clone, Copy)]
pub struct PageOptions {
    /// Size in CSS pixels.
    pub size: [u32; 2],
    /// Colour scheme that the user prefers.
    pub dark: bool,
    /// A phone: touch input and a mobile viewport.
    pub touch: bool,
}

impl Default for PageOptions {
    /// So small that a CPU draws it in a fraction of a second.
    fn default() -> Self {
        Self { size: [480, 320], dark: false, touch: false }
    }
}

/// A running browser; ended, and its folder removed, when dropped.
#[derive(Debug)]
pub struct Browser {
    connection: Arc<Connection>,
    process: ChromiumProcess,
}

impl Browser {
    /// The browser's program, if there is one.
    pub fn find() -> Option<PathBuf> {
        find_chromium()
    }

    /// With `gpu`, WebGPU draws on SwiftShader; otherwise there is no graphics adapter. Fails without a program, or if it does
    /// not answer.
    pub fn launch(gpu: bool) -> Result<Self> {
        let (process, input, output) = ChromiumProcess::start(gpu)?;
        let browser = Self { connection: Connection::start(input, output), process };
        browser.connection.call("", "Browser.getVersion", json!({}))?;
        Ok(browser)
    }

    /// Whether it still answers.
    pub fn answers(&self) -> bool {
        self.connection.call("", "Browser.getVersion", json!({})).is_ok()
    }

    /// Opens an empty page that shares nothing with others of this browser: no cache, no storage.
    pub fn open_page(&self, options: PageOptions) -> Result<Page> {
        let page = Page::open(&self.connection)?;
        page.set_viewport(options.size, 1.0, options.touch)?;
        page.set_media(if options.dark { "dark" } else { "light" })?;
        Ok(page)
    }

    /// Makes all its processes slower by a factor, until the value is dropped.
    pub fn slow_down(&self, factor: f64) -> Result<Slowdown> {
        Slowdown::start(self.process.group(), factor)
    }

    /// Proportional set size of all its processes in MiB.
    pub fn memory_mib(&self) -> f64 {
        self.process.memory_mib()
    }
}

impl Page {
    /// A network of `mbit` megabits per second in each direction, whose responses begin after `rtt_ms`.
    pub fn emulate_network(&self, mbit: f64, rtt_ms: f64) -> Result<()> {
        let bytes_per_sec = mbit * 1e6 / 8.0;
        self.set_network(json!({
            "offline": false, "latency": rtt_ms,
            "downloadThroughput": bytes_per_sec, "uploadThroughput": bytes_per_sec,
        }))
    }

    /// No network, or the machine's own.
    pub fn set_offline(&self, is_offline: bool) -> Result<()> {
        self.set_network(json!({
            "offline": is_offline, "latency": 0, "downloadThroughput": -1, "uploadThroughput": -1,
        }))
    }

    fn set_network(&self, conditions: Value) -> Result<()> {
        self.log(|log| log.network = Some(conditions.clone()))?;
        self.call_everywhere("Network.emulateNetworkConditions", &conditions)
    }

    /// A processor that is slower by a factor.
    pub fn throttle_cpu(&self, rate: f64) -> Result<()> {
        let params = json!({ "rate": rate });
        self.log(|log| log.throttled = Some(params.clone()))?;
        self.call_everywhere("Emulation.setCPUThrottlingRate", &params)
    }

    /// Size in CSS pixels, and device pixels per CSS pixel. `is_mobile` adds touch input.
    pub fn set_viewport(&self, size: [u32; 2], ratio: f64, is_mobile: bool) -> Result<()> {
        let [width, height] = size;
        let metrics = json!({ "width": width, "height": height, "deviceScaleFactor": ratio, "mobile": is_mobile });
        self.call("Emulation.setDeviceMetricsOverride", metrics)?;
        let touch = match is_mobile {
            true => json!({ "enabled": true, "maxTouchPoints": 5 }),
            false => json!({ "enabled": false }),
        };
        self.call("Emulation.setTouchEmulationEnabled", touch).map(drop)
    }

    /// `dark` or `light`.
    pub fn set_media(&self, color_scheme: &str) -> Result<()> {
        let features = json!([{ "name": "prefers-color-scheme", "value": color_scheme }]);
        self.call("Emulation.setEmulatedMedia", json!({ "features": features })).map(drop)
    }

    /// Whether scripts of pages run.
    pub fn set_scripts(&self, run: bool) -> Result<()> {
        self.call("Emulation.setScriptExecutionDisabled", json!({ "value": !run })).map(drop)
    }
}

/// Stops and continues a process group. Ends when its input does, so it never outlives this process.
const SLOWDOWN_SCRIPT: &str = r#"
trap '' TERM
while :; do
    kill -STOP -- "-$0"; read -rt "$1"; stopped=$?
    kill -CONT -- "-$0" || exit; read -rt "$2"; ran=$?
    [ "$stopped" -gt 128 ] && [ "$ran" -gt 128 ] || exit
done"#;
/// Time of a stop and a run together.
const PERIOD_SECS: f64 = 0.02;

/// While it exists, a browser has a fraction of the processors' time. The protocol's own throttling holds up the main thread only,
/// not workers, in which this project's viewer draws.
#[derive(Debug)]
pub struct Slowdown(Child);

impl Slowdown {
    fn start(group: u32, factor: f64) -> Result<Self> {
        let run_secs = PERIOD_SECS / factor.max(1.0);
        let [stop, run] = [PERIOD_SECS - run_secs, run_secs].map(|secs| format!("{secs:.4}"));
        let mut command = Command::new("bash");
        command.args(["-c", SLOWDOWN_SCRIPT, &group.to_string(), &stop, &run]);
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        Ok(Self(command.spawn().context("bash")?))
    }
}

impl Drop for Slowdown {
    fn drop(&mut self) {
        drop(self.0.stdin.take());
        let _ = self.0.wait();
    }
}

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

fn find_chromium() -> Option<PathBuf> {
    match std::env::var_os("INSULA_CHROMIUM").filter(|path| !path.is_empty()) {
        Some(path) => Some(path.into()),
        None => NAMES.into_iter().find_map(find_installed),
    }
}

/// Killed with all its children when dropped.
#[derive(Debug)]
struct ChromiumProcess {
    child: Child,
    folder: Option<TempDir>,
}

impl ChromiumProcess {
    fn start(gpu: bool) -> Result<(Self, ChildStdin, ChildStdout)> {
        let program = find_chromium().context("no Chromium: install it, or name it in INSULA_CHROMIUM")?;
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

    fn group(&self) -> u32 {
        self.child.id()
    }

    /// Proportional set size of the group's processes in MiB.
    fn memory_mib(&self) -> f64 {
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
