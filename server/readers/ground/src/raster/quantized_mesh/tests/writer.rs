//! Writes tiles and terrains in memory.

use super::super::super::facts::{RasterFacts, RasterLimits, Window};
use super::super::{QuantizedMesh, RasterError, TileFiles};
use std::collections::BTreeMap;
use std::io;

pub(super) const LAYER: &str = r#"{"format": "quantized-mesh-1.0", "tiles": ["{z}/{x}/{y}.terrain?v={version}"]}"#;

/// A tile to write. Coordinates and heights are from 0 to 32767.
#[derive(Clone)]
pub(super) struct Tile {
    pub(super) heights_m: [f32; 2],
    pub(super) vertices: Vec<[u16; 3]>,
    pub(super) triangles: Vec<[u32; 3]>,
}

impl Tile {
    /// A grid of `cells` x `cells` with two triangles each, whose heights in metres are the third coordinate.
    pub(super) fn grid(cells: u16, height: impl Fn(u16, u16) -> u16) -> Self {
        let place = |index: u16| (u32::from(index) * 32767 / u32::from(cells)) as u16;
        let indices = (0..=cells).flat_map(|row| (0..=cells).map(move |column| (place(column), place(row))));
        let vertices = indices.map(|(x, y)| [x, y, height(x, y)]).collect();
        let (cells, line) = (u32::from(cells), u32::from(cells) + 1);
        let corners = (0..cells).flat_map(|row| (0..cells).map(move |column| row * line + column));
        let triangles = corners.flat_map(|a| [[a, a + 1, a + line + 1], [a, a + line + 1, a + line]]).collect();
        Self { heights_m: [0.0, 32767.0], vertices, triangles }
    }

    /// A tile with the same height everywhere.
    pub(super) fn flat(height_m: f32) -> Self {
        Self { heights_m: [height_m; 2], ..Self::grid(1, |_, _| 0) }
    }

    pub(super) fn bytes(&self) -> Vec<u8> {
        let (order, codes) = self.high_water_codes();
        let mut bytes = vec![0; 88];
        bytes[24..28].copy_from_slice(&self.heights_m[0].to_le_bytes());
        bytes[28..32].copy_from_slice(&self.heights_m[1].to_le_bytes());
        bytes.extend((order.len() as u32).to_le_bytes());
        for axis in 0..3 {
            let mut last = 0;
            for index in &order {
                let number = i32::from(self.vertices[*index as usize][axis]);
                let step = number - last;
                bytes.extend(((step << 1 ^ step >> 31) as u16).to_le_bytes());
                last = number;
            }
        }
        let is_wide = order.len() > 65536;
        if is_wide {
            bytes.resize(bytes.len().next_multiple_of(4), 0);
        }
        bytes.extend((self.triangles.len() as u32).to_le_bytes());
        for code in codes {
            bytes.extend_from_slice(&code.to_le_bytes()[..if is_wide { 4 } else { 2 }]);
        }
        // No vertices on edges, then a water mask.
        bytes.extend([0; 16]);
        bytes.extend([2, 1, 0, 0, 0, 255]);
        bytes
    }

    /// Vertices in the order of their first use, and the codes of the triangles' corners.
    fn high_water_codes(&self) -> (Vec<u32>, Vec<u32>) {
        let (mut order, mut codes) = (Vec::new(), Vec::new());
        let mut places = vec![None; self.vertices.len()];
        for corner in self.triangles.as_flattened() {
            let used = order.len() as u32;
            let place = *places[*corner as usize].get_or_insert_with(|| {
                order.push(*corner);
                used
            });
            codes.push(used - place);
        }
        (order, codes)
    }
}

/// Files in memory. A file without bytes cannot be read.
#[derive(Clone, Default)]
pub(super) struct Terrain(pub(super) BTreeMap<String, Vec<u8>>);

impl Terrain {
    pub(super) fn with(mut self, name: &str, tile: &Tile) -> Self {
        self.0.insert(name.to_owned(), tile.bytes());
        self
    }

    pub(super) fn with_bytes(mut self, name: &str, bytes: &[u8]) -> Self {
        self.0.insert(name.to_owned(), bytes.to_vec());
        self
    }

    pub(super) fn open(&self, layer: &str) -> Result<(QuantizedMesh, RasterFacts), RasterError> {
        self.open_with(layer, RasterLimits::default())
    }

    pub(super) fn open_with(
        &self,
        layer: &str,
        limits: RasterLimits,
    ) -> Result<(QuantizedMesh, RasterFacts), RasterError> {
        QuantizedMesh::open(layer.as_bytes(), Box::new(self.clone()), limits)
    }

    /// All heights by row.
    pub(super) fn heights(&self, layer: &str) -> Vec<Vec<f32>> {
        let (mut mesh, facts) = self.open(layer).unwrap();
        let heights = mesh.read_heights(Window::all_of(facts.size), facts.size.pixels() as usize).unwrap();
        heights.chunks(facts.size.width as usize).map(<[f32]>::to_vec).collect()
    }
}

impl TileFiles for Terrain {
    fn names(&self) -> io::Result<Vec<String>> {
        Ok(self.0.keys().cloned().collect())
    }

    fn read(&self, name: &str, max_bytes: u64) -> io::Result<Vec<u8>> {
        match self.0.get(name) {
            Some(bytes) if bytes.is_empty() => Err(io::ErrorKind::PermissionDenied.into()),
            Some(bytes) if bytes.len() as u64 > max_bytes => Err(io::ErrorKind::InvalidData.into()),
            Some(bytes) => Ok(bytes.clone()),
            None => Err(io::ErrorKind::NotFound.into()),
        }
    }
}
