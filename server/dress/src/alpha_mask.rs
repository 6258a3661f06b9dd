//! Holes that the alpha of a texture cuts into triangles.
//!
//! A column's texel and a mesh's triangle are opaque, so triangles are divided, and their transparent pieces are dropped.

use std::array;

/// Larger textures are reduced to this number of texels a side.
const MAX_SIDE: usize = 128;
/// A triangle is divided in half at most this often.
const MAX_DEPTH: u32 = 16;

/// The alpha of a texture, reduced, from the top row.
#[derive(Debug, Clone)]
pub struct AlphaGrid {
    width: usize,
    height: usize,
    /// Means of the texels' alpha.
    alpha: Vec<u8>,
}

impl AlphaGrid {
    /// Of the `width * height` texels' alpha; `None` if all are opaque.
    pub fn new(width: usize, height: usize, alpha: &[u8]) -> Option<Self> {
        if width == 0 || alpha.len() != width * height || alpha.iter().all(|alpha| *alpha == u8::MAX) {
            return None;
        }
        let reduced = [width, height].map(|side| side.min(MAX_SIDE));
        let mean = |x: usize, y: usize| {
            let range = |i: usize, full: usize, reduced: usize| i * full / reduced..(i + 1) * full / reduced;
            let rows = range(y, height, reduced[1]);
            let columns = range(x, width, reduced[0]);
            let count = rows.len() * columns.len();
            let of_row =
                |row: usize| alpha[row * width..][columns.clone()].iter().map(|alpha| u64::from(*alpha)).sum::<u64>();
            (rows.map(of_row).sum::<u64>() / count as u64) as u8
        };
        let alpha = (0..reduced[1]).flat_map(|y| (0..reduced[0]).map(move |x| mean(x, y))).collect();
        Some(Self { width: reduced[0], height: reduced[1], alpha })
    }
}

/// Which texels of a texture are opaque.
#[derive(Debug)]
pub struct AlphaMask {
    width: usize,
    height: usize,
    /// Opaque texels in the rectangle from the first texel, in rows of `width + 1`.
    sums: Vec<u32>,
}

/// A part of a triangle: its corners, and its texture coordinates with v up.
pub type Piece = ([[f64; 3]; 3], [[f32; 2]; 3]);

impl AlphaMask {
    /// Texels with less alpha than `cutoff` (0 to 1) are holes; `None` if there is no hole.
    pub fn new(grid: &AlphaGrid, cutoff: f32) -> Option<Self> {
        let is_opaque = |alpha: u8| f32::from(alpha) >= cutoff * 255.0;
        if grid.alpha.iter().all(|alpha| is_opaque(*alpha)) {
            return None;
        }
        let (width, height) = (grid.width, grid.height);
        let mut sums = vec![0; (width + 1) * (height + 1)];
        for y in 0..height {
            let mut of_row = 0;
            for x in 0..width {
                of_row += u32::from(is_opaque(grid.alpha[y * width + x]));
                sums[(y + 1) * (width + 1) + x + 1] = sums[y * (width + 1) + x + 1] + of_row;
            }
        }
        Some(Self { width, height, sums })
    }

    /// Passes the opaque pieces of a triangle to `keep`. Pieces with edges shorter than `min_edge_m`, or of one texel, are
    /// not divided further: their centre decides.
    pub fn cut(&self, whole: Piece, min_edge_m: f64, keep: &mut dyn FnMut(Piece)) {
        let mut pending = vec![(whole, 0)];
        while let Some((piece, depth)) = pending.pop() {
            let texels = self.texels_of(&piece.1);
            let [opaque, count] = self.count(texels);
            if opaque == count {
                keep(piece);
                continue;
            }
            let (edge, length) = longest_edge(&piece.0);
            let is_small = texels.iter().all(|[low, high]| high - low <= 1);
            if opaque > 0 && !is_small && length > min_edge_m && depth < MAX_DEPTH {
                let [first, second] = halves(&piece, edge);
                pending.push((second, depth + 1));
                pending.push((first, depth + 1));
            } else if opaque > 0 && self.is_opaque_at_centre(&piece.1) {
                keep(piece);
            }
        }
    }

    /// Ranges of columns and rows that texture coordinates touch. Textures repeat.
    fn texels_of(&self, uv: &[[f32; 2]; 3]) -> [[usize; 2]; 2] {
        let sides = [self.width, self.height];
        array::from_fn(|axis| {
            let side = sides[axis] as f32;
            let values = uv.map(|uv| if axis == 0 { uv[0] } else { 1.0 - uv[1] });
            let low = values.iter().copied().fold(f32::INFINITY, f32::min);
            let high = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            let tile = low.floor();
            let (low, high) = (((low - tile) * side).floor(), ((high - tile) * side).ceil());
            // Also if a number is not finite.
            if !(low >= 0.0 && high <= side) {
                return [0, sides[axis]];
            }
            let low = (low as usize).min(sides[axis] - 1);
            [low, (high as usize).max(low + 1)]
        })
    }

