//! Drawings as SVG. Coordinates are whole micrometres.

use crate::drawing::{Drawing, DrawnObject, DrawnShape, ShapeRole, SheetItem, TextAnchor};
use crate::lines::LineRole;
use crate::style::{color_text, kind_name};
use std::collections::BTreeMap;
use std::fmt::Write;

const UM_PER_MM: f64 = 1000.0;

/// The drawing as the text of an SVG file.
#[must_use]
pub fn to_svg(drawing: &Drawing) -> String {
    let [width, height] = drawing.grid.size_mm;
    let mut out = String::new();
    let mut text = Svg { drawing, out: &mut out };
    text.push(format_args!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}mm\" height=\"{height}mm\" viewBox=\"0 0 {} {}\">\n",
        um(width),
        um(height)
    ));
    text.push(format_args!("<title>{}</title>\n", escaped(&drawing.title)));
    text.push(format_args!("<rect width=\"100%\" height=\"100%\" fill=\"{}\"/>\n", color_text(drawing.paper)));
    text.clip();
    text.push(format_args!(
        "<g id=\"surfaces\" clip-path=\"url(#frame)\"{}>\n",
        if drawing.is_exact { " shape-rendering=\"crispEdges\"" } else { "" }
    ));
    text.layers(|shape| shape.role == ShapeRole::Surface && shape.opacity >= 1.0, "");
    text.layers(|shape| shape.role == ShapeRole::Shadow, "shadow-");
    text.translucent();
    text.push(format_args!("</g>\n"));
    text.lines();
    text.sheet();
    text.push(format_args!("</svg>\n"));
    out
}

fn um(mm: f64) -> i64 {
    (mm * UM_PER_MM).round() as i64
}

/// Text of XML. Characters that XML does not have are left out.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\t' | '\n' | ' '.. if !matches!(c, '\u{fffe}' | '\u{ffff}') => out.push(c),
            _ => {}
        }
    }
    out
}

struct Svg<'a> {
    drawing: &'a Drawing,
    out: &'a mut String,
}

