//! Coding of prediction errors whose expected size is known as a variance.
//!
//! An error is shifted right so that its standard deviation is two or three steps. The rest is coded as a symbol, by
//! the half-octave of the variance, and the bits that were shifted out are coded raw.

use crate::codec::rans::{RAW, SymbolCoder, SymbolModel};

/// Number of half-octaves of the standard deviation that are distinguished.
const SCALES: usize = 36;
/// Tokens from `-NEAR` to `NEAR` have a symbol each.
const NEAR: i32 = 7;
/// Symbol of all other tokens.
const FAR: usize = 15;

/// Models of prediction errors, and of the first vertex of a piece.
pub(super) struct ScanModels {
    /// By axis and scale.
    token: [[SymbolModel<16>; SCALES]; 3],
    far_token: SymbolModel<32>,
    /// By axis: difference of a piece's first vertex from the last coded vertex.
    pub(super) first: [SymbolModel<32>; 3],
}

impl ScanModels {
    pub(super) fn new() -> Self {
        let shapes = SHAPES.map(|shape| SymbolModel::new(|symbol| typical_count(shape, symbol)));
        let of_axis: [_; SCALES] =
            std::array::from_fn(|scale| shapes[if scale < 6 { scale } else { 6 + scale % 2 }].clone());
        Self {
            token: [of_axis.clone(), of_axis.clone(), of_axis],
            far_token: SymbolModel::default(),
            first: Default::default(),
        }
    }

    /// Codes the errors of three coordinates with these variances.
    #[inline]
    pub(super) fn code<C: SymbolCoder>(&mut self, coder: &mut C, variances: [f32; 3], errors: [i32; 3]) -> [i32; 3] {
        // The exponent of the variance counts half-octaves of the standard deviation.
        let scale = |variance: f32| ((variance.to_bits() >> 23) as i32 - 123).clamp(0, SCALES as i32 - 1) as usize;
        let scales = variances.map(scale);
        let shifts = scales.map(|scale| (scale as u32 / 2).saturating_sub(3));
        let tokens: [i32; 3] = std::array::from_fn(|axis| errors[axis] >> shifts[axis]);
        let to_symbol = |token: i32| if (-NEAR..=NEAR).contains(&token) { (token + NEAR) as usize } else { FAR };
        let [x, y, z] = &mut self.token;
        let models = [&mut x[scales[0]], &mut y[scales[1]], &mut z[scales[2]]];
        let symbols = coder.three(models, tokens.map(to_symbol));
        let near = symbols.map(|symbol| symbol as i32 - NEAR);
        let tokens = if symbols.contains(&FAR) { self.code_far(coder, symbols, tokens) } else { near };
        if shifts == [0; 3] {
            return tokens;
        }
        let low = |axis: usize| errors[axis] as u32 & ((1 << shifts[axis]) - 1);
        let [a, b, c] = shifts;
        if a + b + c <= RAW {
            let all = coder.raw(a + b + c, (low(0) << b | low(1)) << c | low(2));
            let lows = [all >> (b + c), all >> c & ((1 << b) - 1), all & ((1 << c) - 1)];
            return std::array::from_fn(|axis| tokens[axis].wrapping_shl(shifts[axis]) | lows[axis] as i32);
        }
        std::array::from_fn(|axis| tokens[axis].wrapping_shl(shifts[axis]) | coder.raw(shifts[axis], low(axis)) as i32)
    }

    /// Codes the tokens whose symbol is [`FAR`] as numbers.
    #[cold]
    fn code_far<C: SymbolCoder>(&mut self, coder: &mut C, symbols: [usize; 3], tokens: [i32; 3]) -> [i32; 3] {
        std::array::from_fn(|axis| {
            if symbols[axis] != FAR {
                return symbols[axis] as i32 - NEAR;
            }
            let token = tokens[axis];
            let excess = token.unsigned_abs().wrapping_sub(NEAR as u32 + 1) << 1 | u32::from(token < 0);
            let excess = coder.number(&mut self.far_token, excess);
            // A reader may get any number here. The position is checked against the grid later.
            let magnitude = ((excess >> 1) as i32).wrapping_add(NEAR + 1);
            if excess & 1 == 1 { magnitude.wrapping_neg() } else { magnitude }
        })
    }
}

/// Initial frequencies: of the tokens -1 and 1, from each token to the next one, and of [`FAR`]. Token 0 has 1000.
/// For the scales 0 to 5, and for larger even and odd ones. Read off the errors of about thirty meshes.
const SHAPES: [[u32; 4]; 8] = [
    [20, 100, 100, 1],
    [25, 140, 100, 1],
    [70, 290, 100, 1],
    [150, 400, 130, 2],
    [330, 590, 270, 6],
    [420, 650, 410, 13],
    [550, 550, 560, 55],
    [600, 600, 670, 200],
];

/// Initial frequency of a symbol: a geometric distribution.
fn typical_count([below, above, step, far]: [u32; 4], symbol: usize) -> u32 {
    if symbol == FAR {
        return 1000 * far;
    }
    let middle = NEAR as usize;
    let mut count = 1_000_000;
    for distance in 0..symbol.abs_diff(middle) {
        let first = if symbol < middle { below } else { above };
        count = count / 1000 * if distance == 0 { first } else { step };
    }
    count + 100
}
