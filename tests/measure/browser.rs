//! Measures the viewer in a browser: the first picture on a slow link and processor, transferred bytes, the longest task of
//! the main thread and the time from a key to its picture while flying, memory, and the same picture as the native client.
//!
//! `cargo run --release -p insula-measure --bin browser -- CITY... [--runs 3] [--flight 60] [--pictures]`

use anyhow::{Context, Result, ensure};
use clap::{Parser, ValueEnum};
use insula_protocol::Manifest;
use insula_tests::browser::city_page::CityPage;
use insula_tests::browser::same_picture::{SharedView, cameras, in_browser, native, share_of_same};
use insula_tests::browser::{Browser, Button, Page, PageOptions};
use insula_tests::compare::percentile;
use insula_tests::programs::ServerProcess;
use serde::Serialize;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Measures the viewer in headless Chromium, against a server of this build
#[derive(Debug, Parser)]
struct Args {
    /// Baked cities
    #[arg(required_unless_present = "page")]
    cities: Vec<PathBuf>,
    /// Measure cold starts of another page instead
    #[arg(long, requires = "until")]
    page: Option<String>,
    /// JavaScript that gives the milliseconds from that page's navigation to its first picture, once it is there
    #[arg(long)]
    until: Option<String>,
    /// Megabits per second of the emulated link
    #[arg(long, default_value_t = 20.0)]
    mbit: f64,
    /// Its round trip in milliseconds
    #[arg(long, default_value_t = 50.0)]
    rtt: f64,
    /// Factor by which the processor is slower
    #[arg(long, default_value_t = 4.0)]
    slow: f64,
    /// What is slower: the page's main thread, as in the browser's developer tools, or all processes of the browser
    #[arg(long, value_enum, default_value_t = Slow::All)]
    slow_what: Slow,
    /// Draw with WebGPU on a software driver
    #[arg(long)]
    gpu: bool,
    /// Size of the page
    #[arg(long, num_args = 2, default_values_t = [1280, 720])]
    size: Vec<u32>,
    /// Cold starts per city
    #[arg(long, default_value_t = 3)]
    runs: usize,
    /// Seconds of flight; 0 for none
    #[arg(long, default_value_t = 60)]
    flight: u64,
    /// Compare four views of each city with the native client
    #[arg(long)]
    pictures: bool,
    /// Write all measures as JSON
    #[arg(long)]
    report: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Slow {
    Page,
    All,
}

#[derive(Debug, Serialize)]
struct CityReport {
    city: String,
    starts: Vec<Start>,
    flight: Option<Flight>,
    /// Percentage of pixels that are the native client's, by view.
    same_percent: Vec<f64>,
}

#[derive(Debug, Serialize)]
struct Start {
    adapter: String,
    first_picture_ms: f64,
    first_picture_bytes: u64,
    final_picture_ms: f64,
    final_picture_bytes: u64,
    longest_task_ms: f64,
}

#[derive(Debug, Serialize)]
struct Flight {
    longest_task_ms: f64,
    frame_interval_p50_ms: f64,
    frame_interval_p95_ms: f64,
    key_to_picture_p50_ms: f64,
    key_to_picture_p95_ms: f64,
    /// Of all processes of the browser, every ten seconds.
    memory_mib: Vec<f64>,
}

/// Size of compared pictures, which a software driver draws in seconds.
const SMALL: [u32; 2] = [240, 160];
const KEYS: usize = 30;
const MEMORY_EVERY: Duration = Duration::from_secs(10);
/// Longest wait for a picture after a key.
const MOST: Duration = Duration::from_secs(10);
/// Longest start of a page.
const LONGEST_START: Duration = Duration::from_secs(120);
/// Time from a key to the frame with the next camera.
const STOPWATCH: &str = r"(() => {
globalThis.insulaKeyMs = [];
let pressed = null;
addEventListener('keydown', event => pressed ??= event.timeStamp, true);
addEventListener('camera', () => {
    if (pressed !== null) insulaKeyMs.push(performance.now() - pressed);
    pressed = null;
}, true);
})()";

fn main() -> Result<()> {
    let args = Args::parse();
    ensure!(Browser::find().is_some(), "no Chromium: install it, or name it in INSULA_CHROMIUM");
    if let (Some(url), Some(until)) = (&args.page, &args.until) {
        return measure_page(&args, url, until);
    }
    let mut reports = Vec::new();
    for city in &args.cities {
        reports.push(measure(&args, city)?);
    }
    if let Some(path) = &args.report {
        fs::write(path, serde_json::to_string_pretty(&reports)?)?;
    }
    Ok(())
}

