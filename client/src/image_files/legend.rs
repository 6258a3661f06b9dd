//! The legend of colours in the upper left corner of a picture.

use super::caption::{darken, font, padding, paint_glyphs};
use egui::epaint::Galley;
use egui::epaint::text::{Fonts, LayoutJob, TextOptions, TextWrapping};
use egui::{Color32, FontDefinitions};
use image::{Rgb, RgbImage};
use insula_objects::color::{Legend, Ramp};
use insula_protocol::text::at_most;
use std::sync::Arc;

/// Smallest picture with a legend, in pixels.
const MIN_PICTURE_PX: [u32; 2] = [160, 120];
/// Rows of text that the picture would hold.
const ROWS_PER_PICTURE: f32 = 42.0;
/// Sizes of text, in pixels.
const MIN_TEXT_PX: f32 = 9.0;
const MAX_TEXT_PX: f32 = 40.0;
/// Widest text, as a share of the picture's width.
const MAX_WIDTH_SHARE: f32 = 0.3;

/// A line of the legend: its colour if it has one, and its text.
struct LegendLine {
    rgb: Option<[u8; 3]>,
    galley: Arc<Galley>,
}

/// Draws title, ramp and classes. Pictures below 160 x 120 get none; what does not fit below is left out.
pub(super) fn draw_legend(image: &mut RgbImage, legend: &Legend) {
    let [width, height] = [image.width(), image.height()];
    if width < MIN_PICTURE_PX[0] || height < MIN_PICTURE_PX[1] {
        return;
    }
    let text_px = (height as f32 / ROWS_PER_PICTURE).clamp(MIN_TEXT_PX, MAX_TEXT_PX).round();
    let mut fonts = Fonts::new(TextOptions::default(), FontDefinitions::default());
    let mut line = |rgb: Option<[u8; 3]>, text: &str| {
        let drawable: String = text.chars().filter(|c| fonts.has_glyph(&font(text_px), *c)).collect();
        let max_width = width as f32 * MAX_WIDTH_SHARE;
        let wrap = TextWrapping { max_width, max_rows: 1, break_anywhere: true, ..TextWrapping::default() };
        let job = LayoutJob { wrap, ..LayoutJob::simple(drawable, font(text_px), Color32::WHITE, f32::INFINITY) };
        LegendLine { rgb, galley: fonts.with_pixels_per_point(1.0).layout_job(job) }
    };
    let title = legend.unit.as_ref().map_or(legend.title.clone(), |unit| format!("{} ({unit})", legend.title));
    let mut lines = vec![line(None, &title)];
    if let Some(Ramp { range: [low, high], .. }) = &legend.ramp {
        lines.push(line(None, &format!("{} – {}", short(*low), short(*high))));
    }
    lines.extend(legend.entries.iter().map(|entry| line(Some(entry.rgb), &entry.label)));
    paint(image, &lines, legend.ramp.as_ref(), text_px, &fonts.image());
}

fn paint(image: &mut RgbImage, lines: &[LegendLine], ramp: Option<&Ramp>, text_px: f32, atlas: &egui::ColorImage) {
    let (pad, row) = (padding(text_px).max(3.0) as u32, (text_px * 1.35).ceil() as u32);
    let swatch = text_px.round() as u32;
    let widest = lines.iter().map(|line| line.galley.rect.width().ceil() as u32).max().unwrap_or(0);
    let box_width = (widest + swatch + 4 * pad).max(8 * row).min(image.width());
    let ramp_rows = u32::from(ramp.is_some());
    let box_height = ((lines.len() as u32 + ramp_rows) * row + 2 * pad).min(image.height());
    darken(image, 0..box_width, 0..box_height);
    let mut y = pad;
    for (i, line) in lines.iter().enumerate() {
        // The ramp is below the title.
        if let (1, Some(ramp)) = (i, ramp) {
            paint_ramp(image, ramp, [pad, y, box_width.saturating_sub(2 * pad), swatch]);
            y += row;
        }
        if y + row > box_height {
            return;
        }
        if let Some(rgb) = line.rgb {
            fill(image, [pad, y, swatch, swatch], |_| rgb);
        }
        let left = if line.rgb.is_some() { 2 * pad + swatch } else { pad };
        paint_glyphs(image, &line.galley, egui::vec2(left as f32, y as f32), atlas, [0, 0]);
        y += row;
    }
}

fn paint_ramp(image: &mut RgbImage, ramp: &Ramp, area: [u32; 4]) {
    let last = ramp.stops.len().saturating_sub(1) as f32;
    let at = |share: f32| {
        let place = share * last;
        let stop = |i: f32| ramp.stops.get(i as usize).copied().unwrap_or_default();
        let (low, high, part) = (stop(place.floor()), stop(place.ceil()), place.fract());
        std::array::from_fn(|k| (f32::from(low[k]) + (f32::from(high[k]) - f32::from(low[k])) * part).round() as u8)
    };
    fill(image, area, at);
}

/// Fills a rectangle (left, top, width, height) with colours by the share of its width.
fn fill(image: &mut RgbImage, [left, top, width, height]: [u32; 4], rgb: impl Fn(f32) -> [u8; 3]) {
    for x in 0..width {
        let rgb = Rgb(rgb((x as f32 + 0.5) / width as f32));
        for y in 0..height {
            if let Some(pixel) = image.get_pixel_mut_checked(left + x, top + y) {
                *pixel = rgb;
            }
        }
    }
}

/// A number with at most four digits that matter.
fn short(value: f64) -> String {
    let digits = (3.0 - value.abs().max(1e-9).log10().floor()).clamp(0.0, 6.0) as usize;
    at_most(value, digits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_objects::color::LegendEntry;

    fn legend() -> Legend {
        let entry = |rgb, label: &str| LegendEntry { rgb, label: label.into() };
        let ramp = Some(Ramp { range: [1650.0, 2020.0], stops: vec![[0, 0, 90], [250, 250, 0]] });
        let entries = vec![entry([211; 3], "no data")];
        Legend { title: "year of construction".into(), titles: Default::default(), unit: None, entries, ramp }
    }

    #[test]
    fn a_legend_has_its_colours_in_the_upper_left_corner() {
        let plain = RgbImage::from_pixel(640, 480, Rgb([100; 3]));
        let mut image = plain.clone();
        draw_legend(&mut image, &legend());
        let changed = |x, y| image.get_pixel(x, y) != plain.get_pixel(x, y);
        assert!(changed(0, 0) && !changed(639, 0) && !changed(0, 479) && !changed(320, 240));
        let has = |wanted: [u8; 3]| image.pixels().any(|pixel| pixel.0 == wanted);
        assert!(has([211; 3]));
        let yellow = image.pixels().filter(|pixel| pixel.0[0] > 220 && pixel.0[2] < 20).count();
        assert!(yellow > 10, "{yellow} pixels of the ramp's end");
    }

    #[test]
    fn small_pictures_have_none() {
        let mut image = RgbImage::from_pixel(159, 400, Rgb([100; 3]));
        draw_legend(&mut image, &legend());
        assert!(image.pixels().all(|pixel| pixel.0 == [100; 3]));
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!([1650.0, 12.345_67, 0.0, -3.0, 0.001_234].map(short), ["1650", "12.35", "0", "-3", "0.001234"]);
    }
}
