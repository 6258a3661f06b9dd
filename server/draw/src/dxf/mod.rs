//! Drawings as DXF of release 2000 (AC1015). Visible surfaces are closed polylines. Layers are by kind and class.
//!
//! Coordinates are metres of the city's coordinate system, so that a plan lies where other plans of the place do; of views along other
//! axes they are metres along these from the city's origin. A sheet of paper, and a perspective, which has no scale, are in millimetres. The visible surfaces of an
//! object have one border together; lines within it follow by class, and no line is drawn twice. A map in metres has no lines where surfaces
//! of one object pass through each other. The number of an object is in the extended data of the application `INSULA`, and on its first polyline
//! its identifier, too.

mod colors;
mod sections;

use crate::drawing::{Drawing, DrawnLine, DrawnObject, ShapeRole, SheetItem, TextAnchor};
use crate::join::{Rings, unions};
use crate::lines::LineRole;
use crate::style::{Rgb, kind_name};
use crate::view::PaperGrid;
use colors::{color_index, nearest_index};
use insula_protocol::text::at_most;
use sections::{APPLICATION, FIRST_HANDLE, HANDSEED, MODEL_SPACE};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Longest text of a group in characters.
const MAX_TEXT: usize = 250;
/// Decimals of metres and of millimetres: what a survey knows, and what a plotter draws.
const METRE_DECIMALS: usize = 2;
const MILLIMETRE_DECIMALS: usize = 3;
/// Lines this near to the outline of their object are parts of it.
const ON_OUTLINE_MM: f64 = 0.02;
/// Most pairs of a line's part and a corner of the outline that are compared. Beyond, all lines are drawn.
const MAX_TESTS: usize = 50_000_000;
/// Height of texts on paper in millimetres.
const NOTE_MM: f64 = 2.5;

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

/// The border of all visible surfaces of each object.
fn outlines(drawing: &Drawing) -> Vec<Rings> {
    let surfaces = |object: &DrawnObject| -> Rings {
        let shapes = object.shapes.iter().filter(|shape| shape.role == ShapeRole::Surface);
        shapes.flat_map(|shape| shape.rings.iter().cloned()).collect()
    };
    let all: Vec<Rings> = drawing.objects.iter().map(surfaces).collect();
    // Nothing stops it.
    unions(all.clone(), &|_, _| true).unwrap_or(all)
}

/// The parts of lines that are not on the outline, which is drawn already, in millimetres.
fn inner_chains(line: &DrawnLine, outline: &Rings, grid: &PaperGrid) -> Vec<Vec<[f64; 2]>> {
    let corners: usize = outline.iter().map(Vec::len).sum();
    let segments: usize = line.chains.iter().map(Vec::len).sum();
    let is_tested = line.class != LineRole::Hatch && corners.saturating_mul(segments) <= MAX_TESTS;
    let mut chains: Vec<Vec<[f64; 2]>> = Vec::new();
    for chain in &line.chains {
        let chain: Vec<[f64; 2]> = chain.iter().map(|point| grid.mm(*point)).collect();
        let mut goes_on = false;
        for ends in chain.windows(2) {
            let middle = [0, 1].map(|k| 0.5 * (ends[0][k] + ends[1][k]));
            let is_inner = !is_tested || !is_on(outline, grid, middle);
            if is_inner && !goes_on {
                chains.push(vec![ends[0]]);
            }
            if let Some(last) = chains.last_mut().filter(|_| is_inner) {
                last.push(ends[1]);
            }
            goes_on = is_inner;
        }
    }
    chains
}

/// Whether a place, in millimetres, is on a ring.
fn is_on(rings: &Rings, grid: &PaperGrid, [x, y]: [f64; 2]) -> bool {
    rings.iter().any(|ring| {
        let mut before = ring.last().map_or([f64::NAN; 2], |point| grid.mm(*point));
        ring.iter().any(|point| {
            let ([x0, y0], [x1, y1]) = (before, grid.mm(*point));
            before = [x1, y1];
            let (dx, dy) = (x1 - x0, y1 - y0);
            let length2 = (dx * dx + dy * dy).max(f64::MIN_POSITIVE);
            let at = (((x - x0) * dx + (y - y0) * dy) / length2).clamp(0.0, 1.0);
            (x - x0 - at * dx).hypot(y - y0 - at * dy) <= ON_OUTLINE_MM
        })
    })
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
    layers: BTreeMap<String, u8>,
    /// Lowest and highest coordinates of the entities.
    extent: [[f64; 2]; 2],
}

