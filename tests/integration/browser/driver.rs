//! The driver itself, on pages of a plain host: scripts, pictures, input, emulated networks, and the log.

use anyhow::{Context, Result, ensure};
use insula_test_support::faulty_host::FaultyHost;
use insula_tests::browser::{Browser, BrowserOptions, Button, Page};
use serde_json::{Value, json};
use std::{
    fs,
    time::{Duration, Instant},
};
use tempfile::TempDir;

const LIMIT: Duration = Duration::from_secs(10);
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
onmessage = async event => {
    const begin = performance.now();
    let size = 0;
    const isWork = event.data === 'work';
    for (let turn = 0; isWork && turn < 1e8; turn++) size += turn & 1;
    try {
        if (!isWork) size = (await (await fetch(event.data)).arrayBuffer()).byteLength;
        console.log('in the worker', event.data);
        postMessage({ size, ms: performance.now() - begin });
    } catch (error) { postMessage({ error: String(error) }) }
};";

/// A host of the page, a folder that it serves, and the page.
struct Site {
    page: Page,
    host: FaultyHost,
    browser: Browser,
    _folder: TempDir,
}

impl Site {
    fn open(options: BrowserOptions) -> Result<Self> {
        let folder = tempfile::tempdir()?;
        for (name, text) in [("index.html", PAGE), ("style.css", STYLE), ("script.js", SCRIPT), ("worker.js", WORKER)] {
            fs::write(folder.path().join(name), text)?;
        }
        fs::write(folder.path().join("large"), vec![7; 500_000])?;
        let (host, browser) = (FaultyHost::start(folder.path()), Browser::launch(options)?);
        let page = browser.open_page()?;
        page.navigate(&format!("{}/", host.url()))?;
        Ok(Self { page, host, browser, _folder: folder })
    }

    /// What the worker answers.
    fn ask(&self, path: &str) -> Result<Value> {
        self.page.evaluate(&format!("ask('{path}')"))
    }

    fn seconds(&self, path: &str) -> Result<f64> {
        Ok(self.ask(path)?["ms"].as_f64().context("no time")? / 1000.0)
    }
}

fn middle(png: &[u8]) -> Result<[u8; 3]> {
    let picture = image::load_from_memory(png)?.to_rgb8();
    Ok(picture.get_pixel(picture.width() / 2, picture.height() / 2).0)
}

pub(super) fn scripts_and_pictures() -> Result<()> {
    let site = Site::open(BrowserOptions { size: [320, 200], ..BrowserOptions::default() })?;
    let page = &site.page;
    ensure!(
        page.evaluate("new Promise(done => setTimeout(() => done({ a: [1, 'x'] }), 20))")? == json!({ "a": [1, "x"] })
    );
    let error = page.evaluate("nothing.at.all").expect_err("it throws").to_string();
    ensure!(error.contains("ReferenceError") && !error.contains('\u{0}'), "{error}");
    page.wait_for("document.title === 'page'", LIMIT)?;
    let error = page.wait_for("false", Duration::from_millis(200)).expect_err("never").to_string();
    ensure!(error.contains("not within"), "{error}");
    let begin = Instant::now();
    ensure!(page.evaluate_within(Duration::from_millis(300), "new Promise(() => {})").is_err());
    ensure!(begin.elapsed() < LIMIT, "a time limit is not kept");
    ensure!(page.blob("new Blob([new Uint8Array([0, 255, 7])])")? == [0, 255, 7]);
    ensure!(middle(&page.screenshot_png()?)? == [10, 120, 30], "another colour than the page's");
    page.set_media("dark")?;
    ensure!(middle(&page.screenshot_png()?)? == [60, 10, 5], "the page is not dark");
    page.set_viewport([100, 50], 2.0, false)?;
    let picture = image::load_from_memory(&page.screenshot_png()?)?;
    ensure!((picture.width(), picture.height()) == (200, 100), "{} x {}", picture.width(), picture.height());
    ensure!(page.problems()?.is_empty(), "{:?}", page.problems()?);
    ensure!(site.browser.memory_mib() > 20.0, "{} MiB", site.browser.memory_mib());
    Ok(())
}

pub(super) fn input_arrives() -> Result<()> {
    let site = Site::open(BrowserOptions { touch: true, ..BrowserOptions::default() })?;
    let page = &site.page;
    let count = |condition: &str| -> Result<u64> {
        page.evaluate(&format!("seen.filter(event => {condition}).length"))?.as_u64().context("no count")
    };
    page.press("w")?;
    page.hold("PageUp", Duration::from_millis(50))?;
    ensure!(count("event.kind === 'keydown' && event.key === 'w' && event.code === 'KeyW'")? == 1);
    ensure!(count("event.kind === 'keyup' && event.key === 'PageUp'")? == 1);
    page.touch(&[[[50.0, 60.0], [90.0, 60.0]], [[200.0, 60.0], [160.0, 60.0]]])?;
    ensure!(count("event.kind === 'pointerdown' && event.type === 'touch'")? == 2, "{}", page.evaluate("seen")?);
    ensure!(count("event.kind === 'pointerup' && event.x === 90 && event.type === 'touch'")? == 1);
    page.set_viewport([400, 300], 1.0, false)?;
    page.drag(Button::Right, [20.0, 30.0], [60.0, 50.0])?;
    ensure!(count("event.kind === 'pointerdown' && event.button === 2 && event.type === 'mouse'")? == 1);
    ensure!(count("event.kind === 'pointermove' && event.x > 20 && event.x < 60")? > 3);
    page.click([5.0, 5.0], 2)?;
    ensure!(count("event.kind === 'dblclick'")? == 1);
    page.wheel([5.0, 5.0], 120.0)?;
    page.wait_for("seen.some(event => event.kind === 'wheel' && event.delta === 120)", LIMIT)
}

