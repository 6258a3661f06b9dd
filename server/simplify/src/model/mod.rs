//! Models of single files (PLY, OFF, OBJ, STL), for the tools that compress and simplify meshes.

mod face;
mod obj;
pub mod off;
mod ply;
pub mod ply_header;
pub mod ply_values;
pub mod quantise;
pub mod stl;
#[cfg(test)]
mod tests;
mod triangle_model;

pub use triangle_model::{CornerLayer, MAX_COUNT, ModelError, ModelFormat, NO_VALUE, TriangleModel};

impl TriangleModel {
    /// Parses a file. Polygons become triangles. Fails if it is not of the format, has a value that is not
    /// finite, or exceeds [`MAX_COUNT`].
    pub fn read(bytes: &[u8], format: ModelFormat) -> Result<Self, ModelError> {
        let model = match format {
            ModelFormat::Ply => ply::read(bytes)?,
            ModelFormat::Off => off::read(bytes)?,
            ModelFormat::Obj => obj::read(bytes)?,
            ModelFormat::Stl => stl::read(bytes)?,
        };
        model.check()?;
        Ok(model)
    }

    /// The bytes of a file.
    pub fn write(&self, format: ModelFormat) -> Vec<u8> {
        match format {
            ModelFormat::Ply => ply::write(self),
            ModelFormat::Off => off::write(self),
            ModelFormat::Obj => obj::write(self),
            ModelFormat::Stl => stl::write(self),
        }
    }
}