impl<'a> Dxf<'a> {
    fn new(drawing: &'a Drawing, next_handle: u32) -> Self {
        let extent = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        Self { drawing, out: String::new(), next_handle, layers: BTreeMap::new(), extent }
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
        for (object, outline) in drawing.objects.iter().zip(outlines(drawing)) {
            let mut identifier = Some(object.identifier.as_str()).filter(|identifier| !identifier.is_empty());
            let surfaces = object.shapes.iter().find(|shape| shape.role == ShapeRole::Surface);
            let color = surfaces.map_or(7, |shape| color_index(shape.color));
            let layer = layer_name(kind_name(object.kind));
            for ring in &outline {
                let ring: Vec<[f64; 2]> = ring.iter().map(|point| drawing.grid.mm(*point)).collect();
                self.polyline((&layer, color), &ring, true, Some(object), &mut identifier);
            }
            for shape in object.shapes.iter().filter(|shape| shape.role == ShapeRole::Shadow) {
                for ring in drawing.rings(shape) {
                    self.polyline((&format!("SHADOW_{layer}"), 8), &ring, true, Some(object), &mut identifier);
                }
            }
            // Between objects, these are on the outlines.
            let is_drawn = |class| class != LineRole::Intersection || drawing.metres.is_none();
            for line in object.lines.iter().filter(|line| is_drawn(line.class)) {
                let layer = line_layer(line.class);
                for chain in inner_chains(line, &outline, &drawing.grid) {
                    self.polyline((&layer, 7), &chain, false, Some(object), &mut identifier);
                }
            }
        }
        if drawing.metres.is_some() {
            self.notes();
        } else {
            drawing.sheet.iter().for_each(|item| self.sheet_item(item));
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
        if !self.layers.contains_key(layer) {
            self.layers.insert(layer.to_owned(), color);
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
        (layer, color): (&str, u8),
        points: &[[f64; 2]],
        is_closed: bool,
        object: Option<&DrawnObject>,
        identifier: &mut Option<&str>,
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
        // Without this flag, it is open.
        if is_closed {
            self.integer(70, 1);
        }
        for [x, y] in &places {
            self.group(10, x);
            self.group(20, y);
        }
        // Lines within a surface are part of it.
        if let Some(number) = object.and_then(|object| object.number).filter(|_| is_closed) {
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
            SheetItem::Line { points, .. } => self.polyline(("SHEET", 7), points, false, None, &mut None),
            SheetItem::Swatch { points, color } => self.solids(points, *color),
            SheetItem::Area { points } => self.polyline(("SHEET", 7), points, true, None, &mut None),
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
    use crate::convex::PagePoint;
    use crate::drawing::DrawnShape;
    use crate::view::{MetreFrame, PaperRect};
    use insula_objects::FeatureKind;

    /// A house with a light and a dark half, its border and a crease, at 1:1000.
    fn drawing(metres: Option<MetreFrame>) -> Drawing {
        let grid = PaperGrid::new([100.0, 100.0]);
        let at = |x: f64, y: f64| grid.point(glam::DVec2::new(x, y));
        let half = |x: f64| vec![at(x, 10.0), at(x + 10.0, 10.0), at(x + 10.0, 20.0), at(x, 20.0)];
        let shape = |x: f64, role| DrawnShape { role, color: [240; 3], opacity: 1.0, order: 0, rings: vec![half(x)] };
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
                line(LineRole::Border, vec![at(10.0, 20.0), at(10.0, 10.0), at(20.0, 10.0)]),
                line(LineRole::Crease, vec![at(20.0, 10.0), at(20.0, 20.0)]),
                line(LineRole::Intersection, vec![at(15.0, 11.0), at(15.0, 19.0)]),
            ],
        };
        Drawing {
            grid,
            frame: PaperRect { min: [0.0; 2], max: [100.0; 2] },
            metres,
            fitting_scale: None,
            title: "Delft".to_owned(),
            attribution: "3DBAG, CC BY 4.0".to_owned(),
            is_exact: false,
            paper: [255; 3],
            ink: [0; 3],
            objects: vec![house],
            picture: None,
            sheet: vec![SheetItem::Text { at: [5.0, 5.0], size_mm: 2.0, anchor: TextAnchor::Middle, text: "N".into() }],
            without_mesh: 0,
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
        // The house, its shadow and the crease between its halves; its border is not drawn twice.
        assert_eq!(kinds.iter().filter(|kind| **kind == "LWPOLYLINE").count(), 3);
        assert_eq!(kinds.iter().filter(|kind| **kind == "TEXT").count(), 2);
        let begin = all.iter().position(|pair| *pair == (0, "LWPOLYLINE")).unwrap();
        let entities = &all[begin..];
        assert_eq!(values(entities, 8)[..3], ["BUILDING_PART", "SHADOW_BUILDING_PART", "LINE_CREASE"]);
        let mut corners: Vec<_> = values(entities, 10).into_iter().zip(values(entities, 20)).take(4).collect();
        corners.sort_unstable();
        assert_eq!(corners, [("84510", "-2"), ("84510", "8"), ("84530", "-2"), ("84530", "8")]);
        assert_eq!(values(entities, 70), ["1"; 2], "the crease is open");
        assert_eq!((values(entities, 1071), values(entities, 1000)), (vec!["7"; 2], vec!["NL.7\\U+00DF"]));
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
        assert!(dxf.contains("LINE_CREASE") && dxf.contains("LINE_INTERSECTION") && !dxf.contains("LINE_BORDER"));
        let all = pairs(&dxf);
        assert_eq!(values(&all, 1)[1..], ["", "", "N"]);
        assert!(values(&all, 10).contains(&"10") && all.contains(&(70, "4")));
    }

    #[test]
    fn texts_are_ascii() {
        assert_eq!(dxf_text("30\u{b0}\n\u{6771}"), "30\\U+00B0 \\U+6771");
        assert!(dxf_text(&"x".repeat(1000)).len() <= MAX_TEXT);
        assert_eq!(line_layer(LineRole::Crease), "LINE_CREASE");
    }
}
