//! The driver itself, on pages of a plain host: scripts, pictures, input, emulated networks, and the log.

use super::browser;
use super::viewer::REACTION;
use anyhow::{Result, ensure};
use insula_test_support::faulty_host::FaultyHost;
use insula_tests::browser::{Browser, Button, Page, PageOptions};
use serde_json::{Value, json};
use std::fs;
use std::sync::Arc;
use std::time::Duration;
use tempfile::TempDir;

/// Size of a file of the page's folder.
const LARGE: usize = 500_000;
const PAGE: &str = r#"<!doctype html><html><head><title>page</title><meta name=viewport content="width=device-width">
<meta http-equiv="Content-Security-Policy" content="script-src 'self'"><link rel=icon href=data:,>
<link rel=stylesheet href=style.css></head><body><script src=script.js></script></body></html>"#;
const STYLE: &str = "body { margin: 0; background: rgb(10, 120, 30); height: 2000px; touch-action: none }
@media (prefers-color-scheme: dark) { body { background: rgb(60, 10, 5) } }";
const SCRIPT: &str = r"
window.seen = [];
for (const kind of ['keydown', 'keyup', 'pointerdown', 'pointermove', 'pointerup', 'dblclick', 'wheel']) {
    addEventListener(kind, event => seen.push({ kind, key: event.key, code: event.code, type: event.pointerType,
        button: event.button, x: event.clientX, y: event.clientY, delta: event.deltaY }));
}
const worker = new Worker('worker.js');
window.ask = path => new Promise(done => { worker.onmessage = event => done(event.data); worker.postMessage(path); });
";
const WORKER: &str = r"
onmessage = async ({ data }) => {
    try {
        const { byteLength: size } = await (await fetch(data)).arrayBuffer();
        console.log('in the worker', data);
        postMessage({ size });
    } catch (error) { postMessage({ error: String(error) }) }
};";

/// A host of the page, a folder that it serves, and the page.
struct Site {
    page: Page,
    host: FaultyHost,
    browser: Arc<Browser>,
    _folder: TempDir,
}

impl Site {
    fn open(options: PageOptions) -> Result<Self> {
        let folder = tempfile::tempdir()?;
        for (name, text) in [("index.html", PAGE), ("style.css", STYLE), ("script.js", SCRIPT), ("worker.js", WORKER)] {
            fs::write(folder.path().join(name), text)?;
        }
        fs::write(folder.path().join("large"), vec![7; LARGE])?;
        let (host, browser) = (FaultyHost::start(folder.path()), browser(false)?);
        let page = browser.open_page(options)?;
        page.navigate(&format!("{}/", host.url()))?;
        Ok(Self { page, host, browser, _folder: folder })
    }

    /// What the worker answers.
    fn ask(&self, path: &str) -> Result<Value> {
        self.page.evaluate(&format!("ask('{path}')"))
    }

    /// Waits until so many events of a condition were seen.
    fn wait_for_events(&self, condition: &str, count: &str) -> Result<()> {
        self.page.wait_for(&format!("seen.filter(event => {condition}).length {count}"), REACTION)
    }
}

fn middle(png: &[u8]) -> Result<[u8; 3]> {
    let picture = image::load_from_memory(png)?.to_rgb8();
    Ok(picture.get_pixel(picture.width() / 2, picture.height() / 2).0)
}

pub(super) fn scripts_and_pictures() -> Result<()> {
    let site = Site::open(PageOptions { size: [320, 200], ..PageOptions::default() })?;
    let page = &site.page;
    ensure!(
        page.evaluate("new Promise(done => setTimeout(() => done({ a: [1, 'x'] }), 20))")? == json!({ "a": [1, "x"] })
    );
    let error = page.evaluate("nothing.at.all").expect_err("it throws").to_string();
    ensure!(error.contains("ReferenceError") && !error.contains('\u{0}'), "{error}");
    page.wait_for("document.title === 'page'", REACTION)?;
    page.wait_for("Promise.resolve(true)", REACTION)?;
    for never in ["false", "Promise.resolve(false)", "nothing.at.all"] {
        let error = page.wait_for(never, Duration::from_millis(100)).expect_err("never").to_string();
        ensure!(error.contains("not within 100ms"), "{error}");
    }
    let error = page.evaluate_within(Duration::from_millis(300), "new Promise(() => {})").expect_err("never");
    ensure!(format!("{error:#}").contains("not within 300ms"), "{error:#}");
    ensure!(page.blob("new Blob([new Uint8Array([0, 255, 7])])")? == [0, 255, 7]);
    ensure!(middle(&page.screenshot_png()?)? == [10, 120, 30], "another colour than the page's");
    page.set_media("dark")?;
    ensure!(middle(&page.screenshot_png()?)? == [60, 10, 5], "the page is not dark");
    page.set_viewport([100, 50], 2.0, false)?;
    let picture = image::load_from_memory(&page.screenshot_png()?)?;
    ensure!((picture.width(), picture.height()) == (200, 100), "{} x {}", picture.width(), picture.height());
    ensure!(page.problems()?.is_empty(), "{:?}", page.problems()?);
    ensure!(site.browser.answers() && site.browser.memory_mib() > 20.0, "{} MiB", site.browser.memory_mib());
    Ok(())
}

