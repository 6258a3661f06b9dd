//! Elements of OpenStreetMap as both file forms give them, and how a file is read through.

use insula_source::error::InputError;
use insula_source::object::ObjectSink;
use std::fmt;
use std::ops::{ControlFlow, Range};

/// A position in units of 1e-7 degrees: longitude, latitude.
pub(super) type Position = [i32; 2];

/// Units of [`Position`] in a degree.
pub(super) const UNITS_PER_DEGREE: f64 = 1e7;

/// A position whose values are valid; `None` outside of the world.
pub(super) fn position(lon: i64, lat: i64) -> Option<Position> {
    const LON: i64 = 1_800_000_000;
    const LAT: i64 = 900_000_000;
    let is_valid = (-LON..=LON).contains(&lon) && (-LAT..=LAT).contains(&lat);
    is_valid.then_some([lon as i32, lat as i32])
}

/// Longitude and latitude in degrees.
pub(super) fn degrees(position: Position) -> [f64; 2] {
    position.map(|value| f64::from(value) / UNITS_PER_DEGREE)
}

/// Identifier for a node of which only the position is known: the same for the same position, and far from those of other nodes.
pub(super) fn id_of_position([lon, lat]: Position) -> i64 {
    let from_corner = |value: i32, low: i64| i64::from(value) + low;
    // 32 and 31 bits. Editors give new nodes small negative identifiers.
    i64::MIN + (from_corner(lon, 1_800_000_000) << 31) + from_corner(lat, 900_000_000)
}

/// Identifier of a way or a relation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) enum ElementId {
    Way(i64),
    Relation(i64),
}

impl fmt::Display for ElementId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Way(id) => write!(f, "way/{id}"),
            Self::Relation(id) => write!(f, "relation/{id}"),
        }
    }
}

/// Tags of an element: places of keys and values in a text.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tags<'a> {
    pub(super) text: &'a [u8],
    /// Start and end of the key, start and end of the value, for each tag.
    pub(super) spans: &'a [[u32; 4]],
}

impl<'a> Tags<'a> {
    /// Keys and values in the order of the file.
    pub(super) fn iter(self) -> impl Iterator<Item = (&'a [u8], &'a [u8])> {
        let part = move |from: u32, to: u32| self.text.get(from as usize..to as usize).unwrap_or_default();
        self.spans.iter().map(move |[a, b, c, d]| (part(*a, *b), part(*c, *d)))
    }

    /// The value of a key; `None` if it is missing or no valid text.
    pub(super) fn get(self, key: &str) -> Option<&'a str> {
        self.iter().find(|(known, _)| *known == key.as_bytes()).and_then(|(_, value)| std::str::from_utf8(value).ok())
    }

    pub(super) fn is_empty(self) -> bool {
        self.spans.is_empty()
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Member<'a> {
    /// `None` for nodes.
    pub(super) element: Option<ElementId>,
    pub(super) role: &'a [u8],
}

#[derive(Debug, Clone, Copy)]
pub(super) enum Element<'a> {
    Node {
        id: i64,
        position: Position,
        tags: Tags<'a>,
    },
    /// `number` counts the ways of the file from 0; `u64::MAX` for one that only a relation has.
    Way {
        id: i64,
        number: u64,
        refs: &'a [i64],
        tags: Tags<'a>,
    },
    Relation {
        id: i64,
        members: &'a [Member<'a>],
        tags: Tags<'a>,
    },
}

/// The error of a file that has all versions of its elements. `what` tells it.
pub(super) fn of_history(label: &str, what: &str) -> InputError {
    InputError::unsupported(
        label,
        format!("a history of a map ({what}); osmium time-filter makes a map of one day of it"),
    )
}

/// Which elements a pass over a file is for. Others may be visited too.
#[derive(Clone)]
pub(super) enum Pass<'n> {
    /// All elements. Faults of single elements are reported in this pass only. It is the first one.
    First,
    /// Ways by their numbers; no others.
    Ways(Range<u64>),
    /// Nodes, without their tags. Those of a stretch of identifiers (first, last) may be left out if it is not needed.
    Nodes(&'n dyn Fn(i64, i64) -> bool),
}

/// Receives the elements of a pass; `Break` ends it.
pub(super) type Visit<'v> = dyn FnMut(Element<'_>, &mut dyn ObjectSink) -> Result<ControlFlow<()>, InputError> + 'v;

/// A file that can be read through several times.
pub(super) trait ElementFile {
    /// Reads the file from its start. Passes give the elements in the same order each time.
    fn read_through(
        &mut self,
        pass: Pass<'_>,
        sink: &mut dyn ObjectSink,
        visit: &mut Visit<'_>,
    ) -> Result<(), InputError>;

    /// South-western and north-eastern corner of the area that the file says it has; known after the first pass.
    fn extent(&self) -> Option<[Position; 2]>;
}
