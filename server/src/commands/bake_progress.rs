//! Progress of a bake on standard error: a bar on a terminal, else a line now and then.

use super::interrupt;
use indicatif::{ProgressBar, ProgressState, ProgressStyle};
use insula_bake::Progress;
use insula_bake::kept_work::{has_kept_work, scratch_folder};
use insula_protocol::route::without_secrets;
use insula_protocol::text::{printable, shell_word};
use std::ffi::OsString;
use std::fmt;
use std::io::IsTerminal;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Progress template of a stage whose length is unknown.
const SPINNER_TEMPLATE: &str = "{prefix:>10} {spinner} {elapsed}";
/// Progress template of a stage with a known number of steps.
const BAR_TEMPLATE: &str = "{prefix:>10} {wide_bar} {percent:>3}% {elapsed}{left}";
/// Time between two lines where there is no terminal.
pub(super) const LINE_INTERVAL: Duration = Duration::from_secs(10);

/// Shows the progress of a bake. The remaining time covers the current stage only.
pub(super) struct BakeProgress(Arc<Shown>);

/// What the threads of a bake, the clock and the signal handler share.
struct Shown {
    is_terminal: bool,
    start: Instant,
    stage: Arc<Mutex<Option<StageState>>>,
    bar: Mutex<Option<ProgressBar>>,
}

impl BakeProgress {
    /// Starts to print lines, if there is no terminal, and to handle signals that end the program. `out` is the city's
    /// folder.
    pub(super) fn start(out: &Path) -> Self {
        let shown = Arc::new(Shown {
            is_terminal: std::io::stderr().is_terminal(),
            start: Instant::now(),
            stage: Arc::default(),
            bar: Mutex::default(),
        });
        let (of_line, of_signal, out) = (shown.clone(), shown.clone(), out.to_owned());
        let print_line = move || {
            if let Some(line) = of_line.line(Instant::now()) {
                eprintln!("{line}");
            }
        };
        let interval = (!shown.is_terminal).then_some(LINE_INTERVAL);
        interrupt::watch(interval, print_line, move || {
            of_signal.clear_bar();
            let stage = lock(&of_signal.stage).clone();
            if let Some(stage) = stage {
                eprintln!("{}", interrupted(&stage, &out, &std::env::args_os().collect::<Vec<_>>()));
            }
        });
        Self(shown)
    }

    /// Ends the display.
    pub(super) fn clear(&self) {
        *lock(&self.0.stage) = None;
        self.0.clear_bar();
    }
}

impl Progress for BakeProgress {
    fn stage(&self, name: &str, total: u64) {
        self.0.clear_bar();
        *lock(&self.0.stage) = Some(StageState::new(name, total, Instant::now()));
        if self.0.is_terminal {
            *lock(&self.0.bar) = Some(stage_bar(name, total, &self.0.stage));
        }
    }

    fn advance(&self, n: u64) {
        self.0.add(n, StageState::advance);
    }

    fn skip(&self, n: u64) {
        self.0.add(n, StageState::skip);
    }

    fn warn(&self, message: &str) {
        let line = format!("warning: {}", printable(message));
        match &*lock(&self.0.bar) {
            Some(bar) => bar.suspend(|| eprintln!("{line}")),
            None => eprintln!("{line}"),
        }
    }
}

impl Shown {
    fn add(&self, n: u64, count: fn(&mut StageState, u64, Instant)) {
        if let Some(stage) = &mut *lock(&self.stage) {
            count(stage, n, Instant::now());
        }
        // Not while the stage is locked: the bar reads it when it draws.
        if let Some(bar) = &*lock(&self.bar) {
            bar.inc(n);
        }
    }

    fn clear_bar(&self) {
        if let Some(bar) = lock(&self.bar).take() {
            bar.finish_and_clear();
        }
    }

