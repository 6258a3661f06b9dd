//! The built server as a process, and other programs.

use crate::client::Connection;
use std::{
    io::{BufRead, BufReader},
    net::SocketAddr,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

/// Where a program is, if it is installed.
pub(crate) fn find(name: &str) -> Option<PathBuf> {
    std::env::split_paths(&std::env::var_os("PATH")?).map(|folder| folder.join(name)).find(|path| path.is_file())
}

/// `insula-server serve`; killed when dropped.
pub(crate) struct Served {
    child: Child,
    pub(crate) address: SocketAddr,
}

impl Served {
    /// `settings` are `key=value`.
    pub(crate) fn start(place: &str, settings: &[&str]) -> Self {
        Self::run(Command::new(env!("CARGO_BIN_EXE_insula-server")), place, "127.0.0.1:0", settings)
    }

    /// The same with an environment.
    pub(crate) fn start_in(environment: &[(&str, String)], place: &str, settings: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_insula-server"));
        command.envs(environment.iter().map(|(name, value)| (*name, value)));
        Self::run(command, place, "127.0.0.1:0", settings)
    }

    /// The same on an address that is known.
    pub(crate) fn start_at(place: &str, listen: SocketAddr, settings: &[&str]) -> Self {
        Self::run(Command::new(env!("CARGO_BIN_EXE_insula-server")), place, &listen.to_string(), settings)
    }

    /// The same under a limit that the shell's `ulimit` sets.
    pub(crate) fn start_limited(limit: &str, place: &str, settings: &[&str]) -> Self {
        let mut shell = Command::new("sh");
        shell.args(["-c", &format!("ulimit {limit}; exec \"$0\" \"$@\""), env!("CARGO_BIN_EXE_insula-server")]);
        Self::run(shell, place, "127.0.0.1:0", settings)
    }

    fn run(mut command: Command, place: &str, listen: &str, settings: &[&str]) -> Self {
        command.args(["serve", place, "--listen", listen]);
        settings.iter().for_each(|setting| {
            command.args(["--set", setting]);
        });
        let mut child = command
            .env_remove("RUST_LOG")
            .env("AWS_EC2_METADATA_DISABLED", "true")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(if std::env::var_os("INSULA_FAULTS_LOG").is_some() { Stdio::inherit() } else { Stdio::null() })
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.trim().strip_prefix("listening on http://").unwrap_or_else(|| panic!("it said {line:?}"));
        Self { address: address.parse().unwrap(), child }
    }

    pub(crate) fn pid(&self) -> u32 {
        self.child.id()
    }

    pub(crate) fn signal(&self, name: &str) {
        assert!(Command::new("kill").args([name, &self.pid().to_string()]).status().unwrap().success());
    }

    pub(crate) fn is_alive(&mut self) -> bool {
        self.child.try_wait().unwrap().is_none()
    }

    pub(crate) fn descriptors(&self) -> usize {
        std::fs::read_dir(format!("/proc/{}/fd", self.pid())).unwrap().count()
    }

    /// One counter or gauge of `/metrics`.
    pub(crate) fn metric(&self, name: &str) -> f64 {
        let answer = Connection::new(self.address).get("/metrics").unwrap();
        let text = String::from_utf8(answer.body).unwrap();
        let value = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' ')?.parse().ok());
        value.unwrap_or(0.0)
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Waits for something that must come about soon.
#[track_caller]
pub(crate) fn until(what: &str, mut come: impl FnMut() -> bool) {
    let deadline = Instant::now() + Duration::from_secs(20);
    while !come() {
        assert!(Instant::now() < deadline, "{what}: not within 20 s");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// A path as text.
pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}
