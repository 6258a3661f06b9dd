//! Sources of bytes: files in folders or memory, plain or gzip, with progress and size limits.

use std::cell::Cell;
use std::collections::HashSet;
use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use flate2::read::MultiGzDecoder;

use super::{bad_inputs::BadInputs, unread_formats};
use crate::error::InputError;

/// Progress of reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadProgress {
    /// Bytes of the given files that are done, compressed if the files are.
    pub bytes_done: u64,
    /// Size of all given files.
    pub bytes_total: u64,
}

/// Files with a common parent: a source, its material libraries and its images.
pub(crate) trait SourceFiles {
    /// Opens a file by its path relative to the source, with `/` as separator.
    fn open(&self, name: &str) -> io::Result<Box<dyn Read + '_>>;
    /// Size of a file in bytes.
    fn len(&self, name: &str) -> io::Result<u64>;
    /// Distinguishes these files from those of other sources.
    fn location(&self) -> String;
}

/// One city file.
pub(crate) struct CitySource<'a> {
    /// For messages and the report.
    pub(crate) label: String,
    /// Name within `files`.
    pub(crate) name: String,
    pub(crate) files: Rc<dyn SourceFiles + 'a>,
    pub(crate) bytes: u64,
    /// Found in a folder rather than named by the user. It is then ignored if it turns out not to be a city file.
    pub(crate) found: bool,
}

/// Kind of a source by its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum SourceKind {
    Json,
    JsonLines,
    GeoJson,
    GeoJsonLines,
    Obj,
}

/// The kind by extension, ignoring `.gz`.
pub(crate) fn kind_by_name(name: &str) -> Option<SourceKind> {
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

/// The sources of the inputs, in order. A file that is given twice is read once. Fails if an input cannot be read, has no
/// known name or is a folder without a city file, unless `bad` skips it.
///
/// Textures and material libraries are read from a source's folder and below, and from `texture_roots`.
pub(super) fn list(
    inputs: &[PathBuf],
    texture_roots: &[PathBuf],
    bad: &mut BadInputs,
) -> Result<Vec<CitySource<'static>>, InputError> {
    let roots = texture_roots.iter().map(|root| {
        let label = root.display().to_string();
        fs::canonicalize(root).map_err(|cause| InputError::io(&label, cause))
    });
    let roots: Rc<[PathBuf]> = roots.collect::<Result<_, _>>()?;
    let mut sources = Vec::new();
    let mut seen = HashSet::new();
    for input in inputs {
        let label = input.display().to_string();
        let Some((files, found)) = bad.skip(&label, files_of(input))? else { continue };
        for path in files {
            let identity = fs::canonicalize(&path).unwrap_or_else(|_| path.clone());
            if seen.insert(identity) {
                let source = file_source(&path, found, Rc::clone(&roots));
                sources.extend(bad.skip(&path.display().to_string(), source)?);
            }
        }
    }
    Ok(sources)
}

/// The files of an input, and whether they were found in a folder.
fn files_of(input: &Path) -> Result<(Vec<PathBuf>, bool), InputError> {
    let meta = fs::metadata(input).map_err(|cause| InputError::io(&input.display().to_string(), cause))?;
    if meta.is_dir() { Ok((in_folder(input)?, true)) } else { Ok((vec![input.to_owned()], false)) }
}

fn in_folder(folder: &Path) -> Result<Vec<PathBuf>, InputError> {
    let label = folder.display().to_string();
    let (mut paths, mut unread): (_, Option<PathBuf>) = (Vec::new(), None);
    for entry in fs::read_dir(folder).map_err(|cause| InputError::io(&label, cause))? {
        let path = entry.map_err(|cause| InputError::io(&label, cause))?.path();
        let Some(name) = path.file_name().map(|name| name.to_string_lossy()).filter(|_| path.is_file()) else {
            continue;
        };
        if kind_by_name(&name).is_some() {
            paths.push(path);
        } else if unread_formats::is_model(&name) && unread.as_ref().is_none_or(|first| path < *first) {
            unread = Some(path);
        }
    }
    paths.sort();
    match (paths.is_empty(), unread) {
        (false, _) => Ok(paths),
        (true, Some(path)) => Err(unread_formats::refusal(&path.display().to_string())),
        (true, None) => Err(InputError::no_source(folder)),
    }
}

fn file_source(path: &Path, found: bool, roots: Rc<[PathBuf]>) -> Result<CitySource<'static>, InputError> {
    let label = path.display().to_string();
    // Bytes of a name that are not UTF-8 are shown as replacement characters.
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    if kind_by_name(&name).is_none() {
        return Err(unread_formats::refusal(&label));
    }
    let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
    let files = FolderFiles { path: folder, source: (name.clone(), path.to_owned()), roots };
    let bytes = files.len(&name).map_err(|cause| InputError::io(&label, cause))?;
    Ok(CitySource { name, label, files: Rc::new(files), bytes, found })
}

