//! Slices of sequences: a long CityJSONSeq as several sources, each with the header and a run of its lines.

use std::cell::RefCell;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::PathBuf;
use std::rc::Rc;

use super::input::{LocalFile, SourceFiles};
use super::source::{CitySource, SourceKind, is_gz, kind_by_name};

/// A header that is longer is none: the sequence is not divided.
const MAX_HEADER_BYTES: u64 = 16 << 20;

/// The slices of a source, each of about `slice_bytes`; the source itself if it is shorter, or cannot be divided.
pub(super) fn slices(source: CitySource<'static>, slice_bytes: u64) -> Vec<CitySource<'static>> {
    let is_sequence = kind_by_name(&source.name) == Some(SourceKind::JsonLines) && !is_gz(&source.name);
    let count = source.bytes / slice_bytes.max(1);
    if !is_sequence || count < 2 {
        return vec![source];
    }
    // A source inside an archive is extracted to a file; each slice would extract it again.
    let Some(path) = source.files.on_disk(&source.name).ok().filter(|file| file.copy.is_none()).map(|file| file.path)
    else {
        return vec![source];
    };
    let Some(header) = header(&path) else { return vec![source] };
    let header: Rc<[u8]> = header.into();
    let bounds = |number: u64| number * source.bytes / count;
    let slice = |number: u64| {
        let lines = [bounds(number), bounds(number + 1)];
        let (name, path, header) = (source.name.clone(), path.clone(), Rc::clone(&header));
        let files = SlicedFiles { inner: Rc::clone(&source.files), name, path, header, lines };
        CitySource {
            label: source.label.clone(),
            name: source.name.clone(),
            files: Rc::new(files),
            bytes: lines[1] - lines[0],
            found: source.found,
            is_surroundings: false,
        }
    };
    (0..count).map(slice).collect()
}

/// The first line of a sequence, with its end; `None` without one.
fn header(path: &PathBuf) -> Option<Vec<u8>> {
    let mut line = Vec::new();
    let read = BufReader::new(File::open(path).ok()?).take(MAX_HEADER_BYTES).read_until(b'\n', &mut line);
    (read.is_ok() && line.ends_with(b"\n")).then_some(line)
}

/// The files of a source, itself with a run of its lines only.
struct SlicedFiles {
    inner: Rc<dyn SourceFiles>,
    name: String,
    path: PathBuf,
    header: Rc<[u8]>,
    /// Lines that begin in this range of bytes.
    lines: [u64; 2],
}

impl SourceFiles for SlicedFiles {
    fn open(&self, name: &str) -> io::Result<Box<dyn Read + '_>> {
        if name != self.name {
            return self.inner.open(name);
        }
        let [start, end] = self.lines;
        // The header is the first line, and not one of any slice.
        let start = start.max(self.header.len() as u64);
        let mut file = BufReader::new(File::open(&self.path)?);
        file.seek(SeekFrom::Start(start - 1))?;
        let lines = LineRun { file: RefCell::new(file), position: start - 1, end, is_open: false };
        Ok(Box::new(Cursor::new(&self.header).chain(lines.begin()?)))
    }

    fn len(&self, name: &str) -> io::Result<u64> {
        if name == self.name { Ok(self.lines[1] - self.lines[0]) } else { self.inner.len(name) }
    }

    fn on_disk(&self, name: &str) -> io::Result<LocalFile> {
        self.inner.on_disk(name)
    }

    fn location(&self) -> String {
        self.inner.location()
    }
}

/// Lines that begin before a position.
struct LineRun {
    file: RefCell<BufReader<File>>,
    position: u64,
    end: u64,
    /// Whether a line has begun and not ended.
    is_open: bool,
}

impl LineRun {
    /// Skips the rest of the line before the first one. Lines of any length are skipped in pieces.
    fn begin(mut self) -> io::Result<Self> {
        loop {
            let file = self.file.get_mut();
            let buffer = file.fill_buf()?;
            let newline = buffer.iter().position(|byte| *byte == b'\n');
            let used = newline.map_or(buffer.len(), |at| at + 1);
            file.consume(used);
            self.position += used as u64;
            if newline.is_some() || used == 0 {
                return Ok(self);
            }
        }
    }
}

impl Read for LineRun {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if !self.is_open && self.position >= self.end || out.is_empty() {
            return Ok(0);
        }
        let file = self.file.get_mut();
        let buffer = file.fill_buf()?;
        let buffer = &buffer[..buffer.len().min(out.len())];
        let line_end = buffer.iter().position(|byte| *byte == b'\n').map(|at| at + 1);
        let used = line_end.unwrap_or(buffer.len());
        out[..used].copy_from_slice(&buffer[..used]);
        file.consume(used);
        self.position += used as u64;
        self.is_open = line_end.is_none();
        Ok(used)
    }
}

#[cfg(test)]
mod tests {
    use super::super::bad_inputs::BadInputs;
    use super::super::context::ReadOptions;
    use super::super::list::list;
    use super::*;
    use insula_test_support::folder::TestFolder;
    use std::fs;

    #[test]
    fn slices_have_each_line_once_and_the_header() {
        let folder = TestFolder::new("slices");
        let path = folder.path.join("a.city.jsonl");
        for end in ["\n", ""] {
            let lines: Vec<String> = (0..40).map(|i| format!("{i}{}", "x".repeat(i * 7 % 31))).collect();
            fs::write(&path, format!("header\n{}{end}", lines.join("\n"))).unwrap();
            for slice_bytes in [1, 5, 20, 33, 100, 300, 1 << 20] {
                let listed =
                    list(std::slice::from_ref(&path), &ReadOptions::default(), &mut BadInputs::new(false)).unwrap();
                let source = listed.sources.into_iter().next().unwrap();
                let bytes = source.bytes;
                let slices = slices(source, slice_bytes);
                assert_eq!(slices.len() as u64, (bytes / slice_bytes).max(1));
                assert_eq!(slices.iter().map(|slice| slice.bytes).sum::<u64>(), bytes);
                let mut found = Vec::new();
                for slice in &slices {
                    let mut text = String::new();
                    slice.files.open(&slice.name).unwrap().read_to_string(&mut text).unwrap();
                    let mut own = text.lines();
                    assert_eq!(own.next(), Some("header"));
                    found.extend(own.map(str::to_owned));
                }
                assert_eq!(found, lines, "slices of {slice_bytes} bytes");
            }
        }
    }

    #[test]
    fn other_sources_are_not_divided() {
        let folder = TestFolder::new("slices-none");
        for name in ["a.geojsonl", "a.jsonl.gz", "a.obj"] {
            let path = folder.path.join(name);
            fs::write(&path, "line\n".repeat(100)).unwrap();
            let listed = list(&[path], &ReadOptions::default(), &mut BadInputs::new(false)).unwrap();
            assert_eq!(listed.sources.into_iter().flat_map(|source| slices(source, 10)).count(), 1, "{name}");
        }
    }
}
