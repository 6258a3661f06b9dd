//! Where bytes come from: folders or memory, plain or gzip, counted and limited.
//!
//! In: paths as given, or named byte slices. Out: [`CitySource`]s and readers. Next: `cityjson`, `geojson`, `obj`.

use std::cell::Cell;
use std::collections::HashSet;
use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use flate2::read::MultiGzDecoder;

use super::error::InputError;

/// How far the reading is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadProgress {
    /// Bytes of the given files that are done, compressed if they are.
    pub bytes_done: u64,
    /// Bytes of all given files.
    pub bytes_total: u64,
}

/// Files that lie beside each other: a source, its material library and its pictures.
pub(crate) trait SourceFiles {
    /// Opens a file by its path relative to the source; `/` separates.
    fn open(&self, name: &str) -> io::Result<Box<dyn Read + '_>>;
    /// The file's size in bytes.
    fn len(&self, name: &str) -> io::Result<u64>;
    /// Tells this place from others.
    fn place(&self) -> String;
}

/// One city file.
pub(crate) struct CitySource<'a> {
    /// For messages and the report.
    pub(crate) label: String,
    /// Its name within `files`.
    pub(crate) name: String,
    pub(crate) files: Rc<dyn SourceFiles + 'a>,
    pub(crate) bytes: u64,
    /// Found in a folder rather than named: if it turns out to be no city file, it is passed over.
    pub(crate) found: bool,
}

/// What the name says about the content.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum SourceKind {
    Json,
    JsonLines,
    GeoJson,
    GeoJsonLines,
    Obj,
}

/// By extension, `.gz` apart.
pub(crate) fn named_as(name: &str) -> Option<SourceKind> {
    let name = name.to_ascii_lowercase();
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    match name.rsplit_once('.')?.1 {
        "json" => Some(SourceKind::Json),
        "jsonl" => Some(SourceKind::JsonLines),
        "geojson" => Some(SourceKind::GeoJson),
        "geojsonl" | "geojsons" => Some(SourceKind::GeoJsonLines),
        "obj" => Some(SourceKind::Obj),
        _ => None,
    }
}

/// The sources behind the inputs, in order; a file that is named twice is read once.
pub(crate) fn list(inputs: &[PathBuf]) -> Result<Vec<CitySource<'static>>, InputError> {
    let mut sources = Vec::new();
    let mut seen = HashSet::new();
    for input in inputs {
        let label = input.display().to_string();
        let meta = fs::metadata(input).map_err(|cause| InputError::io(&label, cause))?;
        let files = if meta.is_dir() { in_folder(input)? } else { vec![input.clone()] };
        for path in files {
            let identity = fs::canonicalize(&path).unwrap_or_else(|_| path.clone());
            if seen.insert(identity) {
                sources.push(file_source(&path, meta.is_dir())?);
            }
        }
    }
    Ok(sources)
}

fn in_folder(folder: &Path) -> Result<Vec<PathBuf>, InputError> {
    let label = folder.display().to_string();
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder).map_err(|cause| InputError::io(&label, cause))? {
        let path = entry.map_err(|cause| InputError::io(&label, cause))?.path();
        let is_city = path.file_name().and_then(|name| name.to_str()).is_some_and(|name| named_as(name).is_some());
        if is_city && path.is_file() {
            paths.push(path);
        }
    }
    paths.sort();
    if paths.is_empty() { Err(InputError::no_source(folder)) } else { Ok(paths) }
}

fn file_source(path: &Path, found: bool) -> Result<CitySource<'static>, InputError> {
    let label = path.display().to_string();
    let Some(name) = path.file_name().and_then(|name| name.to_str()) else {
        return Err(InputError::unsupported(&label, "its name is not text"));
    };
    let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
    let files = FolderFiles { path: folder };
    let bytes = files.len(name).map_err(|cause| InputError::io(&label, cause))?;
    Ok(CitySource { name: name.to_owned(), label, files: Rc::new(files), bytes, found })
}

