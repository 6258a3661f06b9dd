//! Objects of a city: what is known of them, and how they are drawn.

mod catalog;
mod coloring;
mod styles;

pub use catalog::CityObjects;
pub use coloring::{FilteredOut, ObjectQuery, StyleBuilder};
pub use styles::ObjectStyles;
