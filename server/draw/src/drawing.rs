//! A finished drawing, which the writers of files put on paper.

use crate::convex::PagePoint;
use crate::join::Rings;
use crate::lines::LineRole;
use crate::style::Rgb;
use crate::view::{MetreFrame, PaperGrid, PaperRect};
use insula_objects::FeatureKind;

/// Shapes and lines on a sheet of paper.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawing {
    pub grid: PaperGrid,
    /// Where the city is.
    pub frame: PaperRect,
    /// How the paper lies in the city, for formats that draw in metres; `None` for a sheet, and for a perspective.
    pub metres: Option<MetreFrame>,
    /// The largest round scale, one to this, at which all is on the paper; `None` if it is.
    pub fitting_scale: Option<f64>,
    pub title: String,
    /// Who must be named wherever the drawing is shown; empty if nobody.
    pub attribution: String,
    /// Whether each pixel of a picture shall have one colour of a shape, and no mixture.
    pub is_exact: bool,
    pub paper: Rgb,
    pub ink: Rgb,
    /// By kind, and by number within a kind.
    pub objects: Vec<DrawnObject>,
    /// A picture of the map over surfaces and under lines, of formats that have pictures: PDF.
    pub picture: Option<MapPicture>,
    /// Parts of the sheet around the drawing.
    pub sheet: Vec<SheetItem>,
    /// Leaves and other nodes without a mesh, which are drawn from their columns.
    pub without_mesh: u64,
}

/// A picture whose sides are those of a rectangle of the paper.
#[derive(Debug, Clone, PartialEq)]
pub struct MapPicture {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Row by row from the north.
    pub rgb: Vec<[u8; 3]>,
    /// How opaque each pixel is.
    pub opacity: Vec<u8>,
    /// Millimetres of the paper.
    pub place: PaperRect,
}

/// The visible shapes and lines of an object.
#[derive(Debug, Clone, PartialEq)]
pub struct DrawnObject {
    /// `None` for what belongs to no object.
    pub number: Option<u32>,
    pub kind: FeatureKind,
    /// Of the source; may be empty.
    pub identifier: String,
    pub shapes: Vec<DrawnShape>,
    pub lines: Vec<DrawnLine>,
}

/// A filled shape. It overlaps no other opaque shape.
#[derive(Debug, Clone, PartialEq)]
pub struct DrawnShape {
    pub role: ShapeRole,
    pub color: Rgb,
    pub opacity: f64,
    /// Translucent shapes are painted over all others, in this order: from the farthest to the nearest. 0 for other shapes.
    pub order: u32,
    /// Outer rings and holes, filled by the rule "nonzero".
    pub(crate) rings: Rings,
}

/// Whether a shape is a surface or a shadow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ShapeRole {
    Surface,
    Shadow,
}

/// Lines of one class.
#[derive(Debug, Clone, PartialEq)]
pub struct DrawnLine {
    pub class: LineRole,
    pub width_mm: f64,
    pub(crate) chains: Vec<Vec<PagePoint>>,
}

impl Drawing {
    /// Objects and their translucent shapes in the order in which these are painted; those of one object that follow each other are
    /// together.
    pub(crate) fn translucent(&self) -> Vec<(&DrawnObject, Vec<&DrawnShape>)> {
        let mut shapes: Vec<(&DrawnObject, &DrawnShape)> = Vec::new();
        for object in &self.objects {
            let all = object.shapes.iter().filter(|shape| shape.role == ShapeRole::Surface && shape.opacity < 1.0);
            shapes.extend(all.map(|shape| (object, shape)));
        }
        shapes.sort_by_key(|(_, shape)| shape.order);
        let objects = shapes.chunk_by(|a, b| std::ptr::eq(a.0, b.0));
        objects.map(|shapes| (shapes[0].0, shapes.iter().map(|(_, shape)| *shape).collect())).collect()
    }

    /// The rings of a shape in millimetres from the lower left corner of the paper.
    pub fn rings<'a>(&'a self, shape: &'a DrawnShape) -> impl Iterator<Item = Vec<[f64; 2]>> + 'a {
        shape.rings.iter().map(|ring| ring.iter().map(|point| self.grid.mm(*point)).collect())
    }

    /// The chains of lines in millimetres from the lower left corner of the paper.
    pub fn chains<'a>(&'a self, line: &'a DrawnLine) -> impl Iterator<Item = Vec<[f64; 2]>> + 'a {
        line.chains.iter().map(|chain| chain.iter().map(|point| self.grid.mm(*point)).collect())
    }
}

/// A part of the sheet; millimetres from the lower left corner.
#[derive(Debug, Clone, PartialEq)]
pub enum SheetItem {
    Text {
        at: [f64; 2],
        size_mm: f64,
        anchor: TextAnchor,
        text: String,
    },
    Line {
        points: Vec<[f64; 2]>,
        width_mm: f64,
    },
    Area {
        points: Vec<[f64; 2]>,
    },
    /// An area of a colour.
    Swatch {
        points: Vec<[f64; 2]>,
        color: Rgb,
    },
}

/// Which end of a text is at its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TextAnchor {
    Start,
    Middle,
    End,
}
