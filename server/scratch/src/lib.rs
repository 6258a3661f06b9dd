//! Records that memory does not hold: lists and sorting in scratch files.

pub mod error;
pub mod record_list;
pub mod record_sorter;
