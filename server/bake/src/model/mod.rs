//! Models: triangles of a single file (PLY, OFF, OBJ), for the tools that compress and simplify.
//!
//! In: a file's bytes. Out: a [`Model`], and back. Next: `simplify`, or the codec of `insula_protocol::mesh`.

mod obj;
mod off;
mod ply;
pub mod quantise;

use insula_protocol::mesh::AttributeKind;
use std::{collections::HashMap, path::Path};

/// Most vertices or triangles that are read.
pub const MAX_COUNT: usize = 1 << 24;

/// Values that corners carry.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// What they mean: texture coordinates have 2 numbers, normals 3, colours 3 or 4 from 0 to 1.
    pub kind: AttributeKind,
    /// How many numbers of a value count.
    pub width: usize,
    /// Values; what does not count is 0.
    pub values: Vec<[f32; 4]>,
    /// For each corner `3 t + k` its value.
    pub corners: Vec<u32>,
}

/// Triangles with what their corners carry.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Model {
    /// Vertices, in the file's own units.
    pub positions: Vec<[f64; 3]>,
    /// Triples of vertices.
    pub triangles: Vec<[u32; 3]>,
    /// What corners carry.
    pub layers: Vec<Layer>,
}

/// Why a file is no model.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ModelError {
    /// What cannot be read, and where.
    #[error("{what} in line {line}: is it a {format} file?")]
    Line {
        /// What is wrong.
        what: &'static str,
        /// Where, from 1.
        line: usize,
        /// What it was read as.
        format: &'static str,
    },
    /// What is wrong as a whole.
    #[error("{0}")]
    Whole(&'static str),
}

/// Formats of models.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Stanford's polygon files: text, or binary of either byte order; written in binary.
    Ply,
    /// Geomview's object files, as text.
    Off,
    /// Wavefront's, without materials.
    Obj,
}

impl Format {
    /// By a file's name.
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "ply" => Some(Self::Ply),
            "off" => Some(Self::Off),
            "obj" => Some(Self::Obj),
            _ => None,
        }
    }
}

impl Model {
    /// From a file's bytes. Polygons become fans of triangles.
    ///
    /// # Errors
    /// What is not of the format, not finite, or over [`MAX_COUNT`].
    pub fn read(bytes: &[u8], format: Format) -> Result<Self, ModelError> {
        let model = match format {
            Format::Ply => ply::read(bytes)?,
            Format::Off => off::read(bytes)?,
            Format::Obj => obj::read(bytes)?,
        };
        if model.triangles.as_flattened().iter().any(|vertex| *vertex as usize >= model.positions.len()) {
            return Err(ModelError::Whole("a face names a vertex that is not there"));
        }
        if model.positions.as_flattened().iter().any(|v| !v.is_finite() || v.abs() > 1e12) {
            return Err(ModelError::Whole("a coordinate is not finite, or over 10^12"));
        }
        if model.layers.iter().any(|layer| layer.values.as_flattened().iter().any(|v| !v.is_finite())) {
            return Err(ModelError::Whole("a normal, colour or texture coordinate is not finite"));
        }
        Ok(model)
    }

    /// As a file's bytes.
    pub fn write(&self, format: Format) -> Vec<u8> {
        match format {
            Format::Ply => ply::write(self),
            Format::Off => off::write(self),
            Format::Obj => obj::write(self),
        }
    }

