//! Models of single mesh files, and their simplification.

pub mod disjoint_sets;
pub mod model;
pub mod repair;
pub mod simplify;
pub mod surface;
