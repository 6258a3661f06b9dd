//! A page with `<insula-city>` elements, and what these reported.

use super::{Browser, Page, PageOptions};
use anyhow::{Context, Result};
use image::RgbImage;
use serde_json::Value;
use std::collections::HashSet;
use std::time::Duration;

/// Keeps the last event of each kind with the time and the number of all, for each element, and the longest task of the
/// main thread. Listens while events descend, because those of the element do not rise.
///
/// A view that is new is coarse at first, so a final picture is of the view whose coarse picture came before. One that was being
/// drawn when the view changed already has the camera of the next view, and another picture follows.
const RECORDER: &str = r"(() => {
globalThis.insulaLongestTaskMs = 0;
const now = () => performance.timeOrigin + performance.now();
for (const kind of ['ready', 'progress', 'pick', 'camera', 'status', 'adapter', 'frame']) {
    addEventListener(kind, ({ target, detail }) => {
        if (target?.localName !== 'insula-city') return;
        // Without this time nothing was drawn: only what lies over the picture may have changed.
        if (kind === 'frame' && detail.frameMs === undefined) return;
        const seen = target.insulaSeen ??= { statuses: [], adapters: [], intervalsMs: [] };
        const before = seen[kind];
        if (kind === 'frame') {
            if (before) seen.intervalsMs.push(now() - before.atMs);
            if (!detail.final || !before) seen.coarse = detail.camera;
            seen.isFinal = detail.final && detail.camera === seen.coarse;
        }
        if (kind === 'adapter') {
            seen.adapters.push(detail);
            // The canvas of another adapter is empty.
            if (before?.detail.kind !== detail.kind) seen.isFinal = false;
        }
        if (kind === 'status') seen.statuses.push(detail);
        seen[kind] = { detail, atMs: now(), firstMs: before?.firstMs ?? now(), count: (before?.count ?? 0) + 1 };
    }, true);
}
// The view after all input so far: the engine takes messages in their order, and answers this one, which changes nothing, at once.
const currentView = city => new Promise(resolve => {
    const listen = ({ detail }) => {
        if (detail.frameMs !== undefined) return;
        city.removeEventListener('frame', listen);
        resolve(detail.camera);
    };
    city.addEventListener('frame', listen);
    city.steer('measure', { action: 'undo' });
});
globalThis.insulaIsFinal = async city => {
    const seen = city.insulaSeen;
    const isFinal = () => seen.isFinal && seen.progress.detail.final;
    if (!isFinal()) return false;
    const { count } = seen.frame;
    return await currentView(city) === seen.coarse && isFinal() && seen.frame.count === count;
};
new PerformanceObserver(list => {
    for (const { duration } of list.getEntries()) insulaLongestTaskMs = Math.max(insulaLongestTaskMs, duration);
}).observe({ type: 'longtask', buffered: true });
})()";

/// Longest wait for the first picture; the first with WebGPU on a software driver needs its pipelines.
pub const READY: Duration = Duration::from_secs(120);
/// Longest wait for the final picture of a view.
pub const FINAL: Duration = Duration::from_secs(120);
/// Whether the controls are there, if the page has any.
const CONTROLS: &str = "document.querySelector('#insula-app:not(.has-controls)') === null";
/// Numbers of a camera that differ by less are the same, as they are rounded.
const SAME_CAMERA: f64 = 0.01;

/// A page whose city elements are numbered in the order of the document.
#[derive(Debug)]
pub struct CityPage {
    pub page: Page,
}

impl CityPage {
    /// Opens a page in which no navigation has begun.
    pub fn new(browser: &Browser, options: PageOptions) -> Result<Self> {
        let page = browser.open_page(options)?;
        page.prepare(RECORDER)?;
        Ok(Self { page })
    }

    /// Opens an address and waits for the first picture of its first city.
    pub fn open(browser: &Browser, options: PageOptions, url: &str) -> Result<Self> {
        Self::open_with(browser, options, url, &[])
    }

