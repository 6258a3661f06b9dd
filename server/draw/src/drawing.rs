//! A finished drawing, which the writers of files put on paper.

use crate::{
    convex::PagePoint,
    join::{Rings, unions},
    lines::LineRole,
    style::Rgb,
    view::{MetreFrame, PaperGrid, PaperRect},
};
use insula_export::rings::twice_area;
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
    pub counts: DrawingCounts,
    /// The largest area that two visible parts share, as a share of the page; `None` if it was not asked for.
    pub largest_overlap: Option<f64>,
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

/// How much work a drawing was.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct DrawingCounts {
    /// Triangles that were read.
    pub read: usize,
    /// Triangles of the scene, with terrain as the view needs it.
    pub triangles: usize,
    /// Those in the view that face the eye.
    pub facing: usize,
    /// Faces after the splits of the BSP tree.
    pub sorted: usize,
    /// Visible parts before they are joined.
    pub parts: usize,
    /// Leaves and other nodes without a mesh, which are drawn from their columns.
    pub without_mesh: u64,
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
    /// A shadow on a surface.
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
    /// The area in which opaque shapes overlap, as a share of the page: what they have together beyond their union. Joins all shapes,
    /// which takes as long as drawing them.
    #[must_use]
    pub fn overlap(&self) -> f64 {
        let opaque = |shape: &&DrawnShape| shape.role == ShapeRole::Surface && shape.opacity >= 1.0;
        let shapes = self.objects.iter().flat_map(|object| object.shapes.iter().filter(opaque));
        let all: Rings = shapes.flat_map(|shape| shape.rings.iter().cloned()).collect();
        let area = |rings: &Rings| rings.iter().map(|ring| i128::from(twice_area(ring))).sum::<i128>();
        let union = unions(vec![all.clone()], &|_, _| true).unwrap_or_default();
        let beyond = area(&all) - union.iter().map(area).sum::<i128>();
        let page: f64 = self.grid.size_mm.iter().map(|side| side * self.grid.units_per_mm).product();
        0.5 * beyond as f64 / page
    }

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
