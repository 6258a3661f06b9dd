//! The window, controlled as by a user: keyboard, mouse, a restart, a server that stops.
//!
//! Runs on a virtual screen (Xvfb) with xdotool and compares screenshots, which stay in `target/window`. Without these
//! programs or a graphics driver, the test is reported as ignored.

use anyhow::{Context, Result, bail, ensure};
use image::RgbImage;
use insula_bake::BakeOptions;
use insula_client::ui::{settings::UserSettings, view_link::ViewLink};
use insula_tests::{
    fixtures,
    gpu::{Gpu, adapter_is_required},
    programs::{ServerProcess, find_installed, program},
};
use libtest_mimic::{Arguments, Failed, Trial};
use std::{
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::{Arc, Mutex, PoisonError},
    time::{Duration, Instant},
};

/// Longest wait for a change; with a software driver, frames take long.
const MAX_WAIT: Duration = Duration::from_secs(120);
/// Size of the window of a session in points.
const SESSION_WINDOW: [u32; 2] = [640, 440];
/// Largest share of differing pixels of two pictures of a view: edges, where other tiles were resident.
const SAME_VIEW: f64 = 0.03;
const TOOLS: [&str; 3] = ["Xvfb", "xdotool", "import"];

fn main() {
    let arguments = Arguments::from_args();
    let missing: Vec<&str> = TOOLS.into_iter().filter(|tool| find_installed(tool).is_none()).collect();
    let driver = Gpu::open();
    if !missing.is_empty() || driver.is_err() {
        eprintln!(
            "the window test cannot run: missing {missing:?}, driver: {:?}",
            driver.as_ref().map(|gpu| &gpu.name)
        );
    }
    let ignored = !missing.is_empty() || driver.is_err() && !adapter_is_required();
    let failed = |e: anyhow::Error| Failed::from(format!("{e:#}"));
    let mut tests =
        vec![Trial::test("a_user_controls_the_window", move || a_user_controls_the_window().map_err(failed))];
    for adapter in ["cpu", "gpu"] {
        for scale in [1, 2] {
            let session = move || a_session_with_a_chosen_city(Display { adapter, scale }).map_err(failed);
            tests.push(Trial::test(format!("a_session_with_a_chosen_city_{adapter}_{scale}x"), session));
        }
    }
    let tests = tests.into_iter().map(|test| test.with_ignored_flag(ignored)).collect();
    libtest_mimic::run(&arguments, tests).exit();
}

/// A virtual screen; ended when dropped.
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
        let mut number = String::new();
        BufReader::new(xvfb.stdout.take().context("no output")?).read_line(&mut number)?;
        ensure!(!number.trim().is_empty(), "Xvfb found no free display");
        Ok(Self { xvfb, display: format!(":{}", number.trim()) })
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        let _ = self.xvfb.kill();
        let _ = self.xvfb.wait();
    }
}

/// A running client with its window and its output.
struct Client {
    program: Child,
    display: String,
    window: String,
    /// Pixels per point.
    scale: u32,
    output: Arc<Mutex<Vec<String>>>,
    screenshots: PathBuf,
}

/// How a client draws.
#[derive(Clone, Copy)]
struct Display {
    adapter: &'static str,
    /// Pixels per point.
    scale: u32,
}

impl Client {
    /// Starts `insula view ADDRESS` in `folder`, which has its settings too, and waits for the window.
    fn start(screen: &Screen, folder: &Path, address: &str) -> Result<Self> {
        Self::start_on(Display { adapter: "cpu", scale: 1 }, "controls", screen, folder, address)
    }

    /// As `start`, on a given display. The screenshots lie in the folder `test`, as tests run at the same time.
    fn start_on(display: Display, test: &str, screen: &Screen, folder: &Path, address: &str) -> Result<Self> {
        let mut program = Command::new(program("insula")?)
            .args(["view", address, "--adapter", display.adapter])
            .env("WINIT_X11_SCALE_FACTOR", display.scale.to_string())
            .current_dir(folder)
            .env("DISPLAY", &screen.display)
            .env_remove("WAYLAND_DISPLAY")
            .env("XDG_CONFIG_HOME", folder)
            .env("RUST_LOG", "error,insula_client::ui=debug")
            .env("NO_COLOR", "1")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()?;
        let output = Arc::new(Mutex::new(Vec::new()));
        collect_lines(program.stdout.take(), &output);
        collect_lines(program.stderr.take(), &output);
        let scale = display.scale;
        let screenshots = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("window").join(test);
        std::fs::create_dir_all(&screenshots)?;
        let display = screen.display.clone();
        let mut client = Self { program, display, window: String::new(), scale, output, screenshots };
        let pid = client.program.id().to_string();
        client.wait_until("a window", |client| {
            let found = client.tool("xdotool", &["search", "--pid", &pid]).unwrap_or_default();
            client.window = found.lines().last().unwrap_or_default().to_owned();
            Ok(!client.window.is_empty())
        })?;
        Ok(client)
    }

