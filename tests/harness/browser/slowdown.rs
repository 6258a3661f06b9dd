//! A slower machine for a whole browser.
//!
//! The protocol's own throttling holds up the main thread only, not workers, in which this project's viewer draws.

use anyhow::{Context, Result};
use std::process::{Child, Command, Stdio};

/// Stops and continues a process group. Ends when its input does, so it never outlives this process.
const SCRIPT: &str = r#"
trap '' TERM
while :; do
    kill -STOP -- "-$0"; read -rt "$1"; stopped=$?
    kill -CONT -- "-$0" || exit; read -rt "$2"; ran=$?
    [ "$stopped" -gt 128 ] && [ "$ran" -gt 128 ] || exit
done"#;
/// Time of a stop and a run together.
const PERIOD_SECS: f64 = 0.02;

/// While it exists, a browser has a fraction of the processors' time.
#[derive(Debug)]
pub struct Slowdown(Child);

impl Slowdown {
    pub(super) fn start(group: u32, factor: f64) -> Result<Self> {
        let run_secs = PERIOD_SECS / factor.max(1.0);
        let [stop, run] = [PERIOD_SECS - run_secs, run_secs].map(|secs| format!("{secs:.4}"));
        let mut command = Command::new("bash");
        command.args(["-c", SCRIPT, &group.to_string(), &stop, &run]);
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
