//! The CPU twins of the WGSL stages: same names, same results.

pub mod raycast;
pub mod shade;