    /// Opaque texels, and all texels, of ranges of columns and rows.
    fn count(&self, [[left, right], [top, bottom]]: [[usize; 2]; 2]) -> [u32; 2] {
        let sum = |x: usize, y: usize| self.sums[y * (self.width + 1) + x];
        let opaque = sum(right, bottom) + sum(left, top) - sum(left, bottom) - sum(right, top);
        [opaque, ((right - left) * (bottom - top)) as u32]
    }

    fn is_opaque_at_centre(&self, uv: &[[f32; 2]; 3]) -> bool {
        let centre = array::from_fn(|axis| uv.iter().map(|uv| uv[axis]).sum::<f32>() / 3.0);
        let [[x, _], [y, _]] = self.texels_of(&[centre; 3]);
        self.count([[x, x + 1], [y, y + 1]])[0] > 0
    }
}

/// The corner at which the longest edge begins, and its length.
fn longest_edge(corners: &[[f64; 3]; 3]) -> (usize, f64) {
    let squared = |i: usize| (0..3).map(|axis| (corners[i][axis] - corners[(i + 1) % 3][axis]).powi(2)).sum::<f64>();
    let longest = (1..3).fold(0, |longest, i| if squared(i) > squared(longest) { i } else { longest });
    (longest, squared(longest).sqrt())
}

/// The halves of a piece, divided in the middle of the edge that begins at corner `edge`.
fn halves(piece: &Piece, edge: usize) -> [Piece; 2] {
    let next = (edge + 1) % 3;
    let corner = array::from_fn(|axis| (piece.0[edge][axis] + piece.0[next][axis]) / 2.0);
    let uv = array::from_fn(|axis| (piece.1[edge][axis] + piece.1[next][axis]) / 2.0);
    let with_middle_at = |i: usize| {
        let mut half = *piece;
        (half.0[i], half.1[i]) = (corner, uv);
        half
    };
    [with_middle_at(next), with_middle_at(edge)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Area of the opaque pieces of the square from 0 to 1, whose texture repeats `repeat` times, and their number.
    fn area(mask: &AlphaMask, repeat: f32, min_edge_m: f64) -> (f64, usize) {
        let corner = |x: f64, y: f64| [x, y, 5.0];
        let uv = |x: f32, y: f32| [x * repeat, y * repeat];
        let triangles = [
            ([corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0)], [uv(0.0, 0.0), uv(1.0, 0.0), uv(1.0, 1.0)]),
            ([corner(0.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)], [uv(0.0, 0.0), uv(1.0, 1.0), uv(0.0, 1.0)]),
        ];
        let (mut sum, mut count) = (0.0, 0);
        for triangle in triangles {
            mask.cut(triangle, min_edge_m, &mut |([a, b, c], _)| {
                sum += ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2.0;
                count += 1;
            });
        }
        (sum, count)
    }

    /// A texture of 64 x 64 texels with a hole over the rows from `top` and columns from `left`.
    fn mask(top: usize, left: usize) -> AlphaMask {
        let alpha = |i: usize| if i / 64 >= top && i % 64 >= left { 10 } else { 255 };
        let alpha: Vec<u8> = (0..64 * 64).map(alpha).collect();
        AlphaMask::new(&AlphaGrid::new(64, 64, &alpha).unwrap(), 0.5).unwrap()
    }

    #[test]
    fn transparent_pieces_are_dropped() {
        let (kept, pieces) = area(&mask(32, 32), 1.0, 0.0);
        assert!((kept - 0.75).abs() < 0.01, "{kept}");
        assert!(pieces < 1000, "{pieces}");
        let (kept, _) = area(&mask(32, 0), 3.0, 0.0);
        assert!((kept - 0.5).abs() < 0.02, "{kept}");
        // The hole is in the lower half: v points up.
        let mut lowest = f64::INFINITY;
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        mask(32, 0).cut((corners, [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), 0.0, &mut |(corners, _)| {
            lowest = corners.iter().fold(lowest, |lowest, corner| lowest.min(corner[1]));
        });
        assert!((lowest - 0.5).abs() < 0.02, "{lowest}");
    }

    #[test]
    fn pieces_are_bounded() {
        let chess: Vec<u8> = (0..64 * 64).map(|i| if (i + i / 64) % 2 == 0 { 0 } else { 255 }).collect();
        let chess = AlphaMask::new(&AlphaGrid::new(64, 64, &chess).unwrap(), 0.5).unwrap();
        let (kept, pieces) = area(&chess, 1e6, 0.0);
        assert!(pieces <= 1 << (MAX_DEPTH + 1) && kept > 0.3 && kept < 0.7, "{pieces} {kept}");
        let (_, pieces) = area(&chess, 1.0, 0.25);
        assert!(pieces < 100, "{pieces}");
        area(&chess, f32::NAN, 0.0);
        area(&chess, f32::INFINITY, 0.0);
    }

    #[test]
    fn textures_without_holes_have_no_mask() {
        assert!(AlphaGrid::new(2, 2, &[255; 4]).is_none());
        assert!(AlphaGrid::new(2, 2, &[0; 3]).is_none());
        let grid = AlphaGrid::new(300, 2, &[200; 600]).unwrap();
        assert_eq!((grid.width, grid.height), (128, 2));
        assert!(AlphaMask::new(&grid, 0.5).is_none());
        assert!(AlphaMask::new(&grid, 0.9).is_some());
    }
}
