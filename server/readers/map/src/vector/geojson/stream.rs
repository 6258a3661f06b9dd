//! Parses a GeoJSON document as a stream. Only one feature is in memory at a time.

use super::features::FeatureReader;
use super::geometry::GEOMETRY_TYPES;
use insula_source::error::InputError;
use insula_source::input::Input;
use insula_source::json::lenient::LenientReader;
use insula_source::source::{CitySource, open};
use serde::de::{DeserializeSeed, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_json::value::RawValue;
use serde_json::{Map, Value};
use std::cell::{Cell, RefCell};
use std::fmt;
use std::io::{self, BufRead, Read};

/// Bytes at the end of a document in which its coordinate system is looked for.
const END_BYTES: usize = 1 << 14;
const COLLECTION: &str = "FeatureCollection";
const FEATURE: &str = "Feature";
/// Members of which a document that is a single feature or geometry is made.
const MEMBERS: [&str; 7] = ["id", "properties", "geometry", "place", "coordRefSys", "coordinates", "geometries"];

/// Whether a JSON document of this type is GeoJSON.
pub fn is_type(name: &str) -> bool {
    name == COLLECTION || name == FEATURE || GEOMETRY_TYPES.contains(&name)
}

/// Reads a document feature by feature. Fails if it is damaged, exceeds a limit or is no GeoJSON.
pub(crate) fn read(
    reader: Box<dyn BufRead + '_>,
    features: &mut FeatureReader<'_>,
    input: &Input<'_>,
    bytes_read: &dyn Fn() -> u64,
) -> Result<(), InputError> {
    let limits = ByteLimits::new(input.max_bytes, input.max_line_bytes);
    let label = features.label.to_owned();
    let mut json = serde_json::Deserializer::from_reader(LimitedReader {
        inner: LenientReader::new(skip_bom(reader)),
        limits: &limits,
    });
    let stopped = RefCell::new(None);
    let visitor = DocumentVisitor { features, input, limits: &limits, stopped: &stopped, bytes_read };
    let result = json.deserialize_map(visitor).and_then(|()| {
        limits.next_member();
        json.end()
    });
    match (stopped.into_inner(), result) {
        (Some(error), _) => Err(error),
        (None, Ok(())) => Ok(()),
        (None, Err(error)) => Err(limits.exceeded(&label).unwrap_or_else(|| {
            if error.is_io() { InputError::io(&label, error.into()) } else { InputError::json(&label, &error) }
        })),
    }
}

/// The `type` member of any JSON document, found without reading all of it; `None` if there is none.
pub fn read_type(source: &CitySource<'_>, limit: u64) -> Option<String> {
    let reader = open(source).ok()?.reader.take(limit);
    let kind = RefCell::new(None);
    // The result is always an error, because the visitor stops as soon as it has found the type.
    let _ = serde_json::Deserializer::from_reader(skip_bom(reader)).deserialize_map(TypeVisitor(&kind));
    kind.into_inner()
}

/// The `coordRefSys` member of a document, found without keeping its features; `None` if there is none, or if the document is damaged,
/// which is an error when its features are read.
pub(super) fn find_place_system(input: &Input<'_>) -> Option<Value> {
    let limits = ByteLimits::new(input.max_bytes, input.max_line_bytes);
    let opened = Input { max_bytes: u64::MAX, ..*input }.open().ok()?;
    let reader = LimitedReader { inner: LenientReader::new(skip_bom(opened.reader)), limits: &limits };
    serde_json::Deserializer::from_reader(reader).deserialize_map(PlaceSystemVisitor(&limits)).ok()?
}

/// The `crs` member at the end of a document; `None` if there is none, or if the end cannot be read.
fn find_crs_at_end(input: &Input<'_>) -> Option<Value> {
    let end = end_of(input).ok()?;
    let name = b"\"crs\"";
    let mut places = end.windows(name.len()).enumerate().filter(|(_, window)| window == name).map(|(place, _)| place);
    // That of a feature has more behind its own object.
    places.find_map(|place| {
        let members = [b"{".as_slice(), end.get(place..)?].concat();
        serde_json::from_slice::<Map<String, Value>>(&members).ok()?.remove("crs")
    })
}

/// The last bytes of a text. Fails if it cannot be read.
fn end_of(input: &Input<'_>) -> io::Result<Vec<u8>> {
    let mut end = Vec::new();
    if input.files.is_random() {
        let file = input.files.random(input.name)?;
        if input.is_plain(&mut file.reader(0))? {
            file.reader(file.bytes().saturating_sub(END_BYTES as u64)).read_to_end(&mut end)?;
            return Ok(end);
        }
    }
    let mut reader = input.open().map_err(io::Error::other)?.reader;
    while reader.by_ref().take(END_BYTES as u64).read_to_end(&mut end)? > 0 {
        end.drain(..end.len().saturating_sub(END_BYTES));
    }
    Ok(end)
}

/// Skips a byte order mark.
fn skip_bom<R: BufRead>(mut reader: R) -> R {
    if reader.fill_buf().is_ok_and(|buffer| buffer.starts_with(b"\xef\xbb\xbf")) {
        reader.consume(3);
    }
    reader
}

struct TypeVisitor<'k>(&'k RefCell<Option<String>>);

