//! Results of filters: any bytes give two bitmaps or an error.
#![no_main]
#![allow(clippy::unwrap_used, reason = "a finding is a panic")]

use insula_objects::filter::FilteredObjects;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(objects) = FilteredObjects::decode(bytes) {
        assert_eq!(FilteredObjects::decode(&objects.encode()).unwrap(), objects);
    }
});
