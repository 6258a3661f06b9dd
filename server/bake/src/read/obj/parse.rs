//! An OBJ's lines to arrays. Nothing is looked up yet: libraries and vertices may come after their use.
//!
//! In: lines. Out: [`ObjFile`]. Next: `objects`.

use std::collections::HashMap;
use std::io::BufRead;

use crate::read::error::InputError;
use crate::read::report::SourceReport;
use crate::read::source::next_line;

/// A longer line is damage.
const MAX_LINE_BYTES: usize = 1 << 22;
/// After how many lines progress is told.
const TICK_LINES: u64 = 1 << 14;
/// No vertex has this index.
pub(super) const NONE: u32 = u32::MAX;

/// A face as written.
#[derive(Debug, Clone, Copy)]
pub(super) struct ObjFace {
    /// Its corners are `corners[first..first + len]`.
    pub(super) first: usize,
    pub(super) len: u32,
    /// Index into `ObjFile::materials`.
    pub(super) material: u32,
    /// Index into `ObjFile::names`, of the last `o` and the last `g`.
    pub(super) object: u32,
    pub(super) group: u32,
    pub(super) line: u64,
}

/// What an OBJ says.
#[derive(Default)]
pub(super) struct ObjFile {
    pub(super) positions: Vec<[f64; 3]>,
    pub(super) uvs: Vec<[f32; 2]>,
    /// Position and texture coordinate, each from 0 or [`NONE`]; not checked against the counts.
    pub(super) corners: Vec<[u32; 2]>,
    pub(super) polygons: Vec<ObjFace>,
    /// Names after `usemtl`; the first is that of faces without one.
    pub(super) materials: Vec<String>,
    /// Names after `o` and `g`; the first is that of faces without one.
    pub(super) names: Vec<String>,
    /// Arguments of `mtllib`.
    pub(super) libraries: Vec<String>,
}

#[derive(Default)]
struct ObjParser {
    line: u64,
    material: u32,
    object: u32,
    group: u32,
    material_indices: HashMap<String, u32>,
    name_indices: HashMap<String, u32>,
}

/// Reads all lines; those that make no sense are noted and passed over.
pub(super) fn parse(
    lines: &mut dyn BufRead,
    limit: u64,
    report: &mut SourceReport,
    tick: &dyn Fn(),
) -> Result<ObjFile, InputError> {
    let mut model = ObjFile { materials: vec![String::new()], names: vec![String::new()], ..ObjFile::default() };
    let mut state = ObjParser::default();
    state.material_indices.insert(String::new(), 0);
    state.name_indices.insert(String::new(), 0);
    let (mut line, mut joined, mut bytes) = (Vec::new(), Vec::new(), 0);
    loop {
        let next = next_line(lines, &mut line, MAX_LINE_BYTES).map_err(|cause| InputError::io(&report.path, cause))?;
        state.line += u64::from(next.is_some());
        bytes += line.len() as u64 + 1;
        if bytes > limit {
            let what = "its unpacked size in bytes".to_owned();
            return Err(InputError::TooLarge { path: report.path.clone(), what, limit });
        }
        let goes_on = line.last() == Some(&b'\\') && joined.len() + line.len() < MAX_LINE_BYTES;
        joined.extend_from_slice(&line);
        if next == Some(false) {
            report.problem("line too long", || format!("line {}", state.line));
        } else if goes_on {
            joined.pop();
            joined.push(b' ');
            continue;
        }
        statement(&String::from_utf8_lossy(&joined), &mut model, &mut state, report);
        joined.clear();
        if next.is_none() {
            return Ok(model);
        }
        if state.line % TICK_LINES == 0 {
            tick();
        }
    }
}

fn statement(line: &str, model: &mut ObjFile, state: &mut ObjParser, report: &mut SourceReport) {
    let line = line.trim();
    let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    let rest = rest.trim();
    match word {
        "v" => {
            let [x, y, z] = numbers(rest);
            if [x, y, z].iter().any(|c| c.is_nan()) {
                report.problem("vertex without three numbers", || format!("line {}: {}", state.line, short(line)));
            }
            model.positions.push([x, y, z]);
        }
        "vt" => {
            let [u, v, _] = numbers(rest).map(|c| if c.is_nan() { 0.0 } else { c as f32 });
            model.uvs.push([u, v]);
        }
        "f" => face(rest, model, state, report),
        "usemtl" => state.material = intern(rest, &mut model.materials, &mut state.material_indices),
        "o" => state.object = intern(rest, &mut model.names, &mut state.name_indices),
        "g" => state.group = intern(rest, &mut model.names, &mut state.name_indices),
        "mtllib" if !model.libraries.iter().any(|known| known == rest) => model.libraries.push(rest.to_owned()),
        _ => {}
    }
}