impl Svg<'_> {
    fn push(&mut self, text: std::fmt::Arguments<'_>) {
        // Writing into a string cannot fail.
        let _ = self.out.write_fmt(text);
    }

    /// Micrometres from the upper left corner.
    fn point(&self, [x, y]: [f64; 2]) -> [i64; 2] {
        [um(x), um(self.drawing.grid.size_mm[1] - y)]
    }

    fn clip(&mut self) {
        let frame = self.drawing.frame;
        let ([x, y], [width, height]) = (self.point([frame.min[0], frame.max[1]]), frame.size().map(um));
        self.push(format_args!(
            "<clipPath id=\"frame\"><rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\"/></clipPath>\n"
        ));
    }

    /// Path data: absolute starts, then relative steps.
    fn path(&mut self, points: &[[f64; 2]], is_closed: bool) {
        let mut last: Option<[i64; 2]> = None;
        for point in points {
            let at = self.point(*point);
            match last {
                None => self.push(format_args!("M{} {}", at[0], at[1])),
                Some(before) if before == at => continue,
                Some(before) => {
                    let [dx, dy] = [at[0] - before[0], at[1] - before[1]];
                    let space = if dy < 0 { "" } else { " " };
                    self.push(format_args!("l{dx}{space}{dy}"));
                }
            }
            last = Some(at);
        }
        if is_closed {
            self.push(format_args!("z"));
        }
    }

    /// A group for each kind with a group for each object, of the shapes that `is_in` a layer.
    fn layers(&mut self, is_in: impl Fn(&DrawnShape) -> bool, prefix: &str) {
        let drawing = self.drawing;
        for objects in drawing.objects.chunk_by(|a, b| a.kind == b.kind) {
            let mut is_open = false;
            for object in objects {
                let shapes: Vec<&DrawnShape> = object.shapes.iter().filter(|shape| is_in(shape)).collect();
                if shapes.is_empty() {
                    continue;
                }
                if !is_open {
                    self.push(format_args!("<g id=\"{prefix}{}\">\n", kind_name(object.kind)));
                    is_open = true;
                }
                self.object(object, prefix, "");
                self.shapes(&shapes);
                self.push(format_args!("</g>\n"));
            }
            if is_open {
                self.push(format_args!("</g>\n"));
            }
        }
    }

    /// Translucent shapes in the order in which they are painted. An object whose shapes have others between them has several groups.
    fn translucent(&mut self) {
        let mut groups: BTreeMap<Option<u32>, u32> = BTreeMap::new();
        for (object, shapes) in self.drawing.translucent() {
            let group = groups.entry(object.number).or_default();
            *group += 1;
            let suffix = if *group > 1 { format!("-{group}") } else { String::new() };
            self.object(object, "translucent-", &suffix);
            self.shapes(&shapes);
            self.push(format_args!("</g>\n"));
        }
    }

    fn shapes(&mut self, shapes: &[&DrawnShape]) {
        let drawing = self.drawing;
        for shape in shapes {
            let color = color_text(shape.color);
            self.push(format_args!("<path fill=\"{color}\""));
            if shape.opacity < 1.0 {
                self.push(format_args!(" fill-opacity=\"{:.3}\"", shape.opacity));
            }
            self.push(format_args!(" d=\""));
            for ring in drawing.rings(shape) {
                self.path(&ring, true);
            }
            self.push(format_args!("\"/>"));
        }
    }

    fn object(&mut self, object: &DrawnObject, prefix: &str, suffix: &str) {
        match object.number {
            Some(number) => self.push(format_args!("<g id=\"{prefix}object-{number}{suffix}\"")),
            None => self.push(format_args!("<g id=\"{prefix}land{suffix}\"")),
        }
        if !object.identifier.is_empty() {
            self.push(format_args!(" data-identifier=\"{}\"", escaped(&object.identifier)));
        }
        self.push(format_args!(">"));
    }

    fn lines(&mut self) {
        let drawing = self.drawing;
        let ink = color_text(drawing.ink);
        self.push(format_args!(
            "<g id=\"lines\" clip-path=\"url(#frame)\" fill=\"none\" stroke=\"{ink}\" stroke-linecap=\"round\" stroke-linejoin=\"round\">\n"
        ));
        for (name, class) in LineRole::NAMES {
            self.push(format_args!("<g id=\"{name}\">\n"));
            for object in &drawing.objects {
                for line in object.lines.iter().filter(|line| line.class == class) {
                    let width = um(line.width_mm);
                    match object.number {
                        Some(number) => {
                            self.push(format_args!("<path id=\"{name}-{number}\" stroke-width=\"{width}\" d=\""));
                        }
                        None => self.push(format_args!("<path stroke-width=\"{width}\" d=\"")),
                    }
                    for chain in drawing.chains(line) {
                        self.path(&chain, false);
                    }
                    self.push(format_args!("\"/>\n"));
                }
            }
            self.push(format_args!("</g>\n"));
        }
        self.push(format_args!("</g>\n"));
    }

    fn sheet(&mut self) {
        let drawing = self.drawing;
        let ink = color_text(drawing.ink);
        self.push(format_args!("<g id=\"sheet\" fill=\"{ink}\" font-family=\"Helvetica, Arial, sans-serif\">\n"));
        for item in &drawing.sheet {
            match item {
                SheetItem::Text { at, size_mm, anchor, text } => {
                    let [x, y] = self.point(*at);
                    let anchor = match anchor {
                        TextAnchor::Start => "start",
                        TextAnchor::Middle => "middle",
                        TextAnchor::End => "end",
                    };
                    self.push(format_args!(
                        "<text x=\"{x}\" y=\"{y}\" font-size=\"{}\" text-anchor=\"{anchor}\">{}</text>\n",
                        um(*size_mm),
                        escaped(text)
                    ));
                }
                SheetItem::Line { points, width_mm } => {
                    self.push(format_args!(
                        "<path fill=\"none\" stroke=\"{ink}\" stroke-width=\"{}\" d=\"",
                        um(*width_mm)
                    ));
                    self.path(points, false);
                    self.push(format_args!("\"/>\n"));
                }
                SheetItem::Swatch { points, color } => {
                    self.push(format_args!("<path fill=\"{}\" d=\"", color_text(*color)));
                    self.path(points, true);
                    self.push(format_args!("\"/>\n"));
                }
                SheetItem::Area { points } => {
                    self.push(format_args!("<path d=\""));
                    self.path(points, true);
                    self.push(format_args!("\"/>\n"));
                }
            }
        }
        self.push(format_args!("</g>\n"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_escaped() {
        assert_eq!(escaped("a<b>&\"c\"\u{0}\u{7}é"), "a&lt;b&gt;&amp;&quot;c&quot;é");
    }
}
