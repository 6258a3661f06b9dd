//! Drawings as PDF of one page, with a layer for each kind of content and the number of each object as marked content.

mod text;

use crate::drawing::{Drawing, DrawnObject, DrawnShape, MapPicture, ShapeRole, SheetItem, TextAnchor};
use crate::lines::LineRole;
use crate::style::Rgb;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use pdf_writer::types::{LineCapStyle, LineJoinStyle};
use pdf_writer::{Content, Filter, Finish, Name, Pdf, Rect, Ref, Str, TextStr};
use std::io::Write;
pub use text::PdfLetters;
use text::TextFonts;

const PT_PER_MM: f64 = 72.0 / 25.4;
/// Layers in the order in which they are drawn.
const LAYERS: [&str; 9] = [
    "surfaces", "shadows", "translucent surfaces", "hatching", "creases", "intersections", "borders", "silhouettes",
    "sheet",
];
/// Classes of lines by their layer, from that of hatching on.
const LINES: [LineRole; 5] =
    [LineRole::Hatch, LineRole::Crease, LineRole::Intersection, LineRole::Border, LineRole::Silhouette];
const FIRST_LINES: usize = 3;
/// The layer of a picture, which few drawings have.
const PICTURE_LAYER: &str = "values";
/// Opacities are rounded to this many steps, each of which is a graphics state.
const OPACITY_STEPS: u8 = 100;

/// Names of objects in the file.
const CATALOG: Ref = Ref::new(1);
const PAGES: Ref = Ref::new(2);
const PAGE: Ref = Ref::new(3);
const CONTENT: Ref = Ref::new(4);
const FONT: Ref = Ref::new(5);
const INFO: Ref = Ref::new(6);
const PICTURE: Ref = Ref::new(7);
const PICTURE_OPACITY: Ref = Ref::new(8);
const FIRST_LAYER: i32 = 10;
const FIRST_STATE: i32 = 100;

/// Letters that the drawing as a PDF file does not have.
#[must_use]
pub fn pdf_letters(drawing: &Drawing) -> PdfLetters {
    text::letters_of(texts_of(drawing))
}

fn texts_of(drawing: &Drawing) -> impl Iterator<Item = &str> + Clone {
    drawing
        .sheet
        .iter()
        .filter_map(|item| if let SheetItem::Text { text, .. } = item { Some(text.as_str()) } else { None })
}

pub(crate) fn to_pdf(drawing: &Drawing) -> Vec<u8> {
    let mut pdf = Pdf::new();
    let fonts = TextFonts::of(texts_of(drawing));
    let picture = drawing.picture.as_ref();
    let names = || LAYERS.into_iter().chain(picture.map(|_| PICTURE_LAYER));
    let layers = || (0..names().count()).map(|k| Ref::new(FIRST_LAYER + k as i32));
    let mut catalog = pdf.catalog(CATALOG);
    catalog.pages(PAGES);
    let mut properties = catalog.insert(Name(b"OCProperties")).dict();
    properties.insert(Name(b"OCGs")).array().items(layers());
    properties.insert(Name(b"D")).dict().insert(Name(b"Order")).array().items(layers());
    properties.finish();
    catalog.finish();
    for (k, name) in names().enumerate() {
        let mut layer = pdf.indirect(Ref::new(FIRST_LAYER + k as i32)).dict();
        layer.pair(Name(b"Type"), Name(b"OCG")).pair(Name(b"Name"), TextStr(name));
    }
    pdf.pages(PAGES).kids([PAGE]).count(1);
    let mut page = pdf.page(PAGE);
    let [width, height] = drawing.grid.size_mm.map(pt);
    page.media_box(Rect::new(0.0, 0.0, width, height)).parent(PAGES).contents(CONTENT);
    let mut resources = page.resources();
    resources.fonts().pair(Name(b"F"), FONT).pairs(fonts.others());
    let mut states = resources.ext_g_states();
    for step in 0..=OPACITY_STEPS {
        states.pair(Name(state_name(step).as_bytes()), Ref::new(FIRST_STATE + i32::from(step)));
    }
    states.finish();
    if picture.is_some() {
        resources.x_objects().pair(Name(b"P"), PICTURE);
    }
    let mut named = resources.insert(Name(b"Properties")).dict();
    for (k, layer) in layers().enumerate() {
        named.pair(Name(format!("L{k}").as_bytes()), layer);
    }
    named.finish();
    resources.finish();
    page.finish();
    for step in 0..=OPACITY_STEPS {
        let share = f32::from(step) / f32::from(OPACITY_STEPS);
        pdf.ext_graphics(Ref::new(FIRST_STATE + i32::from(step))).non_stroking_alpha(share);
    }
    pdf.type1_font(FONT).base_font(Name(b"Helvetica")).encoding_predefined(Name(b"WinAnsiEncoding"));
    fonts.add_to(&mut pdf);
    pdf.document_info(INFO).title(TextStr(&drawing.title)).producer(TextStr("Insula"));
    let content = PageContent { drawing, fonts, content: Content::new() }.finish();
    match packed(&content) {
        Some(packed) => {
            pdf.stream(CONTENT, &packed).filter(Filter::FlateDecode);
        }
        // Without compression the page is the same.
        None => {
            pdf.stream(CONTENT, &content);
        }
    }
    if let Some(picture) = picture {
        add_picture(&mut pdf, picture);
    }
    pdf.finish()
}

