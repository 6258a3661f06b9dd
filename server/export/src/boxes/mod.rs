//! Columns of a V-BlockMap as few boxes: neighbouring columns of about the same height and colour and of the same object become one.
//!
//! A V-BlockMap becomes a [`Geometry`] on a grid of whole cells and quarters of a cell in height. The steps, in order: `solids`
//! (what each column fills), `merge` (rectangles), `faces` (tops, and the sides that neighbours do not cover).

mod faces;
mod merge;
mod solids;
#[cfg(test)]
mod tests;

use crate::geometry::Geometry;
use crate::matrix::stretched;
use crate::source::SourceError;
use glam::DAffine3;
use insula_protocol::BlockMap;

/// Units of heights in a cell.
pub(crate) const QUARTERS: u16 = 4;
/// Most that a component of colours differs, in 8-bit sRGB, if one colour shall stand for them.
pub(crate) const COLOUR_RANGE: u8 = merge::COLOUR_RANGE;

/// How far the boxes of a node may lie from its columns, in cells: tops move by up to 3/8, and walls stand on borders of cells.
pub(crate) const ERROR_CELLS: f64 = 0.5;

/// The boxes of a node. `feature` gets an object and its column, and gives the object's row in the property table; `None` leaves the
/// object out, because it is not selected.
pub(crate) fn boxes(
    mut map: BlockMap,
    feature: &mut dyn FnMut(u32, usize) -> Result<Option<u32>, SourceError>,
) -> Result<Geometry, SourceError> {
    // Generated ground has no objects, and the parts that it adds had none before.
    let objects = map.objects.take();
    let layers = solids::layers(&map.stand_on_ground(), objects.as_deref(), feature)?;
    let layers = layers.map(|layer| merge::Layer::of(&layer));
    Ok(faces::faces(&layers))
}

/// From the grid of [`boxes`] to metres from the node's south-west corner at the city's height zero.
pub(crate) fn grid(map: &BlockMap) -> DAffine3 {
    let cell = f64::from(map.cell_m);
    stretched([cell, cell, cell / f64::from(QUARTERS)], [0.0, 0.0, map.z_base_m()])
}

/// The mean of colours; `None` without any.
fn mean(colours: impl Iterator<Item = [u8; 3]>) -> Option<[u8; 3]> {
    let (mut sum, mut count) = ([0u32; 3], 0);
    for rgb in colours {
        sum = [0, 1, 2].map(|k| sum[k] + u32::from(rgb[k]));
        count += 1;
    }
    (count > 0).then(|| sum.map(|sum| ((sum + count / 2) / count) as u8))
}
