//! Cuts triangles where their texture ends or turns, so that each piece is within one image.

use crate::alpha_mask::Piece;
use insula_source::object::Wrap;
use std::array;

/// Texture coordinates beyond the border of an image by less are on it: rounding leaves them so.
const TOLERANCE: f32 = 1.0 / 128.0;
/// A triangle over more mirrored images stays whole, and its texture repeats.
const MAX_IMAGES: f32 = 32.0;

/// A corner of a piece, with its texture coordinates.
type UvCorner = ([f64; 3], [f32; 2]);

/// Passes the pieces of a triangle to `take`, with the texture coordinates of a texture that repeats. What is outside of a texture that ends
/// has the colours of its border.
pub fn cut_at_images(whole: Piece, wrap: Wrap, take: &mut dyn FnMut(Piece)) {
    if wrap == Wrap::Repeat {
        return take(whole);
    }
    let ranges = [0, 1].map(|axis: usize| UvRange::of(whole.1.map(|uv| uv[axis])));
    let corners: [UvCorner; 3] = array::from_fn(|i| (whole.0[i], whole.1[i]));
    let mut pieces = vec![corners.to_vec()];
    for (axis, range) in ranges.iter().enumerate() {
        for border in range.borders(wrap) {
            let halves = pieces.iter().flat_map(|piece| halves(piece, axis, border));
            pieces = halves.filter(|piece| piece.len() >= 3).collect();
        }
    }
    for mut piece in pieces {
        for (axis, range) in ranges.iter().enumerate() {
            let centre = piece.iter().map(|(_, uv)| uv[axis]).sum::<f32>() / piece.len() as f32;
            piece.iter_mut().for_each(|(_, uv)| uv[axis] = range.within_image(uv[axis], centre, wrap));
        }
        for pair in piece.windows(2).skip(1) {
            let triangle = [piece[0], pair[0], pair[1]];
            take((triangle.map(|(corner, _)| corner), triangle.map(|(_, uv)| uv)));
        }
    }
}

/// The texture coordinates of a triangle along an axis.
#[derive(Debug, Clone, Copy)]
struct UvRange {
    low: f32,
    high: f32,
}

impl UvRange {
    fn of(values: [f32; 3]) -> Self {
        let (low, high) = (f32::min(values[0], values[1]), f32::max(values[0], values[1]));
        Self { low: low.min(values[2]), high: high.max(values[2]) }
    }

    /// Whether mirrored images are few, and can be told apart.
    fn is_narrow(self) -> bool {
        self.high - self.low <= MAX_IMAGES && self.low.abs() < 1e6
    }

    /// Where the triangle has to be cut.
    fn borders(self, wrap: Wrap) -> Vec<f32> {
        let all = match wrap {
            Wrap::Repeat => Vec::new(),
            Wrap::Clamp | Wrap::None => vec![0.0, 1.0],
            Wrap::Mirror if self.is_narrow() => {
                (self.low.ceil() as i32..=self.high.floor() as i32).map(|border| border as f32).collect()
            }
            Wrap::Mirror => Vec::new(),
        };
        all.into_iter().filter(|border| self.low + TOLERANCE < *border && *border < self.high - TOLERANCE).collect()
    }

    /// A coordinate of a piece as that of a texture that repeats. `centre` is that of the piece.
    fn within_image(self, coordinate: f32, centre: f32, wrap: Wrap) -> f32 {
        match wrap {
            Wrap::Repeat => coordinate,
            Wrap::Clamp | Wrap::None => coordinate.clamp(0.0, 1.0),
            Wrap::Mirror if self.is_narrow() => {
                let image = centre.floor();
                let within = coordinate - image;
                let turned = if image % 2.0 == 0.0 { within } else { 1.0 - within };
                turned.clamp(0.0, 1.0)
            }
            Wrap::Mirror => coordinate,
        }
    }
}

