//! State of the viewed city: session, camera, tools and display options.

use super::bookmarks::BookmarkPanel;
use super::object_panel::ObjectPanel;
use super::object_source::SharedLookup;
use super::overlay::{DisplayOptions, MESSAGE_TIME, TimedMessage};
use super::path_playback::PathPlayback;
use super::path_recording::PathRecorder;
use super::picture_job::{OpenAgainFn, PictureJob};
use super::picture_size::PictureSize;
use super::pointer_readout::PointerReadout;
use super::search_panel::SearchPanel;
use super::settings::UserSettings;
use super::stone_panel::StonePanel;
use super::style_panel::StylePanel;
use super::window::ViewerWindow;
use crate::render::Adapter;
use crate::session::Session;
use insula_protocol::text::printable;
use insula_shaders::cpu::raycast::RayCounts;
use insula_shaders::layout::Shading;
use insula_viewer::camera::Camera;
use insula_viewer::frame::RenderSettings;
use insula_viewer::interaction::camera_control::CameraControl;
use insula_viewer::interaction::day_animation::DayAnimation;
use insula_viewer::interaction::frame_pacing::FramePacer;
use insula_viewer::interaction::measure::MeasureTool;
use insula_viewer::streamer::FrameRequest;
use insula_viewer::sun::Daylight;
use insula_viewer::switching::SwitchDistances;
use std::time::Instant;

/// Initial state of a [`CityView`].
pub struct CityViewSetup {
    pub session: Session,
    /// URL for view links; empty if the city has none.
    pub address: String,
    /// Initial camera; one that overlooks the whole city if `None`.
    pub camera: Option<Camera>,
    pub daylight: Daylight,
    /// Tolerated screen-space error.
    pub tau_px: f64,
    /// What decides about levels of detail instead.
    pub switching: Option<SwitchDistances>,
    /// Frames a second while the view moves.
    pub fps: f64,
    /// Whether saved images name the city's sources in a corner.
    pub has_captions: bool,
    pub playback: Option<PathPlayback>,
    /// Opens another session of the city, for pictures.
    pub open_again: OpenAgainFn,
    pub cache_bytes: u64,
}

/// A city in the window.
pub struct CityView {
    pub(super) session: Session,
    pub(super) address: String,
    /// Whether saved images name the city's sources in a corner.
    pub(super) has_captions: bool,
    pub(super) control: CameraControl,
    pub(super) display: DisplayOptions,
    /// What decides about levels of detail instead of the tolerated error.
    pub(super) switching: Option<SwitchDistances>,
    /// Settings for the displayed daylight, with one ray per pixel.
    pub(super) render_settings: RenderSettings,
    pub(super) bookmark_panel: BookmarkPanel,
    pub(super) measure: MeasureTool,
    pub(super) readout: PointerReadout,
    pub(super) objects: ObjectPanel,
    pub(super) search: SearchPanel,
    /// Colours and filter of objects.
    pub(super) styles: StylePanel,
    pub(super) stones: StonePanel,
    /// The reader of the objects, until the first view is complete.
    pub(super) unopened_objects: Option<SharedLookup>,
    pub(super) is_shift_down: bool,
    pub(super) open_again: OpenAgainFn,
    pub(super) cache_bytes: u64,
    pub(super) picture: Option<PictureJob>,
    pub(super) recorder: Option<PathRecorder>,
    pub(super) playback: Option<PathPlayback>,
    /// Camera of the playback in half a second.
    pub(super) playback_heading: Option<Camera>,
    pub(super) pacer: FramePacer,
    pub(super) counts_rays: bool,
    /// Ray steps of the last settled frame, if they are counted.
    pub(super) ray_counts: Option<RayCounts>,
    /// Whether the settings have changes that must not be lost.
    pub(super) must_store_settings: bool,
}

impl CityView {
    /// The view of a city that was just connected to. `aspect` is the window's width divided by its height.
    pub fn new(setup: CityViewSetup, settings: &UserSettings, aspect: f64) -> Self {
        let CityViewSetup {
            session,
            address,
            camera,
            daylight,
            tau_px,
            switching,
            fps,
            has_captions,
            playback,
            open_again,
            cache_bytes,
        } = setup;
        let manifest = session.tree().manifest();
        let camera = camera.unwrap_or_else(|| Camera::overview(manifest, aspect));
        let control = CameraControl::new(&camera, manifest.ground_z_m);
        let draws_in_steps = matches!(session.adapter(), Adapter::Cpu(_));
        tracing::info!("opened {}", manifest.name);
        let stones = StonePanel::new(&manifest.stones);
        let mut pacer = FramePacer::new(Instant::now(), draws_in_steps);
        pacer.set_frame_rate(fps);
        let lookup = SharedLookup::new(Box::new(session.object_opener()));
        Self {
            session,
            address,
            has_captions,
            control,
            display: DisplayOptions {
                tau_px,
                shading: Shading::Lit,
                daylight,
                shows_sliders: settings.overlay,
                shows_counters: settings.counters,
                picture: PictureSize::default(),
                day: DayAnimation::default(),
                shows_map: settings.minimap,
                shows_help: false,
                message: None,
            },
            switching,
            render_settings: daylight.render_settings(Shading::Lit, 1),
            bookmark_panel: BookmarkPanel::default(),
            measure: MeasureTool::default(),
            readout: PointerReadout::default(),
            objects: ObjectPanel::new(lookup.clone()),
            search: SearchPanel::new(lookup.clone()),
            styles: StylePanel::new(lookup.clone()),
            stones,
            unopened_objects: Some(lookup),
            is_shift_down: false,
            open_again,
            cache_bytes,
            picture: None,
            recorder: None,
            playback,
            playback_heading: None,
            pacer,
            counts_rays: false,
            ray_counts: None,
            must_store_settings: false,
        }
    }

    pub(super) fn name(&self) -> &str {
        &self.session.tree().manifest().name
    }

    /// Shows a message for a few seconds, and prints it to standard output.
    pub(super) fn show_message(&mut self, text: String) {
        println!("{}", printable(&text));
        self.display.message = Some(TimedMessage { text, until: Instant::now() + MESSAGE_TIME });
    }

    /// Reports the hits that the GPU has counted since.
    pub(super) fn take_hits(&mut self) {
        if let Some((query, pixels)) = self.session.adapter_mut().take_hits() {
            self.session.report_hits(&query, &pixels);
        }
    }

    /// The frame for the window, with its size divided by `divisor`.
    pub(super) fn frame_request(&self, window: &ViewerWindow, divisor: u32) -> FrameRequest {
        FrameRequest {
            camera: self.control.camera(),
            heading: if self.playback.is_some() { self.playback_heading } else { self.control.heading() },
            size_px: window.surface.size_px().map(|side| (side / divisor).max(1)),
            tau_px: if self.switching.is_some() { 1.0 } else { self.display.tau_px },
            switching: self.switching,
        }
    }
}
