//! The frame loop: what is drawn next, and on what.
//!
//! The engine calls [`CityViewer::update`], carries out the step that it returns, reports it, and calls it again when the step says
//! so. On the CPU a step is some rows of a frame, so that a moving camera never waits for a fine frame.

use super::frame_job::{DrawnView, FrameJob};
use super::viewer::{CityViewer, clamped_size};
use insula_shaders::cpu::hit_counts::hit_counts;
use insula_viewer::collision::CitySolids;
use insula_viewer::frame::{FrameData, STILL_SAMPLES};
use insula_viewer::interaction::frame_pacing::{FrameDetail, FrameTime};
use insula_web_host::frame_words::frame_words;
use insula_web_host::messages::{Step, json};
use std::time::Duration;
use wasm_bindgen::prelude::*;
use web_time::Instant;

/// Shortest wait for something that gives no notice, such as a retry that becomes due.
const POLL: Duration = Duration::from_millis(50);
/// While tiles arrive for a view that does not change, this many times as long as a frame took passes before the next: decoding needs
/// the cores too.
const PAUSE_PER_FRAME: u32 = 2;
/// Longest wait of a view that rests.
const REST: Duration = Duration::from_secs(3600);

#[wasm_bindgen]
impl CityViewer {
    /// Takes in arrivals, moves the camera, requests tiles, and returns the next step (JSON, see `Step`).
    pub fn update(&mut self) -> String {
        let now = Instant::now();
        let is_moving = self.advance(now);
        self.notice_view(now);
        self.streamer.set_sun(self.daylight.render_settings(self.shading, 1).shadow_casting_sun());
        let tau_factor = if self.picture_px.is_none() { self.pacer.tau_factor(now) } else { 1.0 };
        self.streamer.set_tau_factor(tau_factor);
        let has_news = self.streamer.has_work();
        let request = self.request(1);
        let elapsed = self.elapsed();
        self.streamer.update(&request, &mut self.renderer, elapsed);
        if has_news || self.streamer.has_work() {
            self.pacer.content_changed();
            (self.is_stale, self.job) = (true, None);
        }
        let step = match self.wait(now) {
            Some(_) if is_moving => Step::wait(Duration::ZERO),
            Some(wait) => Step::wait(wait),
            None => self.draw_step(now),
        };
        json(&step)
    }

    /// Takes in arrivals and requests further tiles while a frame is drawn.
    #[wasm_bindgen(js_name = updateWhileDrawing)]
    pub fn update_while_drawing(&mut self) {
        let elapsed = self.elapsed();
        self.streamer.update_while_drawing(&mut self.fine_requests, elapsed);
    }

    /// Waiting writes to the atlas, for `RowRenderer::write` and `GpuRenderer::write`.
    #[wasm_bindgen(js_name = takeWrites)]
    pub fn take_writes(&mut self) -> Vec<u32> {
        self.renderer.take_writes()
    }

    /// The frame that is drawn, for `RowRenderer::begin` and `GpuRenderer::draw`.
    #[wasm_bindgen(js_name = frameWords)]
    pub fn frame_words(&mut self) -> Vec<u32> {
        let Some(job) = &mut self.job else { return Vec::new() };
        job.is_sent = true;
        frame_words(&job.data)
    }

    /// Takes in rows that the workers drew in `ms`. Returns the pixels (r, g, b, a) when the frame is complete.
    #[wasm_bindgen(js_name = rowsDrawn)]
    pub fn rows_drawn(&mut self, words: &[u32], hit: &[u32], ms: f64) -> Option<Vec<u8>> {
        let job = self.job.as_mut()?;
        let time = Duration::try_from_secs_f64(ms / 1e3).unwrap_or_default();
        job.duration += time;
        let frame = job.data.frame;
        let drawn = words.len() as f64 / f64::from((frame.width_px * frame.height_px).max(1));
        let is_complete = job.rows.append(&frame, words, hit);
        let detail = job.detail;
        if detail.is_final {
            self.pacer.end_step(time, drawn, frame.samples);
        }
        if !is_complete {
            return None;
        }
        let job = self.job.take()?;
        self.drawn_at = Some(Instant::now());
        let pixels = job.rows.develop(&frame);
        self.streamer.report_hits(&job.data.query, &hit_counts(&pixels.hit, job.data.nodes.len()));
        if !detail.is_final {
            let time = FrameTime { scene: job.duration, all: job.duration };
            self.pacer.end_frame(time, detail, true);
        } else if frame.samples < detail.samples {
            self.refine(job.data, detail);
        } else if job.is_picture {
            self.picture_px = None;
        } else {
            self.pacer.end_steps();
        }
        Some(bytemuck::cast_slice(&pixels.colour).to_vec())
    }

    /// The GPU counts the hits of the frame that it draws, for [`CityViewer::report_gpu_hits`].
    #[wasm_bindgen(js_name = gpuCounts)]
    pub fn gpu_counts(&mut self) {
        self.counted = self.job.as_ref().map(|job| job.data.query.clone());
    }

    /// The GPU has counted the hits of each node.
    #[wasm_bindgen(js_name = reportGpuHits)]
    pub fn report_gpu_hits(&mut self, hits: &[u32]) {
        if let Some(query) = self.counted.take() {
            self.streamer.report_hits(&query, hits);
        }
    }

    /// A frame of the GPU took `ms`.
    #[wasm_bindgen(js_name = gpuDrawn)]
    pub fn gpu_drawn(&mut self, ms: f64) {
        let Some(job) = self.job.take() else { return };
        self.drawn_at = Some(Instant::now());
        let time = Duration::try_from_secs_f64(ms / 1e3).unwrap_or_default();
        if job.is_picture {
            self.picture_px = None;
            return;
        }
        self.pacer.end_frame(FrameTime { scene: time, all: time }, job.detail, true);
    }