    /// The same with attributes that the city has before it starts.
    pub fn open_with(browser: &Browser, options: PageOptions, url: &str, attributes: &[(&str, &str)]) -> Result<Self> {
        let city = Self::new(browser, options)?;
        // At this change the document is complete, and the page's modules have not run.
        city.page.prepare(&format!(
            "document.addEventListener('readystatechange', () => {{
                const element = document.querySelector('insula-city');
                if (element) {{ {} }}
            }}, {{ once: true }})",
            set(attributes)
        ))?;
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

    /// Waits for the first picture of a city, and for the controls that follow it on a page of the server.
    pub fn wait_until_ready(&self, number: usize) -> Result<()> {
        self.page.wait_for(&format!("{}.ready", Self::seen(number)), READY)?;
        self.page.wait_for(CONTROLS, READY)
    }

    /// Waits until the picture of the view, after all input so far, cannot improve. After an input that starts a motion, wait
    /// for the motion first.
    pub fn wait_until_final(&self, number: usize) -> Result<()> {
        self.page.wait_for(&format!("insulaIsFinal({})", Self::element(number)), FINAL)
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

    /// Runs `action`, then waits until another view is drawn. The view must rest before.
    pub fn moves_by(&self, what: &str, number: usize, action: impl FnOnce(&Page) -> Result<()>) -> Result<()> {
        let before = self.camera(number)?;
        action(&self.page)?;
        let is_moved = self.page.wait_for(&format!("{}.coarse !== '{before}'", Self::seen(number)), READY);
        is_moved.with_context(|| format!("{what} does not move the camera"))
    }

    /// Shows a view at once, and waits until it is drawn.
    pub fn look(&self, number: usize, camera: &str) -> Result<()> {
        self.page.evaluate(&format!("void {}.flyTo('{camera}', {{ seconds: 0 }})", Self::element(number)))?;
        self.wait_for_view(number, camera)
    }

    /// Waits until a view is drawn.
    pub fn wait_for_view(&self, number: usize, camera: &str) -> Result<()> {
        let is_same = format!(
            "((a, b) => a.every((n, i) => Math.abs(n - b[i]) < {SAME_CAMERA}))({}.coarse.split(','), '{camera}'.split(','))",
            Self::seen(number)
        );
        self.page.wait_for(&is_same, READY)
    }

    /// Restarts an element with other attributes, and waits for its first picture.
    pub fn restart_with(&self, number: usize, attributes: &[(&str, &str)]) -> Result<()> {
        let script = format!(
            "(() => {{ const element = {}, before = element.getAttribute('adapter'); {}
                delete element.insulaSeen;
                // Another adapter restarts it already.
                if (element.getAttribute('adapter') === before) element.restart(); }})()",
            Self::element(number),
            set(attributes)
        );
        self.page.evaluate(&script)?;
        self.wait_until_ready(number)
    }

    /// The element's own picture of its view after all input so far, once it cannot improve.
    pub fn picture(&self, number: usize, [width, height]: [u32; 2]) -> Result<RgbImage> {
        let call = format!("{}.screenshot({{ width: {width}, height: {height} }})", Self::element(number));
        Ok(image::load_from_memory(&self.page.blob(&call)?)?.to_rgb8())
    }

    /// What the user sees in the middle of the page, below its controls.
    pub fn middle(&self) -> Result<RgbImage> {
        let set_visibility = |value: &str| {
            let controls = "document.querySelectorAll('#insula-app > :not(insula-city)')";
            self.page.evaluate(&format!("{controls}.forEach(node => node.style.visibility = '{value}')"))
        };
        set_visibility("hidden")?;
        let png = self.page.screenshot_png();
        set_visibility("")?;
        let all = image::load_from_memory(&png?)?.to_rgb8();
        let [width, height] = [all.width() / 2, all.height() / 2];
        Ok(image::imageops::crop_imm(&all, width / 2, height / 2, width, height).to_image())
    }
}

/// Statements that set the attributes of `element`.
fn set(attributes: &[(&str, &str)]) -> String {
    attributes.iter().map(|(name, value)| format!("element.setAttribute('{name}', '{value}');")).collect()
}

/// Number of colours in steps of 16; an empty page has one.
pub fn colours(picture: &RgbImage) -> usize {
    picture.pixels().map(|p| p.0.map(|c| c / 16)).collect::<HashSet<_>>().len()
}
