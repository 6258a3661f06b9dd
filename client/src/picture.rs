//! Streams and draws single pictures: to their end, and in strips, so that a large picture takes little memory of the device and
//! can be cancelled.

use crate::box_lines::paint_lines;
use crate::error::Result;
use crate::session::Session;
use glam::Vec3;
use insula_shaders::cpu::raycast::Pixels;
use insula_shaders::layout::{FrameUniform, Shading};
use insula_shaders::tone::develop;
use insula_viewer::frame::RenderSettings;
use insula_viewer::streamer::{FEEDBACK_DOWNSCALE, FrameRequest};
use std::time::Duration;

/// Longest wait for an arrival before retries are checked.
const POLL_INTERVAL: Duration = Duration::from_millis(10);
/// Frames with all their tiles that are drawn until feedback changes nothing. Usually one or two are enough. Nodes at the limit of
/// visibility can alternate for ever; all of them are resident then.
const MAX_FULL_FRAMES: u32 = 24;
/// Pixels of a strip, about. A device draws it in a fraction of a second.
const STRIP_PIXELS: u32 = 1 << 16;
/// Strips begin at multiples of this row, at which the ray-caster's pattern of fades repeats.
const STRIP_ROWS: u32 = 8;

/// How a view is streamed to its end.
#[derive(Debug, Clone, Copy)]
pub struct Settling {
    /// Size of the frames that find out what is occluded.
    pub feedback_px: [u32; 2],
    /// The server may be silent for this time.
    pub timeout: Duration,
}

/// Streams until nothing can improve the frame, or until `goes_on`, which is called after each update, returns `false`. Draws
/// frames meanwhile, because their hits decide which tiles are occluded. Fails if the server does not respond for the timeout, or
/// if the adapter fails.
pub fn settle(
    session: &mut Session,
    request: &FrameRequest,
    how: Settling,
    mut goes_on: impl FnMut(&Session) -> bool,
) -> Result<()> {
    let small_px = request.size_px.map(|side| (side / FEEDBACK_DOWNSCALE).max(1));
    let mut full_frames = 0;
    loop {
        session.update(request);
        if !goes_on(session) {
            return Ok(());
        }
        session.check(how.timeout)?;
        let size_px = if !session.is_fetched() {
            // A small frame shows well enough what is occluded while tiles are missing.
            if !session.has_frame() || session.has_feedback(small_px) {
                session.wait(POLL_INTERVAL);
                continue;
            }
            small_px
        } else if !session.has_feedback(how.feedback_px) && full_frames < MAX_FULL_FRAMES {
            full_frames += 1;
            how.feedback_px
        } else {
            return Ok(());
        };
        session.draw(&FrameRequest { size_px, ..*request }, &RenderSettings::default())?;
    }
}

/// Draws the last selection, with the boxes of its nodes if the shading asks for them. Fails if the adapter fails.
pub fn draw_whole(session: &mut Session, request: &FrameRequest, settings: &RenderSettings) -> Result<Pixels> {
    let mut pixels = session.draw(request, settings)?;
    add_boxes(session, request, settings, &mut pixels);
    Ok(pixels)
}

fn add_boxes(session: &Session, request: &FrameRequest, settings: &RenderSettings, pixels: &mut Pixels) {
    if settings.shading == Shading::Bounds {
        paint_lines(pixels, &session.box_edges(request));
    }
}

/// Draws the last selection in strips from top to bottom. `drawn` gets the share that is drawn, 0 to 1, and returns whether to
/// continue. Returns the colours of the whole picture, without distances; `None` if it was cancelled. Fails if the adapter fails.
pub fn draw_in_strips(
    session: &mut Session,
    request: &FrameRequest,
    settings: &RenderSettings,
    mut drawn: impl FnMut(f32) -> bool,
) -> Result<Option<Pixels>> {
    let mut data = session.frame_data(request, settings);
    let whole = data.frame;
    let [width_px, height_px] = request.size_px;
    let rows = (STRIP_PIXELS / width_px.max(1)).next_multiple_of(STRIP_ROWS).max(STRIP_ROWS);
    let mut words = Vec::with_capacity(width_px as usize * height_px as usize);
    let (mut hits, mut distances) = (Vec::with_capacity(words.capacity()), Vec::with_capacity(words.capacity()));
    for top in (0..height_px).step_by(rows as usize) {
        if !drawn(top as f32 / height_px as f32) {
            return Ok(None);
        }
        data.frame = strip_of(&whole, top, rows.min(height_px - top));
        let strip = session.while_fetching(|adapter| adapter.draw(&data))?;
        words.extend(if whole.shading == Shading::Lit as u32 { strip.radiance } else { strip.colour });
        hits.extend(strip.hit);
        distances.extend(strip.distance);
    }
    // Exposure, lines and shade follow from the whole picture.
    let colour = develop(&whole, &words, &hits, &distances);
    let mut pixels = Pixels { width_px, height_px, colour, ..Pixels::default() };
    add_boxes(session, request, settings, &mut pixels);
    Ok(Some(pixels))
}

/// The frame of `rows` rows of another frame, from row `top`.
fn strip_of(whole: &FrameUniform, top: u32, rows: u32) -> FrameUniform {
    let height = whole.height_px as f32;
    let (up, share) = (Vec3::from(whole.up), rows as f32 / height);
    let middle = (2 * top + rows) as f32 / height - 1.0;
    FrameUniform {
        forward: (Vec3::from(whole.forward) - up * middle).to_array(),
        up: (up * share).to_array(),
        height_px: rows,
        ..*whole
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn strips_have_the_rays_of_the_whole_frame() {
        let whole = FrameUniform {
            forward: [0.6, 0.0, -0.8],
            right: [0.0, 0.7, 0.0],
            up: [0.4, 0.0, 0.3],
            width_px: 30,
            height_px: 50,
            ..FrameUniform::zeroed()
        };
        // As in the ray-caster: from the upper edge of row `y`.
        let ray = |frame: &FrameUniform, y: f32| {
            let ndc = y / frame.height_px as f32 * 2.0 - 1.0;
            Vec3::from(frame.forward) - Vec3::from(frame.up) * ndc
        };
        for (top, rows) in [(0, 8), (24, 8), (48, 2), (0, 50)] {
            let strip = strip_of(&whole, top, rows);
            assert_eq!((strip.width_px, strip.height_px, strip.right), (30, rows, whole.right));
            for y in 0..=rows {
                let (expected, found) = (ray(&whole, (top + y) as f32), ray(&strip, y as f32));
                assert!((expected - found).length() < 1e-6, "{top}, {y}: {expected} {found}");
            }
        }
    }
}