/// The city files among the given ones, sorted by name; all of them are at hand as pictures and materials.
pub(crate) fn embedded<'a>(files: &'a [(&'a str, &'a [u8])]) -> Vec<CitySource<'a>> {
    let store: Rc<dyn SourceFiles + 'a> = Rc::new(EmbeddedFiles { files });
    let mut cities: Vec<_> = files.iter().filter(|(name, _)| named_as(name).is_some()).collect();
    cities.sort_by_key(|(name, _)| *name);
    let source = |(name, bytes): &(&str, &[u8])| CitySource {
        label: (*name).to_owned(),
        name: (*name).to_owned(),
        files: Rc::clone(&store),
        bytes: bytes.len() as u64,
        found: false,
    };
    cities.into_iter().map(source).collect()
}

struct FolderFiles {
    path: PathBuf,
}

impl FolderFiles {
    /// Only plain files: a name in a city file must not make us read a device or wait for a pipe.
    fn path_of(&self, name: &str) -> io::Result<PathBuf> {
        if Path::new(name).is_absolute() {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "an absolute path"));
        }
        let path = self.path.join(name);
        if fs::metadata(&path)?.is_file() {
            Ok(path)
        } else {
            Err(io::Error::new(io::ErrorKind::InvalidInput, "not a plain file"))
        }
    }
}

impl SourceFiles for FolderFiles {
    fn open(&self, name: &str) -> io::Result<Box<dyn Read + '_>> {
        Ok(Box::new(File::open(self.path_of(name)?)?))
    }

    fn len(&self, name: &str) -> io::Result<u64> {
        Ok(fs::metadata(self.path_of(name)?)?.len())
    }

    fn place(&self) -> String {
        self.path.display().to_string()
    }
}

struct EmbeddedFiles<'a> {
    files: &'a [(&'a str, &'a [u8])],
}

impl EmbeddedFiles<'_> {
    fn find(&self, name: &str) -> io::Result<&[u8]> {
        let found = self.files.iter().find(|(own, _)| *own == name).map(|(_, bytes)| *bytes);
        found.ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "not among the given files"))
    }
}

impl SourceFiles for EmbeddedFiles<'_> {
    fn open(&self, name: &str) -> io::Result<Box<dyn Read + '_>> {
        Ok(Box::new(self.find(name)?))
    }

    fn len(&self, name: &str) -> io::Result<u64> {
        Ok(self.find(name)?.len() as u64)
    }

    fn place(&self) -> String {
        String::new()
    }
}

/// Counts what passes, so that progress is told in bytes of the file and not of what is unpacked from it.
struct CountingReader<'a> {
    inner: Box<dyn Read + 'a>,
    count: Rc<Cell<u64>>,
}

impl Read for CountingReader<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(buffer)?;
        self.count.set(self.count.get() + read as u64);
        Ok(read)
    }
}

/// A source's unpacked bytes, and how many of the packed ones have been taken.
pub(crate) struct OpenSource<'a> {
    pub(crate) reader: Box<dyn BufRead + 'a>,
    pub(crate) taken: Rc<Cell<u64>>,
}

/// Opens a source, unpacking `.gz`.
pub(crate) fn open<'a>(source: &'a CitySource<'_>) -> Result<OpenSource<'a>, InputError> {
    let inner = source.files.open(&source.name).map_err(|cause| InputError::io(&source.label, cause))?;
    let taken = Rc::new(Cell::new(0));
    let counted = CountingReader { inner, count: Rc::clone(&taken) };
    let reader: Box<dyn BufRead> = if is_gz(&source.name) {
        Box::new(BufReader::with_capacity(1 << 16, MultiGzDecoder::new(BufReader::new(counted))))
    } else {
        Box::new(BufReader::with_capacity(1 << 16, counted))
    };
    Ok(OpenSource { reader, taken })
}

/// The whole source; more than `limit` unpacked bytes are an error, found before they are held.
pub(crate) fn read_all(source: &CitySource<'_>, limit: u64) -> Result<Vec<u8>, InputError> {
    let too_large = || InputError::TooLarge { path: source.label.clone(), what: "its size in bytes".to_owned(), limit };
    if source.bytes > limit {
        return Err(too_large());
    }
    let mut bytes = Vec::new();
    let opened = open(source)?;
    let mut reader = opened.reader.take(limit.saturating_add(1));
    reader.read_to_end(&mut bytes).map_err(|cause| InputError::io(&source.label, cause))?;
    if bytes.len() as u64 > limit { Err(too_large()) } else { Ok(bytes) }
}