    fn tool(&self, tool: &str, arguments: &[&str]) -> Result<String> {
        let output = Command::new(tool).args(arguments).env("DISPLAY", &self.display).output()?;
        ensure!(output.status.success(), "{tool} {arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    }

    fn xdotool(&self, arguments: &[&str]) -> Result<()> {
        self.tool("xdotool", arguments).map(drop)
    }

    fn key(&self, key: &str) -> Result<()> {
        self.xdotool(&["windowfocus", &self.window, "key", key])
    }

    fn hold(&self, key: &str, time: Duration) -> Result<()> {
        self.xdotool(&["windowfocus", &self.window, "keydown", key])?;
        std::thread::sleep(time);
        self.xdotool(&["keyup", key])
    }

    /// Clicks at a place in points.
    fn click(&self, x: u32, y: u32, button: &str) -> Result<()> {
        let [x, y] = [x, y].map(|side| (side * self.scale).to_string());
        self.xdotool(&["mousemove", "--window", &self.window, &x, &y, "sleep", "0.1", "click", button])
    }

    /// Polls `done` while the client runs.
    fn wait_until(&mut self, what: &str, mut done: impl FnMut(&mut Self) -> Result<bool>) -> Result<()> {
        let begin = Instant::now();
        while !done(self)? {
            if let Some(status) = self.program.try_wait()? {
                bail!("waiting for {what}: the program ended with {status}: {:?}", self.lines());
            }
            ensure!(begin.elapsed() < MAX_WAIT, "no {what} within {MAX_WAIT:?}: {:?}", self.lines());
            std::thread::sleep(Duration::from_millis(50));
        }
        Ok(())
    }

    fn lines(&self) -> Vec<String> {
        self.output.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Waits for a line of output that contains `words`, after the first `after` lines.
    fn wait_for_line(&mut self, words: &str, after: usize) -> Result<String> {
        let mut found = None;
        self.wait_until(words, |client| {
            found = client.lines().into_iter().skip(after).find(|line| line.contains(words));
            Ok(found.is_some())
        })?;
        found.context("no line")
    }

    fn screenshot(&self, name: &str) -> Result<RgbImage> {
        let path = self.screenshots.join(format!("{name}.png"));
        self.tool("import", &["-window", &self.window, &path.to_string_lossy()])?;
        Ok(image::open(path)?.to_rgb8())
    }

    /// Runs `action`, and takes a screenshot of the next settled frame.
    fn screenshot_after(&mut self, name: &str, action: impl FnOnce(&mut Self) -> Result<()>) -> Result<RgbImage> {
        let before = self.lines().len();
        action(self)?;
        self.wait_for_line("frame settled", before)?;
        self.screenshot(name)
    }

    /// Runs `action`, and takes screenshots until one differs from `before`.
    fn screenshot_of_change(
        &mut self,
        name: &str,
        before: &RgbImage,
        action: impl FnOnce(&Self) -> Result<()>,
    ) -> Result<RgbImage> {
        action(self)?;
        let mut after = before.clone();
        self.wait_until(name, |client| {
            after = client.screenshot(name)?;
            Ok(difference(before, &after) > 0.05)
        })?;
        Ok(after)
    }

    fn quit(&mut self) -> Result<i32> {
        self.key("Escape")?;
        let begin = Instant::now();
        loop {
            if let Some(status) = self.program.try_wait()? {
                return status.code().context("killed");
            }
            ensure!(begin.elapsed() < MAX_WAIT, "Escape does not end the client");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

fn collect_lines(stream: Option<impl std::io::Read + Send + 'static>, lines: &Arc<Mutex<Vec<String>>>) {
    let (Some(stream), lines) = (stream, lines.clone()) else { return };
    std::thread::spawn(move || {
        for line in BufReader::new(stream).lines().map_while(Result::ok) {
            lines.lock().unwrap_or_else(PoisonError::into_inner).push(line);
        }
    });
}

/// Share of pixels that differ visibly.
fn difference(a: &RgbImage, b: &RgbImage) -> f64 {
    if a.dimensions() != b.dimensions() {
        return 1.0;
    }
    let differs = |(a, b): (&image::Rgb<u8>, &image::Rgb<u8>)| a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > 12);
    a.pixels().zip(b.pixels()).filter(|pair| differs(*pair)).count() as f64 / (a.width() * a.height()) as f64
}

/// The part of a view that no overlay covers: messages appear above, the compass and the status on the left.
fn scene(view: &RgbImage) -> RgbImage {
    let (left, top) = (view.width() * 6 / 10, view.height() / 2);
    image::imageops::crop_imm(view, left, top, view.width() - left, view.height() - top).to_image()
}

/// Number of colours in steps of 16; an empty window has one.
fn colours(screenshot: &RgbImage) -> usize {
    screenshot.pixels().map(|p| p.0.map(|c| c / 16)).collect::<std::collections::HashSet<_>>().len()
}

fn a_user_controls_the_window() -> Result<()> {
    let folder = tempfile::tempdir()?;
    let city = fixtures::baked_chiba()?;
    let settings_at = folder.path().join("insula").join("settings.json");
    std::fs::create_dir_all(folder.path().join("insula"))?;
    std::fs::write(&settings_at, "{ damaged")?;
    let server = ServerProcess::serve(&city, "127.0.0.1:0")?;
    let address = server.address.to_string();
    drop(server);
    let screen = Screen::start()?;

    // The server is down: the window reports it and tries again.
    let mut client = Client::start(&screen, folder.path(), &format!("http://{address}/v1/cities/chiba"))?;
    client.wait_for_line("settings cannot be used", 0)?;
    client.wait_for_line("not connected: ", 0)?;
    client.screenshot("1-connecting")?;
    let server = ServerProcess::serve(&city, &address)?;
    client.wait_for_line("frame settled", 0)?;

    let resized = client.screenshot_after("2-resized", |p| p.xdotool(&["windowsize", &p.window, "640", "400"]))?;
    ensure!(resized.dimensions() == (640, 400) && colours(&resized) > 30, "{:?}", resized.dimensions());
    let before = hide_the_overlay(&mut client, &resized)?;
    let moved = client.screenshot_of_change("4-moved-by-w", &before, |p| p.hold("w", Duration::from_millis(700)))?;
    client.screenshot_of_change("5-higher-by-page-up", &moved, |p| p.hold("Page_Up", Duration::from_millis(500)))?;

    toggle_full_screen_and_bookmark(&mut client)?;
    measure_and_record(&mut client)?;
    save_a_picture(&mut client, [640, 400])?;
    let (link, view) = copy_a_link(&mut client)?;
    stop_and_restart_server(&mut client, server, || ServerProcess::serve(&city, &address))?;

    ensure!(client.quit()? == 0, "after Escape, the exit code is not 0");
    let (settings, note) = UserSettings::load(&settings_at);
    ensure!(note.is_none() && settings.window == [640, 400], "the settings are {settings:?} {note:?}");
    ensure!(settings.bookmarks.get("chiba").is_some_and(|b| b.len() == 1), "the settings are {settings:?}");
    ensure!(!settings.overlay && !settings.minimap, "the settings are {settings:?}");
    ensure!(folder.path().join("insula").join("settings.damaged.json").is_file(), "the damaged file was not saved");

    // The link opens the same view in a second window of the saved size.
    let _server = ServerProcess::serve(&city, &address)?;
    let mut other = Client::start(&screen, folder.path(), &link)?;
    other.wait_for_line("frame settled", 0)?;
    let same = other.screenshot("10-link")?;
    // Idle prefetch does not change the frame, which is not drawn again.
    other.wait_for_line("idle prefetch done", 0)?;
    let settled = |client: &Client| client.lines().iter().filter(|line| line.contains("frame settled")).count();
    let before = settled(&other);
    let same = scene(&same);
    let later = scene(&other.screenshot("11-idle-prefetch")?);
    ensure!(
        difference(&same, &later) < SAME_VIEW,
        "the frame changed during idle prefetch: {}",
        difference(&same, &later)
    );
    ensure!(settled(&other) == before, "the frame was drawn again after idle prefetch");
    let changed = difference(&scene(&view), &same);
    ensure!(changed < SAME_VIEW, "the link opens another view: {changed}");
    ensure!(other.quit()? == 0, "after Escape, the exit code is not 0");
    Ok(())
}

/// A server with two cities: one is chosen, viewed, left, found again and measured; the server stops and is restarted.
/// In the end, the window system destroys the window.
fn a_session_with_a_chosen_city(display: Display) -> Result<()> {
    let folder = tempfile::tempdir()?;
    let city = fixtures::baked_chiba()?;
    let village = fixtures::baked(
        "village",
        &BakeOptions { inputs: vec![fixtures::write_city_json(folder.path(), 3)?], ..BakeOptions::default() },
    )?;
    let serve = |at: &str| {
        let mut command = Command::new(program("insula-server")?);
        ServerProcess::start_with(&mut command, &[&city, &village], at, &[])
    };
    let server = serve("127.0.0.1:0")?;
    let address = server.address.to_string();
    let screen = Screen::start()?;
    std::fs::create_dir_all(folder.path().join("insula"))?;
    let settings = UserSettings { window: SESSION_WINDOW, ..UserSettings::default() };
    std::fs::write(folder.path().join("insula").join("settings.json"), serde_json::to_string(&settings)?)?;
    let test = format!("session-{}-{}x", display.adapter, display.scale);
    let mut client = Client::start_on(display, &test, &screen, folder.path(), &format!("http://{address}"))?;
    choose_the_first_city(&mut client)?;
    fly_away_and_home(&mut client)?;
    measure_area_and_height(&mut client)?;
    client.key("b")?;
    client.wait_for_line("saved as View 1", 0)?;
    save_a_picture(&mut client, SESSION_WINDOW.map(|side| side * display.scale))?;
    copy_a_link(&mut client)?;
    stop_and_restart_server(&mut client, server, || serve(&address))?;
    client.xdotool(&["windowclose", &client.window])?;
    let begin = Instant::now();
    let status = loop {
        match client.program.try_wait()? {
            Some(status) => break status,
            None => ensure!(begin.elapsed() < MAX_WAIT, "the program does not end with its window"),
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    ensure!(status.code() == Some(0), "after the window was destroyed: {status}: {:?}", client.lines());
    Ok(())
}

fn choose_the_first_city(client: &mut Client) -> Result<()> {
    client.wait_for_line("has several cities: choose one with --city: chiba, village", 0)?;
    let mut choice = client.screenshot("1-chooser")?;
    // The second picture appears after the first one.
    client.wait_until("pictures of the cities", |client| {
        std::thread::sleep(Duration::from_millis(500));
        let before = std::mem::replace(&mut choice, client.screenshot("1-chooser")?);
        Ok(colours(&choice) > 60 && before == choice)
    })?;
    client.click(320, 200, "1")?;
    client.wait_for_line("opened chiba", 0)?;
    client.wait_for_line("frame settled", 0)?;
    // The window comes to rest.
    client.wait_for_line("idle prefetch done", 0)?;
    Ok(())
}

fn fly_away_and_home(client: &mut Client) -> Result<()> {
    let home = client.screenshot("2-home")?;
    let before = client.lines().len();
    let away = client.screenshot_of_change("3-away", &home, |p| p.hold("w", Duration::from_millis(900)))?;
    client.wait_for_line("frame settled", before)?;
    let again = client.screenshot_after("4-home", |p| p.key("h"))?;
    ensure!(difference(&home, &away) > 0.05, "the view has not changed");
    let changed = difference(&scene(&home), &scene(&again));
    ensure!(changed < SAME_VIEW, "H shows another view: {changed}");
    Ok(())
}

/// Measures a line, an area and a height: M changes from one to the next.
fn measure_area_and_height(client: &mut Client) -> Result<()> {
    for (name, unit) in [("5-line", "m long"), ("6-area", "in plan"), ("7-height", "m high")] {
        client.key("m")?;
        for (x, y) in [(300, 290), (380, 300), (440, 270)] {
            client.click(x, y, "1")?;
            // Two clicks within a short time are a double click.
            std::thread::sleep(Duration::from_millis(600));
        }
        client.wait_for_line(unit, 0)?;
        client.screenshot(name)?;
    }
    client.key("Escape")
}

/// Hides the counters and the map. The scene stays as it is.
fn hide_the_overlay(client: &mut Client, before: &RgbImage) -> Result<RgbImage> {
    let settled = |client: &Client| client.lines().iter().filter(|line| line.contains("frame settled")).count();
    let frames = settled(client);
    client.key("n")?;
    client.key("o")?;
    let mut hidden = client.screenshot("3-open")?;
    client.wait_until("the overlay's end", |client| {
        std::thread::sleep(Duration::from_millis(700));
        let last = std::mem::replace(&mut hidden, client.screenshot("3-open")?);
        Ok(difference(before, &hidden) > 0.1 && last == hidden)
    })?;
    ensure!(colours(&hidden) > 30, "the window is empty: {} colours", colours(&hidden));
    // The map and the counters reach a little below the middle.
    let lowest = |view: &RgbImage| {
        let view = scene(view);
        image::imageops::crop_imm(&view, 0, view.height() / 2, view.width(), view.height() / 2).to_image()
    };
    let change = difference(&lowest(before), &lowest(&hidden));
    ensure!(change < 0.02 && settled(client) == frames, "the scene was redrawn: {change} of its pixels differ");
    Ok(hidden)
}

fn toggle_full_screen_and_bookmark(client: &mut Client) -> Result<()> {
    // Without a window manager, the request has no effect; the client must continue.
    client.key("F11")?;
    client.screenshot("6-full-screen")?;
    client.key("F11")?;
    client.key("b")?;
    client.wait_for_line("saved as View 1", 0)?;
    Ok(())
}

fn measure_and_record(client: &mut Client) -> Result<()> {
    client.key("m")?;
    client.click(300, 240, "1")?;
    client.wait_for_line("click the next point", 0)?;
    client.click(420, 290, "1")?;
    let long = client.wait_for_line("m long", 0)?;
    let metres: f64 = long.split("measure: ").nth(1).and_then(|t| t.split(' ').next()).context("metres")?.parse()?;
    ensure!((5.0..3000.0).contains(&metres), "{long}");
    client.screenshot("7-measured")?;
    // Escape ends measuring, not the program.
    client.key("Escape")?;
    client.key("r")?;
    client.wait_for_line("recording", 0)?;
    client.hold("d", Duration::from_millis(600))?;
    let moved = client.lines().len();
    client.key("r")?;
    let wrote = client.wait_for_line("insula-path-0001.json", 0)?;
    let path = insula_client::camera_files::read_path(Path::new(wrote.trim_start_matches("wrote ")))?;
    ensure!(path.seconds > 0.5 && path.keys.len() >= 3, "{path:?}");
    // The final frame is drawn with several samples, after one with a single sample.
    client.wait_for_line("idle prefetch done", moved)?;
    Ok(())
}

/// A picture is drawn in the background and written into the current folder.
fn save_a_picture(client: &mut Client, size_px: [u32; 2]) -> Result<()> {
    client.key("p")?;
    let wrote = client.wait_for_line("insula-0001.png", 0)?;
    let picture = image::open(wrote.trim_start_matches("wrote "))?.to_rgb8();
    ensure!(picture.dimensions() == size_px.into() && colours(&picture) > 30, "{:?}", picture.dimensions());
    Ok(())
}

fn copy_a_link(client: &mut Client) -> Result<(String, RgbImage)> {
    client.key("c")?;
    let link = client.wait_for_line("copied insula://", 0)?.trim_start_matches("copied ").to_owned();
    ensure!(ViewLink::parse(&link)?.camera.is_some(), "{link}");
    let mut view = client.screenshot("8-view")?;
    client.wait_until("view at rest", |client| {
        std::thread::sleep(Duration::from_secs(2));
        let before = std::mem::replace(&mut view, client.screenshot("8-view")?);
        Ok(before == view)
    })?;
    Ok((link, view))
}

fn stop_and_restart_server(
    client: &mut Client,
    server: ServerProcess,
    restart: impl FnOnce() -> Result<ServerProcess>,
) -> Result<()> {
    drop(server);
    let before = client.lines().len();
    // Moves closer, so that finer tiles are requested.
    for _ in 0..14 {
        client.click(320, 220, "4")?;
    }
    client.wait_for_line("reconnecting", before)?;
    let gone = client.screenshot("9-reconnecting")?;
    ensure!(colours(&gone) > 30, "resident tiles are no longer drawn");
    let before = client.lines().len();
    let _server = restart()?;
    client.wait_for_line("status: ready", before)?;
    client.wait_for_line("frame settled", before)?;
    client.screenshot("9-reconnected")?;
    Ok(())
}
