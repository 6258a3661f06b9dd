//! The sources of a city in the lower right corner of a picture, as their licences demand.
//!
//! White text on a dark, half-transparent box, with the window's fonts, on the CPU. The fonts are part of the program, so the
//! pixels do not depend on the machine. They have Latin, Greek and Cyrillic letters: other letters are left out, and the source's
//! address is added if there is one. The file's notes keep the full text.

use egui::epaint::Galley;
use egui::epaint::text::{Fonts, LayoutJob, TextOptions, TextWrapping};
use egui::{Color32, FontDefinitions, FontFamily, FontId};
use image::{Rgb, RgbImage};
use insula_protocol::manifest::Attribution;
use std::ops::Range;
use std::sync::Arc;

/// Smallest picture with a caption, in pixels.
const MIN_PICTURE_PX: [u32; 2] = [320, 180];
/// Most of the picture's pixels that the box takes.
const MAX_AREA_SHARE: f32 = 0.03;
/// Widest box, as a share of the picture's width.
const MAX_WIDTH_SHARE: f32 = 0.6;
/// Rows of text of the caption's preferred size that the picture would hold.
const ROWS_PER_PICTURE: f32 = 60.0;
/// Sizes of text, in pixels.
const MIN_TEXT_PX: f32 = 8.0;
const MAX_TEXT_PX: f32 = 48.0;
/// Characters that are laid out. A box that is large enough for more does not exist.
const MAX_CHARS: usize = 2000;
/// What the box leaves of the picture's brightness.
const BOX_TRANSMITTANCE: f32 = 0.4;
/// Drawn instead of a source that has no drawable letter.
const UNDRAWABLE: &str = "sources: see the notes in this file";

/// Draws the sources with their licences, one line each, into the lower right corner. The box takes at most 3% of the picture:
/// where the text does not fit, it becomes smaller and is cut at last. Pictures below 320 x 180 and cities without sources get none.
pub(super) fn draw_caption(image: &mut RgbImage, credits: &[Attribution]) {
    let [width, height] = [image.width(), image.height()];
    if credits.is_empty() || width < MIN_PICTURE_PX[0] || height < MIN_PICTURE_PX[1] {
        return;
    }
    let mut fonts = Fonts::new(TextOptions::default(), FontDefinitions::default());
    let mut can_draw = |c| fonts.has_glyph(&font(MIN_TEXT_PX), c);
    let mut lines: Vec<CaptionLine> = Vec::new();
    for line in credits.iter().map(|credit| CaptionLine::new(credit, &mut can_draw)) {
        if !lines.contains(&line) {
            lines.push(line);
        }
    }
    let caption = fit(&mut fonts, &lines, [width as f32, height as f32]);
    paint(image, &caption, &fonts.image());
}

#[derive(Debug, PartialEq)]
struct CaptionLine {
    text: String,
    /// The source's address, if the text lacks letters of its name.
    address: Option<String>,
}

impl CaptionLine {
    /// `NAME (LICENCE)`, without characters that cannot be drawn.
    fn new(credit: &Attribution, can_draw: &mut impl FnMut(char) -> bool) -> Self {
        let mut drawable = |text: &str| {
            let kept: String = text.chars().filter(|c| can_draw(*c)).collect();
            kept.replace("()", "").split_whitespace().collect::<Vec<_>>().join(" ")
        };
        let name = drawable(&credit.text);
        let licence = drawable(credit.licence.as_deref().unwrap_or_default());
        let licence = if licence.is_empty() { licence } else { format!(" ({licence})") };
        let is_complete = credit.text.chars().all(&mut *can_draw);
        let address = credit.url.clone().filter(|url| !is_complete && !url.is_empty() && url.is_ascii());
        if name.chars().any(char::is_alphanumeric) {
            return Self { text: name + &licence, address };
        }
        Self { text: address.unwrap_or_else(|| UNDRAWABLE.to_owned()) + &licence, address: None }
    }

    fn with_address(&self) -> String {
        match &self.address {
            Some(address) => format!("{}, {address}", self.text),
            None => self.text.clone(),
        }
    }
}

/// Text with its place in a box.
struct Caption {
    galley: Arc<Galley>,
    /// Between the text and the border of its box.
    padding_px: f32,
}

impl Caption {
    fn new(fonts: &mut Fonts, text: String, text_px: f32, wrap: TextWrapping) -> Self {
        let job = LayoutJob { wrap, ..LayoutJob::simple(text, font(text_px), Color32::WHITE, f32::INFINITY) };
        Self { galley: fonts.with_pixels_per_point(1.0).layout_job(job), padding_px: padding(text_px) }
    }

    /// Width and height of the box.
    fn size_px(&self) -> [f32; 2] {
        let size = self.galley.rect.size();
        [size.x, size.y].map(|side| (side + 2.0 * self.padding_px).ceil())
    }
}

