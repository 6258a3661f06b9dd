//! A city as triangles: walls, roofs, undersides and ground.

use super::blocks::{Block, Part, Roof};
use glam::{DVec2, DVec3, Vec3};

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    pub p: Vec3,
    pub normal: Vec3,
    pub rgb: [u8; 3],
}

const STREET: [u8; 3] = [88, 88, 90];

/// All triangles of a block, counter-clockwise from outside.
pub fn push_block(block: &Block, origin: DVec3, out: &mut Vec<Corner>) {
    ground(block, origin, out);
    block.parts().for_each(|part| push_part(part, origin, out));
}

fn ground(block: &Block, origin: DVec3, out: &mut Vec<Corner>) {
    let [low, high] = block.streets;
    let flat = |low: DVec2, high: DVec2| {
        [low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)].map(|p| p.extend(0.0))
    };
    quad(flat(block.low, high), block.ground, origin, out);
    quad(flat(low, DVec2::new(block.low.x, high.y)), STREET, origin, out);
    quad(flat(DVec2::new(block.low.x, low.y), DVec2::new(high.x, block.low.y)), STREET, origin, out);
}

fn push_part(part: &Part, origin: DVec3, out: &mut Vec<Corner>) {
    let at = |u: f64, v: f64, z: f64| (part.centre + part.axis * u + part.axis.perp() * v).extend(z);
    let (u, v, low, high) = (part.half.x, part.half.y, part.bottom_m, part.eaves_m);
    let ring = [(-u, -v), (u, -v), (u, v), (-u, v)];
    for k in 0..4 {
        let (a, b) = (ring[k], ring[(k + 1) % 4]);
        quad([at(a.0, a.1, low), at(b.0, b.1, low), at(b.0, b.1, high), at(a.0, a.1, high)], part.wall, origin, out);
    }
    match part.roof {
        Roof::Flat => quad(ring.map(|(u, v)| at(u, v, high)), part.top, origin, out),
        Roof::Gable(rise_m) => {
            let (west, east) = (at(-u, 0.0, high + rise_m), at(u, 0.0, high + rise_m));
            quad([at(-u, -v, high), at(u, -v, high), east, west], part.top, origin, out);
            quad([at(u, v, high), at(-u, v, high), west, east], part.top, origin, out);
            triangle([at(u, -v, high), at(u, v, high), east], part.wall, origin, out);
            triangle([at(-u, v, high), at(-u, -v, high), west], part.wall, origin, out);
        }
    }
    if part.bottom_m > 0.0 {
        let [a, b, c, d] = ring.map(|(u, v)| at(u, v, low));
        quad([d, c, b, a], part.wall, origin, out);
    }
}

fn quad([a, b, c, d]: [DVec3; 4], rgb: [u8; 3], origin: DVec3, out: &mut Vec<Corner>) {
    triangle([a, b, c], rgb, origin, out);
    triangle([a, c, d], rgb, origin, out);
}

fn triangle(corners: [DVec3; 3], rgb: [u8; 3], origin: DVec3, out: &mut Vec<Corner>) {
    let [a, b, c] = corners;
    let normal = (b - a).cross(c - a).normalize_or(DVec3::Z).as_vec3();
    out.extend(corners.map(|p| Corner { p: (p - origin).as_vec3(), normal, rgb }));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::blocks::block;

    #[test]
    fn triangle_counts_are_exact_and_roofs_face_up() {
        for i in 0..30 {
            let block = block(i, -i);
            let mut corners = Vec::new();
            push_block(&block, DVec3::ZERO, &mut corners);
            assert_eq!(corners.len() as u64, 3 * block.triangles());
            let under = corners.iter().filter(|c| c.normal.z < -1e-3).count();
            let hanging = block.parts().filter(|part| part.bottom_m > 0.0).count();
            assert_eq!(under, hanging * 6);
        }
    }
}