fn measure(args: &Args, city: &Path) -> Result<CityReport> {
    let manifest: Manifest = serde_json::from_slice(&fs::read(city.join("city.json"))?)?;
    let server = ServerProcess::serve(city, "127.0.0.1:0")?;
    let url = format!("http://{}/cities/{}", server.address, manifest.name);
    println!(
        "## {}: {} Mbit/s, {} ms, {:?} {} times slower",
        manifest.name, args.mbit, args.rtt, args.slow_what, args.slow
    );
    println!("| start | adapter | first picture ms | kB | final picture ms | kB | longest task ms |");
    println!("|---|---|---|---|---|---|---|");
    let mut starts = Vec::new();
    for number in 1..=args.runs {
        let start = cold_start(args, &url)?;
        println!(
            "| {number} | {} | {:.0} | {:.0} | {:.0} | {:.0} | {:.0} |",
            start.adapter,
            start.first_picture_ms,
            start.first_picture_bytes as f64 / 1e3,
            start.final_picture_ms,
            start.final_picture_bytes as f64 / 1e3,
            start.longest_task_ms
        );
        starts.push(start);
    }
    let flight = (args.flight > 0).then(|| fly(args, &url)).transpose()?;
    let same_percent = if args.pictures { compare(args, &server, &manifest)? } else { Vec::new() };
    Ok(CityReport { city: manifest.name, starts, flight, same_percent })
}

fn page_options(args: &Args) -> PageOptions {
    PageOptions { size: [args.size[0], args.size[1]], ..PageOptions::default() }
}

/// The element takes WebGPU on a software driver only if it is told to.
fn address(args: &Args, url: &str) -> String {
    if args.gpu { format!("{url}?adapter=gpu") } else { url.to_owned() }
}

/// Opens the page in a new browser.
fn cold_start(args: &Args, url: &str) -> Result<Start> {
    let browser = Browser::launch(args.gpu)?;
    let city = CityPage::new(&browser, page_options(args))?;
    city.page.emulate_network(args.mbit, args.rtt)?;
    let slowdown = match args.slow_what {
        Slow::All => Some(browser.slow_down(args.slow)?),
        Slow::Page => None,
    };
    if slowdown.is_none() {
        city.page.throttle_cpu(args.slow)?;
    }
    city.page.begin_navigation(&address(args, url))?;
    city.wait_until_ready(0)?;
    let origin_ms = number(&city.page, "performance.timeOrigin")?;
    let ready_ms = city.last_event(0, "ready")?["firstMs"].as_f64().context("no time")?;
    city.wait_until_final(0)?;
    let final_ms = city.last_event(0, "progress")?["atMs"].as_f64().context("no time")?;
    let adapter = city.last_event(0, "adapter")?["detail"]["kind"].as_str().unwrap_or("unknown").to_owned();
    Ok(Start {
        adapter,
        first_picture_ms: ready_ms - origin_ms,
        first_picture_bytes: city.page.bytes_until(ready_ms / 1e3)?,
        final_picture_ms: final_ms - origin_ms,
        final_picture_bytes: city.page.bytes_until(final_ms / 1e3)?,
        longest_task_ms: number(&city.page, "insulaLongestTaskMs")?,
    })
}

/// Cold starts of a page that is not ours.
fn measure_page(args: &Args, url: &str, until: &str) -> Result<()> {
    println!("| start | first picture ms | kB |\n|---|---|---|");
    for number_of_start in 1..=args.runs {
        let browser = Browser::launch(args.gpu)?;
        let page = browser.open_page(page_options(args))?;
        page.emulate_network(args.mbit, args.rtt)?;
        let slowdown = match args.slow_what {
            Slow::All => Some(browser.slow_down(args.slow)?),
            Slow::Page => None,
        };
        if slowdown.is_none() {
            page.throttle_cpu(args.slow)?;
        }
        page.begin_navigation(url)?;
        page.wait_for(until, LONGEST_START)?;
        let first_ms = number(&page, until)?;
        let at_secs = (number(&page, "performance.timeOrigin")? + first_ms) / 1e3;
        let kilobytes = page.bytes_until(at_secs)? as f64 / 1e3;
        println!("| {number_of_start} | {first_ms:.0} | {kilobytes:.0} |");
    }
    Ok(())
}

