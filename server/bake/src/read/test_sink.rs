//! A sink for tests.

use super::object::{CrsReference, Description, ObjectSink, SourceMaterial, SourceObject};
use crate::error::InputError;

/// Keeps everything.
#[derive(Debug, Default)]
pub(crate) struct TestSink {
    pub(crate) crs: Vec<CrsReference>,
    pub(crate) materials: Vec<SourceMaterial>,
    pub(crate) objects: Vec<SourceObject>,
    pub(crate) skipped: Vec<(&'static str, String)>,
    pub(crate) problems: Vec<(&'static str, String)>,
    pub(crate) described: Vec<(Description, String)>,
    pub(crate) bytes_done: u64,
}

impl ObjectSink for TestSink {
    fn set_crs(&mut self, crs: &CrsReference) -> Result<(), InputError> {
        self.crs.push(crs.clone());
        Ok(())
    }

    fn add_material(&mut self, material: SourceMaterial) -> u32 {
        if let Some(index) = self.materials.iter().position(|known| *known == material) {
            return index as u32;
        }
        self.materials.push(material);
        self.materials.len() as u32 - 1
    }

    fn add(&mut self, object: SourceObject) -> Result<(), InputError> {
        self.objects.push(object);
        Ok(())
    }

    fn skip(&mut self, reason: &'static str, detail: String) {
        self.skipped.push((reason, detail));
    }

    fn problem(&mut self, kind: &'static str, detail: String) {
        self.problems.push((kind, detail));
    }

    fn describe(&mut self, what: Description, text: &str) {
        self.described.push((what, text.to_owned()));
    }

    fn tick(&mut self, bytes_done: u64) {
        self.bytes_done = bytes_done;
    }
}
