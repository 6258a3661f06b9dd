//! The vertical planes of an object.

use glam::{DVec2, DVec3, Vec3Swizzles};

/// Largest z of a wall's unit normal: 6 degrees off the vertical.
const MAX_NORMAL_Z: f64 = 0.1;
/// Least cosine between normals of one wall: 1.8 degrees.
const MIN_COSINE: f64 = 0.9995;
/// Largest distance of a corner from its wall's plane.
const MAX_OFFSET_M: f64 = 0.05;
/// Most walls that a face is compared with.
const MAX_WALLS: usize = 2048;
/// Smaller faces are no part of a wall.
const MIN_AREA_M2: f64 = 1e-3;

/// Faces of one vertical plane.
#[derive(Debug, Clone)]
pub(super) struct Wall {
    /// Unit normal.
    normal: DVec2,
    offset_m: f64,
    pub(super) faces: Vec<u32>,
}

impl Wall {
    /// Position along the wall, to the right as seen from outside.
    pub(super) fn along_m(&self, p: DVec3) -> f64 {
        self.normal.perp().dot(p.xy())
    }

    /// The place on the map of a position along the wall.
    pub(super) fn place_m(&self, along_m: f64) -> DVec2 {
        self.normal * self.offset_m + self.normal.perp() * along_m
    }

    /// The faces in the wall's plane: along the wall and up.
    pub(super) fn outline(&self, corners: &[[DVec3; 3]]) -> Vec<[DVec2; 3]> {
        let flat = |p: DVec3| DVec2::new(self.along_m(p), p.z);
        self.faces.iter().map(|face| corners[*face as usize].map(flat)).collect()
    }

    fn has(&self, normal: DVec2, corners: &[DVec3; 3]) -> bool {
        self.normal.dot(normal) >= MIN_COSINE
            && corners.iter().all(|p| (self.normal.dot(p.xy()) - self.offset_m).abs() <= MAX_OFFSET_M)
    }
}

/// Groups the steep faces for which `is_facade` holds by plane. The largest face of a wall gives it its plane.
pub(super) fn find_walls(corners: &[[DVec3; 3]], is_facade: &dyn Fn(usize) -> bool) -> Vec<Wall> {
    let mut steep: Vec<(f64, DVec2, usize)> = Vec::new();
    for (i, [a, b, c]) in corners.iter().enumerate().filter(|(i, _)| is_facade(*i)) {
        let cross = (b - a).cross(c - a);
        let (twice_m2, level) = (cross.length(), cross.xy().length());
        if twice_m2 >= 2.0 * MIN_AREA_M2 && cross.z.abs() <= MAX_NORMAL_Z * twice_m2 && level > 0.0 {
            steep.push((twice_m2, cross.xy() / level, i));
        }
    }
    steep.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.2.cmp(&b.2)));
    let mut walls: Vec<Wall> = Vec::new();
    for (_, normal, face) in steep {
        let own = &corners[face];
        if let Some(wall) = walls.iter_mut().find(|wall| wall.has(normal, own)) {
            wall.faces.push(face as u32);
        } else if walls.len() < MAX_WALLS {
            walls.push(Wall { normal, offset_m: normal.dot(own[0].xy()), faces: vec![face as u32] });
        }
    }
    walls
}
