//! Compares a software driver with the CPU ray-caster: both draw the same small city.

use super::{CpuAdapter, GpuAdapter, GpuDevice};
use insula_viewer::render::TrialCity;
use std::time::{Duration, Instant};

const SIZE_PX: [u32; 2] = [320, 180];
/// Frames that each draws at most. The fastest counts.
const MAX_FRAMES: usize = 4;
/// No further frame begins after this time of drawing, for each.
const MAX_TIME: Duration = Duration::from_millis(150);

/// How long both take for a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct DriverTrial {
    pub(super) cpu: Duration,
    pub(super) software: Duration,
    /// Whether it was an earlier run of this program.
    pub(super) is_remembered: bool,
}

impl DriverTrial {
    /// Draws with both. Takes about as long as the driver needs for compiling the ray-caster. Fails if the driver does, with the reason.
    pub(super) fn run(device: &GpuDevice) -> Result<Self, String> {
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
    pub(super) fn prefers_cpu(&self) -> bool {
        self.cpu <= self.software
    }

    /// The result in words. `driver` is the software driver's name.
    pub(super) fn text(&self, driver: &str) -> String {
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
