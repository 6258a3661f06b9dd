//! What every reader gets and gives: files, objects with geometry and attributes, and the report.
//!
//! A reader takes an [`input::Input`] and calls an [`object::ObjectSink`]. It knows nothing of the bake.

pub mod address_reader;
pub mod affine;
pub mod arc;
pub mod archive;
pub mod attributes;
pub mod bucket;
pub mod code_page;
pub mod decimal_mark;
pub mod error;
pub mod file_names;
pub mod files;
pub mod input;
mod input_budget;
pub mod json;
pub mod letters;
mod made;
pub mod name_level;
pub mod object;
pub mod packed;
pub mod problems;
pub mod random_file;
pub mod remote;
pub mod report;
pub mod ring_inside;
pub mod source;
pub mod subject;
pub mod temporary;
pub mod testing;
pub mod text;
pub mod texture;
pub mod units;
pub mod unread_formats;