pub(super) fn networks_are_emulated() -> Result<()> {
    let site = Site::open(BrowserOptions::default())?;
    ensure!(site.seconds("large?0")? < 1.0, "the host is slow");
    site.page.emulate_network(2.0, 300.0)?;
    let slow_s = site.seconds("large?1")?;
    ensure!((2.0..4.0).contains(&slow_s), "500 kB at 2 Mbit/s took {slow_s} s");
    site.page.set_offline(true)?;
    ensure!(site.ask("large?2")?["error"].is_string(), "the page is not offline");
    site.page.set_offline(false)?;
    ensure!(site.ask("large?3")?["size"] == 500_000);
    let requests = site.page.requests()?;
    let of = |name: &str| requests.iter().find(|request| request.url.ends_with(name)).context("not in the log");
    let large = of("large?1")?;
    ensure!(large.status == 200 && (500_000..501_000).contains(&large.bytes), "{large:?}");
    ensure!(large.end_s.is_some_and(|end_s| end_s - large.begin_s > 2.0), "{large:?}");
    ensure!(of("large?2")?.failure.is_some() && of("style.css")?.bytes > 100, "{requests:?}");
    let before = site.page.bytes_until(large.begin_s)?;
    ensure!((501_000..510_000).contains(&before), "{before} bytes before the slow request");
    ensure!(requests.iter().all(|request| request.url.starts_with(&site.host.url())), "{requests:?}");
    Ok(())
}

pub(super) fn slow_processors_are_emulated() -> Result<()> {
    let site = Site::open(BrowserOptions::default())?;
    let work = "(() => { const begin = performance.now(); let sum = 0;
        for (let turn = 0; turn < 1e8; turn++) sum += turn & 1; return performance.now() - begin + sum * 0 })()";
    // The shortest of a few, as other programs run at the same time.
    let shortest = |measure: &dyn Fn() -> Result<f64>| -> Result<f64> {
        (0..4).try_fold(f64::INFINITY, |least, _| Ok(least.min(measure()?)))
    };
    let main = || site.page.evaluate(work)?.as_f64().context("no time");
    let worker = || Ok(site.seconds("work")? * 1000.0);
    // Other programs may slow down one of the measurements that are compared, but hardly that of each round.
    let slowdowns = || -> Result<()> {
        let (fast_ms, worker_ms) = (shortest(&main)?, shortest(&worker)?);
        site.page.throttle_cpu(4.0)?;
        let (slow_ms, slow_worker_ms) = (shortest(&main)?, shortest(&worker)?);
        site.page.throttle_cpu(1.0)?;
        println!("main thread {:.1} times slower, worker {:.1} times", slow_ms / fast_ms, slow_worker_ms / worker_ms);
        ensure!(slow_ms > 1.4 * fast_ms, "{slow_ms} ms after {fast_ms} ms");
        let slowdown = site.browser.slow_down(4.0)?;
        let (slow_ms, slow_worker_ms) = (shortest(&main)?, shortest(&worker)?);
        drop(slowdown);
        println!(
            "whole browser: {:.1} times slower, worker {:.1} times",
            slow_ms / fast_ms,
            slow_worker_ms / worker_ms
        );
        ensure!(
            slow_ms > 1.4 * fast_ms && slow_worker_ms > 1.4 * worker_ms,
            "{slow_ms} ms, worker {slow_worker_ms} ms"
        );
        let after_ms = shortest(&worker)?;
        ensure!(after_ms < 2.0 * worker_ms, "{after_ms} ms after the slowdown, {worker_ms} ms before");
        Ok(())
    };
    slowdowns().or_else(|_| slowdowns()).or_else(|_| slowdowns())
}

pub(super) fn errors_are_collected() -> Result<()> {
    let site = Site::open(BrowserOptions::default())?;
    let page = &site.page;
    site.ask("large")?;
    page.evaluate(
        "console.log('hello', { a: 1 }, 5); setTimeout(() => { throw new Error('late') }); console.error('bad')",
    )?;
    page.evaluate("document.body.append(Object.assign(document.createElement('script'), { text: 'window.ran = 1' }))")?;
    page.evaluate("fetch('missing').then(() => 0)")?;
    page.wait_for("!window.ran", LIMIT)?;
    let all = page.console_messages()?;
    let has =
        |source: &str, words: &str| all.iter().any(|message| message.source == source && message.text.contains(words));
    ensure!(has("console", "hello") && has("console", "in the worker large"), "{all:?}");
    ensure!(has("exception", "late") && has("security", "script-src"), "{all:?}");
    ensure!(has("network", "missing") && has("console", "bad"), "{all:?}");
    ensure!(page.problems()?.iter().all(|message| message.level == "error") && !page.problems()?.is_empty());
    page.clear_messages()?;
    ensure!(page.problems()?.is_empty());
    Ok(())
}
