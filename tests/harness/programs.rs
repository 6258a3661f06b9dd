//! The built programs, driven from outside.

use crate::bucket;
use anyhow::{Context, Result, bail};
use std::{
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
    process::{Child, Command, Output, Stdio},
    time::{Duration, Instant},
};

/// Longest that any program of a test may run.
const MOST: Duration = Duration::from_secs(120);

/// A program of the workspace, beside the running one or the folder of the running test.
///
/// # Errors
///
/// If it was not built: `cargo test --workspace` does.
pub fn program(name: &str) -> Result<PathBuf> {
    let running = std::env::current_exe()?;
    let name = format!("{name}{}", std::env::consts::EXE_SUFFIX);
    let found = running.ancestors().skip(1).take(2).map(|folder| folder.join(&name)).find(|path| path.is_file());
    found.with_context(|| format!("{name} is missing: run cargo build --workspace first, or cargo test --workspace"))
}

/// Runs a program to its end; one that does not end is killed, and that is an error.
pub fn run(command: &mut Command) -> Result<Output> {
    let what = format!("{command:?}");
    let child =
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().context(what.clone())?;
    let (pid, begin) = (child.id(), Instant::now());
    let (sender, receiver) = std::sync::mpsc::sync_channel(1);
    std::thread::spawn(move || sender.send(child.wait_with_output()));
    match receiver.recv_timeout(MOST) {
        Ok(output) => Ok(output?),
        Err(_) => {
            Command::new("kill").args(["-9", &pid.to_string()]).status()?;
            bail!("{what} did not end within {:.0?}", begin.elapsed())
        }
    }
}

/// `insula-server serve` as a process of its own; killed when dropped.
#[derive(Debug)]
pub struct Served {
    child: Child,
    /// `127.0.0.1:PORT`.
    pub address: String,
}

impl Served {
    /// Serves a city's folder, or what is in it from a [`bucket`]; `listen` may have port 0.
    pub fn start(city: &Path, listen: &str) -> Result<Self> {
        let mut command = Command::new(program("insula-server")?);
        command.arg("serve");
        match bucket::place(city)? {
            Some(place) => command.arg(place.url).envs(place.environment),
            None => command.arg(city),
        };
        let mut child = command
            .args(["--listen", listen])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()?;
        let mut line = String::new();
        BufReader::new(child.stdout.take().context("no output")?).read_line(&mut line)?;
        let Some(address) = line.trim().strip_prefix("listening on http://") else {
            let _ = child.kill();
            let _ = child.wait();
            bail!("insula-server said {line:?}");
        };
        Ok(Self { child, address: address.to_owned() })
    }

    /// Kills it at once, with whatever it is doing.
    pub fn kill(mut self) -> Result<()> {
        self.child.kill()?;
        self.child.wait()?;
        Ok(())
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
