//! Well-known text, also with the prefix `SRID=4326;` of PostGIS.

use super::geometry::{Geometry, MALFORMED, MAX_DEPTH, Polygon, Ring, TOO_DEEP, UNKNOWN_TYPE, is_same_place};
use insula_source::arc::divide_arcs;
use insula_source::text::split_words;

/// Names of geometries. Longer names come before their beginnings.
const NAMES: [&str; 17] = split_words(
    "POINT LINESTRING POLYGON TRIANGLE MULTIPOINT MULTILINESTRING MULTIPOLYGON GEOMETRYCOLLECTION CIRCULARSTRING \
    COMPOUNDCURVE CURVEPOLYGON MULTICURVE MULTISURFACE POLYHEDRALSURFACE TIN LINEARRING SURFACE",
);

/// Whether a text begins as a geometry does.
pub(super) fn looks_like_wkt(text: &str) -> bool {
    let (_, text) = split_srid(text.trim_start());
    let mut parser = WktParser::new(text);
    parser.tag().is_ok_and(|name| !name.is_empty()) && (parser.peek() == Some(b'(') || parser.takes_word("EMPTY"))
}

/// Reads a geometry. Returns its SRID if it names one. Fails with the reason for skipping the feature.
pub(super) fn parse(text: &str, geometry: &mut Geometry) -> Result<Option<u32>, &'static str> {
    let (srid, rest) = split_srid(text.trim_start());
    let mut parser = WktParser::new(rest);
    parser.geometry(geometry, 0)?;
    geometry.has_z |= parser.found_z;
    geometry.level_without_heights();
    if parser.peek().is_some_and(|byte| byte != b';') { Err(MALFORMED) } else { Ok(srid) }
}

/// Splits off `SRID=4326;` or `EPSG:4326;`.
fn split_srid(text: &str) -> (Option<u32>, &str) {
    let head = text.get(..5).unwrap_or_default();
    if !head.eq_ignore_ascii_case("srid=") && !head.eq_ignore_ascii_case("epsg:") && !head.eq_ignore_ascii_case("epsg=")
    {
        return (None, text);
    }
    match text[5..].split_once(';') {
        Some((number, rest)) => (number.trim().parse().ok(), rest),
        None => (None, text),
    }
}

struct WktParser<'a> {
    rest: &'a str,
    /// Dimensions named by the current tag.
    has_z: bool,
    has_m: bool,
    /// A position has a height.
    found_z: bool,
}

impl<'a> WktParser<'a> {
    fn new(rest: &'a str) -> Self {
        Self { rest, has_z: false, has_m: false, found_z: false }
    }

    fn peek(&mut self) -> Option<u8> {
        self.rest = self.rest.trim_start();
        self.rest.bytes().next()
    }

    fn takes(&mut self, byte: u8) -> bool {
        let is_next = self.peek() == Some(byte);
        if is_next {
            self.rest = &self.rest[1..];
        }
        is_next
    }

