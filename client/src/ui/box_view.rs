//! Draws the boxes of nodes over the frame.

use super::outlined;
use super::projection::on_screen;
use crate::session::Session;
use egui::{Color32, Context, LayerId};
use insula_shaders::layout::Shading;
use insula_viewer::streamer::FrameRequest;

/// Paints the boxes of the last selection's nodes over a frame that fills the window, if the shading asks for them.
pub fn paint(session: &Session, request: &FrameRequest, shading: Shading, ctx: &Context) {
    if shading == Shading::Bounds {
        let painter = ctx.layer_painter(LayerId::background());
        for ends in session.box_edges(request) {
            outlined::line(&painter, ends.map(|share| on_screen(share, ctx.content_rect())), 1.0, Color32::WHITE);
        }
    }
}
