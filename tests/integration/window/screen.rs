//! The virtual screen that all tests of the window share.

use anyhow::{Context, Result, ensure};
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, PoisonError};

static SCREEN: Mutex<Option<Screen>> = Mutex::new(None);

/// Ended when dropped.
struct Screen {
    xvfb: Child,
    display: String,
}

impl Screen {
    fn start() -> Result<Self> {
        let mut xvfb = Command::new("Xvfb")
            // A reset after the last client would end clients that connect meanwhile.
            .args(["-displayfd", "1", "-screen", "0", "1400x900x24", "-nolisten", "tcp", "-noreset"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()?;
        let stdout = xvfb.stdout.take().context("no output")?;
        let mut screen = Self { xvfb, display: String::new() };
        let mut number = String::new();
        BufReader::new(stdout).read_line(&mut number)?;
        ensure!(!number.trim().is_empty(), "Xvfb found no free display");
        screen.display = format!(":{}", number.trim());
        Ok(screen)
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        let _ = self.xvfb.kill();
        let _ = self.xvfb.wait();
    }
}

/// The `DISPLAY` of the screen. Starts it at the first use.
pub(super) fn display() -> Result<String> {
    let mut shared = SCREEN.lock().unwrap_or_else(PoisonError::into_inner);
    let screen = match shared.take() {
        Some(screen) => screen,
        None => Screen::start()?,
    };
    Ok(shared.insert(screen).display.clone())
}

/// Ends the screen, if it was started.
pub(super) fn close() {
    SCREEN.lock().unwrap_or_else(PoisonError::into_inner).take();
}
