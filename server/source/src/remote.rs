//! Files on a web server: a tileset and its tiles, or any other city file.

use super::address_reader::AddressReader;
use super::input::{LocalFile, SourceFiles};
use super::input_budget::InputBudget;
use super::random_file::copy_to_disk;
use super::source::{CitySource, kind_by_name};
use crate::error::InputError;
use insula_protocol::route::without_secrets;
use percent_encoding::{AsciiSet, CONTROLS, utf8_percent_encode};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{self, Cursor, Read};

/// Larger files are refused: each is in memory.
const MAX_FILE_BYTES: u64 = 1 << 30;
/// Characters of a file's name that an address cannot have, and `\\`, which is another `/` in it. Names in tilesets are decoded before.
const ESCAPED: &AsciiSet =
    &CONTROLS.add(b' ').add(b'"').add(b'#').add(b'%').add(b'<').add(b'>').add(b'?').add(b'`').add(b'\\');

/// Whether an input is an address, of a web server or of a bucket.
pub fn is_address(input: &str) -> bool {
    ["http://", "https://", "s3://"].iter().any(|scheme| input.starts_with(scheme))
}

/// Fails if a name within a folder leads out of it.
pub fn check_name(name: &str) -> io::Result<()> {
    let leads_out = name.starts_with('/') || name.contains("://") || name.split('/').any(|part| part == "..");
    if leads_out {
        return Err(io::Error::new(io::ErrorKind::PermissionDenied, "it lies outside of the source's folder"));
    }
    Ok(())
}

/// The files below the folder of an address.
struct RemoteFiles {
    /// Ends in `/`.
    folder: String,
    /// Query of the input's address, from `?` on: all its files need the same signature or key.
    query: String,
    reader: &'static dyn AddressReader,
    budget: InputBudget,
}

/// The source at an address of a web server. Fails if its name is not that of a city file.
pub fn source(url: &str, reader: &'static dyn AddressReader) -> Result<CitySource<'static>, InputError> {
    let asked = url.split('#').next().unwrap_or(url);
    let (plain, query) = asked.split_at(asked.find('?').unwrap_or(asked.len()));
    let label = without_secrets(url).into_owned();
    let (folder, name) = plain.rsplit_once('/').unwrap_or((plain, ""));
    if kind_by_name(name).is_none() {
        let what = "its name is not that of a city file; give the address of a tileset.json";
        return Err(InputError::unknown_format(&label, what));
    }
    let (folder, query) = (format!("{folder}/"), query.to_owned());
    let files = RemoteFiles { folder, query, reader, budget: InputBudget::start() };
    let name = percent_encoding::percent_decode_str(name).decode_utf8_lossy().into_owned();
    Ok(CitySource::new(label, name, std::rc::Rc::new(files), 0))
}

impl RemoteFiles {
    fn get(&self, name: &str) -> io::Result<Vec<u8>> {
        check_name(name)?;
        let (path, own) = name.split_at(name.find('?').unwrap_or(name.len()));
        let query = match own {
            "" => self.query.clone(),
            own => format!("{own}{}", self.query.replacen('?', "&", 1)),
        };
        let url = format!("{}{}{query}", self.folder, utf8_percent_encode(path, ESCAPED));
        self.budget.check(&self.folder)?;
        let bytes = self.reader.fetch(&url, MAX_FILE_BYTES)?;
        self.budget.spend(bytes.len() as u64);
        Ok(bytes)
    }
}

impl SourceFiles for RemoteFiles {
    fn open(&self, name: &str) -> io::Result<Box<dyn Read + '_>> {
        Ok(Box::new(Cursor::new(self.get(name)?)))
    }

    /// Always 0: the size is not known before the file is fetched.
    fn len(&self, _name: &str) -> io::Result<u64> {
        Ok(0)
    }

    fn on_disk(&self, name: &str) -> io::Result<LocalFile> {
        copy_to_disk(&mut Cursor::new(self.get(name)?))
    }

    /// With a hash of user, password and query in their place: files of two inputs may differ by these alone.
    fn location(&self) -> String {
        let mut hasher = DefaultHasher::new();
        (&self.folder, &self.query).hash(&mut hasher);
        format!("{}#{:016x}", without_secrets(&self.folder), hasher.finish())
    }
}

#[cfg(test)]
mod tests {
    use super::super::address_reader::ListedObject;
    use super::*;
    use std::ops::Range;

    #[derive(Debug)]
    struct Echo;

    impl AddressReader for Echo {
        fn fetch(&self, url: &str, _: u64) -> io::Result<Vec<u8>> {
            Ok(url.as_bytes().to_vec())
        }

        fn list(&self, _: &str) -> io::Result<Vec<ListedObject>> {
            Err(io::ErrorKind::Unsupported.into())
        }

        fn size(&self, _: &str) -> io::Result<u64> {
            Err(io::ErrorKind::Unsupported.into())
        }

        fn range(&self, _: &str, _: Range<u64>) -> io::Result<Vec<u8>> {
            Err(io::ErrorKind::Unsupported.into())
        }
    }

    #[test]
    fn names_are_below_the_folder_of_the_address() {
        let source = source("https://me:secret@example.org/a%20b/tileset.json?key=1#x", &Echo).unwrap();
        assert_eq!(
            (source.name.as_str(), source.label.as_str()),
            ("tileset.json", "https://example.org/a%20b/tileset.json")
        );
        let location = source.files.location();
        assert!(location.starts_with("https://example.org/a%20b/#"), "{location}");
        let other = super::source("https://me:secret@example.org/a%20b/tileset.json?key=2", &Echo).unwrap();
        assert_ne!(location, other.files.location(), "the query may choose the files");
        let read = |name: &str| {
            let mut text = String::new();
            source.files.open(name)?.read_to_string(&mut text).map(|_| text)
        };
        let base = "https://me:secret@example.org/a%20b/";
        assert_eq!(read("tileset.json").unwrap(), format!("{base}tileset.json?key=1"));
        assert_eq!(read("tiles/0 1.b3dm").unwrap(), format!("{base}tiles/0%201.b3dm?key=1"));
        assert_eq!(read("..\\..\\x").unwrap(), format!("{base}..%5C..%5Cx?key=1"));
        assert_eq!(read("a.glb?session=7").unwrap(), format!("{base}a.glb?session=7&key=1"));
        for name in ["../x", "/x", "http://other/x", "a/../../x"] {
            assert_eq!(read(name).unwrap_err().kind(), io::ErrorKind::PermissionDenied, "{name}");
        }
        assert!(super::source("https://example.org/city", &Echo).is_err());
    }
}
