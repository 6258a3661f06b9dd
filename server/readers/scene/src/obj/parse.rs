//! Parses the lines of an OBJ into arrays. Names and indices are not resolved yet, because libraries and vertices may
//! come after their use.

use crate::mesh_unit::told_unit;
use insula_source::error::InputError;
use insula_source::object::ObjectSink;
use insula_source::problems::{ENCODING_GUESSED, MESH_UNIT, PART_NOT_READ};
use insula_source::source::{NextLine, next_line};
use insula_source::text::{decoded, is_usual, likely_encoding};
use std::collections::HashMap;
use std::io::BufRead;

/// Longer lines are treated as damage.
const MAX_LINE_BYTES: usize = 1 << 22;
/// Further material libraries of a file are not read.
const MAX_LIBRARIES: usize = 1000;
/// Lines between two progress reports.
const TICK_LINES: u64 = 1 << 14;
/// Stands for a missing or invalid index.
pub(super) const NONE: u32 = u32::MAX;

/// A face as written.
#[derive(Debug, Clone, Copy)]
pub(super) struct ObjFace {
    /// Index of its first corner in [`ObjFile::corners`].
    first: usize,
    /// Number of its corners.
    len: u32,
    /// Index into [`ObjFile::materials`].
    pub(super) material: u32,
    /// Index into [`ObjFile::names`] of the last `o`.
    pub(super) object: u32,
    /// Index into [`ObjFile::names`] of the last `g`.
    pub(super) group: u32,
    pub(super) line: u64,
}

#[derive(Default)]
pub(super) struct ObjFile {
    pub(super) positions: Vec<[f64; 3]>,
    pub(super) uvs: Vec<[f32; 2]>,
    /// 8-bit sRGB of each position, if all have a colour and not all are white; else empty.
    pub(super) colours: Vec<[u8; 3]>,
    /// Index of the position and of the texture coordinate, each from 0 or [`NONE`]. They may be out of range.
    corners: Vec<[u32; 2]>,
    pub(super) faces: Vec<ObjFace>,
    /// Names after `usemtl`. The first is that of faces without one.
    pub(super) materials: Vec<String>,
    /// Names after `o` and `g`. The first is that of faces without one.
    pub(super) names: Vec<String>,
    /// For each `o` line, the index of its name.
    pub(super) object_lines: Vec<u32>,
    /// For each `g` line, the index of its name.
    pub(super) group_lines: Vec<u32>,
    /// Arguments of `mtllib`.
    pub(super) libraries: Vec<String>,
}

impl ObjFile {
    /// The corners of a face: index of the position and of the texture coordinate, each from 0 or [`NONE`].
    pub(super) fn corners_of(&self, face: &ObjFace) -> &[[u32; 2]] {
        &self.corners[face.first..face.first + face.len as usize]
    }
}

/// Parses all lines. Malformed lines are reported and ignored. Fails if the source cannot be read or has more than `limit`
/// bytes.
pub(super) fn parse(
    label: &str,
    lines: &mut dyn BufRead,
    limit: u64,
    sink: &mut dyn ObjectSink,
    bytes_read: &dyn Fn() -> u64,
) -> Result<ObjFile, InputError> {
    let mut parser = ObjParser::new(sink);
    let (mut line, mut joined, mut bytes) = (Vec::new(), Vec::new(), 0);
    loop {
        let next = next_line(lines, &mut line, MAX_LINE_BYTES);
        let status = next.map_err(|cause| InputError::io(label, cause))?;
        parser.line += u64::from(status != NextLine::EndOfFile);
        bytes += line.len() as u64 + 1;
        if bytes > limit {
            let what = "its unpacked size in bytes".to_owned();
            return Err(InputError::TooLarge { path: label.to_owned(), what, limit });
        }
        let is_continued = line.last() == Some(&b'\\') && joined.len() + line.len() < MAX_LINE_BYTES;
        joined.extend_from_slice(&line);
        if status == NextLine::TooLong {
            parser.sink.problem("line too long", format!("line {}", parser.line));
        } else if is_continued {
            joined.pop();
            joined.push(b' ');
            continue;
        }
        parser.bytes(&joined);
        joined.clear();
        if status == NextLine::EndOfFile {
            return Ok(parser.finish());
        }
        if parser.line.is_multiple_of(TICK_LINES) {
            parser.sink.tick(bytes_read());
        }
    }
}

