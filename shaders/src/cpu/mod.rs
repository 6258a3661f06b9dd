//! The CPU twins of the WGSL stages: same names, same results.

mod column;
pub mod hit_counts;
mod machine;
mod mesh;
pub mod raycast;
pub mod shade;
