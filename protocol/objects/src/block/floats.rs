//! Coding of a column of floats as integers, without loss.
//!
//! Sources have decimal numbers, decimal numbers that were rounded to f32, and other f32. Some of their values are an f64 beside
//! the right one, because a program wrote or read too few digits. So a column has the integers of the nearest values of such a
//! kind, and corrections in steps from one f64 to the next.

use super::cost::Cost;
use super::numbers::{self, History};
use insula_protocol::DecodeError;
use insula_protocol::codec::byte_reader::ByteReader;

/// Maximum digits after the point of decimal numbers.
const MAX_DECIMALS: u8 = 6;
/// Kinds up to this one: decimal numbers with as many digits.
const DECIMALS_MAX: u8 = MAX_DECIMALS;
/// Kinds from this one: the same, rounded to f32.
const DECIMALS_F32: u8 = 8;
const DECIMALS_F32_MAX: u8 = DECIMALS_F32 + MAX_DECIMALS;
/// The bits of f32, in the order of the values.
const F32: u8 = 16;
/// The bits of f64, in the order of the values.
const F64: u8 = 17;
/// Flag of a kind: corrections follow.
const CORRECTED: u8 = 32;

/// Largest correction for which a decimal kind is considered.
const MAX_CORRECTION: u64 = 1 << 12;

/// A column in one kind of integers.
struct Candidate {
    bytes: Vec<u8>,
    integers: Vec<i64>,
    cost: Cost,
}

/// Appends finite floats, one for each of `rows`, in the kind that takes the fewest bytes.
pub(super) fn encode(out: &mut Vec<u8>, rows: &[u16], floats: &[f64], history: &mut History) {
    // More digits than necessary only make numbers larger.
    let decimals = (0..=DECIMALS_MAX).find(|kind| is_likely(*kind, floats));
    let decimals_f32 = (DECIMALS_F32..=DECIMALS_F32_MAX).find(|kind| is_likely(*kind, floats));
    let kinds = [decimals, decimals_f32, Some(F32), Some(F64)];
    let candidates = kinds.into_iter().flatten().filter_map(|kind| candidate(kind, rows, floats, history));
    if let Some(best) = candidates.min_by_key(|candidate| candidate.cost) {
        out.extend_from_slice(&best.bytes);
        history.push(rows, &best.integers);
    }
}

/// Decodes a float for each of `rows`. The inverse of [`encode`].
pub(super) fn decode(
    reader: &mut ByteReader<'_>,
    rows: &[u16],
    history: &mut History,
) -> Result<Vec<f64>, DecodeError> {
    let kind = reader.u8()?;
    let integers = numbers::decode(reader, rows.len(), Some(rows), history)?;
    let corrections =
        if kind & CORRECTED == 0 { vec![0; rows.len()] } else { numbers::decode(reader, rows.len(), None, history)? };
    let float = |(integer, correction): (&i64, i64)| {
        let nearest = float(kind & !CORRECTED, *integer)?;
        Some(from_order(order(nearest).wrapping_add(correction))).filter(|value| value.is_finite())
    };
    let floats = integers.iter().zip(corrections).map(float).collect::<Option<_>>();
    history.push(rows, &integers);
    floats.ok_or(DecodeError::Invalid("a column of floats has an unknown kind or a value that is not finite"))
}

/// Whether most values are of a decimal kind, and all others almost.
fn is_likely(kind: u8, floats: &[f64]) -> bool {
    let correction = |value: &f64| correction(kind, *value, integer(kind, *value)?);
    let mut exact = 0;
    floats.iter().all(|value| {
        let found = correction(value);
        exact += usize::from(found == Some(0));
        found.is_some_and(|correction| correction.unsigned_abs() <= MAX_CORRECTION)
    }) && 4 * exact >= 3 * floats.len()
}

fn candidate(kind: u8, rows: &[u16], floats: &[f64], history: &History) -> Option<Candidate> {
    let integers: Vec<i64> = floats.iter().map(|value| integer(kind, *value)).collect::<Option<_>>()?;
    let correction = |(value, integer): (&f64, &i64)| correction(kind, *value, *integer);
    let corrections: Vec<i64> = floats.iter().zip(&integers).map(correction).collect::<Option<_>>()?;
    let coded = numbers::encode(&integers, Some(rows), history);
    if corrections.iter().all(|correction| *correction == 0) {
        return Some(Candidate { bytes: [vec![kind], coded.bytes].concat(), integers, cost: coded.cost });
    }
    let corrections = numbers::encode(&corrections, None, history);
    let bytes = [vec![kind | CORRECTED], coded.bytes, corrections.bytes].concat();
    Some(Candidate { bytes, integers, cost: coded.cost + corrections.cost })
}

/// Steps from the value of an integer to a float.
fn correction(kind: u8, value: f64, integer: i64) -> Option<i64> {
    Some(order(value).wrapping_sub(order(float(kind, integer)?)))
}

