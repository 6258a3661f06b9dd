//! Reads CityGML and CityJSON.

mod citygml;
mod cityjson;
mod degrees;

pub use citygml::read as read_citygml;
pub use cityjson::{CityJsonForm, read as read_cityjson};
