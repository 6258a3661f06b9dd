//! The program `insula view` with its window: gives it input, and reads what it reports.

use super::screen;
use anyhow::{Context, Result, bail, ensure};
use image::RgbImage;
use insula_tests::programs::{program, run};
use insula_viewer::camera::Camera;
use insula_viewer::camera_text;
use std::io::{BufRead, BufReader, PipeReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Longest wait for a state: turns a hang into an error.
const MAX_WAIT: Duration = Duration::from_secs(120);
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Number of lines of output in an error.
const SHOWN_LINES: usize = 60;
/// Events of the log.
const FRAME: &str = "frame of a new view presented";
const SETTLED: &str = "frame settled";
const RESTS: &str = "idle prefetch done";

/// How a client draws.
#[derive(Clone, Copy)]
pub(super) struct Display {
    pub(super) adapter: &'static str,
    /// Pixels per point.
    pub(super) scale: u32,
}

/// A final frame, as the program reports it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Settled {
    pub(super) camera: Camera,
    pub(super) size_px: [u32; 2],
}

impl Settled {
    fn parse(line: &str) -> Option<Self> {
        let side = |name: &str| -> Option<u32> { field(line, name)?.parse().ok() };
        let size_px = [side("width_px")?, side("height_px")?];
        line.contains(SETTLED).then_some(Self { camera: camera_of(line)?, size_px })
    }
}

/// The value of a field of a line of the log.
fn field<'a>(line: &'a str, name: &str) -> Option<&'a str> {
    line.split(' ').find_map(|word| word.strip_prefix(name)?.strip_prefix('='))
}

fn camera_of(line: &str) -> Option<Camera> {
    camera_text::parse(field(line, "camera")?)
}

/// A running client with its window and its output.
pub(super) struct Client {
    program: Child,
    display: String,
    window: String,
    /// Pixels per point.
    scale: u32,
    output: Arc<Mutex<Vec<String>>>,
    reader: Option<JoinHandle<()>>,
    screenshots: PathBuf,
}

impl Client {
    /// Starts `insula view ADDRESS` in `folder`, which has its settings too, and waits for the window. The screenshots lie in the
    /// folder `test`.
    pub(super) fn start(display: Display, test: &str, folder: &Path, address: &str) -> Result<Self> {
        Self::start_with(display, test, folder, &[address])
    }

    /// The same with several arguments of `insula view`.
    pub(super) fn start_with(display: Display, test: &str, folder: &Path, arguments: &[&str]) -> Result<Self> {
        let Display { adapter, scale } = display;
        let display = screen::display()?;
        // One pipe, so that the lines of both streams have an order.
        let (reader, writer) = std::io::pipe()?;
        let mut command = Command::new(program("insula")?);
        command
            .args(["view", "--adapter", adapter])
            .args(arguments)
            .env("WINIT_X11_SCALE_FACTOR", scale.to_string())
            .current_dir(folder)
            .env("DISPLAY", &display)
            .env_remove("WAYLAND_DISPLAY")
            .env("XDG_CONFIG_HOME", folder)
            .env("RUST_LOG", "error,insula_client::ui=debug,insula_client::ui::viewport=trace")
            .env("NO_COLOR", "1")
            .stdin(Stdio::null())
            .stdout(writer.try_clone()?)
            .stderr(writer);
        let program = command.spawn()?;
        // The pipe ends with the program only if nothing else can write to it.
        drop(command);
        let output = Arc::new(Mutex::new(Vec::new()));
        let reader = Some(collect_lines(reader, output.clone()));
        let screenshots = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("window").join(test);
        std::fs::create_dir_all(&screenshots)?;
        let mut client = Self { program, display, window: String::new(), scale, output, reader, screenshots };
        let pid = client.program.id().to_string();
        client.window = client.wait_for("a window", |client| {
            let found = client.tool("xdotool", &["search", "--pid", &pid]).unwrap_or_default();
            Ok(found.lines().last().map(str::to_owned))
        })?;
        client.move_pointer_away()?;
        Ok(client)
    }