/// The caption in the largest size in which its box is small enough, without addresses if there is none; cut in the smallest size
/// if even that is too large.
fn fit(fonts: &mut Fonts, lines: &[CaptionLine], [width, height]: [f32; 2]) -> Caption {
    let max_area = width * height * MAX_AREA_SHARE;
    let joined =
        |texts: Vec<String>, separator: &str| texts.join(separator).chars().take(MAX_CHARS).collect::<String>();
    let short: Vec<String> = lines.iter().map(|line| line.text.clone()).collect();
    let long = lines.iter().map(CaptionLine::with_address).collect();
    for text in [joined(long, "\n"), joined(short.clone(), "\n")] {
        let mut text_px = (height / ROWS_PER_PICTURE).clamp(MIN_TEXT_PX, MAX_TEXT_PX).round();
        while text_px >= MIN_TEXT_PX {
            let max_width = width * MAX_WIDTH_SHARE - 2.0 * padding(text_px);
            let wrap = TextWrapping { max_width, ..TextWrapping::default() };
            let caption = Caption::new(fonts, text.clone(), text_px, wrap);
            let [box_width, box_height] = caption.size_px();
            if box_width * box_height <= max_area && box_width <= width {
                return caption;
            }
            text_px -= 1.0;
        }
    }
    let pad = 2.0 * padding(MIN_TEXT_PX);
    let row_height = fonts.with_pixels_per_point(1.0).row_height(&font(MIN_TEXT_PX)).ceil();
    let max_rows = ((max_area / (width * MAX_WIDTH_SHARE) - pad) / row_height).floor().max(1.0);
    // One pixel for rounding up.
    let max_width = (max_area / (max_rows * row_height + pad)).min(width * MAX_WIDTH_SHARE) - pad - 1.0;
    let wrap = TextWrapping { max_width, max_rows: max_rows as usize, break_anywhere: true, ..TextWrapping::default() };
    Caption::new(fonts, joined(short, "; "), MIN_TEXT_PX, wrap)
}

pub(super) fn font(text_px: f32) -> FontId {
    FontId::new(text_px, FontFamily::Proportional)
}

pub(super) fn padding(text_px: f32) -> f32 {
    (text_px * 0.15).round().max(1.0)
}

/// Darkens the box and draws the glyphs over it. `atlas` holds the glyphs' coverage as alpha.
fn paint(image: &mut RgbImage, caption: &Caption, atlas: &egui::ColorImage) {
    let [width, height] = caption.size_px().map(|side| side as u32);
    let (left, top) = (image.width().saturating_sub(width), image.height().saturating_sub(height));
    darken(image, left..image.width(), top..image.height());
    let origin = egui::vec2(left as f32, top as f32) + egui::Vec2::splat(caption.padding_px);
    paint_glyphs(image, &caption.galley, origin, atlas, [left, top]);
}

/// Darkens a rectangle, so that text on it can be read.
pub(super) fn darken(image: &mut RgbImage, columns: Range<u32>, rows: Range<u32>) {
    for y in rows {
        for x in columns.clone() {
            let Rgb(rgb) = image.get_pixel_mut(x, y);
            *rgb = rgb.map(|value| (f32::from(value) * BOX_TRANSMITTANCE) as u8);
        }
    }
}

