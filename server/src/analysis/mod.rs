//! Answers of analyses, for the command and for clients of the server: values with what they say, their colours, and areas of equal ones.

pub(crate) mod answer;
pub(crate) mod colors;
pub(crate) mod regions;
pub(crate) mod request;
pub(crate) mod samples;
