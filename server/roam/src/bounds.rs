//! Error bounds of all triangles ("wedgies" in ROAM), computed once.

use super::deviation::deviation;
use super::diamond::{Diamond, Place, upwards};
use super::field::{HeightField, MAX_SIDE};

/// For each diamond an upper bound of the vertical distance between any sample and the drawn surface, two bytes each.
///
/// A diamond's bound is at least the exact deviation of its triangles and at least the bounds of all diamonds that can
/// be halved only after it. Halving exactly the diamonds with bounds above a limit therefore gives a closed surface.
pub(super) struct ErrorBounds {
    /// At the middle of each diamond.
    codes: Vec<u16>,
    side: u32,
}

impl ErrorBounds {
    /// Bounds for a field that is covered by root squares with `side` steps, rounded up to a power of two.
    pub(super) fn new(field: &HeightField, side: u32) -> Self {
        let side = side.clamp(2, MAX_SIDE).next_power_of_two();
        let mut bounds = Self { codes: vec![0; field.len()], side };
        for centre in upwards(field.ends(), side) {
            bounds.compute(field, centre);
        }
        bounds
    }

    /// Sets the bound of a diamond, from which the next larger ones inherit.
    fn compute(&mut self, field: &HeightField, centre: Place) {
        let (Some(index), Some(diamond)) = (field.index(centre), Diamond::at(centre, self.side)) else { return };
        let own = diamond.triangles().map(|corners| encode(deviation(field, &corners, f64::INFINITY))).max();
        let code = self.codes[index].max(own.unwrap_or(0));
        self.codes[index] = code;
        for apex in diamond.apexes.into_iter().flatten().filter_map(|apex| field.index(apex)) {
            self.codes[apex] = self.codes[apex].max(code);
        }
    }

    /// The bound of the diamond in the middle of which sample `index` lies, in metres. Infinite if it must be halved.
    pub(super) fn error_m(&self, index: usize) -> f32 {
        self.codes.get(index).map_or(f32::INFINITY, |code| decode(*code))
    }

    pub(super) fn side(&self) -> u32 {
        self.side
    }
}

/// The upper half of a positive number's bits after the sign, rounded up: 8 bits of its fraction remain.
fn encode(error: f64) -> u16 {
    let nearest = error as f32;
    let above = if f64::from(nearest) < error { nearest.next_up() } else { nearest };
    ((above.to_bits() + 0x7fff) >> 15) as u16
}

fn decode(code: u16) -> f32 {
    f32::from_bits(u32::from(code) << 15)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_round_up_by_less_than_half_a_percent() {
        for error in [0.0, 1e-30, 1e-3, 0.1, 0.5, 1.0, 1.001, 9.99, 123.4, 8848.86, 1e30, f64::from(f32::MAX)] {
            let decoded = f64::from(decode(encode(error)));
            assert!(decoded >= error && (decoded <= error * 1.004 || error > 1e38), "{error} {decoded}");
        }
        assert!(decode(encode(1e300)).is_infinite() && decode(encode(f64::INFINITY)).is_infinite());
    }
}
