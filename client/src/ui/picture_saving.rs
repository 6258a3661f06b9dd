//! Saves pictures of the view.

use super::city_view::CityView;
use super::picture_job::{self, PictureJob, PictureOrder};
use super::view_link::format_link;
use super::window::ViewerWindow;
use crate::error::Result;
use crate::image_files::PictureNotes;
use crate::picture::draw_whole;
use crate::proposal::ShownProposal;
use crate::render::Adapter;
use insula_viewer::frame::{RenderSettings, STILL_SAMPLES};
use insula_viewer::streamer::FrameRequest;
use std::path::PathBuf;

impl CityView {
    /// Starts to draw a picture of the chosen size in the background.
    pub(super) fn save_picture(&mut self, window: &ViewerWindow) {
        if self.picture.is_some() {
            return self.show_message("a picture is being drawn: Esc cancels it".to_owned());
        }
        let window_px = window.surface.size_px();
        let size_px = self.display.picture.size_px(window_px);
        let request = FrameRequest { heading: None, size_px, ..self.frame_request(window, 1) };
        let link = format_link(&self.address, &request.camera, &self.display.daylight, self.objects.only_selected());
        let legend = self.styles.legend().cloned();
        let notes =
            PictureNotes { legend, ..PictureNotes::new(self.session.tree().manifest(), link, self.has_captions) };
        let order = PictureOrder {
            request,
            notes,
            styles: self.session.cache().styles().clone(),
            shows_proposal: self.session.proposal().is_some_and(ShownProposal::is_shown),
            settings: self.picture_settings(),
            on_cpu: matches!(self.session.adapter(), Adapter::Cpu(_)),
            cache_bytes: self.cache_bytes,
        };
        let to_wake = window.window.clone();
        match PictureJob::start(order, self.open_again.clone(), move || to_wake.request_redraw()) {
            Ok(job) => self.picture = Some(job),
            Err(error) => self.show_message(format!("no picture saved: {error}: close other programs")),
        }
    }

    fn picture_settings(&self) -> RenderSettings {
        RenderSettings { samples: STILL_SAMPLES, shading: self.display.shading, ..self.render_settings }
    }

    /// Takes note of a picture that is finished.
    pub(super) fn check_picture(&mut self, window: &ViewerWindow) {
        let Some((order, outcome)) =
            self.picture.as_ref().and_then(|job| Some((job.order.clone(), job.take_outcome()?)))
        else {
            return;
        };
        self.picture = None;
        let written = outcome.or_else(|error| {
            // Without the server, a picture as large as the window shows what the window shows.
            let request = FrameRequest { heading: None, ..self.frame_request(window, 1) };
            if request != order.request { Err(error) } else { self.draw_at_once(&order) }
        });
        self.show_message(match written {
            Ok(path) => format!("wrote {}", path.display()),
            Err(error) => format!("no picture saved: {error}"),
        });
    }

    fn draw_at_once(&mut self, order: &PictureOrder) -> Result<PathBuf> {
        picture_job::save(&draw_whole(&mut self.session, &order.request, &order.settings)?, &order.notes)
    }
}
