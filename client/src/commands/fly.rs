//! `insula fly`: replays a camera path in real time and reports measurements.

use super::headless::{POLL_INTERVAL, open_session, settle};
use crate::args::{FlyArgs, GlobalArgs};
use crate::camera_files::read_path;
use crate::error::{ClientError, Result};
use crate::report::{FlightReport, FlightSample, FrameDifference, RunReport, compare_frames};
use crate::session::Session;
use crate::stream::fetch::Http;
use crate::stream::simulated_link::SimulatedLink;
use crate::ui::view_link::ViewLink;
use insula_command_line::output::Outputs;
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::layout::Shading;
use insula_viewer::camera::CameraPath;
use insula_viewer::frame::{MOVING_SAMPLES, RenderSettings};
use insula_viewer::interaction::frame_pacing::{FRAME_RATE, FramePacer, FrameTime};
use insula_viewer::streamer::FrameRequest;
use insula_viewer::sun::Daylight;
use std::path::Path;
use std::time::{Duration, Instant};

/// How far ahead the camera's motion is prefetched, in seconds.
const LOOKAHEAD_SECS: f64 = 0.5;
/// Shortest interval between two samples of the report, in seconds.
const SAMPLE_SECS: f64 = 1.0;
/// Longest list of samples. Longer flights have longer intervals.
const MAX_SAMPLES: f64 = 3600.0;
/// A frame that takes this multiple of the median is a stall.
const STALL_TIMES_MEDIAN: f64 = 4.0;
/// Size of the cache that renders converged frames for `--compare`, in MiB, unless `--cache-mib` is larger.
const COMPARE_CACHE_MIB: u32 = 512;

/// Runs the command. Fails if the city cannot be opened, the server does not respond, or a file cannot be read or written.
pub(super) fn run(args: &FlyArgs, global: &GlobalArgs) -> Result<()> {
    let link = ViewLink::parse(args.place.place())?;
    if let Some(report) = &args.report {
        let inputs = [Path::new(args.place.place()), &args.path];
        Outputs::new(args.overwrite).reading(inputs).file(report, RunReport::KIND).map_err(ClientError::Usage)?;
    }
    let path = read_path(&args.path)?;
    let first = frame_request(&path, args, global, 0.0)?;
    let http = Http::with_options(simulated_link(args), global.http_options())?;
    let mut session = open_session(args.place.place(), global, Some(http), Some(&first), None)?;
    let daylight = Daylight::new(&args.sun.or_link(link.time, link.look).into(), session.tree().manifest());
    let settings = daylight.render_settings(Shading::Lit, MOVING_SAMPLES);
    session.set_sun(settings.shadow_casting_sun());
    session.set_transitions(!args.no_fades);
    let flight = Flight { args, global, path: &path, settings };
    flight.fly(&mut session)?.write(args.report.as_deref())
}

/// The simulated network, if any of its options is given.
fn simulated_link(args: &FlyArgs) -> Option<SimulatedLink> {
    let rtt = Duration::from_millis(u64::from(args.rtt.unwrap_or(0)));
    let loss = args.loss.unwrap_or(0.0) / 100.0;
    let is_simulated = args.bandwidth.is_some() || args.rtt.is_some() || loss > 0.0;
    is_simulated.then(|| SimulatedLink::new(args.bandwidth, rtt, loss))
}

/// The frame at `t` seconds of the path. Fails if the path has no valid camera there.
fn frame_request(path: &CameraPath, args: &FlyArgs, global: &GlobalArgs, t: f64) -> Result<FrameRequest> {
    let invalid = || ClientError::Usage(format!("camera path has no valid view direction at t={t:.3} s"));
    let camera = path.camera_at(t).ok_or_else(invalid)?;
    let (switching, tau_px) = args.switch.switching(global.tau).map_err(ClientError::Usage)?;
    Ok(FrameRequest { camera, heading: path.camera_at(t + LOOKAHEAD_SECS), size_px: args.size, tau_px, switching })
}

/// A flight along a camera path.
struct Flight<'a> {
    args: &'a FlyArgs,
    global: &'a GlobalArgs,
    path: &'a CameraPath,
    settings: RenderSettings,
}

/// Measurements of a flight so far.
#[derive(Default)]
struct FlightMeasurements {
    samples: Vec<FlightSample>,
    differences: Vec<FrameDifference>,
    frames: u64,
    unconverged_frames: u64,
}

/// Clock of a flight, which pauses while frames are compared.
struct FlightClock {
    begin: Instant,
    frame_due: Instant,
}

impl FlightClock {
    fn secs(&self) -> f64 {
        self.begin.elapsed().as_secs_f64()
    }

    /// Leaves out the time since `since`.
    fn skip(&mut self, since: Instant) {
        let paused = since.elapsed();
        self.begin += paused;
        self.frame_due += paused;
    }

