//! Unit vectors in two bytes, by the octahedral map.
//!
//! Cigolle et al., *A Survey of Efficient Representations for Independent Unit Vectors*, JCGT 2014.

/// Encodes a vector of any length. The low byte is x, the high byte y. Each is 0 to 254 for -1 to 1, and 127 is exactly
/// 0, so that straight up is exact. A zero or NaN vector gives straight up.
pub fn encode(n: [f32; 3]) -> u16 {
    let sum = n[0].abs() + n[1].abs() + n[2].abs();
    if sum.is_nan() || sum <= 0.0 {
        return encode([0.0, 0.0, 1.0]);
    }
    let (mut x, mut y) = (n[0] / sum, n[1] / sum);
    if n[2] < 0.0 {
        (x, y) = ((1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y));
    }
    let byte = |v: f32| ((v * 127.0).round() + 127.0).clamp(0.0, 254.0) as u16;
    byte(x) | byte(y) << 8
}

/// Decodes two bytes of [`encode`]. Every `u16` decodes to a unit vector.
pub fn decode(code: u16) -> [f32; 3] {
    let unpack = |b: u16| (f32::from(b.min(254)) - 127.0) / 127.0;
    let (mut x, mut y) = (unpack(code & 0xff), unpack(code >> 8));
    let z = 1.0 - x.abs() - y.abs();
    if z < 0.0 {
        (x, y) = ((1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y));
    }
    let length = (x * x + y * y + z * z).sqrt();
    [x / length, y / length, z / length]
}

fn sign(v: f32) -> f32 {
    if v < 0.0 { -1.0 } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_is_below_two_degrees_everywhere() {
        for i in 0..2000 {
            let z = 1.0 - 2.0 * (i as f32 + 0.5) / 2000.0;
            let a = i as f32 * 2.399_963;
            let r = (1.0 - z * z).sqrt();
            let n = [r * a.cos(), r * a.sin(), z];
            let m = decode(encode(n));
            let dot: f32 = n.iter().zip(m).map(|(a, b)| a * b).sum();
            assert!(dot > 0.9998, "{n:?} {m:?}");
        }
        assert_eq!(decode(encode([0.0, 0.0, 1.0])), [0.0, 0.0, 1.0]);
        assert!(decode(encode([f32::NAN; 3]))[2] > 0.99);
        for code in [0, 0xffff, 0xff00] {
            assert!(decode(code).iter().all(|v| v.is_finite()));
        }
    }
}
