//! Lines of values, one of which is a geometry as WKT, as hexadecimal WKB or as GeoJSON, or two the coordinates of a point.

mod marks;
mod place;

use super::feature::{DEGREES, FeatureWriter};
use super::geometry::Geometry;
use super::layer::Layer;
use super::{geojson, local, wkb, wkt};
use ::csv::{ByteRecord, Reader, ReaderBuilder};
use insula_source::attributes::{AttributeValue, Attributes};
use insula_source::code_page::CodePage;
use insula_source::decimal_mark::DecimalMark;
use insula_source::error::InputError;
use insula_source::input::{Input, OpenInput};
use insula_source::object::{Description, ObjectSink};
use insula_source::problems::{ENCODING_GUESSED, MARK_GUESSED};
use insula_source::text::{decoded, is_usual, likely_encoding, split_words};
use place::Place;
use std::io::{BufRead, Read};

/// Names of geometry columns, in lower case, the most certain first.
pub(super) const GEOMETRY_NAMES: [&str; 10] =
    split_words("wkt the_geom geom geometry wkt_geom wkt_geometry geom_wkt geometry_wkt wkb_geometry shape");
/// Names of columns with the EPSG code of the geometry.
const SRID_NAMES: [&str; 3] = ["epsg", "srid", "crs"];
const DELIMITERS: [u8; 4] = [b',', b';', b'\t', b'|'];
const NO_GEOMETRY: &str = "no geometry";
/// Beginning of an object of JSON whose quotation marks are not doubled, as MySQL has it.
const ESCAPED_JSON: &[u8] = b"{\\\"";
/// Bytes in which the delimiter is looked for.
const HEAD_BYTES: u64 = 1 << 16;
/// Lines between two progress reports.
const TICK_LINES: u64 = 256;

struct Columns {
    names: Vec<String>,
    place: Place,
    srid: Option<usize>,
    delimiter: u8,
    /// What is before the decimals of numbers, of each column in which that has to be known.
    marks: Vec<Option<DecimalMark>>,
    encoding: CodePage,
    /// No line was beyond ASCII so far, which would tell the encoding.
    is_open: bool,
    /// A line that is not in UTF-8, although others are, is reported.
    is_mixed: bool,
}

/// Reads a source, also one of GeoJSON in lines. Fails if no column has geometries, or if it is in a system that cannot be placed.
pub fn read(input: &Input<'_>, sink: &mut dyn ObjectSink) -> Result<(), InputError> {
    let OpenInput { mut reader, bytes_read } = input.open()?;
    let mut head = Vec::new();
    reader.by_ref().take(HEAD_BYTES).read_to_end(&mut head).map_err(|cause| InputError::io(input.label, cause))?;
    // Large sets of footprints are so named.
    if geojson::is_of_lines(&head) {
        return geojson::read(input, sink);
    }
    let is_whole = (head.len() as u64) < HEAD_BYTES;
    let delimiter = match told_delimiter(&head) {
        Some((delimiter, line_bytes)) => {
            head.drain(..line_bytes);
            delimiter
        }
        None => delimiter_of(&head),
    };
    let guess = likely_encoding(&head);
    let is_open = head.is_ascii();
    let mut builder = ReaderBuilder::new();
    builder.has_headers(false).flexible(true).delimiter(delimiter);
    if head.windows(ESCAPED_JSON.len()).any(|text| text == ESCAPED_JSON) {
        builder.escape(Some(b'\\')).double_quote(false);
    }
    let sample = head.clone();
    let whole: Box<dyn BufRead + '_> = Box::new(std::io::Cursor::new(head).chain(reader));
    let mut lines = builder.from_reader(whole);
    let mut writer = FeatureWriter::new(input, sink);
    let mut first = ByteRecord::new();
    let mut second = ByteRecord::new();
    let has_first = next(input, &mut lines, &mut first)?;
    let has_second = has_first && next(input, &mut lines, &mut second)?;
    let Some((mut columns, has_names)) = columns_of(&first, &second, delimiter, guess.page) else {
        return Err(InputError::unsupported(
            input.label,
            "lines of values without a column of geometries as WKT or GeoJSON, and without columns lon and lat, or x and y",
        ));
    };
    columns.is_open = is_open;
    for guess in columns.settle_marks(&mut builder.from_reader(marks::whole_lines(&sample, is_whole)), has_names) {
        writer.sink.problem(MARK_GUESSED, format!("{}: {guess}", input.name));
    }
    if !is_usual(guess) {
        writer.sink.problem(ENCODING_GUESSED, guessed(&columns.names.join(", "), guess.page, input));
    }
    let layer = Layer::of_file(input.name, columns.names.iter().map(String::as_str));
    let in_degrees = || columns.place.is_in_degrees().then(|| DEGREES.to_owned());
    writer.begin(layer, local::system_beside(input).or_else(in_degrees))?;
    if let Some(attribution) = local::attribution_beside(input) {
        writer.sink.describe(Description::Attribution, &attribution);
    }
    if !has_names {
        add(&first, &columns, &mut writer)?;
    }
    if has_second {
        add(&second, &columns, &mut writer)?;
    }
    let mut count = 0;
    while next(input, &mut lines, &mut second)? {
        columns.settle(&second, input, &mut writer);
        add(&second, &columns, &mut writer)?;
        count += 1;
        if u64::is_multiple_of(count, TICK_LINES) {
            writer.sink.tick(bytes_read.get());
        }
    }
    writer.sink.tick(bytes_read.get());
    writer.finish()
}

