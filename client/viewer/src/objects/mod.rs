//! Objects of a city: what is known of them, and how they are drawn.

mod catalog;
mod coloring;
mod description;
mod style_rules;
mod styles;

pub use catalog::CityObjects;
pub use coloring::{FilteredOut, ObjectQuery, StyleBuilder};
pub use description::ObjectDescription;
pub use style_rules::{RulesError, StyleRules, StyledObjects};
pub use styles::{ObjectState, ObjectStyles};