    /// Makes a picture of this size: a later step draws it, when all tiles are there.
    #[wasm_bindgen(js_name = makePicture)]
    pub fn make_picture(&mut self, width: u32, height: u32) {
        self.picture_px = Some(clamped_size(width, height));
        (self.job, self.view_state) = (None, None);
    }
}

impl CityViewer {
    /// Moves camera and sun. Returns whether anything moves.
    fn advance(&mut self, now: Instant) -> bool {
        if let Some(flight) = &self.flight {
            let (camera, has_arrived) = flight.camera_at(now);
            self.control.set_camera(&camera);
            if has_arrived {
                self.flight = None;
            }
        }
        let is_day_running = self.day.advance(&mut self.daylight, now);
        self.control.advance_to(now);
        let manifest = self.streamer.tree().manifest();
        let solids = CitySolids::new(manifest, self.streamer.cache());
        self.control.keep_outside(&solids, manifest.ground_z_m);
        let is_moving = self.flight.is_some() || is_day_running || self.control.is_moving();
        if !is_moving && self.streamer.is_settled() {
            self.control.lift_out(&solids);
        }
        is_moving
    }

    /// Compares the view with that of the last frame. If it differs, the frame that is being drawn is of no use.
    fn notice_view(&mut self, now: Instant) {
        let state = DrawnView {
            camera: self.control.camera(),
            size_px: self.picture_px.unwrap_or(self.size_px),
            tau_px: self.tau_px,
            switching: self.switching,
            daylight: self.daylight,
            shading: self.shading,
            style_changes: self.style_changes,
        };
        if self.view_state != Some(state) {
            self.pacer.view_changed(now);
            (self.view_state, self.job) = (Some(state), None);
            (self.is_stale, self.is_view_new) = (true, true);
        }
    }

    /// How long nothing needs to be drawn; `None` if a frame is due.
    fn wait(&self, now: Instant) -> Option<Duration> {
        if !self.has_frame() {
            return Some(POLL);
        }
        if self.is_view_new || self.job.is_some() {
            return None;
        }
        if self.is_stale {
            let next_at = self.drawn_at.map_or(now, |drawn_at| drawn_at + self.pacer.frame_time() * PAUSE_PER_FRAME);
            return Some(next_at.saturating_duration_since(now)).filter(|wait| !wait.is_zero());
        }
        let is_settled = self.streamer.is_settled();
        if self.picture_px.is_some() {
            return if is_settled { None } else { Some(POLL) };
        }
        let Some(final_at) = self.pacer.final_frame_at() else { return Some(self.rest()) };
        if !is_settled {
            return Some(POLL);
        }
        Some(final_at.saturating_duration_since(now)).filter(|wait| !wait.is_zero())
    }

    /// How long a complete view needs no step: until a tile that was damaged repeatedly may be requested once more.
    fn rest(&self) -> Duration {
        let recheck_at = self.streamer.downloads().recheck_at();
        recheck_at.map_or(REST, |at| at.saturating_sub(self.elapsed()).max(POLL))
    }

    /// The detail of the next frame, and whether it is the picture that was asked for: that has all rays, and is drawn when the
    /// tiles that its own hits ask for are there.
    fn next_detail(&self, now: Instant) -> (FrameDetail, bool) {
        let is_settled = self.streamer.is_settled();
        match self.picture_px {
            Some(size_px) => {
                let is_picture = is_settled && self.streamer.has_feedback(size_px);
                let samples = if is_picture { STILL_SAMPLES } else { 1 };
                (FrameDetail { divisor: 1, samples, is_changing: false, is_final: is_picture }, is_picture)
            }
            None => (self.pacer.detail(now, is_settled), false),
        }
    }

    /// The next step of the frame that is being drawn, or of a new one.
    fn draw_step(&mut self, now: Instant) -> Step {
        if self.job.is_none() {
            let (detail, is_picture) = self.next_detail(now);
            // A fine frame on the CPU takes long: one with a ray a pixel comes first.
            let samples = match detail.is_final && !self.renderer.is_gpu() && !is_picture {
                true => self.pacer.first_still_samples(detail.samples),
                false => detail.samples,
            };
            let settings = self.daylight.render_settings(self.shading, samples);
            let data = self.streamer.frame_data(&self.request(detail.divisor), &settings);
            self.job = Some(FrameJob::new(data, detail, is_picture));
            (self.is_stale, self.is_view_new) = (false, false);
            self.fine_requests = self.streamer.fine_requests_per_frame();
        }
        let Some(job) = &self.job else { return Step::wait(POLL) };
        let frame = &job.data.frame;
        let (action, count) = match self.renderer.is_gpu() {
            true => ("gpu", frame.height_px),
            false if job.detail.is_final => ("rows", self.pacer.rows_per_step(frame.height_px, frame.samples)),
            false => ("rows", frame.height_px),
        };
        let first = job.rows.rows();
        Step {
            action,
            wait_ms: 0.0,
            width: frame.width_px,
            height: frame.height_px,
            first,
            end: (first + count).min(frame.height_px),
            is_new: !job.is_sent,
            has_writes: self.renderer.has_writes(),
            is_picture: job.is_picture,
            divisor: job.detail.divisor,
            samples: frame.samples,
            is_final: job.detail.is_final && frame.samples == job.detail.samples,
        }
    }

    /// Draws a still frame again, with all its rays.
    fn refine(&mut self, mut data: FrameData, detail: FrameDetail) {
        data.frame.samples = detail.samples;
        self.job = Some(FrameJob::new(data, detail, false));
    }
}
