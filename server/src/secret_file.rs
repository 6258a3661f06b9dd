//! Files of secrets, one per line: tokens, and keys of share links.
//!
//! What a file does not list is not valid. So a file that is missing, too large or no file has no entries, and a malformed line
//! makes only that line useless.

use insula_archive::file::read_limited;
use std::path::Path;

const MAX_FILE_BYTES: u64 = 1 << 20;

/// The valid entries of a file, and what is wrong with the rest. No message quotes a line.
#[derive(Debug)]
pub(crate) struct SecretFile<T> {
    pub(crate) entries: Vec<T>,
    pub(crate) faults: Vec<String>,
}

impl<T> SecretFile<T> {
    /// Reads a file, where `parse` reads one line. Empty lines and lines that begin with `#` are ignored.
    pub(crate) fn read(path: &Path, parse: impl Fn(&str) -> Result<T, &'static str>) -> Self {
        let place = path.display();
        let text = match read_limited(path, MAX_FILE_BYTES) {
            Ok(text) => text,
            Err(error) => return Self { entries: Vec::new(), faults: vec![format!("{place}: {error}")] },
        };
        let (mut entries, mut faults) = (Vec::new(), Vec::new());
        for (number, line) in text.split(|byte| *byte == b'\n').enumerate() {
            let line = line.trim_ascii();
            if line.is_empty() || line.starts_with(b"#") {
                continue;
            }
            match std::str::from_utf8(line).map_err(|_| "is not text").and_then(&parse) {
                Ok(entry) => entries.push(entry),
                Err(reason) => faults.push(format!("{place}, line {}, {reason}: the line is ignored", number + 1)),
            }
        }
        if entries.is_empty() && faults.is_empty() {
            faults.push(format!("{place}: the file has no entry"));
        }
        Self { entries, faults }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn only_valid_lines_are_entries() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let read = |text: &[u8]| {
            fs::write(file.path(), text).unwrap();
            let SecretFile { entries, faults } =
                SecretFile::read(file.path(), |line| if line.len() > 3 { Ok(line.to_owned()) } else { Err("short") });
            (entries, faults)
        };
        let (entries, faults) = read(b"# note\n\nfirst \nx!\r\n\xff\xfe\xfd\xfc\nlast");
        assert_eq!(entries, ["first", "last"]);
        assert!(faults.len() == 2 && faults[0].contains("line 4, short") && faults[1].contains("line 5"), "{faults:?}");
        assert!(!faults.concat().contains("x!"), "no line is quoted");
        for text in [&b""[..], b"# nothing", &vec![b'x'; 1 + MAX_FILE_BYTES as usize]] {
            let (entries, faults) = read(text);
            assert_eq!((entries.len(), faults.len()), (0, 1));
        }
        for path in [Path::new("/dev/zero"), Path::new("/nowhere"), Path::new("/")] {
            let SecretFile { entries, faults } = SecretFile::read(path, |_| Ok(()));
            assert_eq!((entries.len(), faults.len()), (0, 1), "{faults:?}");
        }
    }
}
