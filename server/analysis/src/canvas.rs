//! Pictures with lines and texts. The fonts are part of the program, so that pixels do not depend on the machine.

use epaint::text::{FontDefinitions, FontFamily, FontId, Fonts, LayoutJob, TextOptions, TextWrapping};
use epaint::{Color32, Galley};
use image::{Rgb, RgbImage};
use std::sync::Arc;

/// Which part of a text is at its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Anchor {
    /// The upper left corner.
    Corner,
    Middle,
}

pub(crate) type Color = [u8; 3];

/// A picture that is drawn. Texts are above all else.
pub(crate) struct PictureCanvas {
    pub(crate) image: RgbImage,
    fonts: Fonts,
    texts: Vec<([f32; 2], Arc<Galley>, Color)>,
}

impl PictureCanvas {
    pub(crate) fn new(size: [u32; 2], paper: Color) -> Self {
        let fonts = Fonts::new(TextOptions::default(), FontDefinitions::default());
        Self { image: RgbImage::from_pixel(size[0], size[1], Rgb(paper)), fonts, texts: Vec::new() }
    }

    /// A line with round ends, of a width in pixels.
    pub(crate) fn line(&mut self, [a, b]: [[f32; 2]; 2], width: f32, color: Color) {
        let along = [b[0] - a[0], b[1] - a[1]];
        let length2 = (along[0] * along[0] + along[1] * along[1]).max(1e-9);
        let range = |k: usize| [a[k].min(b[k]) - width, a[k].max(b[k]) + width];
        self.shade([range(0), range(1)], color, |[x, y]| {
            let t = (((x - a[0]) * along[0] + (y - a[1]) * along[1]) / length2).clamp(0.0, 1.0);
            0.5 * width + 0.5 - (x - a[0] - t * along[0]).hypot(y - a[1] - t * along[1])
        });
    }

    pub(crate) fn disc(&mut self, middle: [f32; 2], radius: f32, color: Color) {
        self.line([middle; 2], 2.0 * radius, color);
    }

    pub(crate) fn circle(&mut self, middle: [f32; 2], radius: f32, width: f32, color: Color) {
        let range = |k: usize| [middle[k] - radius - width, middle[k] + radius + width];
        self.shade([range(0), range(1)], color, |[x, y]| {
            0.5 * width + 0.5 - ((x - middle[0]).hypot(y - middle[1]) - radius).abs()
        });
    }

    /// Colours the pixels of a part by how much they are covered, 0 to 1.
    fn shade(&mut self, part: [[f32; 2]; 2], color: Color, covered: impl Fn([f32; 2]) -> f32) {
        let size = [self.image.width(), self.image.height()];
        let [columns, rows] = [0, 1].map(|k| {
            let [from, to] = part[k].map(|v| v.clamp(0.0, size[k] as f32));
            from.floor() as u32..to.ceil() as u32
        });
        for y in rows {
            for x in columns.clone() {
                let share = covered([x as f32 + 0.5, y as f32 + 0.5]).clamp(0.0, 1.0);
                blend(self.image.get_pixel_mut(x, y), color, share);
            }
        }
    }

    /// A text, cut to a width. Letters that the fonts lack are question marks.
    pub(crate) fn text(&mut self, at: [f32; 2], anchor: Anchor, size: f32, max_width: f32, color: Color, text: &str) {
        let font = FontId::new(size, FontFamily::Proportional);
        let drawn = |c: char| if self.fonts.has_glyph(&font, c) { c } else { '?' };
        let text: String = text.chars().map(drawn).collect();
        let wrap = TextWrapping { max_width, max_rows: 1, break_anywhere: true, ..TextWrapping::default() };
        let job = LayoutJob { wrap, ..LayoutJob::simple(text, font, Color32::WHITE, f32::INFINITY) };
        let galley = self.fonts.with_pixels_per_point(1.0).layout_job(job);
        let half = match anchor {
            Anchor::Corner => [0.0; 2],
            Anchor::Middle => [0.5 * galley.rect.width(), 0.5 * galley.rect.height()],
        };
        self.texts.push(([at[0] - half[0], at[1] - half[1]], galley, color));
    }

    /// The picture with its texts.
    pub(crate) fn finish(mut self) -> RgbImage {
        let atlas = self.fonts.image();
        for (at, galley, color) in &self.texts {
            for row in &galley.rows {
                for glyph in row.row.glyphs.iter().filter(|glyph| !glyph.uv_rect.is_nothing()) {
                    let [left, top] = [at[0] + row.pos.x, at[1] + row.pos.y];
                    let corner =
                        [left + glyph.pos.x + glyph.uv_rect.offset.x, top + glyph.pos.y + glyph.uv_rect.offset.y];
                    let [x0, y0] = corner.map(|v| v.round() as i64);
                    let [[u0, v0], [u1, v1]] = [glyph.uv_rect.min, glyph.uv_rect.max].map(|uv| uv.map(usize::from));
                    for (v, u) in (v0..v1).flat_map(|v| (u0..u1).map(move |u| (v, u))) {
                        let Some(covered) = atlas.pixels.get(v * atlas.width() + u) else { continue };
                        let [x, y] = [x0 + (u - u0) as i64, y0 + (v - v0) as i64].map(|k| u32::try_from(k).ok());
                        let pixel = x.zip(y).and_then(|(x, y)| self.image.get_pixel_mut_checked(x, y));
                        pixel.into_iter().for_each(|pixel| blend(pixel, *color, f32::from(covered.a()) / 255.0));
                    }
                }
            }
        }
        self.image
    }
}

fn blend(Rgb(pixel): &mut Rgb<u8>, color: Color, share: f32) {
    for (old, new) in pixel.iter_mut().zip(color) {
        *old = (f32::from(*old) + (f32::from(new) - f32::from(*old)) * share).round() as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_and_texts_have_their_places() {
        let mut canvas = PictureCanvas::new([60, 40], [255; 3]);
        canvas.line([[5.0, 10.0], [25.0, 10.0]], 4.0, [255, 0, 0]);
        canvas.circle([45.0, 20.0], 10.5, 2.0, [0, 0, 255]);
        canvas.text([2.0, 22.0], Anchor::Corner, 14.0, 30.0, [0; 3], "HH\u{4e2d}");
        let image = canvas.finish();
        let at = |x: u32, y: u32| image.get_pixel(x, y).0;
        assert_eq!([at(15, 10), at(15, 14), at(29, 10)], [[255, 0, 0], [255; 3], [255; 3]]);
        assert_eq!([at(55, 20), at(45, 20)], [[0, 0, 255], [255; 3]]);
        let dark = (22..40).flat_map(|y| (0..32).map(move |x| (x, y))).filter(|(x, y)| at(*x, *y)[0] < 128).count();
        assert!((20..200).contains(&dark), "{dark}");
    }
}