/// Compressed bytes; `None` if that fails, which memory does not.
fn packed(bytes: &[u8]) -> Option<Vec<u8>> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).and_then(|()| encoder.finish()).ok()
}

fn add_picture(pdf: &mut Pdf, picture: &MapPicture) {
    let mut add = |place: Ref, bytes: &[u8], is_color: bool| {
        let packed = packed(bytes);
        let mut image = pdf.image_xobject(place, packed.as_deref().unwrap_or(bytes));
        if packed.is_some() {
            image.filter(Filter::FlateDecode);
        }
        let [width, height] = picture.size.map(|side| side as i32);
        image.width(width).height(height).bits_per_component(8).interpolate(false);
        if is_color {
            image.color_space().device_rgb();
            image.s_mask(PICTURE_OPACITY);
        } else {
            image.color_space().device_gray();
        }
    };
    add(PICTURE, picture.rgb.as_flattened(), true);
    add(PICTURE_OPACITY, &picture.opacity, false);
}

fn pt(mm: f64) -> f32 {
    // Without the sign of zero.
    (mm * PT_PER_MM) as f32 + 0.0
}

fn state_name(step: u8) -> String {
    format!("A{step}")
}

struct PageContent<'a> {
    drawing: &'a Drawing,
    fonts: TextFonts,
    content: Content,
}

