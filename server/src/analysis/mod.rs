//! Answers of analyses, for the command and for clients of the server: values with what they say, their colours, areas of equal ones, sheets
//! of paper, and pictures of what places see.

pub(crate) mod answer;
pub(crate) mod colors;
pub(crate) mod error;
pub(crate) mod evidence;
pub(crate) mod regions;
pub(crate) mod request;
pub(crate) mod samples;
pub(crate) mod sheet;