    /// Sleeps until the next frame of `rate` frames per second is due.
    fn wait_for_next_frame(&mut self, rate: f64) {
        self.frame_due += Duration::from_secs_f64(1.0 / rate);
        let now = Instant::now();
        if self.frame_due > now {
            std::thread::sleep(self.frame_due - now);
        } else {
            self.frame_due = now;
        }
    }
}

impl Flight<'_> {
    /// Flies once along the path.
    fn fly(&self, session: &mut Session) -> Result<FlightReport> {
        let mut measured = FlightMeasurements::default();
        let begin = Instant::now();
        let mut clock = FlightClock { begin, frame_due: begin };
        let mut pacer = FramePacer::new(begin, false);
        pacer.set_frame_rate(self.args.fps.unwrap_or(FRAME_RATE));
        let mut compare_at = self.args.compare.map(|_| 0.0);
        loop {
            let t = clock.secs();
            if t > self.path.seconds {
                break;
            }
            let request = frame_request(self.path, self.args, self.global, t)?;
            let is_compared = compare_at.is_some_and(|at| at <= t);
            if is_compared {
                // The comparison is of the resident tiles, not of a cross-fade between them.
                session.end_transitions();
            }
            let Some(pixels) = self.frame(session, &request, t, &mut pacer, &mut measured)? else { continue };
            if is_compared {
                let compare_begin = Instant::now();
                let converged = self.converged_frame(&request)?;
                measured.differences.push(FrameDifference { t, ..compare_frames(&pixels, &converged) });
                compare_at = compare_at.zip(self.args.compare).map(|(at, interval)| at + interval);
                clock.skip(compare_begin);
            }
            if let Some(rate) = self.args.rate {
                clock.wait_for_next_frame(rate);
            }
        }
        measured.samples.push(session.flight_sample(self.path.seconds));
        Ok(self.report(session, measured))
    }

    /// Streams and draws one frame at `t` seconds. `None` if no tile can be drawn yet.
    fn frame(
        &self,
        session: &mut Session,
        request: &FrameRequest,
        t: f64,
        pacer: &mut FramePacer,
        measured: &mut FlightMeasurements,
    ) -> Result<Option<Pixels>> {
        let begin = Instant::now();
        if self.args.paced {
            pacer.view_changed(begin);
            session.set_tau_factor(pacer.tau_factor(begin));
        }
        session.update(request);
        session.check(self.timeout())?;
        measured.frames += 1;
        if measured.samples.is_empty() {
            measured.samples.push(session.flight_sample(t));
        }
        if !session.has_frame() {
            measured.unconverged_frames += 1;
            session.wait(POLL_INTERVAL);
            return Ok(None);
        }
        // Prefetched tiles are not missing in this frame.
        measured.unconverged_frames += u64::from(session.lacks_tiles());
        let pixels = match self.args.paced {
            true => self.draw_paced(session, request, pacer)?,
            false => session.draw(request, &self.settings)?,
        };
        session.record_frame_time(begin.elapsed());
        let sample_secs = (self.path.seconds / MAX_SAMPLES).max(SAMPLE_SECS);
        if measured.samples.len() as f64 * sample_secs <= t {
            measured.samples.push(session.flight_sample(t));
        }
        Ok(Some(pixels))
    }

    /// Draws a frame with the detail that a window would choose.
    fn draw_paced(&self, session: &mut Session, request: &FrameRequest, pacer: &mut FramePacer) -> Result<Pixels> {
        let begin = Instant::now();
        let detail = pacer.detail(begin, session.is_settled());
        let size_px = request.size_px.map(|side| (side / detail.divisor).max(1));
        let settings = RenderSettings { samples: detail.samples, ..self.settings };
        let pixels = session.draw(&FrameRequest { size_px, ..*request }, &settings)?;
        let time = begin.elapsed();
        pacer.end_frame(FrameTime { scene: time, all: time }, detail, true);
        Ok(pixels)
    }

    /// The frame with all its tiles, from a separate session with a large cache and without the simulated network.
    fn converged_frame(&self, request: &FrameRequest) -> Result<Pixels> {
        let global = GlobalArgs { cache_mib: self.global.cache_mib.max(COMPARE_CACHE_MIB), ..self.global.clone() };
        let mut session = open_session(self.args.place.place(), &global, None, Some(request), None)?;
        settle(&mut session, &FrameRequest { heading: None, ..*request }, self.timeout())?;
        session.draw(request, &self.settings)
    }

    fn report(&self, session: &Session, measured: FlightMeasurements) -> FlightReport {
        let mut run = session.report(self.global.tau);
        run.unconverged_share = Some(measured.unconverged_frames as f64 / measured.frames.max(1) as f64);
        FlightReport {
            run,
            stalls: session.stalls(STALL_TIMES_MEDIAN),
            evictions: session.evicted(),
            fetched_again: session.fetched_again(),
            moments: measured.samples,
            errors: measured.differences,
        }
    }

    fn timeout(&self) -> Duration {
        Duration::from_secs(u64::from(self.global.timeout))
    }
}