/// The city files among the given ones, sorted by name. All files are available as images and material libraries.
pub(crate) fn embedded<'a>(files: &'a [(&'a str, &'a [u8])]) -> Vec<CitySource<'a>> {
    let store: Rc<dyn SourceFiles + 'a> = Rc::new(EmbeddedFiles { files });
    let mut cities: Vec<_> = files.iter().filter(|(name, _)| kind_by_name(name).is_some()).collect();
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
    /// Name and path of the source, which the user chose: it may be a link to anywhere.
    source: (String, PathBuf),
    /// Folders besides `path` from which files may be read, without links.
    roots: Rc<[PathBuf]>,
}

impl FolderFiles {
    /// Path of a plain file. A name in a city file must not make the bake read a device, wait for a pipe, or publish a
    /// file from elsewhere: after links and `..`, the file must lie in the source's folder or in one of the roots.
    fn path_of(&self, name: &str) -> io::Result<PathBuf> {
        let (source, path) = &self.source;
        let path = if name == source { path.clone() } else { self.allowed_path(name)? };
        if fs::metadata(&path)?.is_file() {
            Ok(path)
        } else {
            Err(io::Error::new(io::ErrorKind::InvalidInput, "not a plain file"))
        }
    }

    /// The file of that name in the source's folder or a root. An absolute name must lie in a root.
    fn allowed_path(&self, name: &str) -> io::Result<PathBuf> {
        let own = if self.path.as_os_str().is_empty() { Path::new(".") } else { &self.path };
        let own = fs::canonicalize(own)?;
        let mut refused = None;
        for folder in std::iter::once(&own).chain(&*self.roots) {
            let Ok(path) = fs::canonicalize(folder.join(name)) else { continue };
            let is_own = !Path::new(name).is_absolute() && path.starts_with(&own);
            if is_own || self.roots.iter().any(|root| path.starts_with(root)) {
                return Ok(path);
            }
            refused = Some(io::Error::new(io::ErrorKind::PermissionDenied, OUTSIDE));
        }
        Err(refused.unwrap_or_else(|| io::ErrorKind::NotFound.into()))
    }
}

/// Why a file outside of the source's folder is not read.
pub(super) const OUTSIDE: &str = "it lies outside of the source's folder; allow its folder with --texture-root";

impl SourceFiles for FolderFiles {
    fn open(&self, name: &str) -> io::Result<Box<dyn Read + '_>> {
        Ok(Box::new(File::open(self.path_of(name)?)?))
    }

    fn len(&self, name: &str) -> io::Result<u64> {
        Ok(fs::metadata(self.path_of(name)?)?.len())
    }

    fn location(&self) -> String {
        // Differs between any two folders, also between those whose names are not text.
        self.path.to_str().map_or_else(|| format!("{:?}", self.path), str::to_owned)
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

    fn location(&self) -> String {
        String::new()
    }
}

/// Counts the bytes read from the file, before decompression.
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

/// A reader of a source's unpacked bytes, and the number of packed bytes read so far.
pub(crate) struct OpenSource<'a> {
    pub(crate) reader: Box<dyn BufRead + 'a>,
    pub(crate) bytes_read: Rc<Cell<u64>>,
}

/// Opens a source and unpacks `.gz`. Fails if the file cannot be opened.
pub(crate) fn open<'a>(source: &'a CitySource<'_>) -> Result<OpenSource<'a>, InputError> {
    let inner = source.files.open(&source.name).map_err(|cause| InputError::io(&source.label, cause))?;
    let bytes_read = Rc::new(Cell::new(0));
    let counted = CountingReader { inner, count: Rc::clone(&bytes_read) };
    let reader: Box<dyn BufRead> = if is_gz(&source.name) {
        Box::new(BufReader::with_capacity(1 << 16, MultiGzDecoder::new(BufReader::new(counted))))
    } else {
        Box::new(BufReader::with_capacity(1 << 16, counted))
    };
    Ok(OpenSource { reader, bytes_read })
}

/// Reads a whole source. Fails if it has more than `limit` unpacked bytes, before more are in memory.
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

/// Reads a plain file that is not a source. Fails if it has more than `limit` bytes.
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

/// Reads a file next to the source, as named or with `.gz` appended. Fails if it has more than `limit` unpacked bytes.
pub(crate) fn read_sibling(files: &dyn SourceFiles, name: &str, limit: u64) -> io::Result<Vec<u8>> {
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

/// Result of [`next_line`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NextLine {
    Complete,
    /// The line was longer than the limit and is skipped.
    TooLong,
    EndOfFile,
}

