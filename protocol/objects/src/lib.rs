//! The objects of a baked city as data: what they are, their attributes, filters, colours and search.
//!
//! The bake writes these formats, the server and the viewers read them. The crate has no I/O. Decoders accept untrusted bytes: they
//! never panic, and never allocate more than the limits of the formats.

pub mod attribute_names;
pub mod block;
pub mod color;
pub mod family;
pub mod filter;
pub mod kind;
pub mod schema;
pub mod search;
mod suggest;
pub mod value;

pub use block::{BLOCK_OBJECTS, ObjectBlock, ObjectBounds, ObjectRecord};
pub use color::{ColorBy, ColorError, Legend, LegendEntry, Ramp};
pub use filter::{Filter, FilterError};
pub use kind::FeatureKind;
pub use schema::{AttributeInfo, AttributeLabel, Labels, NamedValues, Schema, SchemaBuilder};
pub use value::{Value, ValueType};
