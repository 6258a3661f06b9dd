//! How much the tests do: the quick tier by default, the full tier with `INSULA_TESTS=full`.

/// Whether the full tier runs.
pub fn is_full() -> bool {
    std::env::var("INSULA_TESTS").is_ok_and(|tier| tier == "full")
}

/// Number of random cases of a property.
pub fn cases() -> u32 {
    if is_full() { 1000 } else { 32 }
}