/// What to tell about the guess of an encoding, by a text that shows it.
fn guessed(text: &str, page: CodePage, input: &Input<'_>) -> String {
    format!("{}: {text}: taken as {page}; write it in UTF-8 if letters are wrong", input.name)
}

impl Columns {
    fn new(names: Vec<String>, place: Place, delimiter: u8, encoding: CodePage) -> Self {
        let (srid, marks) = (None, Vec::new());
        Self { names, place, srid, delimiter, marks, encoding, is_open: false, is_mixed: false }
    }

    /// What is before the decimals of numbers of a column, if that has to be known.
    fn mark(&self, index: usize) -> Option<DecimalMark> {
        self.marks.get(index).copied().flatten()
    }

    /// Guesses the encoding by the first line beyond ASCII, if the beginning of the file has none. Reports one that is not in UTF-8 in a
    /// file that is.
    fn settle(&mut self, record: &ByteRecord, input: &Input<'_>, writer: &mut FeatureWriter<'_>) {
        let line = record.as_slice();
        let is_settled = !self.is_open && (self.is_mixed || self.encoding != CodePage::UTF8);
        if is_settled || line.is_ascii() {
            return;
        }
        let guess = likely_encoding(line);
        if self.is_open {
            self.encoding = guess.page;
        }
        self.is_mixed |= !self.is_open && guess.page != CodePage::UTF8;
        if self.is_mixed || !is_usual(guess) {
            let page = guess.page;
            let text: String = decoded(line, page).chars().filter(|letter| !letter.is_ascii()).take(8).collect();
            writer.sink.problem(ENCODING_GUESSED, guessed(&text, page, input));
        }
        self.is_open = false;
    }
}

fn next(
    input: &Input<'_>,
    lines: &mut Reader<Box<dyn BufRead + '_>>,
    record: &mut ByteRecord,
) -> Result<bool, InputError> {
    lines.read_byte_record(record).map_err(|error| {
        let line = error.position().map_or(0, ::csv::Position::line);
        match error.into_kind() {
            ::csv::ErrorKind::Io(cause) => InputError::io(input.label, cause),
            other => InputError::damaged(input.label, format!("line {line}"), format!("{other:?}")),
        }
    })
}

/// The delimiter that a first line `sep=;` tells, as Excel has it, and the bytes of that line.
fn told_delimiter(head: &[u8]) -> Option<(u8, usize)> {
    let line = head.split_inclusive(|byte| *byte == b'\n').next()?;
    let is_told = line.get(..4).is_some_and(|word| word.eq_ignore_ascii_case(b"sep="));
    match line.get(4..)?.trim_ascii_end() {
        [delimiter] if is_told => Some((*delimiter, line.len())),
        // A tabulator is white space.
        [] if is_told && line.get(4) == Some(&b'\t') => Some((b'\t', line.len())),
        _ => None,
    }
}

/// The delimiter that is most frequent in the first line, outside of quotation marks.
fn delimiter_of(head: &[u8]) -> u8 {
    let mut counts = [0; DELIMITERS.len()];
    let mut is_quoted = false;
    // A geometry without quotation marks has commas within parentheses.
    let mut depth = 0_i32;
    for byte in head {
        match byte {
            b'"' => is_quoted = !is_quoted,
            b'\n' if !is_quoted => break,
            b'(' if !is_quoted => depth += 1,
            b')' if !is_quoted => depth -= 1,
            _ if !is_quoted && depth <= 0 => {
                if let Some(index) = DELIMITERS.iter().position(|delimiter| delimiter == byte) {
                    counts[index] += 1;
                }
            }
            _ => {}
        }
    }
    let best = (0..DELIMITERS.len()).rev().max_by_key(|index| counts[*index]).unwrap_or(0);
    DELIMITERS[best]
}

