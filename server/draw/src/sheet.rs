//! The sheet around a drawing: frame, title block, scale bar and north arrow.

use crate::drawing::{SheetItem, TextAnchor};
use crate::error::DrawError;
use crate::view::{PaperRect, Projection};
use glam::{DVec2, DVec3};

/// Smallest and largest side of a paper in millimetres.
const SIDES_MM: std::ops::RangeInclusive<f64> = 20.0..=2000.0;
const MARGIN_MM: f64 = 10.0;
/// Height of the strip below the frame.
const STRIP_MM: f64 = 24.0;
const TITLE_MM: f64 = 5.0;
const TEXT_MM: f64 = 2.8;
const NOTE_MM: f64 = 2.0;
/// Width of a character of the notes: the mean of a sans-serif font, with some reserve.
const NOTE_CHARACTER_MM: f64 = 0.55 * NOTE_MM;
/// Of the sources; the light has one line more.
const MAX_NOTE_LINES: usize = 3;
const NOTE_LINE_MM: f64 = 2.4;

/// Sizes of paper by name in millimetres, in landscape format.
const PAPERS: [(&str, [f64; 2]); 6] = [
    ("A0", [1189.0, 841.0]),
    ("A1", [841.0, 594.0]),
    ("A2", [594.0, 420.0]),
    ("A3", [420.0, 297.0]),
    ("A4", [297.0, 210.0]),
    ("A5", [210.0, 148.0]),
];

/// A sheet of paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Paper {
    /// Width and height in millimetres.
    pub size_mm: [f64; 2],
}

impl Default for Paper {
    /// A3.
    fn default() -> Self {
        Self { size_mm: [420.0, 297.0] }
    }
}

impl Paper {
    /// Reads `A3`, `A3-portrait` or `WIDTHxHEIGHT` in millimetres. Fails on other names and on sizes from out of 20 to 2000 mm.
    pub fn parse(text: &str) -> Result<Self, DrawError> {
        let invalid =
            || DrawError::Invalid(format!("{text}: not a paper: use A0 to A5, A3-portrait, or WIDTHxHEIGHT in mm"));
        let (name, is_portrait) = text.strip_suffix("-portrait").map_or((text, false), |name| (name, true));
        let known = PAPERS.iter().find(|(known, _)| known.eq_ignore_ascii_case(name)).map(|(_, size)| *size);
        let size = match known {
            Some([width, height]) => Some(if is_portrait { [height, width] } else { [width, height] }),
            None => name.split_once('x').and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?])),
        };
        let size_mm: [f64; 2] = size.filter(|_| known.is_some() || !is_portrait).ok_or_else(invalid)?;
        if size_mm.iter().all(|side| SIDES_MM.contains(side)) { Ok(Self { size_mm }) } else { Err(invalid()) }
    }

    /// Where the city is drawn. A bare sheet has nothing else.
    #[must_use]
    pub fn frame(&self, is_bare: bool) -> PaperRect {
        if is_bare {
            return PaperRect { min: [0.0; 2], max: self.size_mm };
        }
        // Small papers have smaller margins.
        let part = (self.size_mm[0].min(self.size_mm[1]) / 148.0).min(1.0);
        let (margin, strip) = (MARGIN_MM * part, STRIP_MM * part);
        PaperRect { min: [margin, margin + strip], max: self.size_mm.map(|side| side - margin) }
    }
}

/// What the title block says.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TitleBlock {
    pub title: String,
    /// View and scale.
    pub description: String,
    /// Date and sun.
    pub light: String,
    /// Who must be named.
    pub attribution: String,
}

/// The parts of a sheet around the frame.
#[must_use]
pub(crate) fn sheet_items(projection: &Projection, block: &TitleBlock) -> Vec<SheetItem> {
    let frame = projection.frame;
    let part = (frame.min[0] / MARGIN_MM).min(1.0);
    let mut items = vec![SheetItem::Line { points: rectangle(&frame), width_mm: 0.35 }];
    let strip = PaperRect { min: [frame.min[0], frame.min[0]], max: [frame.max[0], frame.min[1]] };
    items.push(SheetItem::Line { points: rectangle(&strip), width_mm: 0.35 });
    let text = |at: [f64; 2], size: f64, text: &str| SheetItem::Text {
        at,
        size_mm: size * part,
        anchor: TextAnchor::Start,
        text: text.to_owned(),
    };
    let left = strip.min[0] + 4.0 * part;
    items.push(text([left, strip.max[1] - 7.5 * part], TITLE_MM, &block.title));
    items.push(text([left, strip.max[1] - 12.5 * part], TEXT_MM, &block.description));
    let right = north_arrow(&strip, part, projection, &mut items);
    let bar = scale_bar(&strip, right, part, projection, &mut items);
    let width = (bar - left - 6.0 * part).max(20.0);
    let characters = (width / (NOTE_CHARACTER_MM * part)) as usize;
    let light = wrapped(&block.light, characters).into_iter().take(1);
    for (line, words) in light.chain(note_lines(&block.attribution, characters)).enumerate() {
        items.push(text([left, strip.max[1] - (15.8 + NOTE_LINE_MM * line as f64) * part], NOTE_MM, &words));
    }
    items
}