struct ObjParser<'r> {
    file: ObjFile,
    /// Colours of the first vertices, as they are written.
    colours: Vec<[f32; 3]>,
    sink: &'r mut dyn ObjectSink,
    /// Number of the current line, from 1.
    line: u64,
    material: u32,
    object: u32,
    group: u32,
    material_indices: HashMap<String, u32>,
    name_indices: HashMap<String, u32>,
    /// A guess of the encoding is reported.
    is_guess_told: bool,
}

impl<'r> ObjParser<'r> {
    fn new(sink: &'r mut dyn ObjectSink) -> Self {
        let unnamed = || HashMap::from([(String::new(), 0)]);
        Self {
            file: ObjFile { materials: vec![String::new()], names: vec![String::new()], ..ObjFile::default() },
            colours: Vec::new(),
            sink,
            line: 0,
            material: 0,
            object: 0,
            group: 0,
            material_indices: unnamed(),
            name_indices: unnamed(),
            is_guess_told: false,
        }
    }

    /// A statement in any encoding. The first guess that is not the usual one is reported, but for comments.
    fn bytes(&mut self, line: &[u8]) {
        let guess = likely_encoding(line);
        let text = decoded(line, guess.page);
        if !self.is_guess_told && !is_usual(guess) && !text.trim_start().starts_with('#') {
            self.is_guess_told = true;
            let (number, page) = (self.line, guess.page);
            let advice = "write it in UTF-8 if letters are wrong";
            let detail = format!("line {number}: {}: taken as {page}; {advice}", shorten(&text));
            self.sink.problem(ENCODING_GUESSED, detail);
        }
        self.statement(&text);
    }

    fn statement(&mut self, line: &str) {
        let line = line.trim();
        let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim();
        let file = &mut self.file;
        match word {
            "v" => {
                let [x, y, z] = numbers(rest);
                if [x, y, z].iter().any(|c| c.is_nan()) {
                    let detail = format!("line {}: {}", self.line, shorten(line));
                    self.sink.problem("vertex without three numbers", detail);
                }
                if self.colours.len() == file.positions.len() {
                    self.colours.extend(colour(rest));
                }
                file.positions.push([x, y, z]);
            }
            "vt" => {
                let [u, v, _] = numbers(rest).map(|c| if c.is_nan() { 0.0 } else { c as f32 });
                file.uvs.push([u, v]);
            }
            "f" => self.face(rest),
            "usemtl" => self.material = intern(rest, &mut file.materials, &mut self.material_indices),
            "o" => {
                self.object = intern(rest, &mut file.names, &mut self.name_indices);
                file.object_lines.push(self.object);
            }
            "g" => {
                self.group = intern(rest, &mut file.names, &mut self.name_indices);
                file.group_lines.push(self.group);
            }
            "mtllib" if file.libraries.iter().any(|known| known == rest) => {}
            "mtllib" if file.libraries.len() < MAX_LIBRARIES => file.libraries.push(rest.to_owned()),
            "mtllib" => self.sink.problem("too many material libraries", format!("line {}", self.line)),
            "surf" => self.sink.problem(PART_NOT_READ, format!("line {}: a free-form surface", self.line)),
            // Comments of the file as a whole are at its head.
            word if word.starts_with('#') && file.positions.is_empty() => self.comment(line),
            _ => {}
        }
    }

    /// The file with the colours of its vertices.
    fn finish(mut self) -> ObjFile {
        // Some programs write bytes. Light beyond white is hardly twice as bright.
        let scale = if self.colours.as_flattened().iter().any(|number| *number > 2.0) { 1.0 } else { 255.0 };
        let to_byte = |number: f32| (number * scale).round() as u8;
        let colours: Vec<[u8; 3]> = self.colours.iter().map(|rgb| rgb.map(to_byte)).collect();
        if colours.len() == self.file.positions.len() && colours.iter().any(|rgb| *rgb != [255; 3]) {
            self.file.colours = colours;
        }
        self.file
    }

