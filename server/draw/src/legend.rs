//! The legend of colours by an attribute, in the upper left corner of the frame.

use crate::drawing::{SheetItem, TextAnchor};
use crate::sheet::wrapped;
use crate::style::Rgb;
use crate::view::PaperRect;
use insula_objects::Legend;
use std::collections::HashSet;

const TITLE_MM: f64 = 3.2;
const TEXT_MM: f64 = 2.4;
/// Height of a line.
const ROW_MM: f64 = 4.2;
const PADDING_MM: f64 = 2.5;
const SWATCH_MM: [f64; 2] = [5.0, 3.0];
/// Mean width of a character as a share of the text's height, with some reserve.
const CHARACTER: f64 = 0.6;
/// Width and height of a ramp.
const RAMP_MM: [f64; 2] = [44.0, 4.0];
/// Longest label in characters.
const MAX_LABEL: usize = 40;

fn rectangle([x, y]: [f64; 2], [width, height]: [f64; 2]) -> Vec<[f64; 2]> {
    vec![[x, y], [x + width, y], [x + width, y + height], [x, y + height]]
}

fn frame_of(corner: [f64; 2], size: [f64; 2]) -> SheetItem {
    let mut points = rectangle(corner, size);
    points.push(corner);
    SheetItem::Line { points, width_mm: 0.18 }
}

fn text(at: [f64; 2], size_mm: f64, anchor: TextAnchor, text: &str) -> SheetItem {
    let is_long = text.chars().count() > MAX_LABEL;
    let shown = text.chars().take(if is_long { MAX_LABEL - 3 } else { MAX_LABEL });
    let text = shown.chain(if is_long { "..." } else { "" }.chars()).collect();
    SheetItem::Text { at, size_mm, anchor, text }
}

/// Leaves out the classes that no visible object has. A ramp stays whole.
pub(crate) fn visible_legend(mut legend: Legend, visible: &HashSet<Rgb>) -> Legend {
    if legend.ramp.is_none() {
        legend.entries.retain(|entry| visible.contains(&entry.rgb));
    }
    legend
}

/// Parts of the sheet that say what the colours mean. What has no space in the frame is left out.
pub(crate) fn legend_items(legend: &Legend, frame: &PaperRect) -> Vec<SheetItem> {
    let title = match &legend.unit {
        Some(unit) => format!("{} [{unit}]", legend.title),
        None => legend.title.clone(),
    };
    // A ramp has its labels below it; what is left are objects without a value.
    let in_rows = if legend.ramp.is_some() { legend.entries.len().saturating_sub(1) } else { 0 };
    let [frame_width, frame_height] = frame.size();
    let ramp_height = if legend.ramp.is_some() { RAMP_MM[1] + ROW_MM + 1.0 } else { 0.0 };
    let space = frame_height - 4.0 * PADDING_MM - TITLE_MM - 2.0 - ramp_height;
    let rows = &legend.entries[in_rows..];
    let rows = &rows[..rows.len().min((space / ROW_MM).max(0.0) as usize)];
    let characters = |text: &str| text.chars().count().min(MAX_LABEL) as f64 * CHARACTER;
    let row_width = |label: &str| SWATCH_MM[0] + 2.0 + characters(label) * TEXT_MM;
    let widest = rows.iter().map(|entry| row_width(&entry.label)).fold(characters(&title) * TITLE_MM, f64::max);
    let widest = if legend.ramp.is_some() { widest.max(RAMP_MM[0] + 6.0) } else { widest };
    let size = [
        (widest + 2.0 * PADDING_MM).min(frame_width - 2.0 * PADDING_MM),
        2.0 * PADDING_MM + TITLE_MM + 2.0 + ramp_height + ROW_MM * rows.len() as f64,
    ];
    let corner = [frame.min[0] + PADDING_MM, frame.max[1] - PADDING_MM - size[1]];
    let mut items =
        vec![SheetItem::Swatch { points: rectangle(corner, size), color: [255; 3] }, frame_of(corner, size)];
    let left = corner[0] + PADDING_MM;
    let mut y = corner[1] + size[1] - PADDING_MM - TITLE_MM;
    items.push(text([left, y], TITLE_MM, TextAnchor::Start, &title));
    y -= 2.0;
    if let Some(ramp) = &legend.ramp {
        y -= RAMP_MM[1];
        let is_reversed = ramp.range[0] > ramp.range[1];
        let width = RAMP_MM[0] / ramp.stops.len().max(1) as f64;
        for k in 0..ramp.stops.len() {
            let color = ramp.stops[if is_reversed { ramp.stops.len() - 1 - k } else { k }];
            // Each reaches to the end and is covered by the next one, so that no seams show.
            let from = width * k as f64;
            let points = rectangle([left + 3.0 + from, y], [RAMP_MM[0] - from, RAMP_MM[1]]);
            items.push(SheetItem::Swatch { points, color });
        }
        y -= ROW_MM;
        let last = in_rows.saturating_sub(1).max(1) as f64;
        for (k, entry) in legend.entries[..in_rows].iter().enumerate() {
            let x = left + 3.0 + RAMP_MM[0] * k as f64 / last;
            items.push(text([x, y + 0.8], TEXT_MM, TextAnchor::Middle, &entry.label));
        }
        y -= 1.0;
    }
    for entry in rows {
        y -= ROW_MM;
        let at = [left, y + 0.6];
        items.push(SheetItem::Swatch { points: rectangle(at, SWATCH_MM), color: entry.rgb });
        // White on white.
        if entry.rgb == [255; 3] {
            items.push(frame_of(at, SWATCH_MM));
        }
        items.push(text([left + SWATCH_MM[0] + 2.0, y + 1.2], TEXT_MM, TextAnchor::Start, &entry.label));
    }
    items
}

