//! Draws frames on a GPU or on the CPU.

mod adapter;

pub use adapter::{Adapter, AdapterChoice, OpenedAdapter, Trial, graphics_error};
use insula_archive::disk_cache::DiskCache;
use insula_shaders::cpu::instruction_set::InstructionSet;
use insula_viewer::render::TrialCity;
pub use insula_viewer::render::{AdapterInfo, CpuAdapter, GpuAdapter, GpuDevice};
use std::path::Path;
use std::time::{Duration, Instant};

/// Size of all remembered trials.
const MAX_BYTES: u64 = 1 << 14;
/// Longest time of a frame that is plausible.
const MAX_FRAME: Duration = Duration::from_secs(60);

/// The trials of software drivers, in the user's cache folder: a trial takes as long as compiling the ray-caster for the driver.
///
/// A trial is kept under the driver, the machine's cores and vector instructions, and this program's version. Whatever fails here costs
/// another trial.
struct RememberedTrials {
    cache: Option<DiskCache>,
}

impl RememberedTrials {
    /// Those of this user. None are remembered without a cache folder that can be written.
    fn of_user() -> Self {
        let folders = directories::ProjectDirs::from("", "", "insula");
        folders.map_or(Self { cache: None }, |folders| Self::at(&folders.cache_dir().join("trials")))
    }

    fn at(folder: &Path) -> Self {
        let opened = DiskCache::open(folder, "trial", MAX_BYTES);
        let cache = opened.inspect_err(|error| tracing::debug!("{}: {error}", folder.display())).ok();
        Self { cache }
    }

    fn get(&self, key: &str) -> Option<DriverTrial> {
        let bytes = self.cache.as_ref()?.read(key)?;
        let [cpu_us, software_us] = serde_json::from_slice::<[u64; 2]>(&bytes).ok()?;
        let [cpu, software] = [cpu_us, software_us].map(Duration::from_micros);
        let is_plausible = |time: Duration| !time.is_zero() && time <= MAX_FRAME;
        (is_plausible(cpu) && is_plausible(software)).then_some(DriverTrial { cpu, software, is_remembered: true })
    }

    /// Remembers a trial instead of an earlier one.
    fn keep(&self, key: &str, trial: &DriverTrial) {
        let Some(cache) = &self.cache else { return };
        let us = |time: Duration| time.as_micros().min(u128::from(u64::MAX));
        let text = format!("[{},{}]", us(trial.cpu), us(trial.software));
        if let Err(error) = cache.replace(key, text.as_bytes()) {
            tracing::debug!("a trial cannot be remembered: {error}");
        }
    }
}

/// What a trial depends on: driver, machine, program.
fn trial_key(device: &GpuDevice) -> String {
    let wgpu::AdapterInfo { name, driver, driver_info, backend, .. } = device.adapter.get_info();
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let lanes = InstructionSet::best().map_or("", InstructionSet::name);
    key_of(&[&name, &driver, &driver_info, &backend.to_string(), &cores.to_string(), lanes, env!("CARGO_PKG_VERSION")])
}

/// 32 hexadecimal digits that differ where one of the parts does.
fn key_of(parts: &[&str]) -> String {
    let mut hasher = blake3::Hasher::new();
    for part in parts {
        hasher.update(&(part.len() as u64).to_le_bytes()).update(part.as_bytes());
    }
    hasher.finalize().to_hex()[..32].to_owned()
}

const SIZE_PX: [u32; 2] = [320, 180];
/// Frames that each draws at most. The fastest counts.
const MAX_FRAMES: usize = 4;
/// No further frame begins after this time of drawing, for each.
const MAX_TIME: Duration = Duration::from_millis(150);

/// How long both take for a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct DriverTrial {
    cpu: Duration,
    software: Duration,
    /// Whether it was an earlier run of this program.
    is_remembered: bool,
}

impl DriverTrial {
    /// Draws with both. Takes about as long as the driver needs for compiling the ray-caster. Fails if the driver does, with the reason.
    fn run(device: &GpuDevice) -> Result<Self, String> {
        let city = TrialCity::new().map_err(|e| e.to_string())?;
        let mut gpu = pollster::block_on(GpuAdapter::new(device.clone(), city.pages()))?;
        let mut cpu = CpuAdapter::new(city.pages());
        city.upload(&mut gpu);
        city.upload(&mut cpu);
        let data = city.frame(SIZE_PX);
        // Drivers finish compiling when they draw first.
        gpu.draw(&data).map_err(|e| e.to_string())?;
        let software = shortest(|| gpu.draw(&data).map(drop).map_err(|e| e.to_string()))?;
        let cpu = shortest(|| {
            cpu.draw(&data);
            Ok(())
        })?;
        Ok(Self { cpu, software, is_remembered: false })
    }

