//! Files in buckets of object stores (`s3://BUCKET/NAME`): one, all below a folder, or those of a pattern.

use std::io::{self, Read};
use std::rc::Rc;

use super::address_reader::{AddressReader, ListedObject};
use super::archive::is_archive;
use super::input::{LocalFile, SourceFiles};
use super::random_file::RandomFile;
use super::random_file::copy_to_disk;
use super::remote::check_name;
use super::source::{CitySource, kind_by_name};
use super::unread_formats;
use crate::error::InputError;

/// What an input in a bucket stands for.
pub(super) enum BucketInput {
    File(CitySource<'static>),
    Folder {
        files: Rc<BucketFiles>,
        /// Those below the folder; those that match the pattern if there is one.
        objects: Vec<ListedObject>,
    },
}

/// The files of a folder of a bucket and of its subfolders.
pub(super) struct BucketFiles {
    /// Ends in `/`.
    pub(super) folder: String,
    reader: &'static dyn AddressReader,
}

/// Finds the files of an input. An address is that of a file if it has the name of one, else that of a folder. Fails if there is
/// no such file, the folder cannot be listed, or the file's format is not read.
pub(super) fn open(address: &str, reader: &'static dyn AddressReader) -> Result<BucketInput, InputError> {
    let io_error = |cause| InputError::io(address, cause);
    let (folder, name) = address.rsplit_once('/').unwrap_or((address, ""));
    let files = |folder: &str| Rc::new(BucketFiles { folder: format!("{}/", folder.trim_end_matches('/')), reader });
    if let Some(wild) = address.find(['*', '?', '[']) {
        let folder = address[..wild].rsplit_once('/').map_or("", |(folder, _)| folder);
        let pattern = glob::Pattern::new(address);
        let pattern = pattern.map_err(|error| InputError::unsupported(address, format!("no pattern: {error}")))?;
        let options = glob::MatchOptions { require_literal_separator: true, ..glob::MatchOptions::new() };
        let files = files(folder);
        let mut objects = reader.list(&files.folder).map_err(io_error)?;
        objects.retain(|object| pattern.matches_with(&format!("{}{}", files.folder, object.name), options));
        return Ok(BucketInput::Folder { files, objects });
    }
    if is_archive(name) {
        let what = "archives in buckets are not read; unpack it into the bucket";
        return Err(InputError::unsupported(address, what));
    }
    if kind_by_name(name).is_some() {
        let bytes = reader.size(address).map_err(io_error)?;
        let source = CitySource::new(address.to_owned(), name.to_owned(), files(folder), bytes);
        return Ok(BucketInput::File(source));
    }
    if unread_formats::format_of(name).is_some() {
        return Err(unread_formats::refusal(address));
    }
    let files = files(address);
    let objects = reader.list(&files.folder).map_err(io_error)?;
    Ok(BucketInput::Folder { files, objects })
}

impl BucketFiles {
    fn address(&self, name: &str) -> io::Result<String> {
        check_name(name)?;
        Ok(format!("{}{name}", self.folder))
    }
}

impl SourceFiles for BucketFiles {
    fn open(&self, name: &str) -> io::Result<Box<dyn Read + '_>> {
        Ok(Box::new(self.random(name)?.reader(0)))
    }

    fn len(&self, name: &str) -> io::Result<u64> {
        self.reader.size(&self.address(name)?)
    }

    fn on_disk(&self, name: &str) -> io::Result<LocalFile> {
        copy_to_disk(&mut self.open(name)?)
    }

    fn random(&self, name: &str) -> io::Result<RandomFile> {
        let address = self.address(name)?;
        let bytes = self.reader.size(&address)?;
        Ok(RandomFile::of_object(address, bytes, self.reader))
    }

    fn is_random(&self) -> bool {
        true
    }

