//! zstd frames of known size.
//!
//! Native builds use the reference library in C. Builds for WebAssembly need no C compiler: they decompress with a
//! decoder in Rust and cannot compress.

#[cfg(not(target_arch = "wasm32"))]
mod native;
#[cfg(any(target_arch = "wasm32", test))]
mod portable;

use crate::error::DecodeError;
#[cfg(not(target_arch = "wasm32"))]
pub use native::compress;
#[cfg(not(target_arch = "wasm32"))]
use native::decompress_into;
#[cfg(target_arch = "wasm32")]
pub use portable::compress;
#[cfg(target_arch = "wasm32")]
use portable::decompress_into;

/// Decompresses a frame of exactly `raw_bytes` bytes. The caller must have checked `raw_bytes` against a limit, because
/// it is allocated. Fails on damaged frames and on any other size.
pub fn decompress(packed: &[u8], raw_bytes: usize) -> Result<Vec<u8>, DecodeError> {
    let mut raw = vec![0; raw_bytes];
    match decompress_into(packed, &mut raw)? {
        found if found == raw_bytes => Ok(raw),
        found => Err(DecodeError::Truncated { wanted: raw_bytes, found }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_test_support::rng::Rng;

    /// Decompresses with both decoders, which must agree.
    fn decompress_twice(packed: &[u8], raw_bytes: usize) -> Option<Vec<u8>> {
        let mut raw = [vec![0; raw_bytes], vec![0; raw_bytes]];
        let [first, second] = &mut raw;
        let found = native::decompress_into(packed, first);
        assert_eq!(found, portable::decompress_into(packed, second));
        let [first, second] = raw.map(|raw| found.clone().map(|found| raw[..found].to_vec()));
        assert_eq!(first, second);
        first.ok()
    }

    /// Text-like, constant and incompressible data.
    fn samples() -> Vec<Vec<u8>> {
        let mut rng = Rng::new(1);
        let kinds: [fn(u32) -> u8; 3] =
            [|i| b"columns and roofs "[(i % 18 * (i % 18) % 18) as usize], |_| 7, |i| i as u8];
        let mut samples: Vec<Vec<u8>> = kinds.iter().map(|kind| (0..70_000).map(kind).collect()).collect();
        samples.push((0..300_000).map(|_| rng.bits() as u8).collect());
        samples.extend([0, 1, 255, 256, 1023].map(|length| vec![b'x'; length]));
        samples
    }

    #[test]
    fn both_decoders_read_what_the_encoder_writes() {
        for raw in samples() {
            let packed = compress(&raw).unwrap();
            assert_eq!(decompress_twice(&packed, raw.len()), Some(raw.clone()));
            assert_eq!(decompress(&packed, raw.len()).unwrap(), raw);
        }
    }

    #[test]
    fn another_size_is_refused() {
        for raw in samples() {
            let packed = compress(&raw).unwrap();
            assert!(decompress(&packed, raw.len() + 1).is_err());
            let mut too_small = vec![0; raw.len().saturating_sub(1)];
            if !raw.is_empty() {
                assert!(native::decompress_into(&packed, &mut too_small).is_err());
                assert!(portable::decompress_into(&packed, &mut too_small).is_err());
            }
        }
    }

    #[test]
    fn truncated_frames_are_refused() {
        let raw = &samples()[0];
        let packed = compress(raw).unwrap();
        for length in 0..packed.len() {
            assert!(decompress(&packed[..length], raw.len()).is_err(), "{length}");
            let mut out = vec![0; raw.len()];
            let portable = portable::decompress_into(&packed[..length], &mut out);
            assert!(portable.is_err() || portable == Ok(0), "{length}");
        }
    }

    #[test]
    fn a_window_over_the_limit_is_refused_before_allocation() {
        // Magic, no content size, a window of 1 TiB, and one raw block of one byte.
        let frame = [0x28, 0xb5, 0x2f, 0xfd, 0x00, 30 << 3, 0x09, 0x00, 0x00, b'x'];
        assert!(portable::decompress_into(&frame, &mut [0; 1]).is_err());
        let small_window = [0x28, 0xb5, 0x2f, 0xfd, 0x00, 0x00, 0x09, 0x00, 0x00, b'x'];
        assert_eq!(decompress_twice(&small_window, 1), Some(vec![b'x']));
    }
}