    /// Whether the CPU ray-caster is to draw.
    fn prefers_cpu(&self) -> bool {
        self.cpu <= self.software
    }

    /// The result in words. `driver` is the software driver's name.
    fn text(&self, driver: &str) -> String {
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        let (cpu, software) = (ms(self.cpu), ms(self.software));
        let when = if self.is_remembered { ", remembered" } else { "" };
        format!("frame in a trial: CPU {cpu:.1} ms, {driver} {software:.1} ms{when}")
    }
}

/// The shortest of some frames.
fn shortest(mut draw: impl FnMut() -> Result<(), String>) -> Result<Duration, String> {
    let begin = Instant::now();
    let mut shortest = Duration::MAX;
    for _ in 0..MAX_FRAMES {
        let frame = Instant::now();
        draw()?;
        shortest = shortest.min(frame.elapsed());
        if begin.elapsed() > MAX_TIME {
            break;
        }
    }
    Ok(shortest)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRIAL: DriverTrial =
        DriverTrial { cpu: Duration::from_micros(4100), software: Duration::from_micros(13_000), is_remembered: false };

    #[test]
    fn a_trial_is_remembered_for_its_driver_and_version() {
        let folder = tempfile::tempdir().unwrap();
        let key = key_of(&["llvmpipe", "1"]);
        RememberedTrials::at(folder.path()).keep(&key, &TRIAL);
        let trials = RememberedTrials::at(folder.path());
        assert_eq!(trials.get(&key), Some(DriverTrial { is_remembered: true, ..TRIAL }));
        for other in [key_of(&["llvmpipe", "2"]), key_of(&["llvmpipe1", ""]), key_of(&["llvmpipe"])] {
            assert_eq!(trials.get(&other), None);
        }
        let slower = DriverTrial { software: Duration::from_micros(2000), ..TRIAL };
        trials.keep(&key, &slower);
        assert_eq!(trials.get(&key).map(|trial| trial.prefers_cpu()), Some(false));
    }

    #[test]
    fn a_damaged_file_is_no_trial() {
        let folder = tempfile::tempdir().unwrap();
        let trials = RememberedTrials::at(folder.path());
        let key = key_of(&["llvmpipe"]);
        trials.keep(&key, &TRIAL);
        let file = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
        std::fs::write(&file, b"damaged").unwrap();
        assert_eq!(RememberedTrials::at(folder.path()).get(&key), None);
        let cache = DiskCache::open(folder.path(), "trial", MAX_BYTES).unwrap();
        for text in ["", "[]", "[1]", "[0,5]", "[5,0]", "[-1,5]", "[1,99999999999]", "[1e30,1]", "7"] {
            cache.replace(&key, text.as_bytes()).unwrap();
            assert_eq!(RememberedTrials::at(folder.path()).get(&key), None, "{text}");
        }
    }

    #[test]
    fn the_remembered_trials_are_bounded() {
        let folder = tempfile::tempdir().unwrap();
        let trials = RememberedTrials::at(folder.path());
        for number in 0..2000 {
            trials.keep(&key_of(&[&number.to_string()]), &TRIAL);
        }
        let bytes: u64 =
            std::fs::read_dir(folder.path()).unwrap().map(|file| file.unwrap().metadata().unwrap().len()).sum();
        assert!(bytes <= MAX_BYTES, "{bytes} bytes");
    }

    #[test]
    fn the_faster_one_is_preferred_and_the_reason_says_by_how_much() {
        let ms = Duration::from_millis;
        let trial = DriverTrial { cpu: ms(4), software: ms(13), is_remembered: false };
        assert!(trial.prefers_cpu() && !DriverTrial { cpu: ms(14), ..trial }.prefers_cpu());
        let text = trial.text("llvmpipe");
        assert!(text.contains("CPU 4.0 ms") && text.ends_with("llvmpipe 13.0 ms"), "{text}");
        assert!(DriverTrial { is_remembered: true, ..trial }.text("llvmpipe").ends_with("remembered"));
    }

    #[test]
    fn frames_are_timed_until_there_are_enough() {
        let mut frames = 0;
        let shortest_frame = shortest(|| {
            frames += 1;
            Ok(())
        });
        assert!(shortest_frame.is_ok_and(|time| time < MAX_TIME) && frames == MAX_FRAMES, "{frames} frames");
        assert_eq!(shortest(|| Err("lost".into())), Err("lost".into()));
    }
}
