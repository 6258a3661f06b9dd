//! Drawings as DXF of release 2000 (AC1015): what is seen as closed polylines on layers by kind and class.
//!
//! Coordinates are metres of the city's coordinate system, so that a plan lies where other plans of the place do; of views along other
//! axes they are metres along these. A sheet of paper, and a perspective, which has no scale, are in millimetres. Lines that are borders
//! of surfaces are not drawn twice. The number of an object is in the extended data of the application `INSULA`, and on its first polyline
//! its identifier, too.

mod colors;
mod sections;

use crate::{
    drawing::{Drawing, DrawnObject, DrawnShape, ShapeRole, SheetItem, TextAnchor},
    lines::LineRole,
    style::{Rgb, kind_name},
};
use colors::{color_index, nearest_index};
use insula_objects::FeatureKind;
use insula_protocol::text::at_most;
use sections::{APPLICATION, FIRST_HANDLE, HANDSEED, MODEL_SPACE};
use std::{collections::BTreeSet, fmt::Write};

/// Longest text of a group in characters.
const MAX_TEXT: usize = 250;
/// Decimals of metres and of millimetres: what a survey knows, and what a plotter draws.
const METRE_DECIMALS: usize = 2;
const MILLIMETRE_DECIMALS: usize = 3;
/// Height of texts on paper in millimetres.
const NOTE_MM: f64 = 2.5;

/// The drawing as the text of a DXF file.
pub(crate) fn to_dxf(drawing: &Drawing) -> String {
    let mut content = Dxf::new(drawing, FIRST_HANDLE);
    content.entities();
    let mut dxf = Dxf::new(drawing, content.next_handle);
    dxf.header();
    dxf.tables(&content);
    dxf.blocks();
    dxf.begin_section("ENTITIES");
    dxf.out.push_str(&content.out);
    dxf.group(0, "ENDSEC");
    dxf.objects();
    dxf.group(0, "EOF");
    // The header has the handle after the last one.
    dxf.out.replacen(HANDSEED, &format!("{:X}", dxf.next_handle), 1)
}

fn layer_name(name: &str) -> String {
    name.to_ascii_uppercase().replace('-', "_")
}

fn line_layer(class: LineRole) -> String {
    let name = LineRole::NAMES.iter().find(|(_, known)| *known == class).map_or("line", |(name, _)| name);
    format!("LINE_{}", layer_name(name))
}

fn shape_layer(kind: FeatureKind, role: ShapeRole) -> String {
    let name = layer_name(kind_name(kind));
    if role == ShapeRole::Shadow { format!("SHADOW_{name}") } else { name }
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

/// A file, or the entities of one, in the making.
struct Dxf<'a> {
    drawing: &'a Drawing,
    out: String,
    next_handle: u32,
    /// Layers of the entities, with their colours.
    layers: BTreeSet<(String, u8)>,
    /// Lowest and highest coordinates of the entities.
    extent: [[f64; 2]; 2],
}

impl<'a> Dxf<'a> {
    fn new(drawing: &'a Drawing, next_handle: u32) -> Self {
        let extent = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        Self { drawing, out: String::new(), next_handle, layers: BTreeSet::new(), extent }
    }

    fn group(&mut self, code: u32, value: &str) {
        let _ = writeln!(self.out, "{code}\n{value}");
    }

    fn integer(&mut self, code: u32, value: i64) {
        let _ = writeln!(self.out, "{code}\n{value}");
    }

    fn number(&mut self, code: u32, value: f64) {
        self.group(code, &at_most(value, 6));
    }

    fn handle(&mut self, code: u32, handle: u32) {
        let _ = writeln!(self.out, "{code}\n{handle:X}");
    }

    fn new_handle(&mut self) -> u32 {
        self.next_handle += 1;
        self.next_handle - 1
    }

    /// A place of the paper in units of the file.
    fn place(&self, mm: [f64; 2]) -> [f64; 2] {
        self.drawing.metres.map_or(mm, |frame| frame.place(mm))
    }