impl<'de> Visitor<'de> for TypeVisitor<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some(name) = map.next_key::<String>()? {
            if name == "type" {
                *self.0.borrow_mut() = Some(map.next_value()?);
                return Err(A::Error::custom("found"));
            }
            map.next_value::<IgnoredAny>()?;
        }
        Ok(())
    }
}

struct PlaceSystemVisitor<'l>(&'l ByteLimits);

impl<'de> Visitor<'de> for PlaceSystemVisitor<'_> {
    type Value = Option<Value>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
        let mut found = None;
        loop {
            self.0.next_member();
            match map.next_key::<String>()?.as_deref() {
                Some("coordRefSys") => found = Some(map.next_value()?),
                Some("features") => map.next_value_seed(SkippedFeatures(self.0))?,
                Some(_) => map.next_value::<IgnoredAny>().map(|_| ())?,
                None => return Ok(found),
            }
        }
    }
}

/// Passes over features. Each may have as many bytes as if it were read.
struct SkippedFeatures<'l>(&'l ByteLimits);

impl<'de> DeserializeSeed<'de> for SkippedFeatures<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for SkippedFeatures<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list of features")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<(), A::Error> {
        loop {
            self.0.next_member();
            if seq.next_element::<IgnoredAny>()?.is_none() {
                return Ok(());
            }
        }
    }
}

/// Limits on the bytes of the whole document and of the current member or feature, which is held in memory.
struct ByteLimits {
    all: ByteLimit,
    member: ByteLimit,
}

struct ByteLimit {
    what: &'static str,
    bytes: u64,
    remaining: Cell<u64>,
    exceeded: Cell<bool>,
}

impl ByteLimits {
    fn new(all: u64, member: u64) -> Self {
        let limit = |what, bytes| ByteLimit { what, bytes, remaining: Cell::new(bytes), exceeded: Cell::new(false) };
        Self { all: limit("its size in bytes", all), member: limit("the size of one feature in bytes", member) }
    }

    fn next_member(&self) {
        self.member.remaining.set(self.member.bytes);
    }

    fn take(&self, bytes: u64) -> io::Result<()> {
        for limit in [&self.all, &self.member] {
            let remaining = limit.remaining.get().checked_sub(bytes);
            limit.exceeded.set(remaining.is_none());
            limit.remaining.set(remaining.ok_or_else(|| io::Error::other("too large"))?);
        }
        Ok(())
    }

    fn exceeded(&self, path: &str) -> Option<InputError> {
        let limit = [&self.all, &self.member].into_iter().find(|limit| limit.exceeded.get())?;
        Some(limit.error(path))
    }
}

impl ByteLimit {
    fn error(&self, path: &str) -> InputError {
        InputError::TooLarge { path: path.to_owned(), what: self.what.to_owned(), limit: self.bytes }
    }
}

/// Counts bytes against limits. The parser reads single bytes, so only bytes that it has seen are counted.
struct LimitedReader<'l, R> {
    inner: R,
    limits: &'l ByteLimits,
}

impl<R: Read> Read for LimitedReader<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(buffer)?;
        self.limits.take(read as u64)?;
        Ok(read)
    }
}

/// Visits the members of the document in order.
struct DocumentVisitor<'d, 'a> {
    features: &'d mut FeatureReader<'a>,
    input: &'d Input<'d>,
    limits: &'d ByteLimits,
    /// The error that ended the parsing, because serde can only pass on a text.
    stopped: &'d RefCell<Option<InputError>>,
    bytes_read: &'d dyn Fn() -> u64,
}

