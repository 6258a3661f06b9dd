//! The window, driven as a person would: keys, mouse, a second start, a server that goes away.
//!
//! It runs in a virtual screen (Xvfb) by xdotool, and looks at screenshots. Without these, or without a driver that can present,
//! it is reported as ignored. Pictures are left in `target/window`.

use anyhow::{Context, Result, bail, ensure};
use image::RgbImage;
use insula_client::ui::{settings::UserSettings, view_link::ViewLink};
use insula_tests::{
    fixtures,
    gpu::{Gpu, adapter_is_required},
    programs::{ServerProcess, program},
};
use libtest_mimic::{Arguments, Failed, Trial};
use std::{
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::{Arc, Mutex, PoisonError},
    time::{Duration, Instant},
};

/// Longest that anything may take that a person waits for; much of it is the software driver's.
const MOST: Duration = Duration::from_secs(30);
const TOOLS: [&str; 3] = ["Xvfb", "xdotool", "import"];

fn main() {
    let arguments = Arguments::from_args();
    let missing: Vec<&str> = TOOLS.into_iter().filter(|tool| !is_installed(tool)).collect();
    let driver = Gpu::open();
    if !missing.is_empty() || driver.is_err() {
        eprintln!("no window can be driven: missing {missing:?}, driver: {:?}", driver.as_ref().map(|gpu| &gpu.name));
    }
    let ignored = !missing.is_empty() || driver.is_err() && !adapter_is_required();
    let run = || a_person_drives_the_window().map_err(|e| Failed::from(format!("{e:#}")));
    let tests = vec![Trial::test("a_person_drives_the_window", run).with_ignored_flag(ignored)];
    libtest_mimic::run(&arguments, tests).exit();
}

fn is_installed(tool: &str) -> bool {
    let paths = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&paths).any(|folder| folder.join(tool).is_file())
}

/// A virtual screen; ended when dropped.
struct Screen {
    xvfb: Child,
    display: String,
}