    /// A length on paper in units of the file.
    fn length(&self, mm: f64) -> f64 {
        self.drawing.metres.map_or(mm, |frame| mm * frame.per_mm)
    }

    fn decimals(&self) -> usize {
        if self.drawing.metres.is_some() { METRE_DECIMALS } else { MILLIMETRE_DECIMALS }
    }

    fn begin_section(&mut self, name: &str) {
        self.group(0, "SECTION");
        self.group(2, name);
    }

    fn entities(&mut self) {
        let drawing = self.drawing;
        for object in &drawing.objects {
            let mut identifier = Some(object.identifier.as_str()).filter(|identifier| !identifier.is_empty());
            for shape in &object.shapes {
                self.shape(object, shape, &mut identifier);
            }
            // Other lines are borders of the surfaces, or between surfaces of different light.
            let is_own = |class: LineRole| {
                class == LineRole::Hatch
                    || object.shapes.is_empty()
                    || !drawing.is_lit && matches!(class, LineRole::Crease | LineRole::Intersection)
            };
            for line in object.lines.iter().filter(|line| is_own(line.class)) {
                let layer = line_layer(line.class);
                for chain in drawing.chains(line) {
                    self.polyline(&layer, 7, &chain, false, (Some(object), &mut identifier));
                }
            }
        }
        if drawing.metres.is_some() {
            self.notes();
        } else {
            drawing.sheet.iter().for_each(|item| self.sheet_item(item));
        }
    }

    fn shape(&mut self, object: &DrawnObject, shape: &DrawnShape, identifier: &mut Option<&str>) {
        let layer = shape_layer(object.kind, shape.role);
        let color = if shape.role == ShapeRole::Shadow { 8 } else { color_index(shape.color) };
        for ring in self.drawing.rings(shape) {
            self.polyline(&layer, color, &ring, true, (Some(object), &mut *identifier));
        }
    }

    /// Title and sources below a drawing in metres, which has no sheet.
    fn notes(&mut self) {
        let drawing = self.drawing;
        let frame = drawing.frame;
        let lines = [&drawing.title, &drawing.attribution];
        for (line, text) in (1..).zip(lines.into_iter().filter(|text| !text.is_empty())) {
            let at = [frame.min[0], frame.min[1] - 1.8 * NOTE_MM * f64::from(line)];
            self.text(at, NOTE_MM, 0, text);
        }
    }

    fn entity(&mut self, kind: &str, layer: &str, color: u8) {
        if !self.layers.iter().any(|(known, _)| known == layer) {
            self.layers.insert((layer.to_owned(), color));
        }
        let handle = self.new_handle();
        self.group(0, kind);
        self.handle(5, handle);
        self.handle(330, MODEL_SPACE);
        self.group(100, "AcDbEntity");
        self.group(8, layer);
    }

    /// A polyline, unless it is too small for the decimals of the file.
    fn polyline(
        &mut self,
        layer: &str,
        color: u8,
        points: &[[f64; 2]],
        is_closed: bool,
        (object, identifier): (Option<&DrawnObject>, &mut Option<&str>),
    ) {
        let decimals = self.decimals();
        let mut places: Vec<[String; 2]> = Vec::with_capacity(points.len());
        for point in points {
            let place = self.place(*point);
            let text = place.map(|v| at_most(v, decimals));
            if places.last() != Some(&text) {
                places.push(text);
            }
            for (k, v) in place.into_iter().enumerate() {
                (self.extent[0][k], self.extent[1][k]) = (self.extent[0][k].min(v), self.extent[1][k].max(v));
            }
        }
        if is_closed && places.len() > 1 && places.first() == places.last() {
            places.pop();
        }
        if places.len() < if is_closed { 3 } else { 2 } {
            return;
        }
        self.entity("LWPOLYLINE", layer, color);
        self.group(100, "AcDbPolyline");
        self.integer(90, places.len() as i64);
        self.integer(70, i64::from(is_closed));
        for [x, y] in &places {
            self.group(10, x);
            self.group(20, y);
        }
        if let Some(number) = object.and_then(|object| object.number) {
            self.group(1001, APPLICATION);
            self.integer(1071, i64::from(number));
            if let Some(identifier) = identifier.take() {
                self.group(1000, &dxf_text(identifier));
            }
        }
    }

