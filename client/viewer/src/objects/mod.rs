//! How objects are drawn: colours, hidden and outlined ones.

mod styles;

pub use styles::ObjectStyles;