    fn tool(&self, tool: &str, arguments: &[&str]) -> Result<String> {
        // `import` waits forever for a window that is gone.
        let output = run(Command::new(tool).args(arguments).env("DISPLAY", &self.display))?;
        ensure!(output.status.success(), "{tool} {arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    }

    fn xdotool(&self, arguments: &[&str]) -> Result<()> {
        self.tool("xdotool", arguments).map(drop)
    }

    /// Polls `find` until it finds something, while the client runs.
    fn wait_for<T>(&mut self, what: &str, mut find: impl FnMut(&Self) -> Result<Option<T>>) -> Result<T> {
        let begin = Instant::now();
        loop {
            if let Some(found) = find(self)? {
                return Ok(found);
            }
            if let Some(status) = self.program.try_wait()? {
                bail!("waiting for {what}: the program ended with {status}: {}", self.last_lines());
            }
            ensure!(begin.elapsed() < MAX_WAIT, "no {what} within {MAX_WAIT:?}: {}", self.last_lines());
            std::thread::sleep(POLL_INTERVAL);
        }
    }

    /// Waits until the program ends. Returns its exit code.
    pub(super) fn wait_for_end(&mut self) -> Result<i32> {
        let begin = Instant::now();
        let status = loop {
            if let Some(status) = self.program.try_wait()? {
                break status;
            }
            ensure!(begin.elapsed() < MAX_WAIT, "the program does not end within {MAX_WAIT:?}: {}", self.last_lines());
            std::thread::sleep(POLL_INTERVAL);
        };
        // What it said last is in the pipe.
        if let Some(reader) = self.reader.take() {
            let _ = reader.join();
        }
        status.code().with_context(|| format!("the program ended with {status}: {}", self.last_lines()))
    }
}

/// Input.
impl Client {
    pub(super) fn key(&self, key: &str) -> Result<()> {
        self.xdotool(&["windowfocus", &self.window, "key", key])
    }

    /// Holds a key until the program has shown a camera that `is_there`, and waits for the final frame of where it stopped.
    pub(super) fn hold(&mut self, key: &str, is_there: impl Fn(&Camera) -> bool) -> Result<Settled> {
        let before = self.line_count();
        self.xdotool(&["windowfocus", &self.window, "keydown", key])?;
        let moved = self.wait_for_frame(&format!("camera moved by {key}"), before, &is_there);
        // A key that is still held would be another test's, too.
        self.xdotool(&["keyup", key])?;
        moved?;
        self.wait_for_settled(before, |frame| is_there(&frame.camera))
    }

    /// Clicks at a place in points.
    pub(super) fn click(&self, [x, y]: [u32; 2]) -> Result<()> {
        let [x, y] = [x, y].map(|side| (side * self.scale).to_string());
        self.xdotool(&["mousemove", "--window", &self.window, &x, &y, "click", "1"])
    }

    /// Turns the wheel upwards at a place in points.
    pub(super) fn turn_wheel(&self, [x, y]: [u32; 2], steps: u32) -> Result<()> {
        let [x, y, steps] = [x * self.scale, y * self.scale, steps].map(|number| number.to_string());
        self.xdotool(&["mousemove", "--window", &self.window, &x, &y, "click", "--repeat", &steps, "--delay", "1", "4"])
    }

    /// Moves the pointer out of the window, where it changes nothing.
    pub(super) fn move_pointer_away(&self) -> Result<()> {
        self.xdotool(&["mousemove", "1399", "899"])
    }

    pub(super) fn resize(&self, size_px: [u32; 2]) -> Result<()> {
        let [width, height] = size_px.map(|side| side.to_string());
        self.xdotool(&["windowsize", &self.window, &width, &height])
    }

    /// Destroys the window, as a window system does.
    pub(super) fn destroy_window(&self) -> Result<()> {
        self.xdotool(&["windowclose", &self.window])
    }

    /// Ends the program by its key. Returns its exit code.
    pub(super) fn quit(&mut self) -> Result<i32> {
        self.key("ctrl+q")?;
        self.wait_for_end()
    }
}

/// Output.
impl Client {
    fn lines(&self) -> MutexGuard<'_, Vec<String>> {
        self.output.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn last_lines(&self) -> String {
        let lines = self.lines();
        lines[lines.len().saturating_sub(SHOWN_LINES)..].join("\n")
    }

    /// Number of lines so far.
    pub(super) fn line_count(&self) -> usize {
        self.lines().len()
    }

    /// Waits for a line of output that contains `words`, after the first `after` lines.
    pub(super) fn wait_for_line(&mut self, words: &str, after: usize) -> Result<String> {
        self.wait_for(&format!("line {words:?}"), |client| {
            let lines = client.lines();
            Ok(lines.iter().skip(after).find(|line| line.contains(words)).cloned())
        })
    }

    /// Waits until exactly these panels are shown, in the order of the program. Only lines after the first `after` count.
    pub(super) fn wait_for_panels(&mut self, panels: &str, after: usize) -> Result<()> {
        self.wait_for(&format!("panels {panels:?}"), |client| {
            let lines = client.lines();
            let last = lines.iter().skip(after).rfind(|line| line.contains("panels shown"));
            Ok(last.and_then(|line| field(line, "open")).filter(|open| *open == panels).map(|_| ()))
        })
    }

    /// Waits for a frame, after the first `after` lines, whose camera `is_there`.
    pub(super) fn wait_for_frame(
        &mut self,
        what: &str,
        after: usize,
        is_there: impl Fn(&Camera) -> bool,
    ) -> Result<()> {
        self.wait_for(what, |client| {
            let lines = client.lines();
            let mut frames = lines.iter().skip(after).filter(|line| line.contains(FRAME));
            Ok(frames.any(|line| camera_of(line).is_some_and(|camera| is_there(&camera))).then_some(()))
        })
    }

    /// Waits for a final frame after the first `after` lines that is the right one.
    pub(super) fn wait_for_settled(&mut self, after: usize, is_right: impl Fn(&Settled) -> bool) -> Result<Settled> {
        self.wait_for("final frame", |client| {
            let lines = client.lines();
            let mut frames = lines.iter().skip(after).filter_map(|line| Settled::parse(line));
            Ok(frames.find(&is_right))
        })
    }

    /// Waits until nothing is left to draw or to fetch for the view of the last final frame. Returns this frame.
    pub(super) fn wait_for_rest(&mut self) -> Result<Settled> {
        self.wait_for("view at rest", |client| {
            let lines = client.lines();
            let mut reports =
                lines.iter().rev().filter(|line| [FRAME, SETTLED, RESTS].iter().any(|e| line.contains(e)));
            let is_resting = reports.next().is_some_and(|line| line.contains(RESTS));
            Ok(is_resting.then(|| reports.find_map(|line| Settled::parse(line))).flatten())
        })
    }

    /// Whether the scene was drawn after the first `after` lines.
    pub(super) fn has_drawn_since(&self, after: usize) -> bool {
        self.lines().iter().skip(after).any(|line| line.contains(FRAME) || line.contains(SETTLED))
    }

    pub(super) fn screenshot(&self, name: &str) -> Result<RgbImage> {
        let path = self.screenshots.join(format!("{name}.png"));
        self.tool("import", &["-window", &self.window, &path.to_string_lossy()])?;
        Ok(image::open(path)?.to_rgb8())
    }

    /// Takes screenshots until one is right: the window system shows a frame a little later than the program reports it.
    pub(super) fn picture(&mut self, name: &str, is_right: impl Fn(&RgbImage) -> bool) -> Result<RgbImage> {
        self.wait_for(&format!("right picture {name}"), |client| Ok(Some(client.screenshot(name)?).filter(&is_right)))
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

fn collect_lines(stream: PipeReader, lines: Arc<Mutex<Vec<String>>>) -> JoinHandle<()> {
    std::thread::spawn(move || {
        for line in BufReader::new(stream).lines().map_while(Result::ok) {
            lines.lock().unwrap_or_else(PoisonError::into_inner).push(line);
        }
    })
}