    /// Fills a convex polygon by solids, of which each has the corners of a triangle or, crosswise, of two.
    fn solids(&mut self, points: &[[f64; 2]], color: Rgb) {
        let Some(first) = points.first() else { return };
        for k in (1..points.len().saturating_sub(1)).step_by(2) {
            let (second, third) = (points[k], points[k + 1]);
            let last = points.get(k + 2).copied().unwrap_or(third);
            self.entity("SOLID", "SHEET", 7);
            self.integer(62, i64::from(nearest_index(color)));
            self.group(100, "AcDbTrace");
            // The corners of a solid go along one side, then along the opposite one.
            for (k, [x, y]) in (0..).zip([*first, second, last, third]) {
                for (code, v) in [(10 + k, x), (20 + k, y), (30 + k, 0.0)] {
                    self.number(code, v);
                }
            }
        }
    }

    fn text(&mut self, mm: [f64; 2], size_mm: f64, alignment: i64, text: &str) {
        let ([x, y], size) = (self.place(mm), self.length(size_mm));
        self.entity("TEXT", "SHEET", 7);
        self.group(100, "AcDbText");
        for (code, v) in [(10, x), (20, y), (30, 0.0), (40, size)] {
            self.number(code, v);
        }
        self.group(1, &dxf_text(text));
        if alignment != 0 {
            self.integer(72, alignment);
            for (code, v) in [(11, x), (21, y), (31, 0.0)] {
                self.number(code, v);
            }
        }
        self.group(100, "AcDbText");
    }

