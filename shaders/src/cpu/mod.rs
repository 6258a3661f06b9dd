//! The CPU twins of the WGSL stages: same names, same results.

mod column;
mod machine;
mod mesh;
pub mod raycast;
pub mod shade;
pub mod tally;
