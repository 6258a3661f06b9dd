//! Vertices without repeated positions.

use insula_source::object::TriangleMesh;
use std::collections::HashMap;

/// Collects triangles; corners at exactly the same position share a vertex.
#[derive(Debug, Default)]
pub(super) struct Welder {
    mesh: TriangleMesh,
    numbers: HashMap<[u64; 3], u32>,
    /// Triangles of which two corners are equal.
    pub(super) degenerate: u64,
    /// Triangles with a coordinate that is not finite.
    pub(super) not_finite: u64,
}

impl Welder {
    /// Adds a triangle unless it is degenerate or not finite.
    pub(super) fn add(&mut self, corners: [[f64; 3]; 3]) {
        if corners.iter().flatten().any(|value| !value.is_finite()) {
            self.not_finite += 1;
            return;
        }
        // Negative zero is zero.
        let keys = corners.map(|corner| corner.map(|value| (value + 0.0).to_bits()));
        if keys[0] == keys[1] || keys[1] == keys[2] || keys[2] == keys[0] {
            self.degenerate += 1;
            return;
        }
        let positions = &mut self.mesh.positions;
        let numbers = &mut self.numbers;
        let triangle = [0, 1, 2].map(|k| {
            *numbers.entry(keys[k]).or_insert_with(|| {
                positions.push(corners[k]);
                positions.len() as u32 - 1
            })
        });
        self.mesh.triangles.push(triangle);
    }

    pub(super) fn finish(self) -> TriangleMesh {
        self.mesh
    }
}
