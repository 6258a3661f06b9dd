//! A triangle on its way from a reader to the city.

/// A triangle in world coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorldTriangle {
    /// World positions in metres.
    pub corners: [[f64; 3]; 3],
    /// Texture coordinates, v up.
    pub uv: [[f32; 2]; 3],
    /// Number returned by `SceneBuilder::material` of the bake.
    pub material: u32,
    /// Whether it belongs to the outside of a building without a texture, and may get a generated facade if it is steep.
    pub is_facade: bool,
}

impl WorldTriangle {
    /// Turns a triangle that faces down. Terrain is one-sided, so it must face up.
    pub fn facing_up(&self) -> Self {
        let [a, b, c] = self.corners;
        let z = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if z >= 0.0 {
            return *self;
        }
        Self { corners: [a, c, b], uv: [self.uv[0], self.uv[2], self.uv[1]], ..*self }
    }
}
