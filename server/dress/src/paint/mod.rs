//! Pictures of the ground from above: land use, water, roads, paths and rails, painted in colours of materials.
//!
//! Shapes on the map, in metres, become texels in sRGB with alpha, on a grid that is anchored to the map, so that
//! neighbouring pictures fit texel by texel. Terrain has them as textures.
//!
//! The picture is painted in blocks of 256 x 256 texels with 16 samples each. A sample holds a
//! material instead of a colour. Shapes replace each other without blending, so there is no gap between areas with
//! a common border. The colour of a texel is the mean of its samples in linear light.

mod canvas;
mod class;
mod clip;
mod error;
mod junctions;
mod material;
mod noise;
mod painter;
mod palette;
mod pattern;
mod prepare;
mod reach;
mod resolve;
mod road_paint;
mod shape;
mod stroke;
mod surfacing;
mod tags;
#[cfg(test)]
mod tests;

pub use class::{AreaClass, LineClass};
pub use clip::{between, clip_segment};
pub use error::PaintError;
pub use noise::mix_bits;
pub use painter::{GroundPainter, over};
pub use shape::{PaintArea, PaintLine, PaintShape, Sidewalks};
pub use tags::{LineLook, area_look, is_zebra, line_look};