    fn sheet_item(&mut self, item: &SheetItem) {
        match item {
            SheetItem::Line { points, .. } => self.polyline("SHEET", 7, points, false, (None, &mut None)),
            SheetItem::Swatch { points, color } => self.solids(points, *color),
            SheetItem::Area { points } => self.polyline("SHEET", 7, points, true, (None, &mut None)),
            SheetItem::Text { at, size_mm, anchor, text } => {
                let alignment = match anchor {
                    TextAnchor::Start => 0,
                    TextAnchor::Middle => 1,
                    TextAnchor::End => 2,
                };
                self.text(*at, *size_mm, alignment, text);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        convex::PagePoint,
        drawing::{DrawingCounts, DrawnLine},
        view::{MetreFrame, PaperGrid, PaperRect},
    };

    /// A house with a light and a dark half, its border and a crease, at 1:1000.
    fn drawing(metres: Option<MetreFrame>) -> Drawing {
        let grid = PaperGrid::new([100.0, 100.0]);
        let at = |x: f64, y: f64| grid.point(glam::DVec2::new(x, y));
        let half = |x: f64| vec![at(x, 10.0), at(x + 10.0, 10.0), at(x + 10.0, 20.0), at(x, 20.0)];
        let shape = |x: f64, role| DrawnShape { role, color: [240; 3], opacity: 1.0, rings: vec![half(x)] };
        let line = |class, chain: Vec<PagePoint>| DrawnLine { class, width_mm: 0.1, chains: vec![chain] };
        let house = DrawnObject {
            number: Some(7),
            kind: FeatureKind::BuildingPart,
            identifier: "NL.7\u{df}".to_owned(),
            shapes: vec![
                shape(10.0, ShapeRole::Surface),
                shape(20.0, ShapeRole::Surface),
                shape(30.0, ShapeRole::Shadow),
            ],
            lines: vec![
                line(LineRole::Border, half(10.0)),
                line(LineRole::Crease, vec![at(20.0, 10.0), at(20.0, 20.0)]),
            ],
        };
        Drawing {
            grid,
            frame: PaperRect { min: [0.0; 2], max: [100.0; 2] },
            metres,
            title: "Delft".to_owned(),
            attribution: "3DBAG, CC BY 4.0".to_owned(),
            is_exact: false,
            is_lit: true,
            paper: [255; 3],
            ink: [0; 3],
            objects: vec![house],
            sheet: vec![SheetItem::Text { at: [5.0, 5.0], size_mm: 2.0, anchor: TextAnchor::Middle, text: "N".into() }],
            counts: DrawingCounts::default(),
            largest_overlap: None,
        }
    }

    /// Pairs of codes and values.
    fn pairs(dxf: &str) -> Vec<(u32, &str)> {
        let lines: Vec<&str> = dxf.lines().collect();
        lines.chunks(2).map(|pair| (pair[0].parse().unwrap(), pair[1])).collect()
    }

    fn values<'a>(pairs: &[(u32, &'a str)], code: u32) -> Vec<&'a str> {
        pairs.iter().filter(|(known, _)| *known == code).map(|(_, value)| *value).collect()
    }

    #[test]
    fn a_plan_is_closed_polylines_in_metres_of_the_city() {
        let dxf = to_dxf(&drawing(Some(MetreFrame { per_mm: 1.0, at_zero: [84_500.0, -12.0] })));
        let all = pairs(&dxf);
        let kinds = values(&all, 0);
        assert_eq!(kinds.iter().filter(|kind| **kind == "LWPOLYLINE").count(), 3);
        assert_eq!(kinds.iter().filter(|kind| **kind == "TEXT").count(), 2);
        let begin = all.iter().position(|pair| *pair == (0, "LWPOLYLINE")).unwrap();
        let entities = &all[begin..];
        assert_eq!(values(entities, 8)[..3], ["BUILDING_PART", "BUILDING_PART", "SHADOW_BUILDING_PART"]);
        assert_eq!(values(entities, 10)[..4], ["84510", "84520", "84520", "84510"]);
        assert_eq!(values(entities, 20)[..4], ["-2", "-2", "8", "8"]);
        assert_eq!(values(entities, 70), ["1"; 3]);
        assert_eq!((values(entities, 1071), values(entities, 1000)), (vec!["7"; 3], vec!["NL.7\\U+00DF"]));
        assert_eq!(values(entities, 1), ["Delft", "3DBAG, CC BY 4.0"]);
        assert!(all.contains(&(1, "AC1015")) && all.contains(&(70, "6")) && !dxf.contains("-0\n"));
    }

    #[test]
    fn handles_are_all_different_and_below_the_seed() {
        for metres in [None, Some(MetreFrame { per_mm: 1.0, at_zero: [0.0; 2] })] {
            let dxf = to_dxf(&drawing(metres));
            let all = pairs(&dxf);
            let at = all.iter().position(|pair| *pair == (9, "$HANDSEED")).unwrap();
            let hex = |text: &str| u32::from_str_radix(text, 16).unwrap();
            let seed = hex(all[at + 1].1);
            let mut handles: Vec<u32> =
                all[at + 2..].iter().filter(|(code, _)| [5, 105].contains(code)).map(|(_, text)| hex(text)).collect();
            let count = handles.len();
            handles.sort_unstable();
            handles.dedup();
            assert!(handles.len() == count && handles.iter().all(|handle| *handle < seed), "{handles:?} {seed}");
        }
    }

    #[test]
    fn a_sheet_is_in_millimetres_with_its_texts() {
        let dxf = to_dxf(&drawing(None));
        let all = pairs(&dxf);
        assert_eq!(values(&all, 1)[1..], ["", "", "N"]);
        assert!(values(&all, 10).contains(&"10") && all.contains(&(70, "4")));
    }

    #[test]
    fn lines_within_surfaces_of_one_colour_are_drawn() {
        let dxf = to_dxf(&Drawing { is_lit: false, ..drawing(None) });
        assert!(dxf.contains("LINE_CREASE") && !dxf.contains("LINE_BORDER"));
    }

    #[test]
    fn texts_are_ascii() {
        assert_eq!(dxf_text("30\u{b0}\n\u{6771}"), "30\\U+00B0 \\U+6771");
        assert!(dxf_text(&"x".repeat(1000)).len() <= MAX_TEXT);
        assert_eq!(line_layer(LineRole::Crease), "LINE_CREASE");
    }
}
