//! Files of a bucket as sources.

use crate::read::bad_inputs::BadInputs;
use crate::read::context::ReadOptions;
use crate::read::list::list;
use crate::read::slice::slices;
use insula_source::address_reader::{AddressReader, ListedObject};
use insula_source::error::InputError;
use insula_source::source::CitySource;
use std::io::{self, Read};
use std::ops::Range;
use std::path::PathBuf;

/// The bucket `town`: each object has its own name as its bytes.
#[derive(Debug)]
struct Town;

const NAMES: [&str; 6] = ["a.obj", "in/b.geojsonl", "in/c.parquet", "in/deep/d.obj", "in/deep/photo.png", "in/e.ifc"];

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