fn rectangle(rect: &PaperRect) -> Vec<[f64; 2]> {
    let PaperRect { min, max } = rect;
    vec![*min, [max[0], min[1]], *max, [min[0], max[1]], *min]
}

/// Lines of at most so many characters, if no word is longer.
pub(crate) fn wrapped(text: &str, characters: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= characters => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// The first [`MAX_NOTE_LINES`] lines; the last one ends with dots if there is more.
fn note_lines(text: &str, characters: usize) -> Vec<String> {
    let mut lines = wrapped(text, characters);
    if lines.len() > MAX_NOTE_LINES {
        lines.truncate(MAX_NOTE_LINES);
        lines.iter_mut().last().into_iter().for_each(|line| line.push_str(" ..."));
    }
    lines
}

/// An arrow to the grid's north as the view shows it. Returns where it begins.
fn north_arrow(strip: &PaperRect, part: f64, projection: &Projection, items: &mut Vec<SheetItem>) -> f64 {
    let axes = &projection.axes;
    let radius = 8.0 * part;
    let middle = DVec2::new(strip.max[0] - radius - 5.0 * part, 0.5 * (strip.min[1] + strip.max[1]));
    let north = DVec2::new(DVec3::Y.dot(axes.right), DVec3::Y.dot(axes.up));
    // Along the view, north is a point.
    if north.length() > 0.05 {
        let (along, across) = (north * radius, north.perp().normalize_or(DVec2::X) * radius * 0.3);
        let tip = middle + along * 0.8;
        let foot = middle - along * 0.6;
        let points = [tip, foot + across, middle - along * 0.4, foot - across];
        items.push(SheetItem::Area { points: points.iter().map(DVec2::to_array).collect() });
        items.push(SheetItem::Text {
            at: (middle + north.normalize_or(DVec2::Y) * radius * 1.05 - DVec2::new(0.0, 0.3 * TEXT_MM * part))
                .to_array(),
            size_mm: TEXT_MM * part,
            anchor: TextAnchor::Middle,
            text: "N".to_owned(),
        });
    }
    middle.x - radius - 6.0 * part
}

/// A bar of a round length at most 60 mm long. Returns where it begins.
fn scale_bar(strip: &PaperRect, right: f64, part: f64, projection: &Projection, items: &mut Vec<SheetItem>) -> f64 {
    let Some(scale) = projection.scale else { return right };
    let longest_m = 0.06 * part * scale;
    let power = 10f64.powf(longest_m.log10().floor());
    let length_m = [5.0, 2.0, 1.0].map(|factor| factor * power).into_iter().find(|m| *m <= longest_m).unwrap_or(power);
    let length = length_m * 1000.0 / scale;
    let (begin, y) = (right - length, strip.min[1] + 8.0 * part);
    let height = 1.6 * part;
    for k in 0..4 {
        let (a, b) = (begin + 0.25 * length * f64::from(k), begin + 0.25 * length * f64::from(k + 1));
        let rect = rectangle(&PaperRect { min: [a, y], max: [b, y + height] });
        items.push(if k % 2 == 0 {
            SheetItem::Area { points: rect }
        } else {
            SheetItem::Line { points: rect, width_mm: 0.18 }
        });
    }
    for (share, text) in
        [(0.0, "0".to_owned()), (0.5, meters(0.5 * length_m)), (1.0, format!("{} m", meters(length_m)))]
    {
        items.push(SheetItem::Text {
            at: [begin + share * length, y + height + 1.2 * part],
            size_mm: TEXT_MM * part,
            anchor: TextAnchor::Middle,
            text,
        });
    }
    begin - 4.0 * part
}

fn meters(m: f64) -> String {
    if m >= 1.0 { format!("{m:.0}") } else { format!("{m}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn papers_have_names_or_sizes() {
        assert_eq!(Paper::parse("a3").unwrap().size_mm, [420.0, 297.0]);
        assert_eq!(Paper::parse("A4-portrait").unwrap().size_mm, [210.0, 297.0]);
        assert_eq!(Paper::parse("400x100").unwrap().size_mm, [400.0, 100.0]);
        for wrong in ["A9", "1x1", "400x", "400x100-portrait", "nanxnan", "3000x10"] {
            assert!(Paper::parse(wrong).is_err(), "{wrong}");
        }
        assert_eq!(Paper::parse("A3").unwrap().frame(false).size(), [400.0, 253.0]);
    }

    #[test]
    fn long_notes_are_wrapped_and_end_with_dots() {
        assert_eq!(note_lines("aa bb cc", 5), ["aa bb", "cc"]);
        assert_eq!(note_lines("a b c d e", 1), ["a", "b", "c ..."]);
    }
}
