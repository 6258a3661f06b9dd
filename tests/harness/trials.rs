//! Tests with and without a graphics device in one program.

use crate::gpu::{Gpu, adapter_is_required};
use anyhow::Result;
use libtest_mimic::{Arguments, Failed, Trial};
use std::sync::Arc;

/// Tests, and the device that some of them need.
#[derive(Debug)]
pub struct Trials {
    gpu: Arc<Result<Gpu>>,
    tests: Vec<Trial>,
}

impl Trials {
    /// Asks for a device, once and before any test: that is what decides whether those that need it count as ignored.
    pub fn open() -> Self {
        let gpu = Gpu::open();
        if let Err(error) = &gpu {
            eprintln!("no GPU test can run: {error:#}");
        }
        Self { gpu: Arc::new(gpu), tests: Vec::new() }
    }

    /// A test that needs the device.
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

    /// A test that needs none.
    #[must_use]
    pub fn plain(mut self, name: &str, test: fn() -> Result<()>) -> Self {
        let run = move || test().map_err(|e| Failed::from(format!("{e:#}")));
        self.tests.push(Trial::test(name, run));
        self
    }

    /// Runs them as the command line says, and ends the program.
    pub fn run(self) -> ! {
        libtest_mimic::run(&Arguments::from_args(), self.tests).exit()
    }
}
