//! Drawings as DXF of release 12 (AC1009), which all CAD programs read. Units are millimetres of paper, y upwards.
//!
//! Lines are polylines on layers by class. Outlines of shapes are closed polylines on layers by kind, fills are solids of three or
//! four corners on layers of their own. Release 12 has neither fills with holes nor names of objects; the number of an object is in
//! the extended data of the application `INSULA`.

use crate::{
    drawing::{Drawing, DrawnObject, ShapeRole, SheetItem, TextAnchor},
    lines::LineRole,
    style::{Rgb, kind_name},
};
use insula_objects::FeatureKind;
use std::{collections::BTreeSet, fmt::Write};

/// Name of the application of extended data.
const APPLICATION: &str = "INSULA";
/// Longest text of a group in characters.
const MAX_TEXT: usize = 250;

/// The drawing as the text of a DXF file.
pub(crate) fn to_dxf(drawing: &Drawing) -> String {
    let mut dxf = Dxf { drawing, out: String::new() };
    dxf.header();
    dxf.tables();
    dxf.group(0, "SECTION");
    dxf.group(2, "ENTITIES");
    for object in &drawing.objects {
        for shape in &object.shapes {
            let prefix = if shape.role == ShapeRole::Shadow { "SHADOW" } else { "SURFACE" };
            let layer = format!("{prefix}_{}", layer_name(kind_name(object.kind)));
            if shape.role == ShapeRole::Surface && shape.opacity >= 1.0 {
                let fill = format!("FILL_{}", layer_name(kind_name(object.kind)));
                drawing.parts(shape).for_each(|part| dxf.solids(&fill, &part, shape.color));
            }
            for ring in drawing.rings(shape) {
                dxf.polyline(&layer, &ring, true, Some(object));
            }
        }
        for line in &object.lines {
            for chain in drawing.chains(line) {
                dxf.polyline(&line_layer(line.class), &chain, false, Some(object));
            }
        }
    }
    for item in &drawing.sheet {
        dxf.sheet_item(item);
    }
    dxf.group(0, "ENDSEC");
    dxf.group(0, "EOF");
    dxf.out
}

fn layer_name(name: &str) -> String {
    name.to_ascii_uppercase().replace('-', "_")
}

fn line_layer(class: LineRole) -> String {
    let name = LineRole::NAMES.iter().find(|(_, known)| *known == class).map_or("line", |(name, _)| name);
    format!("LINE_{}", layer_name(name))
}

/// Printable ASCII; other characters as the escapes of DXF.
fn dxf_text(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            ' '..='~' => out.push(c),
            c if c.is_control() => out.push(' '),
            c => {
                let mut units = [0u16; 2];
                for unit in c.encode_utf16(&mut units) {
                    // Writing into a string cannot fail.
                    let _ = write!(out, "\\U+{unit:04X}");
                }
            }
        }
        if out.len() >= MAX_TEXT {
            break;
        }
    }
    out
}

/// The nearest of the few colours that release 12 has: black, or a grey.
fn color_index([r, g, b]: Rgb) -> u8 {
    let grey = (u32::from(r) + u32::from(g) + u32::from(b)) / 3;
    match grey {
        0..=60 => 7,
        61..=140 => 8,
        141..=200 => 9,
        _ => 254,
    }
}

/// Lightness of the five pairs of colours that each hue has.
const LEVELS: [f64; 5] = [255.0, 165.0, 127.0, 76.0, 38.0];
/// The greys from 250 on.
const GREYS: [u8; 6] = [51, 91, 132, 173, 214, 255];

/// Red, green and blue of an index from 10 to 255: 24 hues with ten colours each, then greys.
fn index_color(index: u8) -> [f64; 3] {
    if index >= 250 {
        return [f64::from(GREYS[usize::from(index - 250)]); 3];
    }
    let (hue, shade) = (f64::from((index - 10) / 10) / 4.0, usize::from(index % 10));
    let level = LEVELS[shade / 2];
    // Odd ones are half as strong.
    let least = if shade % 2 == 1 { 0.5 } else { 0.0 };
    [0.0, 4.0, 2.0].map(|turn| {
        let away = ((hue + turn) % 6.0 - 3.0).abs() - 1.0;
        level * away.clamp(0.0, 1.0).max(least)
    })
}