impl DocumentVisitor<'_, '_> {
    fn check<E: Error>(&self, result: Result<(), InputError>) -> Result<(), E> {
        result.map_err(|error| {
            self.stopped.replace(Some(error));
            E::custom("stopped")
        })
    }

    fn wrong_type(&self, kind: Option<&str>) -> InputError {
        let what = match kind {
            Some(kind) => format!("its type is {kind}, not \"{COLLECTION}\", \"{FEATURE}\" or a geometry"),
            None => "not GeoJSON".to_owned(),
        };
        InputError::unsupported(self.features.label, what)
    }
}

impl<'de> Visitor<'de> for DocumentVisitor<'_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a GeoJSON document")
    }

    fn visit_map<A: MapAccess<'de>>(mut self, mut map: A) -> Result<(), A::Error> {
        let mut kind: Option<String> = None;
        let mut single = SingleFeature { members: Vec::new(), bytes: 0 };
        loop {
            self.limits.next_member();
            let Some(name) = map.next_key::<String>()? else { break };
            if name == "features" {
                // Some programs write it last.
                if !self.features.has_crs()
                    && let Some(crs) = find_crs_at_end(self.input)
                {
                    let agreed = self.features.set_crs(&crs);
                    self.check(agreed)?;
                }
                map.next_value_seed(FeaturesVisitor(&mut self))?;
                continue;
            }
            let raw: Box<RawValue> = map.next_value()?;
            match name.as_str() {
                "type" => {
                    kind = serde_json::from_str(raw.get()).ok().filter(|kind: &String| is_type(kind));
                    if kind.is_none() {
                        let shown: String = raw.get().chars().take(64).collect();
                        self.check(Err(self.wrong_type(Some(&shown))))?;
                    }
                }
                "crs" => {
                    let crs: Value = serde_json::from_str(raw.get()).map_err(A::Error::custom)?;
                    let agreed = self.features.set_crs(&crs);
                    self.check(agreed)?;
                }
                "coordRefSys" => {
                    let system: Value = serde_json::from_str(raw.get()).map_err(A::Error::custom)?;
                    self.features.set_place_system(&system);
                }
                name => {
                    if let Ok(Value::String(text)) = serde_json::from_str(raw.get()) {
                        self.features.describe(name, &text);
                    }
                }
            }
            // The type may be the last member.
            if kind.as_deref() != Some(COLLECTION) && MEMBERS.contains(&name.as_str()) {
                let kept = single.keep(name, raw, &self.limits.member, self.features.label);
                self.check(kept)?;
            }
        }
        match kind.as_deref() {
            None => self.check(Err(self.wrong_type(None))),
            Some(COLLECTION) => Ok(()),
            Some(kind) => {
                let read = self.features.read_feature(single.text(kind).as_bytes());
                self.check(read)
            }
        }
    }
}

/// The members of a document that is a single feature or geometry.
struct SingleFeature {
    members: Vec<(String, Box<RawValue>)>,
    bytes: u64,
}

impl SingleFeature {
    /// Fails if all members together exceed the limit of one feature.
    fn keep(&mut self, name: String, raw: Box<RawValue>, limit: &ByteLimit, label: &str) -> Result<(), InputError> {
        self.bytes += raw.get().len() as u64;
        if self.bytes > limit.bytes {
            return Err(limit.error(label));
        }
        self.members.push((name, raw));
        Ok(())
    }

    fn text(&self, kind: &str) -> String {
        let members: Vec<String> = self.members.iter().map(|(name, raw)| format!("\"{name}\":{raw}")).collect();
        let members = members.join(",");
        let separator = if members.is_empty() { "" } else { "," };
        let object = format!("{{\"type\":\"{kind}\"{separator}{members}}}");
        if kind == FEATURE { object } else { format!("{{\"type\":\"{FEATURE}\",\"geometry\":{object}}}") }
    }
}

/// Visits the features one at a time.
struct FeaturesVisitor<'c, 'd, 'a>(&'c mut DocumentVisitor<'d, 'a>);

impl<'de> DeserializeSeed<'de> for FeaturesVisitor<'_, '_, '_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for FeaturesVisitor<'_, '_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list of features")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<(), A::Error> {
        let document = self.0;
        loop {
            document.limits.next_member();
            let Some(raw) = seq.next_element::<Box<RawValue>>()? else { return Ok(()) };
            let read = document.features.read_feature(raw.get().as_bytes());
            document.check(read)?;
            document.features.tick(document.bytes_read);
        }
    }
}
