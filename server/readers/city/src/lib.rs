//! Reads CityGML.

mod citygml;

pub use citygml::read as read_citygml;