impl Screen {
    fn start() -> Result<Self> {
        let mut xvfb = Command::new("Xvfb")
            // Without its reset, which who connects meanwhile does not survive, whenever the last client goes.
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

/// The program with its window, and what it said.
struct Person {
    program: Child,
    display: String,
    window: String,
    said: Arc<Mutex<Vec<String>>>,
    pictures: PathBuf,
}

impl Person {
    /// Starts `insula view ADDRESS` in `folder`, which has its settings too, and waits for the window.
    fn start(screen: &Screen, folder: &Path, address: &str) -> Result<Self> {
        let mut program = Command::new(program("insula")?)
            .args(["view", address, "--adapter", "cpu"])
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
        let said = Arc::new(Mutex::new(Vec::new()));
        listen(program.stdout.take(), &said);
        listen(program.stderr.take(), &said);
        let pictures = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("window");
        std::fs::create_dir_all(&pictures)?;
        let mut person = Self { program, display: screen.display.clone(), window: String::new(), said, pictures };
        let pid = person.program.id().to_string();
        person.until("a window", |person| {
            let found = person.tool("xdotool", &["search", "--pid", &pid]).unwrap_or_default();
            person.window = found.lines().last().unwrap_or_default().to_owned();
            Ok(!person.window.is_empty())
        })?;
        Ok(person)
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

    fn click(&self, x: u32, y: u32, button: &str) -> Result<()> {
        let (x, y) = (x.to_string(), y.to_string());
        self.xdotool(&["mousemove", "--window", &self.window, &x, &y, "sleep", "0.1", "click", button])
    }

    fn until(&mut self, what: &str, mut done: impl FnMut(&mut Self) -> Result<bool>) -> Result<()> {
        let begin = Instant::now();
        while !done(self)? {
            if let Some(status) = self.program.try_wait()? {
                bail!("waiting for {what}: the program ended with {status}: {:?}", self.all_said());
            }
            ensure!(begin.elapsed() < MOST, "no {what} within {MOST:?}: {:?}", self.all_said());
            std::thread::sleep(Duration::from_millis(50));
        }
        Ok(())
    }

    fn all_said(&self) -> Vec<String> {
        self.said.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Waits until it says something with `words` in it, after `after` lines.
    fn says(&mut self, words: &str, after: usize) -> Result<String> {
        let mut found = None;
        self.until(words, |person| {
            found = person.all_said().into_iter().skip(after).find(|line| line.contains(words));
            Ok(found.is_some())
        })?;
        found.context("said")
    }

    fn look(&self, name: &str) -> Result<RgbImage> {
        let path = self.pictures.join(format!("{name}.png"));
        self.tool("import", &["-window", &self.window, &path.to_string_lossy()])?;
        Ok(image::open(path)?.to_rgb8())
    }

    /// Does something and looks once the picture is as good as it gets again.
    fn look_after(&mut self, name: &str, action: impl FnOnce(&mut Self) -> Result<()>) -> Result<RgbImage> {
        let said = self.all_said().len();
        action(self)?;
        self.says("frame settled", said)?;
        self.look(name)
    }

    /// Does something and looks until the picture is another one than `before`.
    fn changes(&mut self, name: &str, before: &RgbImage, action: impl FnOnce(&Self) -> Result<()>) -> Result<RgbImage> {
        action(self)?;
        let mut after = before.clone();
        self.until(name, |person| {
            after = person.look(name)?;
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
            ensure!(begin.elapsed() < MOST, "Escape does not end it");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Person {
    fn drop(&mut self) {
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

fn listen(output: Option<impl std::io::Read + Send + 'static>, said: &Arc<Mutex<Vec<String>>>) {
    let (Some(output), said) = (output, said.clone()) else { return };
    std::thread::spawn(move || {
        for line in BufReader::new(output).lines().map_while(Result::ok) {
            said.lock().unwrap_or_else(PoisonError::into_inner).push(line);
        }
    });
}

/// Share of pixels that differ by more than a hair.
fn difference(a: &RgbImage, b: &RgbImage) -> f64 {
    if a.dimensions() != b.dimensions() {
        return 1.0;
    }
    let differs = |(a, b): (&image::Rgb<u8>, &image::Rgb<u8>)| a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > 12);
    a.pixels().zip(b.pixels()).filter(|pair| differs(*pair)).count() as f64 / (a.width() * a.height()) as f64
}

/// Colours, in steps of 16: an empty window has one.
fn colours(picture: &RgbImage) -> usize {
    picture.pixels().map(|p| p.0.map(|c| c / 16)).collect::<std::collections::HashSet<_>>().len()
}

fn a_person_drives_the_window() -> Result<()> {
    let folder = tempfile::tempdir()?;
    let city = fixtures::baked_chiba()?;
    let settings_at = folder.path().join("insula").join("settings.json");
    std::fs::create_dir_all(folder.path().join("insula"))?;
    std::fs::write(&settings_at, "{ damaged")?;
    let server = ServerProcess::serve(&city, "127.0.0.1:0")?;
    let address = server.address.to_string();
    drop(server);
    let screen = Screen::start()?;

    // Nobody answers: the window says so and tries again.
    let mut person = Person::start(&screen, folder.path(), &format!("http://{address}/v1/cities/chiba"))?;
    person.says("settings cannot be used", 0)?;
    person.says("not connected: ", 0)?;
    person.look("1-connecting")?;
    let server = ServerProcess::serve(&city, &address)?;
    person.says("status: ready", 0)?;

    let resized = person.look_after("2-resized", |p| p.xdotool(&["windowsize", &p.window, "640", "400"]))?;
    ensure!(resized.dimensions() == (640, 400) && colours(&resized) > 30, "{:?}", resized.dimensions());
    // Counters and map away, then the picture is the city's alone.
    person.key("n")?;
    let before = person.look_after("3-open", |p| p.key("o"))?;
    ensure!(colours(&before) > 30, "the window is empty: {} colours", colours(&before));
    let moved = person.changes("4-moved-by-w", &before, |p| p.hold("w", Duration::from_millis(700)))?;
    person.changes("5-higher-by-page-up", &moved, |p| p.hold("Page_Up", Duration::from_millis(500)))?;

    fill_the_screen_and_keep(&mut person)?;
    measure_and_record(&mut person)?;
    let (link, view) = copy_a_link(&mut person)?;
    lose_the_server(&mut person, server, &city, &address)?;

    ensure!(person.quit()? == 0, "Escape ends it with an error");
    let (settings, note) = UserSettings::load(&settings_at);
    ensure!(note.is_none() && settings.window == [640, 400], "kept: {settings:?} {note:?}");
    ensure!(settings.bookmarks.get("chiba").is_some_and(|b| b.len() == 1), "kept: {settings:?}");
    ensure!(!settings.overlay && !settings.minimap, "kept: {settings:?}");
    ensure!(folder.path().join("insula").join("settings.damaged.json").is_file(), "the damaged file is lost");

    // The link opens the same view in another window, of the size that was kept.
    let _server = ServerProcess::serve(&city, &address)?;
    let mut other = Person::start(&screen, folder.path(), &link)?;
    other.says("frame settled", 0)?;
    let same = other.look("10-link")?;
    // What a turn would show comes while the picture rests, which is not drawn again for that.
    other.says("idle prefetch done", 0)?;
    let rests = other.all_said().iter().filter(|line| line.contains("frame settled")).count();
    std::thread::sleep(Duration::from_secs(1));
    let later = other.all_said().iter().filter(|line| line.contains("frame settled")).count();
    ensure!(later == rests && difference(&same, &other.look("11-looked-around")?) < 0.02, "it is drawn again: {later}");
    ensure!(difference(&view, &same) < 0.02, "the link opens another view: {}", difference(&view, &same));
    ensure!(other.quit()? == 0, "Escape ends it with an error");
    Ok(())
}

fn fill_the_screen_and_keep(person: &mut Person) -> Result<()> {
    // No window manager is here to fill the screen: it must ask for it, go on, and take it back.
    person.key("F11")?;
    person.look("6-full-screen")?;
    person.key("F11")?;
    person.key("b")?;
    person.says("saved as View 1", 0)?;
    Ok(())
}

fn measure_and_record(person: &mut Person) -> Result<()> {
    person.key("m")?;
    person.click(300, 240, "1")?;
    person.says("click a second point", 0)?;
    person.click(420, 290, "1")?;
    let apart = person.says("m apart", 0)?;
    let metres: f64 = apart.split("measure: ").nth(1).and_then(|t| t.split(' ').next()).context("metres")?.parse()?;
    ensure!((5.0..3000.0).contains(&metres), "{apart}");
    person.look("7-measured")?;
    person.key("m")?;
    person.key("r")?;
    person.says("recording", 0)?;
    person.hold("d", Duration::from_millis(600))?;
    person.key("r")?;
    let wrote = person.says("insula-path-0001.json", 0)?;
    let path = insula_client::camera_files::read_path(Path::new(wrote.trim_start_matches("wrote ")))?;
    ensure!(path.seconds > 0.5 && path.keys.len() >= 3, "{path:?}");
    Ok(())
}

fn copy_a_link(person: &mut Person) -> Result<(String, RgbImage)> {
    person.key("c")?;
    let link = person.says("copied insula://", 0)?.trim_start_matches("copied ").to_owned();
    ensure!(ViewLink::parse(&link)?.camera.is_some(), "{link}");
    // The message goes away by itself.
    std::thread::sleep(Duration::from_secs(6));
    Ok((link, person.look("8-view")?))
}

fn lose_the_server(person: &mut Person, server: ServerProcess, city: &Path, address: &str) -> Result<()> {
    drop(server);
    let said = person.all_said().len();
    // Nearer, so that finer tiles are wanted.
    for _ in 0..14 {
        person.click(320, 220, "4")?;
    }
    person.says("reconnecting", said)?;
    let gone = person.look("9-reconnecting")?;
    ensure!(colours(&gone) > 30, "what was there is not drawn any more");
    let said = person.all_said().len();
    let _server = ServerProcess::serve(city, address)?;
    person.says("status: ready", said)?;
    person.says("frame settled", said)?;
    person.look("9-reconnected")?;
    Ok(())
}
