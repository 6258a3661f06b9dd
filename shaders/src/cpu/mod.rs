//! The CPU twins of the WGSL stages: same names, same results.

mod column;
pub mod raycast;
pub mod shade;
pub mod tally;