fn number(page: &Page, expression: &str) -> Result<f64> {
    page.evaluate(expression)?.as_f64().with_context(|| format!("{expression} is no number"))
}

fn numbers(page: &Page, expression: &str) -> Result<Vec<f64>> {
    let all = page.evaluate(expression)?;
    let mut all: Vec<f64> = all.as_array().context("no list")?.iter().filter_map(serde_json::Value::as_f64).collect();
    all.sort_by(f64::total_cmp);
    Ok(all)
}

/// Flies by keys and mouse with a slow main thread, then measures single keys.
fn fly(args: &Args, url: &str) -> Result<Flight> {
    let browser = Browser::launch(args.gpu)?;
    let city = CityPage::new(&browser, page_options(args))?;
    city.page.prepare(STOPWATCH)?;
    city.page.navigate(&address(args, url))?;
    city.wait_until_ready(0)?;
    city.wait_until_final(0)?;
    city.page.throttle_cpu(args.slow)?;
    city.page.evaluate("insulaLongestTaskMs = 0")?;
    let memory_mib = fly_for(Duration::from_secs(args.flight), args, &browser, &city)?;
    let longest_task_ms = number(&city.page, "insulaLongestTaskMs")?;
    let intervals = numbers(&city.page, &format!("{}.insulaSeen.intervalsMs", CityPage::element(0)))?;
    city.wait_until_final(0)?;
    city.page.evaluate("insulaKeyMs.length = 0")?;
    for turn in 0..KEYS {
        let before = number(&city.page, "insulaKeyMs.length")?;
        city.page.press(["w", "s"][turn % 2])?;
        city.page.wait_for(&format!("insulaKeyMs.length > {before}"), MOST)?;
        city.wait_until_final(0)?;
    }
    let keys = numbers(&city.page, "insulaKeyMs")?;
    let flight = Flight {
        longest_task_ms,
        frame_interval_p50_ms: percentile(&intervals, 0.5),
        frame_interval_p95_ms: percentile(&intervals, 0.95),
        key_to_picture_p50_ms: percentile(&keys, 0.5),
        key_to_picture_p95_ms: percentile(&keys, 0.95),
        memory_mib,
    };
    println!("flight of {} s, main thread {} times slower:", args.flight, args.slow);
    println!("- longest task of the main thread {:.0} ms; 0: none over 50 ms", flight.longest_task_ms);
    println!("- between frames {:.0} ms, p95 {:.0} ms", flight.frame_interval_p50_ms, flight.frame_interval_p95_ms);
    println!("- key to picture {:.0} ms, p95 {:.0} ms", flight.key_to_picture_p50_ms, flight.key_to_picture_p95_ms);
    println!("- memory in MiB: {:.0?}", flight.memory_mib);
    Ok(flight)
}

/// Flies in large curves. Returns the browser's memory over time.
fn fly_for(time: Duration, args: &Args, browser: &Browser, city: &CityPage) -> Result<Vec<f64>> {
    let (begin, middle) = (Instant::now(), [f64::from(args.size[0]) / 2.0, f64::from(args.size[1]) / 2.0]);
    let (mut memory_mib, mut turn) = (vec![browser.memory_mib()], 0u32);
    while begin.elapsed() < time {
        let key = ["w", "w", "d", "w", "a", "s"][turn as usize % 6];
        city.page.hold(key, Duration::from_millis(900))?;
        let aside = if turn % 4 < 3 { 180.0 } else { -90.0 };
        city.page.drag(Button::Left, middle, [middle[0] + aside, middle[1]])?;
        turn += 1;
        if begin.elapsed() > MEMORY_EVERY * memory_mib.len() as u32 {
            memory_mib.push(browser.memory_mib());
        }
    }
    Ok(memory_mib)
}

/// Four views beside the native client's.
fn compare(args: &Args, server: &ServerProcess, manifest: &Manifest) -> Result<Vec<f64>> {
    let (folder, adapter) = (tempfile::tempdir()?, if args.gpu { "gpu" } else { "cpu" });
    let browser = Browser::launch(args.gpu)?;
    let mut shares = Vec::new();
    for camera in cameras(manifest)? {
        let view = SharedView { server: server.address, city: manifest.name.clone(), camera, size_px: SMALL };
        let same = share_of_same(&native(&view, folder.path())?, &in_browser(&browser, &view, adapter)?)?;
        println!("- {adapter}, camera {}: {:.3}% of the pixels are the native client's", shares.len(), same * 100.0);
        shares.push(same * 100.0);
    }
    Ok(shares)
}