/// The index of the nearest colour of release 12.
fn nearest_index(color: Rgb) -> u8 {
    let distance = |index: &u8| {
        let of_index = index_color(*index);
        (0..3).map(|k| (of_index[k] - f64::from(color[k])).powi(2)).sum::<f64>()
    };
    (10..=255).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(255)
}

struct Dxf<'a> {
    drawing: &'a Drawing,
    out: String,
}

impl Dxf<'_> {
    fn group(&mut self, code: u32, value: &str) {
        let _ = writeln!(self.out, "{code}\n{value}");
    }

    fn number(&mut self, code: u32, value: f64) {
        let _ = writeln!(self.out, "{code}\n{value:.4}");
    }

    fn integer(&mut self, code: u32, value: i64) {
        let _ = writeln!(self.out, "{code}\n{value}");
    }

    fn header(&mut self) {
        let [width, height] = self.drawing.grid.size_mm;
        self.group(0, "SECTION");
        self.group(2, "HEADER");
        for (name, value) in [("$ACADVER", "AC1009"), ("$DWGCODEPAGE", "ascii")] {
            self.group(9, name);
            self.group(if name == "$ACADVER" { 1 } else { 3 }, value);
        }
        for (name, [x, y]) in [("$EXTMIN", [0.0, 0.0]), ("$EXTMAX", [width, height])] {
            self.group(9, name);
            for (code, v) in [(10, x), (20, y), (30, 0.0)] {
                self.number(code, v);
            }
        }
        self.group(0, "ENDSEC");
    }

    fn tables(&mut self) {
        let mut layers: BTreeSet<(String, u8)> = BTreeSet::from([("SHEET".to_owned(), 7)]);
        layers.extend(LineRole::NAMES.iter().map(|(_, class)| (line_layer(*class), 7)));
        let kinds: BTreeSet<FeatureKind> = self.drawing.objects.iter().map(|object| object.kind).collect();
        for kind in kinds {
            let of_kind = |object: &&DrawnObject| object.kind == kind;
            let shape = self.drawing.objects.iter().filter(of_kind).find_map(|object| object.shapes.first());
            let name = layer_name(kind_name(kind));
            layers.insert((format!("SURFACE_{name}"), shape.map_or(7, |shape| color_index(shape.color))));
            layers.insert((format!("SHADOW_{name}"), 8));
            layers.insert((format!("FILL_{name}"), 7));
        }
        self.group(0, "SECTION");
        self.group(2, "TABLES");
        self.table("LTYPE", 1);
        for (code, value) in
            [(0, "LTYPE"), (2, "CONTINUOUS"), (70, "64"), (3, "Solid line"), (72, "65"), (73, "0"), (40, "0.0")]
        {
            self.group(code, value);
        }
        self.group(0, "ENDTAB");
        self.table("LAYER", layers.len());
        for (name, color) in layers {
            self.group(0, "LAYER");
            self.group(2, &name);
            self.integer(70, 0);
            self.integer(62, i64::from(color));
            self.group(6, "CONTINUOUS");
        }
        self.group(0, "ENDTAB");
        self.table("STYLE", 1);
        let style = [
            (0, "STYLE"),
            (2, "STANDARD"),
            (70, "0"),
            (40, "0.0"),
            (41, "1.0"),
            (50, "0.0"),
            (71, "0"),
            (42, "2.5"),
            (3, "txt"),
            (4, ""),
        ];
        for (code, value) in style {
            self.group(code, value);
        }
        self.group(0, "ENDTAB");
        self.table("APPID", 1);
        for (code, value) in [(0, "APPID"), (2, APPLICATION), (70, "0")] {
            self.group(code, value);
        }
        self.group(0, "ENDTAB");
        self.group(0, "ENDSEC");
    }

    fn table(&mut self, name: &str, entries: usize) {
        self.group(0, "TABLE");
        self.group(2, name);
        self.integer(70, entries as i64);
    }

    fn polyline(&mut self, layer: &str, points: &[[f64; 2]], is_closed: bool, object: Option<&DrawnObject>) {
        self.group(0, "POLYLINE");
        self.group(8, layer);
        self.integer(66, 1);
        for code in [10, 20, 30] {
            self.number(code, 0.0);
        }
        self.integer(70, i64::from(is_closed));
        if let Some(number) = object.and_then(|object| object.number) {
            let identifier = object.map_or("", |object| object.identifier.as_str());
            self.group(1001, APPLICATION);
            self.group(1000, &format!("object-{number}"));
            self.group(1000, &dxf_text(identifier));
        }
        for [x, y] in points {
            self.group(0, "VERTEX");
            self.group(8, layer);
            for (code, v) in [(10, *x), (20, *y), (30, 0.0)] {
                self.number(code, v);
            }
        }
        self.group(0, "SEQEND");
        self.group(8, layer);
    }

    /// Fills a convex polygon by solids, of which each has the corners of a triangle or, crosswise, of two.
    fn solids(&mut self, layer: &str, points: &[[f64; 2]], color: Rgb) {
        let Some(first) = points.first() else { return };
        for k in (1..points.len().saturating_sub(1)).step_by(2) {
            let (second, third) = (points[k], points[k + 1]);
            let last = points.get(k + 2).copied().unwrap_or(third);
            // The corners of a solid go along one side, then along the opposite one.
            self.solid(layer, [*first, second, last, third], color);
        }
    }

    fn solid(&mut self, layer: &str, corners: [[f64; 2]; 4], color: Rgb) {
        self.group(0, "SOLID");
        self.group(8, layer);
        self.integer(62, i64::from(nearest_index(color)));
        for (k, [x, y]) in (0..).zip(corners) {
            for (code, v) in [(10 + k, x), (20 + k, y), (30 + k, 0.0)] {
                self.number(code, v);
            }
        }
    }

    fn sheet_item(&mut self, item: &SheetItem) {
        match item {
            SheetItem::Line { points, .. } => self.polyline("SHEET", points, false, None),
            SheetItem::Swatch { points, color } => self.solids("SHEET", points, *color),
            SheetItem::Area { points } => self.polyline("SHEET", points, true, None),
            SheetItem::Text { at: [x, y], size_mm, anchor, text } => {
                let alignment = match anchor {
                    TextAnchor::Start => 0,
                    TextAnchor::Middle => 1,
                    TextAnchor::End => 2,
                };
                self.group(0, "TEXT");
                self.group(8, "SHEET");
                for (code, v) in [(10, *x), (20, *y), (30, 0.0), (40, *size_mm)] {
                    self.number(code, v);
                }
                self.group(1, &dxf_text(text));
                self.integer(72, alignment);
                for (code, v) in [(11, *x), (21, *y), (31, 0.0)] {
                    self.number(code, v);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_have_the_nearest_index() {
        let expected = [([255, 0, 0], 10), ([255, 255, 0], 50), ([0, 255, 0], 90), ([0, 255, 255], 130)];
        for (color, index) in expected.into_iter().chain([([0, 0, 255], 170), ([255, 0, 255], 210), ([0, 0, 127], 174)])
        {
            assert_eq!(nearest_index(color), index, "{color:?}");
        }
        assert_eq!([[255, 255, 255], [130, 131, 132], [50, 50, 50]].map(nearest_index), [255, 252, 250]);
    }

    #[test]
    fn texts_are_ascii() {
        assert_eq!(dxf_text("30\u{b0}\n\u{6771}"), "30\\U+00B0 \\U+6771");
        assert!(dxf_text(&"x".repeat(1000)).len() <= MAX_TEXT);
        assert_eq!(line_layer(LineRole::Crease), "LINE_CREASE");
    }
}
