//! What tests of readers need: a sink that keeps everything, files, and packed bytes.

use super::input::SourceFiles;
use super::object::{CrsReference, Description, ObjectSink, SourceMaterial, SourceObject};
use super::random_file::LocalFile;
use crate::error::InputError;
use flate2::Compression;
use flate2::write::GzEncoder;
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::PathBuf;

/// Keeps everything.
#[derive(Debug, Default)]
pub struct TestSink {
    pub crs: Vec<CrsReference>,
    pub materials: Vec<SourceMaterial>,
    pub objects: Vec<SourceObject>,
    pub skipped: Vec<(&'static str, String)>,
    pub problems: Vec<(&'static str, String)>,
    pub described: Vec<(Description, String)>,
    pub bytes_done: u64,
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

/// Files of a folder.
pub struct TestFiles(pub PathBuf);

impl SourceFiles for TestFiles {
    fn open(&self, name: &str) -> io::Result<Box<dyn Read + '_>> {
        Ok(Box::new(File::open(self.0.join(name))?))
    }

    fn len(&self, name: &str) -> io::Result<u64> {
        Ok(std::fs::metadata(self.0.join(name))?.len())
    }

    fn on_disk(&self, name: &str) -> io::Result<LocalFile> {
        Ok(LocalFile { path: self.0.join(name), copy: None })
    }

    fn location(&self) -> String {
        self.0.display().to_string()
    }
}

/// A text in UTF-16, without a mark.
pub fn utf16(text: &str, is_big_endian: bool) -> Vec<u8> {
    text.encode_utf16().flat_map(|unit| if is_big_endian { unit.to_be_bytes() } else { unit.to_le_bytes() }).collect()
}

/// The bytes, packed.
pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).and_then(|()| encoder.finish()).unwrap_or_default()
}
