//! A page with `<insula-city>` elements, and what these reported.

use super::{Browser, Page};
use anyhow::{Context, Result, ensure};
use image::RgbImage;
use serde_json::Value;
use std::{
    collections::HashSet,
    time::{Duration, Instant},
};

/// Keeps the last event of each kind with the time and the number of all, for each element, and the longest task of the
/// main thread. Listens while events descend, because those of the element do not rise.
const RECORDER: &str = r"(() => {
globalThis.insulaLongestTaskMs = 0;
const now = () => performance.timeOrigin + performance.now();
for (const kind of ['ready', 'progress', 'pick', 'camera', 'status', 'adapter', 'frame']) {
    addEventListener(kind, ({ target, detail }) => {
        if (target?.localName !== 'insula-city') return;
        const seen = target.insulaSeen ??= { statuses: [], intervalsMs: [] };
        const before = seen[kind];
        if (kind === 'frame' && before) seen.intervalsMs.push(now() - before.atMs);
        if (kind === 'status') seen.statuses.push(detail);
        seen[kind] = { detail, atMs: now(), firstMs: before?.firstMs ?? now(), count: (before?.count ?? 0) + 1 };
    }, true);
}
new PerformanceObserver(list => {
    for (const { duration } of list.getEntries()) insulaLongestTaskMs = Math.max(insulaLongestTaskMs, duration);
}).observe({ type: 'longtask', buffered: true });
})()";

/// Longest wait for the first picture; the first with WebGPU on a software driver needs its pipelines.
pub const READY: Duration = Duration::from_secs(60);
/// Longest wait for the final picture of a view.
pub const FINAL: Duration = Duration::from_secs(120);

/// A page whose city elements are numbered in the order of the document.
#[derive(Debug)]
pub struct CityPage {
    pub page: Page,
}

impl CityPage {
    /// Opens a page in which no navigation has begun.
    pub fn new(browser: &Browser) -> Result<Self> {
        let page = browser.open_page()?;
        page.prepare(RECORDER)?;
        Ok(Self { page })
    }

    /// Opens an address and waits for the first picture of its first city.
    pub fn open(browser: &Browser, url: &str) -> Result<Self> {
        let city = Self::new(browser)?;
        city.page.navigate(url)?;
        city.wait_until_ready(0)?;
        Ok(city)
    }

    /// A script's expression of an element.
    pub fn element(number: usize) -> String {
        format!("document.querySelectorAll('insula-city')[{number}]")
    }

    fn seen(number: usize) -> String {
        format!("{}.insulaSeen", Self::element(number))
    }

    /// Waits for the first picture of a city.
    pub fn wait_until_ready(&self, number: usize) -> Result<()> {
        self.page.wait_for(&format!("{}.ready", Self::seen(number)), READY)
    }

    /// Waits until nothing can improve the view.
    pub fn wait_until_final(&self, number: usize) -> Result<()> {
        let seen = Self::seen(number);
        self.page.wait_for(&format!("{seen}.progress.detail.final && {seen}.frame.detail.final"), FINAL)
    }

    /// Waits until an adapter draws, `cpu` or `gpu`. A page draws with the CPU until the pipelines of the GPU are made.
    pub fn wait_for_adapter(&self, number: usize, kind: &str) -> Result<()> {
        self.page.wait_for(&format!("{}.adapter.detail.kind === '{kind}'", Self::seen(number)), READY)
    }

    /// The last event of a kind: `detail`, `atMs`, `firstMs` (milliseconds since 1970) and `count`; null before the first.
    pub fn last_event(&self, number: usize, kind: &str) -> Result<Value> {
        self.page.evaluate(&format!("{}?.['{kind}'] ?? null", Self::seen(number)))
    }

    /// All details of `status` events.
    pub fn statuses(&self, number: usize) -> Result<Vec<Value>> {
        let all = self.page.evaluate(&format!("{}.statuses", Self::seen(number)))?;
        Ok(all.as_array().context("no list")?.clone())
    }

    /// The view as text.
    pub fn camera(&self, number: usize) -> Result<String> {
        let last = self.last_event(number, "frame")?;
        Ok(last["detail"]["camera"].as_str().context("no frame was drawn")?.to_owned())
    }

    /// Runs `action`, then waits until the view is another.
    pub fn moves_by(&self, what: &str, number: usize, action: impl FnOnce(&Page) -> Result<()>) -> Result<()> {
        let (before, begin) = (self.camera(number)?, Instant::now());
        action(&self.page)?;
        while self.camera(number)? == before {
            ensure!(begin.elapsed() < READY / 4, "{what} does not move the camera");
            std::thread::sleep(Duration::from_millis(50));
        }
        Ok(())
    }

    /// Waits until the camera has come to rest after an input: on a slow machine, frames lag behind.
    pub fn wait_until_still(&self, number: usize) -> Result<()> {
        let begin = Instant::now();
        let mut before = self.camera(number)?;
        loop {
            std::thread::sleep(Duration::from_secs(1));
            let camera = self.camera(number)?;
            if camera == before {
                return Ok(());
            }
            ensure!(begin.elapsed() < READY, "the camera does not come to rest");
            before = camera;
        }
    }

    /// Restarts an element with other attributes, and waits for its first picture.
    pub fn restart_with(&self, number: usize, attributes: &[(&str, &str)]) -> Result<()> {
        let element = Self::element(number);
        let set = attributes.iter().map(|(name, value)| format!("element.setAttribute('{name}', '{value}');"));
        let script = format!(
            "(() => {{ const element = {element}, before = element.getAttribute('adapter'); {}
                delete element.insulaSeen;
                // Another adapter restarts it already.
                if (element.getAttribute('adapter') === before) element.restart(); }})()",
            set.collect::<String>()
        );
        self.page.evaluate(&script)?;
        self.wait_until_ready(number)
    }

    /// The element's own picture of its view.
    pub fn picture(&self, number: usize, [width, height]: [u32; 2]) -> Result<RgbImage> {
        let call = format!("{}.screenshot({{ width: {width}, height: {height} }})", Self::element(number));
        Ok(image::load_from_memory(&self.page.blob(&call)?)?.to_rgb8())
    }

    /// What the user sees in the middle of the page.
    pub fn middle(&self) -> Result<RgbImage> {
        let all = image::load_from_memory(&self.page.screenshot_png()?)?.to_rgb8();
        let [width, height] = [all.width() / 2, all.height() / 2];
        Ok(image::imageops::crop_imm(&all, width / 2, height / 2, width, height).to_image())
    }
}

/// Number of colours in steps of 16; an empty page has one.
pub fn colours(picture: &RgbImage) -> usize {
    picture.pixels().map(|p| p.0.map(|c| c / 16)).collect::<HashSet<_>>().len()
}