/// Finds the columns by the first two lines, and whether the first line has their names; `None` without a geometry.
fn columns_of(first: &ByteRecord, second: &ByteRecord, delimiter: u8, encoding: CodePage) -> Option<(Columns, bool)> {
    let is_geometry = |field: &[u8]| {
        let text = decoded(field, encoding);
        wkt::looks_like_wkt(&text) || wkb::bytes_of_hex(&text).is_some() || geojson::looks_like_geometry(&text)
    };
    if let Some(geometry) = first.iter().position(is_geometry) {
        let names = (1..=first.len()).map(|number| format!("column {number}")).collect();
        return Some((Columns::new(names, Place::Text(geometry), delimiter, encoding), false));
    }
    let names: Vec<String> = first.iter().map(|name| decoded(name, encoding).trim().to_owned()).collect();
    let lower: Vec<String> = names.iter().map(|name| name.to_lowercase()).collect();
    let by_name = GEOMETRY_NAMES.iter().filter_map(|known| lower.iter().position(|name| name == known));
    let is_filled = |index: &usize| second.get(*index).is_some_and(is_geometry);
    let mut candidates: Vec<usize> = by_name.collect();
    candidates.extend((0..names.len()).filter(is_filled));
    let filled = candidates.iter().copied().find(is_filled).map(Place::Text);
    let place = filled.or_else(|| Place::of_names(&lower)).or_else(|| candidates.first().copied().map(Place::Text))?;
    let srid = SRID_NAMES.iter().find_map(|known| lower.iter().position(|name| name == known));
    Some((Columns { srid, ..Columns::new(names, place, delimiter, encoding) }, true))
}

fn add(record: &ByteRecord, columns: &Columns, writer: &mut FeatureWriter<'_>) -> Result<(), InputError> {
    if record.iter().all(<[u8]>::is_empty) {
        return Ok(());
    }
    let line = record.position().map_or(0, ::csv::Position::line);
    let mut attributes = Attributes::default();
    for (index, field) in record.iter().enumerate() {
        let text = decoded(field, columns.encoding);
        if let Some(name) = columns.names.get(index)
            && !columns.place.is_of(index)
            && !text.trim().is_empty()
        {
            let value = columns.mark(index).and_then(|mark| mark.value(&text));
            attributes.push(name, value.unwrap_or_else(|| AttributeValue::from_untyped(&text)));
        }
    }
    let field = |index| decoded(record.get(index).unwrap_or_default(), columns.encoding);
    let mut srid = columns.srid.and_then(|index| code_of(&field(index)));
    let mut geometry = Geometry::default();
    let parsed = match &columns.place {
        Place::Text(index) => geometry_of(&field(*index), &mut geometry),
        place => {
            let mark = place.map_column().and_then(|index| columns.mark(index));
            place.add_point(field, columns.delimiter, mark, &mut geometry).map(|()| None)
        }
    };
    if let Ok(Some(own)) = parsed {
        srid = Some(own);
    }
    if parsed.is_ok() {
        writer.set_srid(srid)?;
    }
    writer.add(Some(format!("line {line}")), attributes, parsed.map(|_| geometry))
}

/// Reads a geometry; returns the code of its system if it tells one.
pub(super) fn geometry_of(text: &str, geometry: &mut Geometry) -> Result<Option<u32>, &'static str> {
    match wkb::bytes_of_hex(text) {
        _ if text.trim().is_empty() => Err(NO_GEOMETRY),
        Some(bytes) => wkb::parse(&bytes, geometry),
        None if geojson::looks_like_geometry(text) => {
            let (parsed, code) = geojson::parse_geometry(text)?;
            *geometry = parsed;
            Ok(code)
        }
        None => wkt::parse(text, geometry),
    }
}

/// The code in `28992` or `EPSG:28992`.
fn code_of(text: &str) -> Option<u32> {
    let text = text.trim();
    let head = text.get(..5).unwrap_or_default();
    if head.eq_ignore_ascii_case("epsg:") { text[5..].trim().parse().ok() } else { text.parse().ok() }
}
