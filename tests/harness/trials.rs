//! The list of tests of one program. Each test says what it needs.
//!
//! A test that needs an absent thing is reported as ignored. So are tests of the full tier, unless `INSULA_TESTS=full`.
//! With `INSULA_TEST_TIMES=FILE`, each test adds a line to that file: its seconds, without the wait for its turn, and its name.

use crate::gpu::{Gpu, adapter_is_required};
use anyhow::Result;
use insula_test_support::tier;
use libtest_mimic::{Arguments, Failed, Trial};
use std::fs::File;
use std::io::Write;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// Result of a test: nothing if it panics when it fails.
pub trait Outcome {
    /// As an error.
    fn into_result(self) -> Result<()>;
}

impl Outcome for () {
    fn into_result(self) -> Result<()> {
        Ok(())
    }
}

impl Outcome for Result<()> {
    fn into_result(self) -> Self {
        self
    }
}

/// A resource that one test at a time may use. Other tests run meanwhile.
#[derive(Debug)]
pub struct Turn(Mutex<()>);

impl Turn {
    /// A resource that no test uses.
    pub const fn new() -> Self {
        Self(Mutex::new(()))
    }
}

impl Default for Turn {
    fn default() -> Self {
        Self::new()
    }
}

/// Memory and processors: bakes of whole cities, which use all cores.
pub static WHOLE_CITY: Turn = Turn::new();

/// Threads besides one for each core: tests that wait for their turn, a browser or a window occupy theirs.
const WAITING: usize = 2;

enum Run {
    Plain(Box<dyn FnOnce() -> Result<()> + Send>),
    OnGpu(fn(&Gpu) -> Result<()>),
}

pub struct Test {
    name: String,
    run: Run,
    is_ignored: bool,
    is_full_tier: bool,
    turn: Option<&'static Turn>,
}

impl Test {
    fn with(name: impl Into<String>, run: Run) -> Self {
        Self { name: name.into(), run, is_ignored: false, is_full_tier: false, turn: None }
    }

    /// A test that needs nothing. It fails by an error or a panic.
    pub fn new<R: Outcome>(name: impl Into<String>, test: impl FnOnce() -> R + Send + 'static) -> Self {
        Self::with(name, Run::Plain(Box::new(move || test().into_result())))
    }

    /// A test that needs a graphics adapter.
    pub fn on_gpu(name: impl Into<String>, test: fn(&Gpu) -> Result<()>) -> Self {
        Self::with(name, Run::OnGpu(test))
    }

    /// Reports the test as ignored if what it needs is absent.
    #[must_use]
    pub fn ignored_if(mut self, is_absent: bool) -> Self {
        self.is_ignored |= is_absent;
        self
    }

    /// Runs the test in the full tier only.
    #[must_use]
    pub fn full_tier(mut self) -> Self {
        self.is_full_tier = true;
        self
    }

    /// Runs the test while no other test has the same turn.
    #[must_use]
    pub fn in_turn(mut self, turn: &'static Turn) -> Self {
        self.turn = Some(turn);
        self
    }
}

/// Tests that need nothing, named as their functions.
#[macro_export]
macro_rules! tests {
    ($($test:ident),+ $(,)?) => { [$($crate::trials::Test::new(stringify!($test), $test)),+] };
}

/// Tests that need a graphics adapter, named as their functions.
#[macro_export]
macro_rules! gpu_tests {
    ($($test:ident),+ $(,)?) => { [$($crate::trials::Test::on_gpu(stringify!($test), $test)),+] };
}

pub struct Trials {
    module: &'static str,
    gpu: Arc<Result<Gpu>>,
    times: Option<Arc<File>>,
    tests: Vec<Trial>,
}

impl Trials {
    /// Opens the GPU before any test, because that decides which tests are ignored.
    pub fn open() -> Self {
        let gpu = Gpu::open();
        if let Err(error) = &gpu {
            eprintln!("no GPU test can run: {error:#}");
        }
        let times = std::env::var_os("INSULA_TEST_TIMES").map(|file| {
            let file = File::options().create(true).append(true).open(&file);
            Arc::new(file.unwrap_or_else(|error| panic!("cannot open the file of INSULA_TEST_TIMES: {error}")))
        });
        Self { module: "", gpu: Arc::new(gpu), times, tests: Vec::new() }
    }

    /// Names the module of the tests that are added next.
    pub fn module(&mut self, name: &'static str) -> &mut Self {
        self.module = name;
        self
    }

    /// Whether a graphics adapter is there, or must be.
    pub fn has_gpu(&self) -> bool {
        self.gpu.is_ok() || adapter_is_required()
    }

    pub fn add(&mut self, tests: impl IntoIterator<Item = Test>) -> &mut Self {
        for test in tests {
            let name = format!("{}::{}", self.module, test.name);
            let needs_gpu = matches!(test.run, Run::OnGpu(_));
            let is_ignored = test.is_ignored || test.is_full_tier && !tier::is_full() || needs_gpu && !self.has_gpu();
            let (gpu, run, turn, times) = (self.gpu.clone(), test.run, test.turn, self.times.clone());
            let timed_name = name.clone();
            let run = move || {
                // A test that failed leaves nothing behind that the next could trip over.
                let _turn = turn.map(|turn| turn.0.lock().unwrap_or_else(PoisonError::into_inner));
                let begin = Instant::now();
                let result = match (run, gpu.as_ref()) {
                    (Run::Plain(run), _) => run().map_err(|e| Failed::from(format!("{e:#}"))),
                    (Run::OnGpu(run), Ok(gpu)) => run(gpu).map_err(|e| Failed::from(format!("{}: {e:#}", gpu.name))),
                    (Run::OnGpu(_), Err(error)) => Err(Failed::from(format!("an adapter is required: {error:#}"))),
                };
                if let Some(mut times) = times.as_deref() {
                    writeln!(times, "{:.1} {timed_name}", begin.elapsed().as_secs_f64())
                        .map_err(|e| Failed::from(e.to_string()))?;
                }
                result
            };
            let kind = if test.is_full_tier { "full tier" } else { "" };
            self.tests.push(Trial::test(name, run).with_ignored_flag(is_ignored).with_kind(kind));
        }
        self
    }

    /// Runs the tests that the command line selects. `clean_up` runs after the last.
    pub fn run(self, clean_up: impl FnOnce()) -> ! {
        let mut arguments = Arguments::from_args();
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        arguments.test_threads.get_or_insert(cores + WAITING);
        let conclusion = libtest_mimic::run(&arguments, self.tests);
        clean_up();
        conclusion.exit()
    }
}