    fn expect(&mut self, byte: u8) -> Result<(), &'static str> {
        if self.takes(byte) { Ok(()) } else { Err(MALFORMED) }
    }

    fn word(&mut self) -> &str {
        self.peek();
        let end = self.rest.find(|c: char| !c.is_ascii_alphabetic()).unwrap_or(self.rest.len());
        let (word, rest) = self.rest.split_at(end);
        self.rest = rest;
        word
    }

    fn takes_word(&mut self, expected: &str) -> bool {
        let before = self.rest;
        let is_next = self.word().eq_ignore_ascii_case(expected);
        if !is_next {
            self.rest = before;
        }
        is_next
    }

    /// The name of a geometry with its dimensions (`POINT Z`, `POINTZ`); empty if a parenthesis follows directly.
    fn tag(&mut self) -> Result<&'static str, &'static str> {
        let word = self.word().to_ascii_uppercase();
        if word.is_empty() {
            return Ok("");
        }
        let found = NAMES.iter().find_map(|name| Some((*name, word.strip_prefix(name)?)));
        let (name, attached) = found.ok_or(UNKNOWN_TYPE)?;
        let before = self.rest;
        let dimensions = if attached.is_empty() { self.word().to_ascii_uppercase() } else { attached.to_owned() };
        (self.has_z, self.has_m) = match dimensions.as_str() {
            "Z" => (true, false),
            "M" => (false, true),
            "ZM" => (true, true),
            _ if attached.is_empty() => {
                self.rest = before;
                (false, false)
            }
            _ => return Err(UNKNOWN_TYPE),
        };
        Ok(name)
    }

    fn number(&mut self) -> Result<f64, &'static str> {
        self.peek();
        let end = self.rest.find(|c: char| !(c.is_ascii_alphanumeric() || matches!(c, '.' | '+' | '-')));
        let (number, rest) = self.rest.split_at(end.unwrap_or(self.rest.len()));
        self.rest = rest;
        number.parse().map_err(|_| MALFORMED)
    }

    fn position(&mut self) -> Result<[f64; 3], &'static str> {
        let (x, y) = (self.number()?, self.number()?);
        let mut z = f64::NAN;
        for index in 0..2 {
            if matches!(self.peek(), None | Some(b',' | b')')) {
                break;
            }
            let value = self.number()?;
            // A third number is z unless the tag says that it is m.
            if index == 0 && (self.has_z || !self.has_m) {
                z = value;
                self.found_z = true;
            }
        }
        Ok([x, y, z])
    }

    /// Items in parentheses, separated by commas; none for `EMPTY`.
    fn list(&mut self, mut item: impl FnMut(&mut Self) -> Result<(), &'static str>) -> Result<(), &'static str> {
        if self.takes_word("EMPTY") {
            return Ok(());
        }
        self.expect(b'(')?;
        loop {
            item(self)?;
            if !self.takes(b',') {
                return self.expect(b')');
            }
        }
    }

    fn line(&mut self) -> Result<Ring, &'static str> {
        let mut line = Ring::new();
        self.list(|parser| {
            line.push(parser.position()?);
            Ok(())
        })?;
        Ok(line)
    }

    fn polygon(&mut self) -> Result<Polygon, &'static str> {
        let mut polygon = Polygon::new();
        self.list(|parser| {
            polygon.push(parser.line()?);
            Ok(())
        })?;
        Ok(polygon)
    }

    /// A ring or part of a curve, with or without a tag.
    fn curve(&mut self, depth: u32) -> Result<Ring, &'static str> {
        if depth > MAX_DEPTH {
            return Err(TOO_DEEP);
        }
        if self.takes_word("EMPTY") {
            return Ok(Ring::new());
        }
        if self.peek() == Some(b'(') {
            return self.line();
        }
        match self.tag()? {
            "LINESTRING" => self.line(),
            "CIRCULARSTRING" => Ok(divide_arcs(&self.line()?)),
            "COMPOUNDCURVE" => self.compound_curve(depth),
            _ => Err(UNKNOWN_TYPE),
        }
    }

    fn compound_curve(&mut self, depth: u32) -> Result<Ring, &'static str> {
        let mut line = Ring::new();
        self.list(|parser| {
            let part = parser.curve(depth + 1)?;
            let shared = usize::from(is_same_place(line.last(), part.first()));
            line.extend(part.into_iter().skip(shared));
            Ok(())
        })?;
        Ok(line)
    }

    fn curve_polygon(&mut self, depth: u32) -> Result<Polygon, &'static str> {
        let mut polygon = Polygon::new();
        self.list(|parser| {
            polygon.push(parser.curve(depth + 1)?);
            Ok(())
        })?;
        Ok(polygon)
    }

    fn geometry(&mut self, geometry: &mut Geometry, depth: u32) -> Result<(), &'static str> {
        if depth > MAX_DEPTH {
            return Err(TOO_DEEP);
        }
        let name = self.tag()?;
        match name {
            "POINT" => self.list(|parser| {
                geometry.push_point(parser.position()?);
                Ok(())
            }),
            "MULTIPOINT" => self.list(|parser| {
                if parser.takes_word("EMPTY") {
                    return Ok(());
                }
                let is_nested = parser.takes(b'(');
                geometry.push_point(parser.position()?);
                if is_nested { parser.expect(b')') } else { Ok(()) }
            }),
            "LINESTRING" => self.line().map(|line| geometry.push_line(line)),
            "LINEARRING" => self.line().map(|line| geometry.push_polygon(vec![line])),
            "CIRCULARSTRING" => self.line().map(|line| geometry.push_line(divide_arcs(&line))),
            "COMPOUNDCURVE" => self.compound_curve(depth).map(|line| geometry.push_line(line)),
            "MULTILINESTRING" | "MULTICURVE" => self.list(|parser| {
                geometry.push_line(parser.curve(depth + 1)?);
                Ok(())
            }),
            "POLYGON" | "TRIANGLE" => self.polygon().map(|polygon| geometry.push_polygon(polygon)),
            "CURVEPOLYGON" => self.curve_polygon(depth).map(|polygon| geometry.push_polygon(polygon)),
            "MULTIPOLYGON" | "POLYHEDRALSURFACE" | "TIN" => {
                geometry.is_surface |= name != "MULTIPOLYGON";
                self.list(|parser| parser.polygon().map(|polygon| geometry.push_polygon(polygon)))
            }
            "MULTISURFACE" => self.list(|parser| match parser.peek() {
                Some(b'(') => parser.polygon().map(|polygon| geometry.push_polygon(polygon)),
                _ => parser.geometry(geometry, depth + 1),
            }),
            "GEOMETRYCOLLECTION" => self.list(|parser| parser.geometry(geometry, depth + 1)),
            _ => Err(UNKNOWN_TYPE),
        }
    }
}