    /// Vertices at the same place become one; how many were left out.
    pub fn weld(&mut self) -> usize {
        let mut first = HashMap::with_capacity(self.positions.len());
        let mut positions = Vec::with_capacity(self.positions.len());
        let number = |position: &[f64; 3]| {
            // Zero has two signs.
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

    /// Diagonal of the box around all vertices.
    pub fn diagonal(&self) -> f64 {
        let side = |k: usize| {
            let values = self.positions.iter().map(|p| p[k]);
            values.clone().fold(f64::NEG_INFINITY, f64::max) - values.fold(f64::INFINITY, f64::min)
        };
        (0..3).map(side).map(|side| side.max(0.0).powi(2)).sum::<f64>().sqrt()
    }
}

/// Appends a polygon as a fan of triangles, by its corners' numbers.
fn fan(polygon: &[u32], mut push: impl FnMut([u32; 3])) {
    for pair in polygon.windows(2).skip(1) {
        push([polygon[0], pair[0], pair[1]]);
    }
}

fn limit(count: usize) -> Result<(), ModelError> {
    if count > MAX_COUNT { Err(ModelError::Whole("more than 16 million vertices or triangles")) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model() -> Model {
        let positions = vec![[0.0, 0.0, 0.0], [1.5, 0.0, 0.0], [0.0, 2.25, 0.0], [0.0, 0.0, -3.0]];
        let triangles = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        Model { positions, triangles, layers: vec![] }
    }

    #[test]
    fn every_format_comes_back() {
        for format in [Format::Ply, Format::Off, Format::Obj] {
            assert_eq!(Model::read(&model().write(format), format).unwrap(), model(), "{format:?}");
        }
    }

    #[test]
    fn layers_come_back_in_obj_and_ply() {
        let mut model = model();
        let corners: Vec<u32> = model.triangles.as_flattened().to_vec();
        let layer = |kind, width, values: [[f32; 4]; 4]| Layer {
            kind,
            width,
            values: values.to_vec(),
            corners: corners.clone(),
        };
        let value = |v: f32| [v, 1.0 - v, 0.0, 0.0];
        model.layers.push(layer(AttributeKind::TexCoord, 2, [0.0, 0.25, 0.5, 1.0].map(value)));
        let normal = |k: usize| std::array::from_fn(|i| f32::from(i == k));
        model.layers.push(layer(AttributeKind::Normal, 3, [0, 1, 2, 0].map(normal)));
        assert_eq!(Model::read(&model.write(Format::Obj), Format::Obj).unwrap(), model);
        let read = Model::read(&model.write(Format::Ply), Format::Ply).unwrap();
        let values = |model: &Model, layer: usize| -> Vec<[f32; 4]> {
            let layer = &model.layers[layer];
            layer.corners.iter().map(|value| layer.values[*value as usize]).collect()
        };
        assert_eq!(read.layers.len(), 2);
        assert!((0..2).all(|layer| values(&read, layer) == values(&model, layer)));
    }

    #[test]
    fn text_as_others_write_it_is_read() {
        let off =
            "OFF # a comment\n# another\n\n5 2 0\n0 0 0\n1 0 0 \n1 1 0\n0 1 0\n0 0 1\n4 0 1 2 3\n3 0 1 4 255 0 0\n";
        let model = Model::read(off.as_bytes(), Format::Off).unwrap();
        assert_eq!(model.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 4]]);
        let obj = "mtllib a.mtl\nv 0 0 0 1\nv 1 0 0\n\nv 1 1 0\nusemtl x\nf -3//1 -2 3\ng\nf 1/1/1 2/1/1 3/1/1\nvt 0 0\nvn 0 0 1\n";
        let model = Model::read(obj.as_bytes(), Format::Obj).unwrap();
        assert_eq!(model.triangles, [[0, 1, 2], [0, 1, 2]]);
        let ply = "ply\r\nformat ascii 1.0\r\ncomment c\r\nelement vertex 3\r\nproperty float x\r\nproperty float y\r\nproperty float z\r\nproperty float confidence\r\nelement face 1\r\nproperty list uchar int vertex_indices\r\nend_header\r\n0 0 0 1\r\n1 0 0 1\r\n0 1 0 1\r\n3 0 1 2\r\n";
        assert_eq!(Model::read(ply.as_bytes(), Format::Ply).unwrap().triangles, [[0, 1, 2]]);
    }

    #[test]
    fn any_damage_is_an_error_or_a_model() {
        for format in [Format::Ply, Format::Off, Format::Obj] {
            let whole = model().write(format);
            for length in 0..whole.len() {
                let _ = Model::read(&whole[..length], format);
                for byte in [0, b'9', b' ', b'\n', 0xff] {
                    let mut bytes = whole.clone();
                    bytes[length] = byte;
                    if let Ok(model) = Model::read(&bytes, format) {
                        assert!(model.triangles.as_flattened().iter().all(|v| (*v as usize) < model.positions.len()));
                    }
                }
            }
        }
        let huge = b"ply\nformat binary_little_endian 1.0\nelement vertex 9999999999\nproperty float x\nend_header\n";
        assert!(Model::read(huge, Format::Ply).is_err());
        assert!(Model::read(b"OFF\n4000000000 1 1\n", Format::Off).is_err());
    }

    #[test]
    fn vertices_at_one_place_are_welded() {
        let mut model = model();
        model.positions.push([-0.0, 0.0, 0.0]);
        model.triangles.push([4, 1, 2]);
        assert_eq!(model.weld(), 1);
        assert_eq!(model.triangles[4], [0, 1, 2]);
    }
}
