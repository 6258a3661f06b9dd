//! Chromium without a window, driven by the DevTools protocol over a pair of pipes.
//!
//! `INSULA_CHROMIUM` names the program; without it, it is searched on the path. A test that finds none must be reported as
//! ignored.

mod base64;
pub mod city_page;
mod connection;
mod emulation;
mod input;
mod page;
pub mod page_log;
mod process;
pub mod same_picture;
mod slowdown;

pub use input::Button;
pub use page::Page;
pub use slowdown::Slowdown;

use anyhow::Result;
use connection::Connection;
use process::ChromiumProcess;
use serde_json::json;
use std::{path::PathBuf, sync::Arc};

/// How the browser starts, and what its pages are at first.
#[derive(Debug, Clone, Copy)]
pub struct BrowserOptions {
    /// WebGPU on SwiftShader; otherwise there is no graphics adapter.
    pub gpu: bool,
    /// Size of a page in CSS pixels.
    pub size: [u32; 2],
    /// Colour scheme that the user prefers.
    pub dark: bool,
    /// A phone: touch input and a mobile viewport.
    pub touch: bool,
}

impl Default for BrowserOptions {
    fn default() -> Self {
        Self { gpu: false, size: [960, 600], dark: false, touch: false }
    }
}

/// A running browser; ended, and its folder removed, when dropped.
#[derive(Debug)]
pub struct Browser {
    options: BrowserOptions,
    connection: Arc<Connection>,
    process: ChromiumProcess,
}

impl Browser {
    /// The browser's program, if there is one.
    pub fn find() -> Option<PathBuf> {
        process::find()
    }

    /// Fails without a program, or if it does not answer.
    pub fn launch(options: BrowserOptions) -> Result<Self> {
        let (process, input, output) = ChromiumProcess::start(&options)?;
        let connection = Connection::start(input, output);
        connection.call("", "Browser.getVersion", json!({}))?;
        Ok(Self { options, connection, process })
    }

    /// Opens an empty page that shares nothing with others of this browser: no cache, no storage.
    pub fn open_page(&self) -> Result<Page> {
        let page = Page::open(&self.connection)?;
        page.set_viewport(self.options.size, 1.0, self.options.touch)?;
        page.set_media(if self.options.dark { "dark" } else { "light" })?;
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