    /// Names a unit that a comment tells.
    fn comment(&mut self, line: &str) {
        if let Some(detail) = told_unit(&format!("line {}", self.line), line) {
            self.sink.problem(MESH_UNIT, detail);
        }
    }

    fn face(&mut self, text: &str) {
        let file = &mut self.file;
        let first = file.corners.len();
        for word in text.split_ascii_whitespace() {
            let mut indices = word.split('/');
            let position = parse_index(indices.next().unwrap_or(""), file.positions.len());
            let uv = parse_index(indices.next().unwrap_or(""), file.uvs.len());
            file.corners.push([position, uv]);
        }
        let len = file.corners.len() - first;
        if len < 3 {
            let detail = format!("line {}: f {}", self.line, shorten(text));
            self.sink.problem("face of less than three corners", detail);
            file.corners.truncate(first);
            return;
        }
        file.faces.push(ObjFace {
            first,
            len: len as u32,
            material: self.material,
            object: self.object,
            group: self.group,
            line: self.line,
        });
    }
}

/// The first three numbers; NaN for those that are missing or invalid.
fn numbers(text: &str) -> [f64; 3] {
    let mut words = text.split_ascii_whitespace();
    std::array::from_fn(|_| words.next().and_then(|word| word.parse().ok()).unwrap_or(f64::NAN))
}

/// The colour behind the coordinates of a vertex.
fn colour(text: &str) -> Option<[f32; 3]> {
    let mut numbers = text.split_ascii_whitespace().skip(3).map(|word| word.parse::<f32>().ok());
    Some([numbers.next()??, numbers.next()??, numbers.next()??])
}

/// Parses an index from 1, or from -1 for the last of `count` entries; [`NONE`] if it is invalid.
fn parse_index(word: &str, count: usize) -> u32 {
    let Ok(number) = word.parse::<i64>() else { return NONE };
    let index = if number < 0 { count as i64 + number } else { number - 1 };
    u32::try_from(index).unwrap_or(NONE)
}

fn intern(name: &str, names: &mut Vec<String>, indices: &mut HashMap<String, u32>) -> u32 {
    if let Some(&index) = indices.get(name) {
        return index;
    }
    let index = names.len() as u32;
    names.push(name.to_owned());
    indices.insert(name.to_owned(), index);
    index
}

