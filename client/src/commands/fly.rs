//! `insula fly`: a camera path at its own pace, measured.
//!
//! In: a place that has a city, a path file, a simulated link. Out: a report. Next: scripts.

use super::snapshot::{PAUSE, settle, start};
use crate::{
    args::{Fly, Global},
    camera_files::read_path,
    error::{ClientError, Result},
    report::{FlightReport, PictureError, pictures_apart},
    session::Session,
    stream::{fetch::Http, link::Link},
    ui::pace::Pace,
};
use insula_shaders::{cpu::raycast::Pixels, layout::Shading};
use insula_viewer::{
    camera::CameraPath,
    frame::{MOVING_SAMPLES, RenderSettings},
    streamer::FrameRequest,
    sun::Daylight,
};
use std::time::{Duration, Instant};

/// How far ahead the camera's next place is looked at, in seconds.
const AHEAD_SECS: f64 = 0.5;
/// Between two moments of the report, in seconds.
const MOMENT_SECS: f64 = 1.0;
/// Most moments that are kept: longer flights have longer ones.
const MOMENTS: f64 = 3600.0;
/// A frame that takes this many times the median is a stall.
const STALL: f64 = 4.0;

/// Runs the command.
pub fn run(args: &Fly, global: &Global) -> Result<()> {
    let path = read_path(&args.path)?;
    let first = shot(&path, args, global, 0.0)?;
    let mut session = start(&args.server, global, Some(Http::new(link(args))?), Some(&first))?;
    let look = Daylight::new(&args.sun.into(), session.tree().manifest()).render_settings(Shading::Lit, MOVING_SAMPLES);
    session.set_sun(look.shadow_casting_sun());
    session.set_transitions(!args.no_fades);
    let report = fly(&mut session, &path, args, &look, global)?;
    match &args.report {
        Some(path) => report.write(path),
        None => {
            let json = serde_json::to_string_pretty(&report).map_err(|e| ClientError::Failed(e.to_string()))?;
            println!("{json}");
            Ok(())
        }
    }
}

/// The link that was asked for, if any.
fn link(args: &Fly) -> Option<Link> {
    let rtt = Duration::from_millis(u64::from(args.rtt.unwrap_or(0)));
    let loss = args.loss.unwrap_or(0.0) / 100.0;
    (args.bandwidth.is_some() || args.rtt.is_some() || loss > 0.0).then(|| Link::new(args.bandwidth, rtt, loss))
}

/// A frame as a window draws it.
fn paced(session: &mut Session, shot: &FrameRequest, look: &RenderSettings, pace: &mut Pace) -> Result<Pixels> {
    let begin = Instant::now();
    pace.changed(begin);
    let detail = pace.detail(begin, session.is_settled());
    let size_px = shot.size_px.map(|side| (side / detail.divide).max(1));
    let pixels =
        session.draw(&FrameRequest { size_px, ..*shot }, &RenderSettings { samples: detail.samples, ..*look })?;
    pace.end(begin, detail, true);
    Ok(pixels)
}

/// What is seen at `t` seconds.
fn shot(path: &CameraPath, args: &Fly, global: &Global, t: f64) -> Result<FrameRequest> {
    let camera = path.camera_at(t).ok_or_else(|| ClientError::Usage("the path looks nowhere on its way".into()))?;
    Ok(FrameRequest { camera, heading: path.camera_at(t + AHEAD_SECS), size_px: args.size, tau_px: global.tau })
}

/// Flies once along a path.
fn fly(
    session: &mut Session,
    path: &CameraPath,
    args: &Fly,
    look: &RenderSettings,
    global: &Global,
) -> Result<FlightReport> {
    let timeout = Duration::from_secs(u64::from(global.timeout));
    let moment_secs = (path.seconds / MOMENTS).max(MOMENT_SECS);
    let (mut moments, mut errors) = (Vec::new(), Vec::new());
    let (mut frames, mut unconverged) = (0u64, 0u64);
    let mut begin = Instant::now();
    let mut frame_due = begin;
    let mut pace = Pace::new(begin);
    let mut compare_at = args.compare.map(|_| 0.0);
    loop {
        let t = begin.elapsed().as_secs_f64();
        if t > path.seconds {
            break;
        }
        let shot = shot(path, args, global, t)?;
        let compared = compare_at.is_some_and(|at| at <= t);
        if compared {
            // What is compared is what has come, not how it is shown.
            session.end_transitions();
        }
        let before = Instant::now();
        session.update(&shot);
        session.check(timeout)?;
        frames += 1;
        if moments.is_empty() {
            moments.push(session.flight_moment(t));
        }
        if !session.has_frame() {
            unconverged += 1;
            session.wait(PAUSE);
            continue;
        }
        // What is only preloaded is not missing in this frame's picture.
        unconverged += u64::from(session.lacks_tiles());
        let pixels = match args.paced {
            true => paced(session, &shot, look, &mut pace)?,
            false => session.draw(&shot, look)?,
        };
        session.record_frame_time(before.elapsed());
        if moments.len() as f64 * moment_secs <= t {
            moments.push(session.flight_moment(t));
        }
        if let (Some(at), Some(every)) = (compare_at, args.compare)
            && compared
        {
            let paused = Instant::now();
            let converged = converged(args, global, &shot, look, timeout)?;
            errors.push(PictureError { t, ..pictures_apart(&pixels, &converged) });
            compare_at = Some(at + every);
            begin += paused.elapsed();
            frame_due += paused.elapsed();
        }
        if let Some(rate) = args.rate {
            frame_due += Duration::from_secs_f64(1.0 / rate);
            let now = Instant::now();
            if frame_due > now {
                std::thread::sleep(frame_due - now);
            } else {
                frame_due = now;
            }
        }
    }
    moments.push(session.flight_moment(path.seconds));
    let mut run = session.report(global.tau);
    run.unconverged_share = Some(unconverged as f64 / frames.max(1) as f64);
    let stalls = session.stalls(STALL);
    Ok(FlightReport {
        run,
        stalls,
        evictions: session.evicted(),
        fetched_again: session.fetched_again(),
        moments,
        errors,
    })
}

/// What the frame would show if all were here: by a client of its own, over no slow link, without a limit to speak of.
fn converged(
    args: &Fly,
    global: &Global,
    shot: &FrameRequest,
    look: &RenderSettings,
    timeout: Duration,
) -> Result<Pixels> {
    let roomy = Global { cache_mib: global.cache_mib.max(512), ..global.clone() };
    let mut other = start(&args.server, &roomy, None, Some(shot))?;
    settle(&mut other, &FrameRequest { heading: None, ..*shot }, timeout)?;
    other.draw(shot, look)
}
