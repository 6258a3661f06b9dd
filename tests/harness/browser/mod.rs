//! Chromium without a window, driven by the DevTools protocol over a pair of pipes.
//!
//! `INSULA_CHROMIUM` names the program; without it, it is searched on the path. A test that finds none must be reported as
//! ignored.

pub mod city_page;
mod connection;
mod emulation;
mod input;
mod page;
pub mod page_log;
mod process;
pub mod same_picture;
mod slowdown;

use anyhow::Result;
use connection::Connection;
pub use input::Button;
pub use page::Page;
use process::ChromiumProcess;
use serde_json::json;
pub use slowdown::Slowdown;
use std::path::PathBuf;
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
