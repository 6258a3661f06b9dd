//! Tests with and without a GPU in one program. Without a GPU, those that need one are reported as ignored.

use crate::gpu::{Gpu, adapter_is_required};
use anyhow::Result;
use libtest_mimic::{Arguments, Failed, Trial};
use std::sync::Arc;

#[derive(Debug)]
pub struct Trials {
    gpu: Arc<Result<Gpu>>,
    tests: Vec<Trial>,
}

impl Trials {
    /// Opens the GPU before any test, because that decides which tests are ignored.
    pub fn open() -> Self {
        let gpu = Gpu::open();
        if let Err(error) = &gpu {
            eprintln!("no GPU test can run: {error:#}");
        }
        Self { gpu: Arc::new(gpu), tests: Vec::new() }
    }

    /// Adds a test that needs the GPU.
    #[must_use]
    pub fn on_gpu(mut self, name: &str, test: fn(&Gpu) -> Result<()>) -> Self {
        let gpu = self.gpu.clone();
        let run = move || match gpu.as_ref() {
            Ok(gpu) => test(gpu).map_err(|e| Failed::from(format!("{}: {e:#}", gpu.name))),
            Err(error) => Err(Failed::from(format!("an adapter is required: {error:#}"))),
        };
        let ignored = self.gpu.is_err() && !adapter_is_required();
        self.tests.push(Trial::test(name, run).with_ignored_flag(ignored));
        self
    }

    /// Adds a test that does not.
    #[must_use]
    pub fn plain(mut self, name: &str, test: fn() -> Result<()>) -> Self {
        let run = move || test().map_err(|e| Failed::from(format!("{e:#}")));
        self.tests.push(Trial::test(name, run));
        self
    }

    /// Runs the tests that the command line selects, and exits.
    pub fn run(self) -> ! {
        libtest_mimic::run(&Arguments::from_args(), self.tests).exit()
    }
}
