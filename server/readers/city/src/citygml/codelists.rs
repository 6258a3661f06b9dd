//! Codelists beside the source: names of the codes of attributes.

use super::decode::TextReader;
use super::paths::relative_to;
use super::tree::Tree;
use super::tree_builder::{BuildContext, Built, build, start_tree};
use super::xml::{Event, XmlReader};
use insula_source::error::InputError;
use insula_source::input::SourceFiles;
use std::collections::HashMap;
use std::io::{BufReader, Read};

/// Longer codelists are read up to here.
const MAX_LIST_BYTES: u64 = 8 << 20;
/// Further codelists are not opened.
const MAX_LISTS: usize = 512;
/// Further codes are left out.
const MAX_CODES: usize = 1 << 20;

/// The codelists that attributes have named so far.
pub(super) struct Codelists<'a> {
    files: &'a dyn SourceFiles,
    source_name: &'a str,
    /// Names by codes, by the codelist's path as attributes have it. Empty for a file that is missing.
    lists: HashMap<Box<str>, HashMap<Box<str>, Box<str>>>,
    codes_left: usize,
}

impl<'a> Codelists<'a> {
    pub(super) fn new(files: &'a dyn SourceFiles, source_name: &'a str) -> Self {
        Self { files, source_name, lists: HashMap::new(), codes_left: MAX_CODES }
    }

    /// The name of a code; `None` if the codelist or the code is missing.
    pub(super) fn name_of(&mut self, code_space: &str, code: &str) -> Option<&str> {
        let is_path = !code_space.is_empty() && !code_space.contains("://") && !code_space.starts_with("urn:");
        if !is_path {
            return None;
        }
        if !self.lists.contains_key(code_space) {
            if self.lists.len() >= MAX_LISTS {
                return None;
            }
            let mut names = HashMap::new();
            // A codelist is an extra: what could be read of it counts.
            let _ = self.read(code_space, &mut names);
            self.codes_left -= names.len();
            self.lists.insert(code_space.into(), names);
        }
        self.lists.get(code_space)?.get(code).map(|name| &**name)
    }

    fn read(&self, code_space: &str, names: &mut HashMap<Box<str>, Box<str>>) -> Result<(), InputError> {
        let path = relative_to(self.source_name, code_space);
        let file = self.files.open(&path).map_err(|cause| InputError::io(&path, cause))?;
        let text = TextReader::new(&path, Box::new(BufReader::new(file.take(MAX_LIST_BYTES))), None)?;
        let mut reader = XmlReader::new(&path, text);
        let mut tree = Tree::default();
        let context = BuildContext { dimension: None, has_appearance: &|_| false };
        loop {
            match reader.next()? {
                Event::Start { name, element, is_empty: false, .. }
                    if element.local_name().as_ref() == "Definition" =>
                {
                    start_tree(&mut tree, name, &element);
                }
                Event::EndOfFile => return Ok(()),
                _ => continue,
            }
            if build(&mut reader, &mut tree, &context)? == Built::Complete && names.len() < self.codes_left {
                names.extend(definition(&tree, &reader));
            }
        }
    }
}

/// Code and name of a definition. The code is the identifier, or else the name; then its description is what it stands
/// for.
fn definition(tree: &Tree, reader: &XmlReader<'_>) -> Option<(Box<str>, Box<str>)> {
    let text = |local| tree.child_named(&reader.names, 0, local).and_then(|child| tree.text_of(child));
    let (identifier, name, description) = (text("identifier"), text("name"), text("description"));
    let code = identifier.or(name)?;
    let of_name = name.filter(|name| *name != code);
    Some((code.into(), of_name.or(description)?.into()))
}