/// The parts of a convex piece below and above a border; those of fewer than three corners are none.
fn halves(piece: &[UvCorner], axis: usize, border: f32) -> [Vec<UvCorner>; 2] {
    let [mut below, mut above] = [Vec::new(), Vec::new()];
    for (corner, next) in piece.iter().zip(piece.iter().cycle().skip(1)) {
        let [own, other] = [corner, next].map(|(_, uv)| f64::from(uv[axis]) - f64::from(border));
        if own <= 0.0 {
            below.push(*corner);
        }
        if own >= 0.0 {
            above.push(*corner);
        }
        if own < 0.0 && other > 0.0 || own > 0.0 && other < 0.0 {
            let share = own / (own - other);
            let place = array::from_fn(|i| corner.0[i] + share * (next.0[i] - corner.0[i]));
            let mut uv: [f32; 2] = array::from_fn(|i| corner.1[i] + share as f32 * (next.1[i] - corner.1[i]));
            uv[axis] = border;
            below.push((place, uv));
            above.push((place, uv));
        }
    }
    [below, above]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The pieces of a triangle whose texture coordinates are its corners on the map.
    fn pieces(corners: [[f32; 2]; 3], wrap: Wrap) -> Vec<Piece> {
        let mut pieces = Vec::new();
        let whole = (corners.map(|[x, y]| [f64::from(x), f64::from(y), 1.0]), corners);
        cut_at_images(whole, wrap, &mut |piece| pieces.push(piece));
        pieces
    }

    fn area(pieces: &[Piece]) -> f64 {
        let area = |[a, b, c]: [[f64; 3]; 3]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        pieces.iter().map(|(corners, _)| area(*corners) / 2.0).sum()
    }

    fn assert_mapped(pieces: &[Piece], expected: impl Fn(f64) -> f64) {
        for (corner, uv) in pieces.iter().flat_map(|(corners, uv)| corners.iter().zip(uv)) {
            for axis in [0, 1] {
                assert!((f64::from(uv[axis]) - expected(corner[axis])).abs() < 1e-5, "{corner:?} {uv:?}");
            }
        }
    }

    #[test]
    fn textures_end_at_their_border() {
        let corners = [[-1.0, -0.5], [3.0, 0.25], [0.5, 2.0]];
        for wrap in [Wrap::Clamp, Wrap::None] {
            let pieces = pieces(corners, wrap);
            assert_mapped(&pieces, |at| at.clamp(0.0, 1.0));
            assert!((area(&pieces) - 4.4375).abs() < 1e-5, "{}", area(&pieces));
        }
        // Within the image, and hardly beyond it, nothing is cut.
        assert_eq!(pieces([[0.0, 0.0], [1.005, 0.0], [0.5, 1.0]], Wrap::Clamp).len(), 1);
    }

    #[test]
    fn mirrored_textures_turn_in_every_other_image() {
        let pieces = pieces([[-1.5, 0.0], [4.25, 0.5], [0.5, 2.75]], Wrap::Mirror);
        let wave = |at: f64| 1.0 - (at.rem_euclid(2.0) - 1.0).abs();
        assert_mapped(&pieces, wave);
        assert!(pieces.len() > 8 && (area(&pieces) - 7.40625).abs() < 1e-4, "{} {}", pieces.len(), area(&pieces));
    }

    #[test]
    fn others_stay_whole() {
        let corners = [[-1.0, 0.0], [3.0, 0.0], [0.0, 2.0]];
        assert_eq!(pieces(corners, Wrap::Repeat)[0].1, corners);
        for far in [1e9, f32::MAX, f32::NAN] {
            assert_eq!(pieces([[0.0, 0.0], [far, 0.0], [0.0, 0.5]], Wrap::Mirror).len(), 1, "{far}");
            assert!(pieces([[0.0, 0.0], [far, 0.0], [0.0, 0.5]], Wrap::Clamp).len() <= 3, "{far}");
        }
    }
}
