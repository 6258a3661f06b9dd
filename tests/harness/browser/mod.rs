//! Chromium without a window, driven by the DevTools protocol over a pair of pipes.
//!
//! `INSULA_CHROMIUM` names the program; without it, it is searched on the path. A test that finds none must be reported as
//! ignored.

pub mod city_page;
mod connection;
mod input;
mod page;
pub mod page_log;
mod process;
pub mod same_picture;

use anyhow::{Context, Result};
use connection::Connection;
pub use input::Button;
pub use page::Page;
use process::ChromiumProcess;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;

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
        process::find()
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
