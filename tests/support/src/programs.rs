//! The built programs, run as processes.

use crate::bucket;
use anyhow::{Context, Result, bail, ensure};
use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Read};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, ExitStatus, Output, Stdio};
use std::time::{Duration, Instant};

/// Longest time that a program of a test may run.
const MAX_TIME: Duration = Duration::from_secs(120);
/// Longest time that [`wait_until`] waits.
const PATIENCE: Duration = Duration::from_secs(60);

/// The path of a program of the workspace, found beside the running program or test. Fails if it is not built.
pub fn program(name: &str) -> Result<PathBuf> {
    let running = std::env::current_exe()?;
    let name = format!("{name}{}", std::env::consts::EXE_SUFFIX);
    let found = running.ancestors().skip(1).take(2).map(|folder| folder.join(&name)).find(|path| path.is_file());
    found.with_context(|| format!("{name} is missing: run cargo build --workspace first, or cargo test --workspace"))
}

pub fn find_installed(name: &str) -> Option<PathBuf> {
    std::env::split_paths(&std::env::var_os("PATH")?).map(|folder| folder.join(name)).find(|path| path.is_file())
}

/// Runs a program to its end. Fails if it runs for longer than two minutes; it is killed then.
pub fn run(command: &mut Command) -> Result<Output> {
    let text = format!("{command:?}");
    let child =
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().context(text.clone())?;
    let pid = child.id();
    let (sender, receiver) = std::sync::mpsc::sync_channel(1);
    std::thread::spawn(move || sender.send(child.wait_with_output()));
    match receiver.recv_timeout(MAX_TIME) {
        Ok(output) => Ok(output?),
        Err(_) => {
            Command::new("kill").args(["-9", &pid.to_string()]).status()?;
            bail!("{text} did not end within {MAX_TIME:?}")
        }
    }
}

/// What a program of the workspace prints on standard output, run in a folder with the words of a line. Fails with its errors if it fails.
pub fn call(folder: &Path, name: &str, line: &str) -> Result<String> {
    let mut command = Command::new(program(name)?);
    command.current_dir(folder).args(line.split_whitespace()).env_remove("RUST_LOG");
    let output = run(&mut command)?;
    ensure!(output.status.success(), "{name} {line}: {}", String::from_utf8_lossy(&output.stderr));
    Ok(String::from_utf8(output.stdout)?)
}

/// `insula-server serve` as a process; killed when dropped.
#[derive(Debug)]
pub struct ServerProcess {
    child: Child,
    stdout: BufReader<ChildStdout>,
    /// Where it listens.
    pub address: SocketAddr,
}

impl ServerProcess {
    /// Serves a city's folder, or its copy in a [`bucket`]. Fails if the server does not start.
    pub fn serve(city: &Path, listen: &str) -> Result<Self> {
        let mut command = Command::new(program("insula-server")?);
        match bucket::upload_if_requested(city)? {
            Some(city) => Self::start(command.envs(city.environment), &city.url, listen, &[]),
            None => Self::start(&mut command, path_text(city), listen, &[]),
        }
    }

    /// Adds the arguments of `serve` to `command` and runs it. `settings` are `key=value`. Fails unless the server prints
    /// its address. With `INSULA_TEST_LOG` set, its log goes to standard error.
    pub fn start(command: &mut Command, place: impl AsRef<OsStr>, listen: &str, settings: &[&str]) -> Result<Self> {
        Self::start_with(command, &[place], listen, settings)
    }

    /// The same with several cities.
    pub fn start_with(
        command: &mut Command,
        places: &[impl AsRef<OsStr>],
        listen: &str,
        settings: &[&str],
    ) -> Result<Self> {
        command.arg("serve").args(places).args(["--listen", listen]);
        command.args(settings.iter().flat_map(|setting| ["--set", setting]));
        let log = std::env::var_os("INSULA_TEST_LOG").map_or_else(Stdio::null, |_| Stdio::inherit());
        let mut child = command
            .env_remove("RUST_LOG")
            .env("AWS_EC2_METADATA_DISABLED", "true")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(log)
            .spawn()
            .with_context(|| format!("{command:?}"))?;
        let mut stdout = BufReader::new(child.stdout.take().context("the server has no standard output")?);
        let mut line = String::new();
        stdout.read_line(&mut line)?;
        let Some(address) = line.trim().strip_prefix("listening on http://") else {
            let _ = child.kill();
            bail!("the server ended with {}, its output is {line:?}", child.wait()?);
        };
        Ok(Self { child, stdout, address: address.parse()? })
    }

    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Sends a signal, such as `-TERM`.
    pub fn signal(&self, name: &str) {
        assert!(Command::new("kill").args([name, &self.pid().to_string()]).status().unwrap().success());
    }

    /// Whether it still runs.
    pub fn is_alive(&mut self) -> bool {
        self.child.try_wait().unwrap().is_none()
    }

    /// Number of its open file descriptors.
    pub fn descriptors(&self) -> usize {
        std::fs::read_dir(format!("/proc/{}/fd", self.pid())).unwrap().count()
    }

    /// Waits until it ends. Returns the rest of its standard output, too.
    pub fn wait(mut self) -> (ExitStatus, String) {
        wait_until("the end of the server", || !self.is_alive());
        let mut rest = String::new();
        self.stdout.read_to_string(&mut rest).unwrap();
        (self.child.wait().unwrap(), rest)
    }
}

impl Drop for ServerProcess {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Polls `condition` for at most a minute. Panics with `what` if it does not come true.
#[track_caller]
pub fn wait_until(what: &str, mut condition: impl FnMut() -> bool) {
    let deadline = Instant::now() + PATIENCE;
    while !condition() {
        assert!(Instant::now() < deadline, "{what}: not within {PATIENCE:?}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// A path as text. Panics if it is not UTF-8.
pub fn path_text(path: &Path) -> &str {
    path.to_str().unwrap()
}