/// A plain file that is no city, of at most `limit` bytes.
pub(crate) fn read_file(path: &Path, limit: u64) -> Result<Vec<u8>, InputError> {
    let label = path.display().to_string();
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(|cause| InputError::io(&label, cause))?;
    file.take(limit.saturating_add(1)).read_to_end(&mut bytes).map_err(|cause| InputError::io(&label, cause))?;
    if bytes.len() as u64 > limit {
        return Err(InputError::TooLarge { path: label, what: "its size in bytes".to_owned(), limit });
    }
    Ok(bytes)
}

/// A file beside the source, as named or with `.gz` behind, of at most `limit` unpacked bytes.
pub(crate) fn read_beside(files: &dyn SourceFiles, name: &str, limit: u64) -> io::Result<Vec<u8>> {
    let packed = format!("{name}.gz");
    let (name, inner) = match files.open(name) {
        Ok(inner) => (name, inner),
        Err(error) => (packed.as_str(), files.open(&packed).map_err(|_| error)?),
    };
    let mut reader: Box<dyn Read> = if is_gz(name) { Box::new(MultiGzDecoder::new(inner)) } else { inner };
    let mut bytes = Vec::new();
    reader.by_ref().take(limit.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit {
        return Err(io::Error::other(format!("more than {limit} bytes")));
    }
    Ok(bytes)
}

/// The next line without its end, into `line`; `Ok(None)` at the end, `Ok(Some(false))` for a line that is longer than
/// `limit` and was passed over.
pub(crate) fn next_line(reader: &mut dyn BufRead, line: &mut Vec<u8>, limit: usize) -> io::Result<Option<bool>> {
    line.clear();
    let (mut any, mut whole) = (false, true);
    loop {
        let buffer = reader.fill_buf()?;
        if buffer.is_empty() {
            return Ok(any.then_some(whole));
        }
        any = true;
        let end = buffer.iter().position(|&byte| byte == b'\n');
        let part = &buffer[..end.unwrap_or(buffer.len())];
        if line.len() + part.len() > limit {
            whole = false;
            line.clear();
        } else if whole {
            line.extend_from_slice(part);
        }
        let used = part.len() + usize::from(end.is_some());
        reader.consume(used);
        if end.is_some() {
            if line.last() == Some(&b'\r') {
                line.pop();
            }
            return Ok(Some(whole));
        }
    }
}

fn is_gz(name: &str) -> bool {
    name.to_ascii_lowercase().ends_with(".gz")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_formats() {
        assert_eq!(named_as("a.city.json"), Some(SourceKind::Json));
        assert_eq!(named_as("A.CITY.JSONL.GZ"), Some(SourceKind::JsonLines));
        assert_eq!(named_as("b.obj.gz"), Some(SourceKind::Obj));
        assert_eq!(named_as("c.geojson.gz"), Some(SourceKind::GeoJson));
        assert_eq!(named_as("c.geojsonl"), Some(SourceKind::GeoJsonLines));
        assert_eq!(named_as("b.mtl"), None);
        assert_eq!(named_as("json"), None);
    }

    #[test]
    fn lines_end_in_any_way_and_long_ones_are_passed_over() {
        let mut text: &[u8] = b"one\r\ntwo is too long\n\nlast";
        let mut line = Vec::new();
        let mut seen = Vec::new();
        while let Some(whole) = next_line(&mut text, &mut line, 5).unwrap() {
            seen.push((String::from_utf8(line.clone()).unwrap(), whole));
        }
        let expected = [("one", true), ("", false), ("", true), ("last", true)];
        assert_eq!(seen, expected.map(|(line, whole)| (line.to_owned(), whole)));
    }

    #[test]
    fn embedded_cities_are_sorted_and_the_rest_lies_beside() {
        let files: [(&str, &[u8]); 3] = [("b.obj", b"2"), ("a.mtl", b"m"), ("a.obj", b"1")];
        let sources = embedded(&files);
        assert_eq!(sources.iter().map(|source| source.name.as_str()).collect::<Vec<_>>(), ["a.obj", "b.obj"]);
        assert_eq!(read_beside(&*sources[0].files, "a.mtl", 10).unwrap(), b"m");
        assert!(read_beside(&*sources[0].files, "a.mtl", 0).is_err());
        assert!(matches!(read_all(&sources[0], 0), Err(InputError::TooLarge { .. })));
        assert_eq!(read_all(&sources[0], 1).unwrap(), b"1");
    }
}