impl PageContent<'_> {
    fn finish(mut self) -> Vec<u8> {
        let drawing = self.drawing;
        let [width, height] = drawing.grid.size_mm.map(pt);
        self.fill_color(drawing.paper);
        self.content.rect(0.0, 0.0, width, height).fill_nonzero();
        self.content.save_state();
        let frame = drawing.frame;
        let size = frame.size().map(pt);
        self.content.rect(pt(frame.min[0]), pt(frame.min[1]), size[0], size[1]).clip_nonzero().end_path();
        self.shapes(0, |shape| shape.role == ShapeRole::Surface && shape.opacity >= 1.0);
        self.shapes(1, |shape| shape.role == ShapeRole::Shadow);
        self.begin(2);
        for (object, shapes) in drawing.translucent() {
            self.object(object, &shapes);
        }
        self.content.end_marked_content();
        self.picture();
        self.content.set_line_cap(LineCapStyle::RoundCap).set_line_join(LineJoinStyle::RoundJoin);
        let [r, g, b] = drawing.ink.map(share);
        self.content.set_stroke_rgb(r, g, b);
        for (k, class) in LINES.into_iter().enumerate() {
            self.lines(FIRST_LINES + k, class);
        }
        self.content.restore_state();
        self.sheet();
        self.content.finish().to_vec()
    }

    fn picture(&mut self) {
        let Some(picture) = &self.drawing.picture else { return };
        self.begin(LAYERS.len());
        self.content.save_state().set_parameters(Name(state_name(OPACITY_STEPS).as_bytes()));
        let ([x, y], [width, height]) = (picture.place.min.map(pt), picture.place.size().map(pt));
        self.content.transform([width, 0.0, 0.0, height, x, y]).x_object(Name(b"P")).restore_state();
        self.content.end_marked_content();
    }

    fn fill_color(&mut self, color: Rgb) {
        let [r, g, b] = color.map(share);
        self.content.set_fill_rgb(r, g, b);
    }

    fn begin(&mut self, layer: usize) {
        let name = format!("L{layer}");
        self.content.begin_marked_content_with_properties(Name(b"OC")).properties_named(Name(name.as_bytes()));
    }

    fn begin_object(&mut self, number: Option<u32>) {
        let mut marked = self.content.begin_marked_content_with_properties(Name(b"Object"));
        let id = number.map_or_else(|| "land".to_owned(), |number| format!("object-{number}"));
        marked.properties().pair(Name(b"Id"), Str(id.as_bytes()));
    }

    fn path(&mut self, points: &[[f64; 2]], is_closed: bool) {
        for (k, [x, y]) in points.iter().enumerate() {
            if k == 0 {
                self.content.move_to(pt(*x), pt(*y));
            } else {
                self.content.line_to(pt(*x), pt(*y));
            }
        }
        if is_closed {
            self.content.close_path();
        }
    }

    fn shapes(&mut self, layer: usize, is_in: impl Fn(&DrawnShape) -> bool) {
        let drawing = self.drawing;
        self.begin(layer);
        for object in &drawing.objects {
            let shapes: Vec<&DrawnShape> = object.shapes.iter().filter(|shape| is_in(shape)).collect();
            if !shapes.is_empty() {
                self.object(object, &shapes);
            }
        }
        self.content.end_marked_content();
    }

    fn object(&mut self, object: &DrawnObject, shapes: &[&DrawnShape]) {
        let drawing = self.drawing;
        self.begin_object(object.number);
        for shape in shapes {
            self.fill_color(shape.color);
            let step = (shape.opacity.clamp(0.0, 1.0) * f64::from(OPACITY_STEPS)).round() as u8;
            self.content.set_parameters(Name(state_name(step).as_bytes()));
            for ring in drawing.rings(shape) {
                self.path(&ring, true);
            }
            self.content.fill_nonzero();
        }
        self.content.end_marked_content();
    }

    fn lines(&mut self, layer: usize, class: LineRole) {
        let drawing = self.drawing;
        self.begin(layer);
        for object in &drawing.objects {
            for line in object.lines.iter().filter(|line| line.class == class) {
                self.begin_object(object.number);
                self.content.set_line_width(pt(line.width_mm));
                for chain in drawing.chains(line) {
                    self.path(&chain, false);
                }
                self.content.stroke();
                self.content.end_marked_content();
            }
        }
        self.content.end_marked_content();
    }

    fn sheet(&mut self) {
        let drawing = self.drawing;
        self.begin(LAYERS.len() - 1);
        let [r, g, b] = drawing.ink.map(share);
        self.content.set_fill_rgb(r, g, b).set_stroke_rgb(r, g, b);
        for item in &drawing.sheet {
            match item {
                SheetItem::Line { points, width_mm } => {
                    self.content.set_line_width(pt(*width_mm));
                    self.path(points, false);
                    self.content.stroke();
                }
                SheetItem::Swatch { points, color } => {
                    let [red, green, blue] = color.map(share);
                    self.content.save_state().set_fill_rgb(red, green, blue);
                    self.path(points, true);
                    self.content.fill_nonzero().restore_state();
                }
                SheetItem::Area { points } => {
                    self.path(points, true);
                    self.content.fill_nonzero();
                }
                SheetItem::Text { at: [x, y], size_mm, anchor, text } => {
                    let part = match anchor {
                        TextAnchor::Start => 0.0,
                        TextAnchor::Middle => 0.5,
                        TextAnchor::End => 1.0,
                    };
                    let x = x - part * size_mm * self.fonts.width(text);
                    self.fonts.show(&mut self.content, [x, *y], *size_mm, text);
                }
            }
        }
        self.content.end_marked_content();
    }
}

fn share(v: u8) -> f32 {
    f32::from(v) / 255.0
}