/// Draws white glyphs at `origin`, none to the left of or above `corner`.
pub(super) fn paint_glyphs(
    image: &mut RgbImage,
    galley: &Galley,
    origin: egui::Vec2,
    atlas: &egui::ColorImage,
    [left, top]: [u32; 2],
) {
    for row in &galley.rows {
        for glyph in row.row.glyphs.iter().filter(|glyph| !glyph.uv_rect.is_nothing()) {
            let corner = origin + row.pos.to_vec2() + (glyph.pos + glyph.uv_rect.offset).to_vec2().round();
            let [[u0, v0], [u1, v1]] = [glyph.uv_rect.min, glyph.uv_rect.max].map(|uv| uv.map(usize::from));
            for (v, u) in (v0..v1).flat_map(|v| (u0..u1).map(move |u| (v, u))) {
                let (x, y) = (corner.x as i64 + (u - u0) as i64, corner.y as i64 + (v - v0) as i64);
                let is_in_box = x >= i64::from(left) && y >= i64::from(top);
                let coverage = atlas.pixels.get(v * atlas.width() + u).filter(|_| is_in_box && u < atlas.width());
                let Some(coverage) = coverage else { continue };
                if let Some(Rgb(rgb)) = image.get_pixel_mut_checked(x as u32, y as u32) {
                    *rgb = rgb.map(|value| value + ((255 - u32::from(value)) * u32::from(coverage.a()) / 255) as u8);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn credit(text: &str, licence: Option<&str>, url: Option<&str>) -> Attribution {
        Attribution { text: text.into(), licence: licence.map(str::to_owned), url: url.map(str::to_owned) }
    }

    /// The pixels that differ between a plain picture of one brightness and the same with a caption.
    fn changed(size: [u32; 2], brightness: u8, credits: &[Attribution]) -> Vec<[u32; 2]> {
        let plain = RgbImage::from_pixel(size[0], size[1], Rgb([brightness; 3]));
        let mut image = plain.clone();
        draw_caption(&mut image, credits);
        let is_changed = |(x, y): &(u32, u32)| image.get_pixel(*x, *y) != plain.get_pixel(*x, *y);
        let all = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y)));
        all.filter(is_changed).map(|(x, y)| [x, y]).collect()
    }

    #[test]
    fn a_caption_is_small_and_in_the_lower_right_corner() {
        let short = vec![credit("3DBAG Team", Some("CC BY 4.0"), None)];
        let many: Vec<Attribution> =
            (0..30).map(|i| credit(&format!("Office of surveys number {i}"), Some("CC BY-SA 4.0"), None)).collect();
        let long = vec![credit(&"word ".repeat(200), None, None), credit(&"x".repeat(1000), None, None)];
        for size in [[320, 180], [640, 360], [1280, 720], [400, 900], [3840, 2160], [8192, 180], [320, 8192]] {
            for credits in [&short, &many, &long] {
                let pixels = changed(size, 200, credits);
                let share = pixels.len() as f32 / (size[0] * size[1]) as f32;
                assert!(!pixels.is_empty() && share <= MAX_AREA_SHARE, "{size:?}: {share}");
                assert!(pixels.contains(&[size[0] - 1, size[1] - 1]), "{size:?}");
                assert!(pixels.iter().all(|[x, _]| *x as f32 >= size[0] as f32 * 0.39), "{size:?}");
            }
        }
    }

    #[test]
    fn text_contrasts_with_its_box_on_any_ground() {
        for brightness in [0, 128, 255] {
            let mut image = RgbImage::from_pixel(640, 360, Rgb([brightness; 3]));
            draw_caption(&mut image, &[credit("PLATEAU", Some("CC BY 4.0"), None)]);
            // Within the box.
            let places = (350..360).flat_map(|y| (570..640).map(move |x| (x, y)));
            let bright = places.filter(|(x, y)| image.get_pixel(*x, *y).0[0] > 200).count();
            assert!((40..350).contains(&bright), "{brightness}: {bright} pixels of text");
            assert_eq!(image.get_pixel(639, 359).0[0], (f32::from(brightness) * BOX_TRANSMITTANCE) as u8);
        }
    }

    #[test]
    fn small_pictures_and_cities_without_sources_have_no_caption() {
        let credits = [credit("3DBAG", None, None)];
        for size in [[319, 180], [320, 179], [1, 1]] {
            assert_eq!(changed(size, 200, &credits), [[0; 2]; 0]);
        }
        assert_eq!(changed([640, 360], 200, &[]), [[0; 2]; 0]);
    }

    #[test]
    fn no_box_stands_for_a_letter_that_the_fonts_lack() {
        let mut fonts = Fonts::new(TextOptions::default(), FontDefinitions::default());
        let mut line = |credit: Attribution| {
            CaptionLine::new(&credit, &mut |c| fonts.has_glyph(&FontId::proportional(9.0), c)).with_address()
        };
        assert_eq!(line(credit("3DBAG – Größe, Ærø", Some("CC BY 4.0"), None)), "3DBAG – Größe, Ærø (CC BY 4.0)");
        let japanese = "国土交通省 Project PLATEAU（東京都）";
        assert_eq!(line(credit(japanese, Some("CC BY 4.0"), None)), "Project PLATEAU (CC BY 4.0)");
        let url = Some("https://www.mlit.go.jp/plateau");
        assert_eq!(line(credit(japanese, None, url)), "Project PLATEAU, https://www.mlit.go.jp/plateau");
        assert_eq!(line(credit("国土交通省", Some("CC BY 4.0"), url)), "https://www.mlit.go.jp/plateau (CC BY 4.0)");
        assert_eq!(line(credit("国土交通省", None, None)), UNDRAWABLE);
        for text in [japanese, "\u{10ffff}\u{e000}", "日本 \u{1f600}"] {
            let drawn = line(credit(text, None, None));
            assert!(drawn.chars().all(fonts_have), "{drawn}");
        }
    }

    fn fonts_have(c: char) -> bool {
        Fonts::new(TextOptions::default(), FontDefinitions::default()).has_glyph(&FontId::proportional(9.0), c)
    }
}
