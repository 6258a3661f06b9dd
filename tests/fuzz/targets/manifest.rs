//! Manifests in JSON and bincode: a manifest that passes its check round trips.
#![no_main]
#![allow(clippy::unwrap_used, reason = "a finding is a panic")]

use insula_protocol::{Manifest, codec::bincode};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let read = [bincode::from_bytes::<Manifest>(bytes).ok(), serde_json::from_slice(bytes).ok()];
    for manifest in read.into_iter().flatten().filter(|manifest| manifest.check().is_ok()) {
        let packed = bincode::to_bytes(&manifest).expect("a manifest can be packed");
        assert_eq!(bincode::from_bytes::<Manifest>(&packed).expect("and unpacked"), manifest);
        assert!((0..=manifest.depth).all(|level| manifest.cell_m_at(level) > 0.0));
    }
});