    /// The state as one line; `None` between the stages.
    fn line(&self, now: Instant) -> Option<String> {
        let stage = lock(&self.stage);
        let stage = stage.as_ref()?;
        let percent = stage.percent().map_or(String::new(), |percent| format!(" {percent}%"));
        let seconds = now.saturating_duration_since(self.start).as_secs();
        Some(format!("baking: {}{percent} after {seconds} s{}", stage.name, stage.left(now)))
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn stage_bar(name: &str, total: u64, stage: &Arc<Mutex<Option<StageState>>>) -> ProgressBar {
    let (bar, template) = match total {
        0 => (ProgressBar::new_spinner(), SPINNER_TEMPLATE),
        total => (ProgressBar::new(total), BAR_TEMPLATE),
    };
    // A test proves that the templates parse.
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    let stage = stage.clone();
    let left = move |_: &ProgressState, out: &mut dyn fmt::Write| {
        let text = lock(&stage).as_ref().map_or(String::new(), |stage| stage.left(Instant::now()));
        let _ = out.write_str(&text);
    };
    let bar = bar.with_style(style.with_key("left", left)).with_prefix(name.to_owned());
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

/// How far a stage is.
#[derive(Debug, Clone)]
struct StageState {
    name: String,
    /// Number of steps; 0 if it is unknown.
    total: u64,
    /// Steps that took work.
    worked: u64,
    /// Steps whose result existed.
    skipped: u64,
    start: Instant,
}

impl StageState {
    fn new(name: &str, total: u64, start: Instant) -> Self {
        Self { name: name.to_owned(), total, worked: 0, skipped: 0, start }
    }

    fn advance(&mut self, n: u64, _now: Instant) {
        self.worked += n;
    }

    fn skip(&mut self, n: u64, now: Instant) {
        if self.worked == 0 {
            // The work begins after the steps that an interrupted bake has finished.
            self.start = now;
        }
        self.skipped += n;
    }

    fn percent(&self) -> Option<u64> {
        (self.worked + self.skipped).saturating_mul(100).checked_div(self.total).map(|percent| percent.min(100))
    }

    /// Time for the steps that are left, at the speed of those that took work; `None` before the first and after the last.
    fn remaining(&self, now: Instant) -> Option<Duration> {
        let left = self.total.checked_sub(self.worked + self.skipped).filter(|left| *left > 0)?;
        let elapsed = now.saturating_duration_since(self.start);
        (self.worked > 0).then(|| elapsed.mul_f64(left as f64 / self.worked as f64))
    }

    /// The remaining time, for the end of a line; empty if it is unknown.
    fn left(&self, now: Instant) -> String {
        self.remaining(now).map(left_text).unwrap_or_default()
    }
}

/// A remaining time, for the end of a line.
pub(super) fn left_text(left: Duration) -> String {
    match left.as_secs() {
        seconds @ 0..100 => format!(", {seconds} s left"),
        seconds @ 100..6000 => format!(", {} min left", seconds.div_ceil(60)),
        seconds => format!(", {:.1} h left", seconds as f64 / 3600.0),
    }
}

/// What is kept of a bake that is interrupted, and the command that continues it. `line` is the program's own.
fn interrupted(stage: &StageState, out: &Path, line: &[OsString]) -> String {
    let is_kept = has_kept_work(out);
    let percent =
        stage.percent().filter(|_| stage.name != "read").map_or(String::new(), |percent| format!(" at {percent}%"));
    let word = |word: &dyn fmt::Display| shell_word(&printable(&word.to_string())).into_owned();
    let partial = word(&scratch_folder(out).display());
    let kept = if is_kept {
        format!("finished work is kept in {partial}; continue with")
    } else {
        format!("nothing is finished yet, so {partial} may be removed; start again with")
    };
    let mut words: Vec<String> =
        line.iter().map(|argument| word(&without_secrets(&argument.to_string_lossy()))).collect();
    if is_kept && !words.iter().any(|word| word == "--resume") {
        // After the name of the command: an argument at the end may follow a `--`.
        words.insert(words.len().min(2), "--resume".into());
    }
    format!("interrupted in stage {}{percent}: {kept}: {}", stage.name, words.join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn seconds(seconds: u64) -> Duration {
        Duration::from_secs(seconds)
    }

    #[test]
    fn progress_templates_parse() {
        for template in [SPINNER_TEMPLATE, BAR_TEMPLATE] {
            ProgressStyle::with_template(template).unwrap();
        }
    }

    #[test]
    fn resumed_steps_say_nothing_of_the_time_that_is_left() {
        let start = Instant::now();
        let mut stage = StageState::new("sample", 1000, start);
        stage.skip(900, start + seconds(2));
        assert_eq!(stage.left(start + seconds(2)), "", "no step has taken time yet");
        stage.advance(10, start + seconds(12));
        assert_eq!((stage.left(start + seconds(12)), stage.percent()), (", 90 s left".to_owned(), Some(91)));
        stage.skip(10, start + seconds(12));
        assert_eq!(stage.remaining(start + seconds(12)), Some(seconds(80)));
        stage.advance(80, start + seconds(92));
        assert_eq!(stage.left(start + seconds(92)), "", "what follows the last step is not counted");
        let unknown = StageState::new("ground", 0, start);
        assert_eq!((unknown.percent(), unknown.left(start)), (None, String::new()));
    }

    #[test]
    fn lines_are_plain_and_end_with_the_stages() {
        let (start, stage) = (Instant::now(), Arc::new(Mutex::new(None)));
        let shown = Shown { is_terminal: false, start, stage: stage.clone(), bar: Mutex::default() };
        let progress = BakeProgress(Arc::new(shown));
        let line = |after| progress.0.line(start + seconds(after));
        assert_eq!(line(1), None);
        progress.stage("sample", 200);
        stage.lock().unwrap().as_mut().unwrap().start = start;
        progress.advance(20);
        assert_eq!(line(70).as_deref(), Some("baking: sample 10% after 70 s, 11 min left"));
        assert_eq!(line(2000).as_deref(), Some("baking: sample 10% after 2000 s, 5.0 h left"));
        progress.stage("ground", 0);
        assert_eq!(line(2001).as_deref(), Some("baking: ground after 2001 s"));
        progress.clear();
        assert_eq!(line(2002), None);
    }

    #[test]
    fn interruption_names_a_whole_command_that_resumes() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("my city");
        let line =
            ["./insula-server", "bake", "it's.geojson", "--out", out.to_str().unwrap(), "--", "b"].map(OsString::from);
        let mut stage = StageState::new("sample", 8, Instant::now());
        stage.advance(3, Instant::now());
        let text = interrupted(&stage, &out, &line);
        assert!(text.starts_with("interrupted in stage sample at 37%: nothing is finished yet, so "), "{text}");
        assert!(!text.contains("--resume"), "{text}");
        let partial = folder.path().join("my city.partial");
        fs::create_dir_all(partial.join("packs")).unwrap();
        let text = interrupted(&stage, &out, &line);
        let path = folder.path().display();
        assert!(
            text.contains(&format!("kept in '{path}/my city.partial'; continue with: ./insula-server bake --resume ")),
            "{text}"
        );
        assert!(text.ends_with(&format!(r"'it'\''s.geojson' --out '{path}/my city' -- b")), "{text}");
    }
}
