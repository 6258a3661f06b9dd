//! Triangles with the values that their corners carry.

use insula_protocol::mesh::AttributeKind;
use std::collections::HashMap;
use std::path::Path;

/// Largest number of vertices or triangles.
pub const MAX_COUNT: usize = 1 << 24;

/// Stands for the value of a corner that has none.
pub const NO_VALUE: u32 = u32::MAX;

/// Values of one kind that corners carry.
#[derive(Debug, Clone, PartialEq)]
pub struct CornerLayer {
    /// Texture coordinates have 2 components, normals 3, colours 3 or 4 from 0 to 1.
    pub kind: AttributeKind,
    /// Number of components.
    pub width: usize,
    /// Unused components are 0.
    pub values: Vec<[f32; 4]>,
    /// For each corner `3 t + k` the index of its value, or [`NO_VALUE`].
    pub corners: Vec<u32>,
}

impl CornerLayer {
    /// The value of a corner, if it has one.
    pub fn value(&self, corner: usize) -> Option<[f32; 4]> {
        self.values.get(self.corners[corner] as usize).copied()
    }

    /// Number of corners without a value.
    pub fn missing(&self) -> usize {
        self.corners.iter().filter(|value| **value == NO_VALUE).count()
    }
}

/// Triangles with the values of their corners.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriangleModel {
    /// Vertices in the file's own unit.
    pub positions: Vec<[f64; 3]>,
    /// Triples of vertices.
    pub triangles: Vec<[u32; 3]>,
    pub layers: Vec<CornerLayer>,
}

/// Why a file cannot be read as a model.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ModelError {
    /// A line is invalid.
    #[error("{what} in line {line}: is it a {format} file?")]
    Line {
        what: &'static str,
        /// From 1.
        line: usize,
        format: &'static str,
    },
    /// The file as a whole is invalid.
    #[error("{0}")]
    Whole(&'static str),
}

/// Formats of models.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelFormat {
    /// Stanford polygon file: text, or binary of either byte order. Written as binary.
    Ply,
    /// Geomview object file, as text.
    Off,
    /// Wavefront OBJ, without materials.
    Obj,
    /// Triangles of a stereolithography file, text or binary, in single precision and without layers. Written as binary.
    Stl,
}

impl ModelFormat {
    /// The format by file extension.
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "ply" => Some(Self::Ply),
            "off" => Some(Self::Off),
            "obj" => Some(Self::Obj),
            "stl" => Some(Self::Stl),
            _ => None,
        }
    }
}

impl TriangleModel {
    /// Welds vertices at the same position. Returns the number of vertices that were removed.
    pub fn weld(&mut self) -> usize {
        let mut first = HashMap::with_capacity(self.positions.len());
        let mut positions = Vec::with_capacity(self.positions.len());
        let number = |position: &[f64; 3]| {
            // Adding 0 turns -0 into 0.
            *first.entry(position.map(|v| (v + 0.0).to_bits())).or_insert_with(|| {
                positions.push(*position);
                positions.len() as u32 - 1
            })
        };
        let numbers: Vec<u32> = self.positions.iter().map(number).collect();
        self.triangles.as_flattened_mut().iter_mut().for_each(|vertex| *vertex = numbers[*vertex as usize]);
        let before = std::mem::replace(&mut self.positions, positions).len();
        before - self.positions.len()
    }

    /// Diagonal of the bounding box, in the file's own unit.
    pub fn diagonal(&self) -> f64 {
        let side = |k: usize| {
            let values = self.positions.iter().map(|p| p[k]);
            values.clone().fold(f64::NEG_INFINITY, f64::max) - values.fold(f64::INFINITY, f64::min)
        };
        (0..3).map(side).map(|side| side.max(0.0).powi(2)).sum::<f64>().sqrt()
    }

    /// Fails if an index is out of range or a value not finite.
    pub(super) fn check(&self) -> Result<(), ModelError> {
        if self.triangles.as_flattened().iter().any(|vertex| *vertex as usize >= self.positions.len()) {
            return Err(ModelError::Whole("a face refers to a vertex that does not exist"));
        }
        if self.positions.as_flattened().iter().any(|v| !v.is_finite() || v.abs() > 1e12) {
            return Err(ModelError::Whole("a coordinate is not finite, or over 10^12"));
        }
        if self.layers.iter().any(|layer| layer.values.as_flattened().iter().any(|v| !v.is_finite())) {
            return Err(ModelError::Whole("a normal, colour or texture coordinate is not finite"));
        }
        Ok(())
    }
}

/// Fails if a count exceeds [`MAX_COUNT`].
pub(super) fn check_count(count: usize) -> Result<(), ModelError> {
    if count > MAX_COUNT { Err(ModelError::Whole("more than 16 million vertices or triangles")) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vertices_at_the_same_position_are_welded() {
        let positions = vec![[0.0, 0.0, 0.0], [1.5, 0.0, 0.0], [0.0, 2.25, 0.0], [-0.0, 0.0, 0.0]];
        let mut model = TriangleModel { positions, triangles: vec![[0, 2, 1], [3, 1, 2]], layers: vec![] };
        assert_eq!(model.weld(), 1);
        assert_eq!(model.triangles[1], [0, 1, 2]);
    }
}