    fn location(&self) -> String {
        self.folder.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::super::bad_inputs::BadInputs;
    use super::super::context::ReadOptions;
    use super::super::list::list;
    use super::super::slice::slices;
    use super::*;
    use std::ops::Range;
    use std::path::PathBuf;

    /// The bucket `town`: each object has its own name as its bytes.
    #[derive(Debug)]
    struct Town;

    const NAMES: [&str; 6] =
        ["a.obj", "in/b.geojsonl", "in/c.parquet", "in/deep/d.obj", "in/deep/photo.png", "in/e.ifc"];

    impl AddressReader for Town {
        fn fetch(&self, _: &str, _: u64) -> io::Result<Vec<u8>> {
            Err(io::ErrorKind::Unsupported.into())
        }

        fn list(&self, folder: &str) -> io::Result<Vec<ListedObject>> {
            let folder = folder.strip_prefix("s3://town/").ok_or(io::ErrorKind::NotFound)?;
            let name = |name: &&str| Some(name.strip_prefix(folder)?.to_owned());
            let object = |name: String| ListedObject { bytes: (folder.len() + name.len()) as u64, name };
            Ok(NAMES.iter().filter_map(name).map(object).collect())
        }

        fn size(&self, address: &str) -> io::Result<u64> {
            let name = address.strip_prefix("s3://town/").filter(|name| NAMES.contains(name));
            name.map(|name| name.len() as u64).ok_or_else(|| io::ErrorKind::NotFound.into())
        }

        fn range(&self, address: &str, range: Range<u64>) -> io::Result<Vec<u8>> {
            let name = address.strip_prefix("s3://town/").ok_or(io::ErrorKind::NotFound)?;
            Ok(name.as_bytes()[range.start as usize..range.end as usize].to_vec())
        }
    }

    fn listed(input: &str) -> Result<Vec<CitySource<'static>>, InputError> {
        let options = ReadOptions { addresses: Some(&Town), ..ReadOptions::default() };
        Ok(list(&[PathBuf::from(input)], &options, &mut BadInputs::new(false))?.sources)
    }

    fn labels(input: &str) -> Vec<String> {
        listed(input).unwrap().into_iter().map(|source| source.label).collect()
    }

    #[test]
    fn files_folders_and_patterns_of_a_bucket_are_sources() {
        assert_eq!(labels("s3://town/a.obj"), ["s3://town/a.obj"]);
        let all = ["s3://town/in/b.geojsonl", "s3://town/in/c.parquet", "s3://town/in/deep/d.obj"];
        assert_eq!(labels("s3://town/in"), all);
        assert_eq!(labels("s3://town/in/"), all);
        assert_eq!(labels("s3://town/in/*.parquet"), ["s3://town/in/c.parquet"]);
        assert_eq!(labels("s3://town/in/**/*.obj"), ["s3://town/in/deep/d.obj"]);
        for input in ["s3://town/b.obj", "s3://town/out", "s3://other/a", "s3://town/in/*.gml", "s3://town/a.zip"] {
            assert!(listed(input).is_err(), "{input}");
        }
        let refused = list(&["s3://town/a.obj".into()], &ReadOptions::default(), &mut BadInputs::new(false));
        assert!(refused.is_err(), "a program without a reader of addresses");
    }

    #[test]
    fn bytes_are_those_of_objects_below_the_folder() {
        let source = listed("s3://town/in").unwrap().swap_remove(2);
        let read = |name: &str| {
            let mut text = String::new();
            source.files.open(name)?.read_to_string(&mut text).map(|_| text)
        };
        assert_eq!((source.name.as_str(), source.bytes), ("deep/d.obj", 13));
        assert_eq!(read(&source.name).unwrap(), "in/deep/d.obj");
        assert_eq!(read("deep/photo.png").unwrap(), "in/deep/photo.png");
        assert_eq!(std::fs::read(&source.files.on_disk("e.ifc").unwrap().path).unwrap(), b"in/e.ifc");
        assert_eq!(read("../a.obj").unwrap_err().kind(), io::ErrorKind::PermissionDenied);
        assert_eq!(read("none.png").unwrap_err().kind(), io::ErrorKind::NotFound);
    }

    #[test]
    fn objects_are_divided() {
        let sequence = listed("s3://town/in/b.geojsonl").unwrap().swap_remove(0);
        let slices = slices(sequence, 5);
        let mut texts = vec![String::new(); slices.len()];
        for (slice, text) in slices.iter().zip(&mut texts) {
            slice.files.open(&slice.name).unwrap().read_to_string(text).unwrap();
        }
        assert_eq!(texts, ["in/b.geojsonl", ""], "its only line begins in the first slice");
    }
}