/// The first three numbers; NaN for what is none.
fn numbers(text: &str) -> [f64; 3] {
    let mut words = text.split_ascii_whitespace();
    std::array::from_fn(|_| words.next().and_then(|word| word.parse().ok()).unwrap_or(f64::NAN))
}

fn face(text: &str, model: &mut ObjFile, state: &ObjParser, report: &mut SourceReport) {
    let first = model.corners.len();
    for word in text.split_ascii_whitespace() {
        let mut indices = word.split('/');
        let position = index(indices.next().unwrap_or(""), model.positions.len());
        let uv = index(indices.next().unwrap_or(""), model.uvs.len());
        model.corners.push([position, uv]);
    }
    let len = model.corners.len() - first;
    if len < 3 {
        report.problem("face of less than three corners", || format!("line {}: f {}", state.line, short(text)));
        model.corners.truncate(first);
        return;
    }
    model.polygons.push(ObjFace {
        first,
        len: len as u32,
        material: state.material,
        object: state.object,
        group: state.group,
        line: state.line,
    });
}

/// From 1, or counted back from the last one so far; [`NONE`] if it is no index.
fn index(word: &str, so_far: usize) -> u32 {
    let Ok(number) = word.parse::<i64>() else { return NONE };
    let index = if number < 0 { so_far as i64 + number } else { number - 1 };
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

fn short(text: &str) -> String {
    text.chars().take(60).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read::report::SourceFormat;

    fn parsed(text: &str) -> (ObjFile, SourceReport) {
        let mut report = SourceReport::new("a.obj", SourceFormat::Obj, 0);
        let model = parse(&mut text.as_bytes(), 1 << 20, &mut report, &|| {}).unwrap();
        (model, report)
    }

    #[test]
    fn indices_count_from_one_or_back() {
        let (model, report) =
            parsed("v 0 0 0\nv 1 0 0\r\nvt 0.5 1\nv 0 1 0 1\nf 1/1 2//7 3/1/2\nf -3/-1 -2 \\\n -1\nf 1 x 0");
        assert_eq!(model.positions[2], [0.0, 1.0, 0.0]);
        assert_eq!(model.corners[..6], [[0, 0], [1, NONE], [2, 0], [0, 0], [1, NONE], [2, NONE]]);
        assert_eq!(model.corners[6..], [[0, NONE], [NONE, NONE], [NONE, NONE]]);
        assert_eq!(model.polygons.len(), 3);
        assert!(report.problems.is_empty());
    }

    #[test]
    fn names_materials_and_faults_are_kept() {
        let text =
            "mtllib a b.mtl\no house 1\ng walls\nusemtl brick\nf 1 2 3\no tree\nusemtl\nf 1 2 3\nf 1 2\nv 1 x 2\nq";
        let (model, report) = parsed(text);
        assert_eq!(model.libraries, ["a b.mtl"]);
        let named = |polygon: &ObjFace| {
            let names = [polygon.object, polygon.group].map(|i| model.names[i as usize].as_str());
            (names, model.materials[polygon.material as usize].as_str())
        };
        assert_eq!(named(&model.polygons[0]), (["house 1", "walls"], "brick"));
        assert_eq!(named(&model.polygons[1]), (["tree", "walls"], ""));
        assert_eq!(report.problems["face of less than three corners"].first, ["line 9: f 1 2"]);
        assert_eq!(report.problems["vertex without three numbers"].count, 1);
    }

    #[test]
    fn an_unpacked_flood_is_an_error() {
        let mut report = SourceReport::new("a.obj", SourceFormat::Obj, 0);
        let result = parse(&mut "v 0 0 0\n".repeat(100).as_bytes(), 99, &mut report, &|| {});
        assert!(matches!(result, Err(InputError::TooLarge { limit: 99, .. })));
    }
}