/// The integer of the value of a kind that is nearest to a float. `None` if it would be out of range.
fn integer(kind: u8, value: f64) -> Option<i64> {
    let decimal = |digits: u8| {
        let scaled = (value * 10f64.powi(i32::from(digits))).round();
        // Larger integers are not exact as f64.
        (scaled.abs() <= (1u64 << 53) as f64).then_some(scaled as i64)
    };
    match kind {
        0..=DECIMALS_MAX => decimal(kind),
        DECIMALS_F32..=DECIMALS_F32_MAX => decimal(kind - DECIMALS_F32),
        F32 => {
            let bits = (value as f32).to_bits() as i32;
            Some(i64::from(bits ^ ((bits >> 31) as u32 >> 1) as i32))
        }
        _ => Some(order(value)),
    }
}

/// The value of an integer. `None` if the kind is unknown or the value is not finite.
fn float(kind: u8, integer: i64) -> Option<f64> {
    let value = match kind {
        0..=DECIMALS_MAX => integer as f64 / 10f64.powi(i32::from(kind)),
        DECIMALS_F32..=DECIMALS_F32_MAX => {
            f64::from((integer as f64 / 10f64.powi(i32::from(kind - DECIMALS_F32))) as f32)
        }
        F32 => {
            let bits = i32::try_from(integer).ok()?;
            f64::from(f32::from_bits((bits ^ ((bits >> 31) as u32 >> 1) as i32) as u32))
        }
        F64 => from_order(integer),
        _ => return None,
    };
    value.is_finite().then_some(value)
}

/// Numbers floats in ascending order: 0 is +0, -1 is -0, neighbours have neighbouring numbers.
fn order(value: f64) -> i64 {
    let bits = value.to_bits() as i64;
    bits ^ ((bits >> 63) as u64 >> 1) as i64
}

/// The inverse of [`order`].
fn from_order(order: i64) -> f64 {
    f64::from_bits((order ^ ((order >> 63) as u64 >> 1) as i64) as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Encodes and decodes, and returns the kind.
    fn round_trip(floats: &[f64]) -> u8 {
        let rows: Vec<u16> = (0..floats.len() as u16).collect();
        let mut bytes = Vec::new();
        encode(&mut bytes, &rows, floats, &mut History::new(floats.len()));
        let mut reader = ByteReader::new(&bytes);
        let decoded = decode(&mut reader, &rows, &mut History::new(floats.len())).unwrap();
        reader.finish().unwrap();
        assert!(decoded.iter().map(|value| value.to_bits()).eq(floats.iter().map(|value| value.to_bits())));
        bytes[0]
    }

    #[test]
    fn columns_round_trip_in_the_kind_of_their_values() {
        let numbers = |f: fn(u32) -> f64| (0..512).map(f).collect::<Vec<_>>();
        assert_eq!(round_trip(&numbers(|i| f64::from(i * i % 997))), 0);
        assert_eq!(round_trip(&numbers(|i| f64::from(i * i % 99_991) / 100.0)), 2);
        assert_eq!(round_trip(&numbers(|i| f64::from((f64::from(i * i % 9973) / 1000.0) as f32))), DECIMALS_F32 + 3);
        assert_eq!(
            round_trip(&numbers(|i| f64::from(f32::from_bits(0x4100_0000 + i.wrapping_mul(0x9e37_79b9) % (1 << 23))))),
            F32
        );
        round_trip(&numbers(|i| f64::from(i).sin()));
        let beside = numbers(|i| f64::from_bits((f64::from(i * i % 9973) / 100.0).to_bits() + u64::from(i % 10 == 9)));
        assert_eq!(round_trip(&beside), 2 | CORRECTED);
        round_trip(&[
            0.0,
            -0.0,
            0.1,
            25.71,
            f64::MAX,
            f64::MIN,
            f64::MIN_POSITIVE,
            -5e-324,
            1e15 + 0.1,
            f64::from(f32::MAX),
        ]);
        round_trip(&[f64::MAX; 5]);
        round_trip(&[-0.0]);
    }

    #[test]
    fn orders_are_ascending_and_round_trip() {
        let ascending = [f64::MIN, -1.0, -5e-324, -0.0, 0.0, 5e-324, 1.0, f64::MAX];
        assert!(ascending.map(order).is_sorted());
        assert!(ascending.iter().all(|value| from_order(order(*value)).to_bits() == value.to_bits()));
        assert_eq!((order(0.0), order(-0.0)), (0, -1));
    }

    #[test]
    fn values_that_are_not_finite_and_unknown_kinds_are_refused() {
        let constant = |kind: u8, value: i64| {
            let mut bytes = vec![kind];
            bytes.extend(numbers::encode(&[value], None, &History::new(1)).bytes);
            decode(&mut ByteReader::new(&bytes), &[0], &mut History::new(1))
        };
        assert_eq!(constant(F64, order(2.5)), Ok(vec![2.5]));
        assert!(constant(F64, order(f64::INFINITY)).is_err() && constant(F64, order(f64::NAN)).is_err());
        assert!(constant(F32, i64::from(f32::INFINITY.to_bits())).is_err() && constant(F32, 1 << 40).is_err());
        assert!([7, 15, 18, 64].iter().all(|kind| constant(*kind, 0).is_err()));
    }
}