pub(super) fn input_arrives() -> Result<()> {
    let site = Site::open(PageOptions { touch: true, ..PageOptions::default() })?;
    let page = &site.page;
    page.press("w")?;
    site.wait_for_events("event.kind === 'keydown' && event.key === 'w' && event.code === 'KeyW'", "=== 1")?;
    page.hold("PageUp", Duration::ZERO)?;
    site.wait_for_events("event.kind === 'keyup' && event.key === 'PageUp'", "=== 1")?;
    page.touch(&[[[50.0, 60.0], [90.0, 60.0]], [[200.0, 60.0], [160.0, 60.0]]])?;
    site.wait_for_events("event.kind === 'pointerup' && event.x === 90 && event.type === 'touch'", "=== 1")?;
    site.wait_for_events("event.kind === 'pointerdown' && event.type === 'touch'", "=== 2")?;
    page.set_viewport([400, 300], 1.0, false)?;
    page.drag(Button::Right, [20.0, 30.0], [60.0, 50.0])?;
    site.wait_for_events("event.kind === 'pointerdown' && event.button === 2 && event.type === 'mouse'", "=== 1")?;
    site.wait_for_events("event.kind === 'pointermove' && event.x > 20 && event.x < 60", "> 3")?;
    page.click([5.0, 5.0], 2)?;
    site.wait_for_events("event.kind === 'dblclick'", "=== 1")?;
    page.wheel([5.0, 5.0], 120.0)?;
    site.wait_for_events("event.kind === 'wheel' && event.delta === 120", "> 0")
}

pub(super) fn networks_are_emulated() -> Result<()> {
    let site = Site::open(PageOptions::default())?;
    ensure!(site.ask("large?0")?["size"] == LARGE);
    site.page.emulate_network(4.0, 300.0)?;
    ensure!(site.ask("large?1")?["size"] == LARGE);
    site.page.set_offline(true)?;
    ensure!(site.ask("large?2")?["error"].is_string(), "the page is not offline");
    site.page.set_offline(false)?;
    ensure!(site.ask("large?3")?["size"] == LARGE);
    let of = |name: &str| site.page.ended_request(|request| request.url.ends_with(name));
    let large = of("large?1")?;
    ensure!(large.status == 200 && (500_000..501_000).contains(&large.bytes), "{large:?}");
    // 500 kB at 4 Mbit/s.
    ensure!(large.end_s.is_some_and(|end_s| end_s - large.begin_s > 1.0), "{large:?}");
    ensure!(of("large?2")?.failure.is_some(), "a request without a network did not fail");
    ensure!(of("style.css")?.bytes > 100, "no bytes of the style");
    let before = site.page.bytes_until(large.begin_s)?;
    ensure!((501_000..510_000).contains(&before), "{before} bytes before the slow request");
    let requests = site.page.requests()?;
    ensure!(requests.iter().all(|request| request.url.starts_with(&site.host.url())), "{requests:?}");
    Ok(())
}

pub(super) fn errors_are_collected() -> Result<()> {
    let site = Site::open(PageOptions::default())?;
    let page = &site.page;
    site.ask("large")?;
    page.evaluate(
        "console.log('hello', { a: 1 }, 5); setTimeout(() => { throw new Error('late') }); console.error('bad')",
    )?;
    page.evaluate("document.body.append(Object.assign(document.createElement('script'), { text: 'window.ran = 1' }))")?;
    page.evaluate("fetch('missing').then(() => 0)")?;
    for (source, words) in [
        ("console", "hello"),
        ("console", "in the worker large"),
        ("console", "bad"),
        ("exception", "late"),
        ("security", "script-src"),
        ("network", "missing"),
    ] {
        page.wait_for_message(source, words)?;
    }
    ensure!(page.evaluate("window.ran === undefined")? == true, "a script ran that the page forbids");
    let problems = page.problems()?;
    ensure!(problems.iter().all(|message| message.level == "error"), "{problems:?}");
    let is_problem = |words: &str| problems.iter().any(|message| message.text.contains(words));
    ensure!(
        ["bad", "late", "script-src", "missing"].into_iter().all(is_problem) && !is_problem("hello"),
        "{problems:?}"
    );
    Ok(())
}