/// Most characters of a line of notes.
const NOTE_CHARACTERS: usize = 100;

/// Lines of text in a box in the lower left corner of the frame. What has no space is left out.
pub(crate) fn note_items(notes: &[String], frame: &PaperRect) -> Vec<SheetItem> {
    let [width, height] = frame.size();
    let most = (((width - 4.0 * PADDING_MM) / (CHARACTER * TEXT_MM)) as usize).clamp(20, NOTE_CHARACTERS);
    let lines = notes.iter().flat_map(|note| wrapped(note, most));
    let lines: Vec<String> = lines.map(|line| line.chars().take(most).collect()).collect();
    let lines = &lines[..lines.len().min((0.4 * height / ROW_MM) as usize)];
    let widest = lines.iter().map(|line| line.chars().count()).max().unwrap_or(0);
    if widest == 0 {
        return Vec::new();
    }
    let size = [
        widest as f64 * CHARACTER * TEXT_MM + 2.0 * PADDING_MM,
        lines.len() as f64 * ROW_MM + 2.0 * PADDING_MM - (ROW_MM - TEXT_MM),
    ];
    let corner = [0, 1].map(|k| frame.min[k] + PADDING_MM);
    let mut items =
        vec![SheetItem::Swatch { points: rectangle(corner, size), color: [255; 3] }, frame_of(corner, size)];
    items.extend(lines.iter().enumerate().map(|(i, line)| SheetItem::Text {
        at: [corner[0] + PADDING_MM, corner[1] + size[1] - PADDING_MM - TEXT_MM - ROW_MM * i as f64],
        size_mm: TEXT_MM,
        anchor: TextAnchor::Start,
        text: line.clone(),
    }));
    items
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_objects::{LegendEntry, Ramp};

    #[test]
    fn only_visible_classes_are_listed() {
        let entry = |k: u8| LegendEntry { rgb: [k; 3], label: format!("class {k}") };
        let of = |ramp: Option<Ramp>| Legend {
            title: "kind".into(),
            titles: Default::default(),
            unit: None,
            entries: (0..4).map(entry).collect(),
            ramp,
        };
        let visible = HashSet::from([[1; 3], [3; 3], [9; 3]]);
        let listed =
            |legend: Legend| visible_legend(legend, &visible).entries.iter().map(|e| e.rgb[0]).collect::<Vec<_>>();
        assert_eq!(listed(of(None)), [1, 3]);
        assert_eq!(listed(of(Some(Ramp { range: [0.0, 1.0], stops: vec![[1; 3], [2; 3]] }))), [0, 1, 2, 3]);
    }

    #[test]
    fn legends_stay_in_the_frame() {
        let entry = |k: usize| LegendEntry { rgb: [k as u8; 3], label: format!("value {k}") };
        let frame = PaperRect { min: [10.0, 10.0], max: [110.0, 90.0] };
        for (count, ramp) in
            [(3, None), (200, None), (6, Some(Ramp { range: [9.0, 1.0], stops: vec![[1; 3], [2; 3]] }))]
        {
            let is_ramp = ramp.is_some();
            let legend = Legend {
                title: "height".into(),
                titles: Default::default(),
                unit: Some("m".into()),
                entries: (0..count).map(entry).collect(),
                ramp,
            };
            let items = legend_items(&legend, &frame);
            let swatches: Vec<_> = items
                .iter()
                .filter_map(|item| match item {
                    SheetItem::Swatch { points, color } => Some((points, *color)),
                    _ => None,
                })
                .collect();
            for [x, y] in swatches.iter().flat_map(|(points, _)| points.iter()) {
                assert!((10.0..=110.0).contains(x) && (10.0..=90.0).contains(y), "{x} {y}");
            }
            if is_ramp {
                assert_eq!(swatches[1..].iter().map(|(_, color)| color[0]).collect::<Vec<_>>(), [2, 1, 5]);
            } else {
                assert!(swatches.len() > 3 && swatches.len() <= count.min(20) + 1);
            }
        }
    }

    #[test]
    fn white_has_a_frame() {
        let frames = |rgb: [u8; 3]| {
            let entries = vec![LegendEntry { rgb, label: "no value".into() }];
            let legend = Legend { title: String::new(), titles: Default::default(), unit: None, entries, ramp: None };
            let items = legend_items(&legend, &PaperRect { min: [0.0; 2], max: [200.0; 2] });
            items.iter().filter(|item| matches!(item, SheetItem::Line { .. })).count()
        };
        assert_eq!([frames([200; 3]), frames([255; 3])], [1, 2]);
    }

    #[test]
    fn notes_are_wrapped_and_fit_into_the_frame() {
        let frame = PaperRect { min: [10.0, 34.0], max: [410.0, 287.0] };
        let notes = ["word ".repeat(60), "second".to_owned()];
        let items = note_items(&notes, &frame);
        let texts: Vec<&String> = items
            .iter()
            .filter_map(|item| if let SheetItem::Text { text, .. } = item { Some(text) } else { None })
            .collect();
        assert_eq!(texts.iter().map(|text| text.len()).collect::<Vec<_>>(), [99, 99, 99, 6]);
        assert!(note_items(&["a".repeat(9999)], &frame).len() == 3 && note_items(&[], &frame).is_empty());
    }
}