/// Reads the next line into `line`, without its end; a line of more than `limit` bytes is skipped. Fails if the source
/// cannot be read.
pub(crate) fn next_line(reader: &mut dyn BufRead, line: &mut Vec<u8>, limit: usize) -> io::Result<NextLine> {
    line.clear();
    let (mut any, mut status) = (false, NextLine::Complete);
    loop {
        let buffer = reader.fill_buf()?;
        if buffer.is_empty() {
            return Ok(if any { status } else { NextLine::EndOfFile });
        }
        any = true;
        let end = buffer.iter().position(|&byte| byte == b'\n');
        let part = &buffer[..end.unwrap_or(buffer.len())];
        if line.len() + part.len() > limit {
            status = NextLine::TooLong;
            line.clear();
        } else if status == NextLine::Complete {
            line.extend_from_slice(part);
        }
        let used = part.len() + usize::from(end.is_some());
        reader.consume(used);
        if end.is_some() {
            if line.last() == Some(&b'\r') {
                line.pop();
            }
            return Ok(status);
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
    fn kind_is_known_by_the_extension() {
        assert_eq!(kind_by_name("a.city.json"), Some(SourceKind::Json));
        assert_eq!(kind_by_name("A.CITY.JSONL.GZ"), Some(SourceKind::JsonLines));
        assert_eq!(kind_by_name("b.obj.gz"), Some(SourceKind::Obj));
        assert_eq!(kind_by_name("c.geojson.gz"), Some(SourceKind::GeoJson));
        assert_eq!(kind_by_name("c.geojsonl"), Some(SourceKind::GeoJsonLines));
        assert_eq!(kind_by_name("b.mtl"), None);
        assert_eq!(kind_by_name("json"), None);
    }

    #[test]
    fn lines_have_any_ending_and_long_ones_are_skipped() {
        let mut text: &[u8] = b"one\r\ntwo is too long\n\nlast";
        let mut line = Vec::new();
        let mut seen = Vec::new();
        loop {
            match next_line(&mut text, &mut line, 5).unwrap() {
                NextLine::EndOfFile => break,
                status => seen.push((String::from_utf8(line.clone()).unwrap(), status)),
            }
        }
        let expected = [
            ("one", NextLine::Complete),
            ("", NextLine::TooLong),
            ("", NextLine::Complete),
            ("last", NextLine::Complete),
        ];
        assert_eq!(seen, expected.map(|(line, status)| (line.to_owned(), status)));
    }

    #[test]
    #[cfg(unix)]
    fn files_beside_a_source_are_read_from_its_folder_and_the_roots_only() {
        use std::os::unix::fs::symlink;
        let folder = insula_test_support::folder::TestFolder::new("siblings");
        let path = |name: &str| folder.path.join(name);
        for name in ["in/sub", "private", "shared"] {
            fs::create_dir_all(path(name)).unwrap();
        }
        for name in ["in/a.obj", "in/own.png", "in/sub/b.png", "private/photo.png", "shared/c.png"] {
            fs::write(path(name), name).unwrap();
        }
        symlink(path("private/photo.png"), path("in/link.png")).unwrap();
        symlink(path("private"), path("in/dir")).unwrap();
        symlink(path("in/a.obj"), path("in/linked.obj")).unwrap();
        let private = path("private/photo.png").display().to_string();
        let shared = path("shared/c.png").display().to_string();
        for (roots, source) in [(vec![], "in/a.obj"), (vec![path("shared")], "in/linked.obj")] {
            let sources = list(&[path(source)], &roots, &mut BadInputs::new(false)).unwrap();
            let read = |name: &str| read_sibling(&*sources[0].files, name, 99);
            assert_eq!(read("own.png").unwrap(), b"in/own.png");
            assert_eq!(read("sub/../sub/b.png").unwrap(), b"in/sub/b.png");
            assert_eq!(read(&sources[0].name).unwrap(), b"in/a.obj");
            for name in ["../private/photo.png", "link.png", "dir/photo.png", &private] {
                assert_eq!(read(name).unwrap_err().kind(), io::ErrorKind::PermissionDenied, "{name}");
            }
            for name in ["../shared/c.png", &shared] {
                assert_eq!(read(name).is_ok(), !roots.is_empty(), "{name}");
            }
            assert_eq!(read("c.png").is_ok(), !roots.is_empty());
            assert_eq!(read("none.png").unwrap_err().kind(), io::ErrorKind::NotFound);
        }
        assert!(list(&[path("in/a.obj")], &[path("none")], &mut BadInputs::new(true)).is_err());
    }

    #[test]
    fn embedded_cities_are_sorted_and_other_files_are_siblings() {
        let files: [(&str, &[u8]); 3] = [("b.obj", b"2"), ("a.mtl", b"m"), ("a.obj", b"1")];
        let sources = embedded(&files);
        assert_eq!(sources.iter().map(|source| source.name.as_str()).collect::<Vec<_>>(), ["a.obj", "b.obj"]);
        assert_eq!(read_sibling(&*sources[0].files, "a.mtl", 10).unwrap(), b"m");
        assert!(read_sibling(&*sources[0].files, "a.mtl", 0).is_err());
        assert!(matches!(read_all(&sources[0], 0), Err(InputError::TooLarge { .. })));
        assert_eq!(read_all(&sources[0], 1).unwrap(), b"1");
    }
}
