//! The objects' identifiers, in memory or in a scratch file. Only reports and messages need them.

use super::triangle_store::TriangleStore;
use std::fs::File;
use std::io::{self, BufRead, BufReader, BufWriter, Write};
use std::path::PathBuf;

/// Longer identifiers are cut in messages.
const MAX_CHARS: usize = 80;

/// Identifiers in the order of the objects.
#[derive(Debug)]
pub(crate) enum ObjectNames {
    Memory(Vec<String>),
    /// One per line. `None` if the file could not be written: a message then gives the object's number.
    File {
        path: PathBuf,
        writer: Option<BufWriter<File>>,
    },
}

impl ObjectNames {
    /// Keeps identifiers where the triangles are kept.
    pub(crate) fn for_triangles(triangles: &TriangleStore) -> Self {
        match triangles.own_file() {
            None => Self::Memory(Vec::new()),
            Some(file) => {
                let path = file.path().with_file_name("names");
                let writer = File::create_new(&path).ok().map(BufWriter::new);
                Self::File { path, writer }
            }
        }
    }

    pub(crate) fn push(&mut self, id: String) {
        match self {
            Self::Memory(names) => names.push(id),
            Self::File { writer, .. } => {
                let written = writer.as_mut().map_or(Ok(()), |file| writeln!(file, "{}", shorten(&id)));
                if written.is_err() {
                    *writer = None;
                }
            }
        }
    }

    /// Ends the writing.
    pub(crate) fn finish(&mut self) {
        if let Self::File { writer, .. } = self {
            let _ = writer.take().map(|mut file| file.flush());
        }
    }

    /// All identifiers, if they are in memory.
    pub(crate) fn in_memory(&self) -> &[String] {
        match self {
            Self::Memory(names) => names,
            Self::File { .. } => &[],
        }
    }

    /// An object's identifier for a message, else its number.
    pub(crate) fn describe(&self, object: u32) -> String {
        let found = match self {
            Self::Memory(names) => names.get(object as usize).map(|id| shorten(id)),
            Self::File { path, .. } => File::open(path).ok().and_then(|file| nth_line(file, object as usize)),
        };
        found.filter(|id| !id.is_empty()).unwrap_or_else(|| format!("number {object}"))
    }
}

fn nth_line(file: File, n: usize) -> Option<String> {
    let mut lines = BufReader::new(file).lines();
    lines.nth(n)?.map_err(|_: io::Error| ()).ok()
}

/// The identifier on one line.
fn shorten(id: &str) -> String {
    id.chars().map(|c| if c.is_control() { ' ' } else { c }).take(MAX_CHARS).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::scratch_budget::ScratchBudget;
    use insula_test_support::folder::TestFolder;

    #[test]
    fn names_are_found_again_in_memory_and_in_a_file() {
        let folder = TestFolder::new("names");
        let stored = TriangleStore::in_file(folder.path.join("triangles"), ScratchBudget::new(0)).unwrap();
        for triangles in [TriangleStore::Memory(Vec::new()), stored] {
            let mut names = ObjectNames::for_triangles(&triangles);
            ["a", "two\nlines", ""].into_iter().for_each(|id| names.push(id.to_owned()));
            names.finish();
            assert_eq!([0, 1, 2, 3].map(|i| names.describe(i)), ["a", "two lines", "number 2", "number 3"]);
        }
    }
}
