//! `insula fly`: a camera path at its own pace, measured.
//!
//! In: a server, a path file, a simulated network. Out: a report. Next: scripts.

use super::snapshot::start;
use crate::{
    args::{Fly, Global},
    camera::CameraPath,
    error::{ClientError, Result},
    session::Shot,
    stream::{fetch::Http, throttle::Throttle},
    sun::Daylight,
};
use insula_shaders::layout::Shading;
use std::time::{Duration, Instant};

/// How far ahead the camera's next place is looked at, in seconds.
const AHEAD_SECS: f64 = 0.5;

/// Runs the command.
pub fn run(args: &Fly, global: &Global) -> Result<()> {
    let path = CameraPath::read(&args.path)?;
    let rtt = Duration::from_millis(u64::from(args.rtt.unwrap_or(0)));
    let throttle = (args.bandwidth.is_some() || args.rtt.is_some()).then(|| Throttle::new(args.bandwidth, rtt));
    let mut session = start(&args.server, global, Some(Http::new(throttle)?))?;
    let timeout = Duration::from_secs(u64::from(global.timeout));
    let look = Daylight::new(&args.sun, session.tree().manifest()).look(Shading::Lit, 1);
    session.set_sun(look.casting());
    let begin = Instant::now();
    let (mut frames, mut unconverged) = (0u32, 0u32);
    loop {
        let t = begin.elapsed().as_secs_f64();
        if t > path.seconds {
            break;
        }
        let camera = path.at(t).ok_or_else(|| ClientError::Usage("the path looks nowhere on its way".into()))?;
        let shot = Shot { camera, heading: path.at(t + AHEAD_SECS), size_px: args.size, tau_px: global.tau };
        let before = Instant::now();
        session.step(&shot);
        session.draw(&shot, &look)?;
        session.timed(before.elapsed());
        session.check(timeout)?;
        frames += 1;
        // What is only preloaded is not missing in this frame's picture.
        let missing = session.selection().wanted.iter().any(|w| w.group != crate::select::priority::Group::Preload);
        unconverged += u32::from(missing || session.selection().cut.is_empty());
    }
    let mut report = session.report(global.tau);
    report.unconverged_share = Some(f64::from(unconverged) / f64::from(frames.max(1)));
    match &args.report {
        Some(path) => report.write(path),
        None => {
            let json = serde_json::to_string_pretty(&report).map_err(|e| ClientError::Failed(e.to_string()))?;
            println!("{json}");
            Ok(())
        }
    }
}
