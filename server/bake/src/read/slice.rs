//! Slices: a long source as several, which different machines read.
//!
//! A sequence of lines becomes runs of lines, each after the header if there is one. FlatGeobuf and GeoParquet are divided by their
//! readers, by features and row groups. All other formats have to be read from their beginning, and stay whole.

use super::json_kind::{self, JsonKind};
use insula_source::input::{LocalFile, Share, SourceFiles};
use insula_source::random_file::{RandomFile, RandomReader};
use insula_source::source::{CitySource, SourceKind, kind_by_name};
use std::io::{self, BufRead, BufReader, Cursor, Read};
use std::ops::Range;
use std::rc::Rc;

/// A header that is longer is none: one slice has the whole sequence.
const MAX_HEADER_BYTES: u64 = 16 << 20;

/// The slices of a source, each of about `slice_bytes`; the source itself if it is shorter, or cannot be divided.
pub(super) fn slices(source: CitySource<'static>, slice_bytes: u64) -> Vec<CitySource<'static>> {
    let count = source.bytes / slice_bytes.max(1);
    // A source inside an archive is extracted to a file; each slice would extract it again.
    if count < 2 || !source.files.is_random() || !is_plain(&source) {
        return vec![source];
    }
    let has_header = match kind_by_name(&source.name) {
        // The first line of one slice may not tell that of all.
        Some(SourceKind::JsonLines) if json_kind::of(&source) == JsonKind::GeoJson => return vec![source],
        Some(SourceKind::JsonLines) => Some(true),
        Some(SourceKind::GeoJsonLines) => Some(false),
        Some(SourceKind::FlatGeobuf | SourceKind::GeoParquet) => None,
        _ => return vec![source],
    };
    let slice = |number: u64| {
        let CitySource { label, name, files, bytes, found, .. } = &source;
        let share = Share { number, count };
        let range = share.of(*bytes);
        let bytes = range.end - range.start;
        let (files, share): (Rc<dyn SourceFiles>, _) = match has_header {
            Some(has_header) => {
                let lines = LineSlice { inner: Rc::clone(files), name: name.clone(), has_header, range };
                (Rc::new(lines), Share::WHOLE)
            }
            None => (Rc::clone(files), share),
        };
        CitySource { found: *found, share, ..CitySource::new(label.clone(), name.clone(), files, bytes) }
    };
    (0..count).map(slice).collect()
}

/// Whether a source is read as it is: not packed, and a text in UTF-8. One that cannot be read is not divided either.
fn is_plain(source: &CitySource<'_>) -> bool {
    let input = source.input(u64::MAX);
    source.files.random(&source.name).and_then(|file| input.is_plain(&mut file.reader(0))).unwrap_or(false)
}

/// The files of a source, itself with a run of its lines only. Nothing is read before it is opened: a folder may have thousands of
/// sequences, and each scan lists all of them.
struct LineSlice {
    inner: Rc<dyn SourceFiles>,
    name: String,
    /// Whether the first line belongs to all slices.
    has_header: bool,
    /// Lines that begin in this range of bytes.
    range: Range<u64>,
}

/// The first line of a sequence, with its end; `None` if it is longer than a header. Fails if the file cannot be read.
fn header(file: &RandomFile) -> io::Result<Option<Vec<u8>>> {
    let mut line = Vec::new();
    file.reader(0).take(MAX_HEADER_BYTES).read_until(b'\n', &mut line)?;
    Ok(Some(line).filter(|line| line.ends_with(b"\n")))
}

impl SourceFiles for LineSlice {
    fn open(&self, name: &str) -> io::Result<Box<dyn Read + '_>> {
        if name != self.name {
            return self.inner.open(name);
        }
        let file = self.inner.random(name)?;
        let Some(header) = (if self.has_header { header(&file)? } else { Some(Vec::new()) }) else {
            // Without a header, the first slice is the whole file.
            return Ok(if self.range.start == 0 { Box::new(file.reader(0)) } else { Box::new(io::empty()) });
        };
        // The header is the first line, and not one of any slice.
        let start = self.range.start.max(header.len() as u64);
        let position = start.saturating_sub(1);
        let mut lines = LineRun { reader: file.reader(position), position, end: self.range.end, is_open: false };
        if start > 0 {
            lines.skip_line()?;
        }
        Ok(Box::new(Cursor::new(header).chain(lines)))
    }

    fn len(&self, name: &str) -> io::Result<u64> {
        if name == self.name { Ok(self.range.end - self.range.start) } else { self.inner.len(name) }
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
    reader: BufReader<RandomReader>,
    position: u64,
    end: u64,
    /// Whether a line has begun and not ended.
    is_open: bool,
}

impl LineRun {
    /// Skips the rest of a line. Lines of any length are skipped in pieces.
    fn skip_line(&mut self) -> io::Result<()> {
        loop {
            let buffer = self.reader.fill_buf()?;
            let newline = buffer.iter().position(|byte| *byte == b'\n');
            let used = newline.map_or(buffer.len(), |at| at + 1);
            self.reader.consume(used);
            self.position += used as u64;
            if newline.is_some() || used == 0 {
                return Ok(());
            }
        }
    }
}

impl Read for LineRun {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if !self.is_open && self.position >= self.end || out.is_empty() {
            return Ok(0);
        }
        let buffer = self.reader.fill_buf()?;
        let buffer = &buffer[..buffer.len().min(out.len())];
        let line_end = buffer.iter().position(|byte| *byte == b'\n').map(|at| at + 1);
        let used = line_end.unwrap_or(buffer.len());
        out[..used].copy_from_slice(&buffer[..used]);
        self.reader.consume(used);
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
    use insula_source::testing::{gzip, utf16};
    use insula_test_support::folder::TestFolder;
    use std::fs;

    #[test]
    fn slices_have_each_line_once_and_the_header() {
        let folder = TestFolder::new("slices");
        for (end, name) in [("\n", "a.city.jsonl"), ("", "a.city.jsonl"), ("\n", "a.geojsonl"), ("", "a.geojsonl")] {
            let path = folder.path.join(name);
            let lines: Vec<String> = (0..40).map(|i| format!("{i}{}", "x".repeat(i * 7 % 31))).collect();
            let header = if name == "a.geojsonl" { "" } else { "header\n" };
            fs::write(&path, format!("{header}{}{end}", lines.join("\n"))).unwrap();
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
                    let own = text.strip_prefix(header).unwrap();
                    found.extend(own.lines().map(str::to_owned));
                }
                assert_eq!(found, lines, "{name}: slices of {slice_bytes} bytes");
            }
        }
    }

    #[test]
    fn a_sequence_without_a_header_is_one_slice() {
        let folder = TestFolder::new("slices-header");
        let path = folder.path.join("a.city.jsonl");
        fs::write(&path, "one line without an end").unwrap();
        let listed = list(&[path], &ReadOptions::default(), &mut BadInputs::new(false)).unwrap();
        let slices = slices(listed.sources.into_iter().next().unwrap(), 8);
        let text = |slice: &CitySource<'_>| io::read_to_string(slice.files.open(&slice.name).unwrap()).unwrap();
        assert_eq!(slices.iter().map(text).collect::<Vec<_>>(), ["one line without an end", ""]);
    }

    #[test]
    fn other_sources_are_not_divided() {
        let folder = TestFolder::new("slices-none");
        let lines = "line\n".repeat(100);
        // Random bytes stay as many when they are packed.
        let noise: Vec<u8> = (0..100_u64).map(|i| (i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as u8).collect();
        for (name, bytes) in [
            ("a.jsonl", gzip(&noise)),
            ("b.jsonl", utf16(&lines, false)),
            ("c.jsonl", "{\"type\": \"Feature\"}\n".repeat(9).into()),
            ("a.obj", lines.clone().into()),
            ("a.geojson", lines.into()),
        ] {
            let path = folder.path.join(name);
            fs::write(&path, bytes).unwrap();
            let listed = list(&[path], &ReadOptions::default(), &mut BadInputs::new(false)).unwrap();
            assert_eq!(listed.sources.into_iter().flat_map(|source| slices(source, 10)).count(), 1, "{name}");
        }
    }
}
