//! Pictures of values over the surfaces of a plan.

use crate::drawing::{Drawing, MapPicture, SheetItem};
use crate::legend::{legend_items, note_items};
use crate::view::PaperRect;
use insula_objects::Legend;

/// Values as colours.
#[derive(Debug, Clone)]
pub struct ValuePicture {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Colours and opacities, row by row from the north.
    pub pixels: Vec<([u8; 3], u8)>,
    /// Lower and upper corner in metres of the city's coordinate system.
    pub area: [[f64; 2]; 2],
}

/// Width of the borders of places in millimetres.
const BORDER_MM: f64 = 0.5;

/// Draws closed rings in metres of the city's coordinate system over a plan. Drawings that are no plan stay as they are.
pub fn outline(drawing: &mut Drawing, rings: &[Vec<[f64; 2]>]) {
    let Some(metres) = drawing.metres else { return };
    let line = |ring: &Vec<[f64; 2]>| SheetItem::Line {
        points: ring.iter().map(|place| [0, 1].map(|k| (place[k] - metres.at_zero[k]) / metres.per_mm)).collect(),
        width_mm: BORDER_MM,
    };
    drawing.sheet.extend(rings.iter().map(line));
}

/// Lays a picture over the surfaces of a plan, with a legend of its colours and lines of text. Of formats, PDF has pictures. Drawings that
/// are no plan stay as they are.
pub fn lay(drawing: &mut Drawing, picture: ValuePicture, legend: &Legend, notes: &[String]) {
    let Some(metres) = drawing.metres else { return };
    let mm = |place: [f64; 2]| [0, 1].map(|k| (place[k] - metres.at_zero[k]) / metres.per_mm);
    let place = PaperRect { min: mm(picture.area[0]), max: mm(picture.area[1]) };
    let (rgb, opacity) = picture.pixels.into_iter().unzip();
    drawing.picture = Some(MapPicture { size: picture.size, rgb, opacity, place });
    drawing.sheet.extend(legend_items(legend, &drawing.frame));
    drawing.sheet.extend(note_items(notes, &drawing.frame));
}
