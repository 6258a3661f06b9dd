//! Files in buckets of object stores (`s3://BUCKET/NAME`): one, all below a folder, or those of a pattern.

use super::address_reader::{AddressReader, ListedObject};
use super::archive::is_archive;
use super::input::{LocalFile, SourceFiles};
use super::input_budget::{InputBudget, MAX_INPUT_BYTES};
use super::random_file::{RandomFile, copy_up_to};
use super::remote::check_name;
use super::source::{CitySource, kind_by_name};
use super::unread_formats;
use crate::error::InputError;
use std::io::{self, Read};
use std::rc::Rc;
use std::sync::Arc;

/// What an input in a bucket stands for.
pub enum BucketInput {
    File(CitySource<'static>),
    Folder {
        files: Rc<BucketFiles>,
        /// Those below the folder; those that match the pattern if there is one.
        objects: Vec<ListedObject>,
        /// Names below the folder that are no paths, and are not read.
        refused: Vec<String>,
    },
}

/// The files of a folder of a bucket and of its subfolders.
pub struct BucketFiles {
    /// Ends in `/`.
    pub folder: String,
    reader: &'static dyn AddressReader,
    budget: Arc<InputBudget>,
}

/// Finds the files of an input. An address is that of a file if it has the name of one, else that of a folder. Fails if there is
/// no such file, the folder cannot be listed, or the file's format is not read.
pub fn open(address: &str, reader: &'static dyn AddressReader) -> Result<BucketInput, InputError> {
    let io_error = |cause| InputError::io(address, cause);
    let (folder, name) = address.rsplit_once('/').unwrap_or((address, ""));
    let files = |folder: &str| {
        let folder = format!("{}/", folder.trim_end_matches('/'));
        Rc::new(BucketFiles { folder, reader, budget: Arc::new(InputBudget::start()) })
    };
    if let Some(wild) = address.find(['*', '?', '[']) {
        let folder = address[..wild].rsplit_once('/').map_or("", |(folder, _)| folder);
        let pattern = glob::Pattern::new(address);
        let pattern = pattern.map_err(|error| InputError::unsupported(address, format!("no pattern: {error}")))?;
        let options = glob::MatchOptions { require_literal_separator: true, ..glob::MatchOptions::new() };
        let files = files(folder);
        let (mut objects, refused) = files.list().map_err(io_error)?;
        objects.retain(|object| pattern.matches_with(&format!("{}{}", files.folder, object.name), options));
        return Ok(BucketInput::Folder { files, objects, refused });
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
    let (objects, refused) = files.list().map_err(io_error)?;
    Ok(BucketInput::Folder { files, objects, refused })
}

impl BucketFiles {
    /// The objects below the folder, and the names of those that are no paths: no file of a folder has such a name.
    fn list(&self) -> io::Result<(Vec<ListedObject>, Vec<String>)> {
        let is_path = |name: &str| !name.split('/').any(|word| matches!(word, "" | "." | ".."));
        let (objects, refused): (Vec<_>, Vec<_>) =
            self.reader.list(&self.folder)?.into_iter().partition(|object| is_path(&object.name));
        Ok((objects, refused.into_iter().map(|object| object.name).collect()))
    }

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
        copy_up_to(&mut self.open(name)?, MAX_INPUT_BYTES)
    }

    fn random(&self, name: &str) -> io::Result<RandomFile> {
        let address = self.address(name)?;
        let bytes = self.reader.size(&address)?;
        Ok(RandomFile::of_object(address, bytes, self.reader, Arc::clone(&self.budget)))
    }

    fn is_random(&self) -> bool {
        true
    }

    fn location(&self) -> String {
        self.folder.clone()
    }
}