fn shorten(text: &str) -> String {
    text.chars().take(60).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_source::testing::TestSink;

    fn parsed(text: &str) -> (ObjFile, Vec<(&'static str, String)>) {
        parsed_bytes(text.as_bytes())
    }

    fn parsed_bytes(mut bytes: &[u8]) -> (ObjFile, Vec<(&'static str, String)>) {
        let mut sink = TestSink::default();
        let file = parse("a.obj", &mut bytes, 1 << 20, &mut sink, &|| 0).unwrap();
        (file, sink.problems)
    }

    #[test]
    fn names_in_other_encodings_are_guessed_and_reported_once() {
        // A comment and names in Windows-1251: Дом, стена and крыша.
        let comment = b"# \xc4\xee\xec\n";
        let (file, problems) = parsed_bytes(comment);
        assert!(problems.is_empty() && file.names.len() == 1);
        let names = b"usemtl \xf1\xf2\xe5\xed\xe0\ng \xea\xf0\xfb\xf8\xe0\n";
        let (file, problems) = parsed_bytes(names);
        assert_eq!((file.materials[1].as_str(), file.names[1].as_str()), ("стена", "крыша"));
        assert_eq!(problems.len(), 1);
        assert!(problems[0].0 == ENCODING_GUESSED && problems[0].1.contains("taken as windows-1251"), "{problems:?}");
    }

    #[test]
    fn indices_count_from_one_or_from_the_end() {
        let (file, problems) =
            parsed("v 0 0 0\nv 1 0 0\r\nvt 0.5 1\nv 0 1 0 1\nf 1/1 2//7 3/1/2\nf -3/-1 -2 \\\n -1\nf 1 x 0");
        assert_eq!(file.positions[2], [0.0, 1.0, 0.0]);
        assert_eq!(file.corners[..6], [[0, 0], [1, NONE], [2, 0], [0, 0], [1, NONE], [2, NONE]]);
        assert_eq!(file.corners[6..], [[0, NONE], [NONE, NONE], [NONE, NONE]]);
        assert_eq!(file.faces.len(), 3);
        assert!(problems.is_empty());
    }

    #[test]
    fn vertices_may_have_colours() {
        let colours = |text: &str| parsed(text).0.colours;
        assert_eq!(colours("v 0 0 0 1 0 0.2\nv 1 0 0 0 0 0"), [[255, 0, 51], [0, 0, 0]]);
        assert_eq!(colours("v 0 0 0 255 0 51"), [[255, 0, 51]]);
        for text in ["v 0 0 0 1 1 1", "v 0 0 0 1 0 0\nv 0 0 0", "v 0 0 0 1"] {
            assert!(colours(text).is_empty(), "{text}");
        }
    }

    #[test]
    fn names_materials_and_faults_are_recorded() {
        let text =
            "mtllib a b.mtl\no house 1\ng walls\nusemtl brick\nf 1 2 3\no tree\nusemtl\nf 1 2 3\nf 1 2\nv 1 x 2\nq";
        let (file, problems) = parsed(text);
        assert_eq!(file.libraries, ["a b.mtl"]);
        let named = |face: &ObjFace| {
            let names = [face.object, face.group].map(|i| file.names[i as usize].as_str());
            (names, file.materials[face.material as usize].as_str())
        };
        assert_eq!(named(&file.faces[0]), (["house 1", "walls"], "brick"));
        assert_eq!(named(&file.faces[1]), (["tree", "walls"], ""));
        let expected = [
            ("face of less than three corners", "line 9: f 1 2"),
            ("vertex without three numbers", "line 10: v 1 x 2"),
        ];
        assert_eq!(problems, expected.map(|(kind, detail)| (kind, detail.to_owned())));
    }

    #[test]
    fn units_in_comments_are_named() {
        for (text, unit_m) in [
            ("# File units = inches\nv 0 0 0\n", Some("0.0254")),
            ("#\n# units: Centimeters\nv 0 0 0\n", Some("0.01")),
            ("# units in mm\nv 0 0 0\n", Some("0.001")),
            ("# File units = meters\nv 0 0 0\n", None),
            ("# 1 unit = 100 cm\nv 0 0 0\n", None),
            ("v 0 0 0\n# units = mm\n", None),
        ] {
            let problems = parsed(text).1;
            let is_named =
                |unit: &str| problems[0].0 == MESH_UNIT && problems[0].1.contains(&format!("\"scale\": {unit} in"));
            assert!(unit_m.map_or(problems.is_empty(), is_named), "{text}: {problems:?}");
        }
    }

    #[test]
    fn free_form_surfaces_are_named() {
        let problems = parsed("v 0 0 0\ncstype bspline\nsurf 0 1 0 1 1 1 1 1\nl 1 1\n").1;
        assert_eq!(problems, [(PART_NOT_READ, "line 3: a free-form surface".to_owned())]);
    }

    #[test]
    fn only_the_first_thousand_libraries_are_read() {
        let text: String = (0..1200).map(|i| format!("mtllib {i}.mtl\nmtllib {i}.mtl\n")).collect();
        let (file, problems) = parsed(&text);
        assert_eq!((file.libraries.len(), problems.len(), problems[0].0), (1000, 400, "too many material libraries"));
    }

    #[test]
    fn source_beyond_the_size_limit_is_an_error() {
        let result = parse("a.obj", &mut "v 0 0 0\n".repeat(100).as_bytes(), 99, &mut TestSink::default(), &|| 0);
        assert!(matches!(result, Err(InputError::TooLarge { limit: 99, .. })));
    }
}
