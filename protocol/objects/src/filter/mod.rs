//! Filters: expressions over the attributes of objects, such as `yearOfConstruction < 1900 && height > 20`.
//!
//! | expression | holds if |
//! |---|---|
//! | `a == 1`, `!=`, `<`, `<=`, `>`, `>=` | the comparison holds; never if a value is missing |
//! | `a in (1, 2)` | `a` is one of the values |
//! | `a ~ "kirche"` | the text `a` contains the other one; upper and lower case are equal |
//! | `a` | `a` is true or, if it is no boolean, present |
//! | `a == null`, `a != null` | `a` is missing; present |
//! | `!x`, `x && y`, `x \|\| y`, `(x)` | as usual; `!` binds tightest, then `&&` |
//!
//! Values are numbers, texts in double or single quotes, `true`, `false`, dates such as `2001-05-01`, attributes and `year(date)`.
//! Names that have other characters than letters, digits and `_.:-@#$`, or that begin with a digit, are written in backticks. In
//! quotes and backticks, a backslash makes the next character an ordinary one.
//!
//! Unless the schema has an attribute of that name, `id` is the number of the object, `identifier` its identifier in the source,
//! `kind` what it is and `height` the height of its bounds in metres. Texts that begin with a date can be compared with dates,
//! texts that are numbers with numbers.
//!
//! A part has the values of its parent where it has none of its own: buildings often have the year, and their parts the height. A whole has
//! the largest numbers of its parts where neither it nor its parent has one, the latest dates, `true` before `false`, and the height of the
//! box around them all.

mod city;
mod evaluate;
mod lexer;
mod parser;
mod parts;

use crate::block::ObjectBlock;
use crate::kind::FeatureKind;
use crate::schema::{FIELD_NAMES, Schema};
use crate::suggest;
use crate::value::ValueRef;
pub use city::{FilterBuilder, FilteredObjects};
use evaluate::{Expression, ObjectInFamily, ObjectRow};
use parts::PartFacts;
use roaring::RoaringBitmap;

/// Maximum bytes of a filter.
pub const MAX_FILTER_BYTES: usize = 4096;
/// Maximum depth of parentheses, negations and function calls.
pub const MAX_DEPTH: usize = 64;

/// What is told of a filter that no object of a city passes.
pub const NONE_PASSES: &str = "no object passes the filter";
/// What that means where other objects are drawn, too: kinds of which none passes stay as they are, and these are all.
pub const NONE_PASSES_IN_VIEW: &str = "no object passes the filter, so it changes nothing";

/// What is wrong with a filter, for programs that say it in words of their own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FilterFault {
    /// The text is no expression.
    Syntax,
    /// Objects have no such attribute, or no such kind.
    Name,
    /// Values of these types cannot be compared.
    Type,
    /// The text is too long, or too deep.
    Size,
}

impl FilterFault {
    /// The word of programs for it.
    pub fn code(self) -> &'static str {
        match self {
            Self::Syntax => "syntax",
            Self::Name => "name",
            Self::Type => "type",
            Self::Size => "size",
        }
    }
}

/// Why a text is no filter.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message} (at character {at})")]
pub struct FilterError {
    /// What is wrong.
    pub fault: FilterFault,
    /// Number of the character in the text, from 1.
    pub at: usize,
    /// What is wrong and what to do.
    pub message: String,
}

/// A [`FilterError`] whose place is in bytes.
#[derive(Debug)]
struct Fault {
    fault: FilterFault,
    at: usize,
    message: String,
}

impl Fault {
    fn syntax(at: usize, message: impl Into<String>) -> Self {
        Self { fault: FilterFault::Syntax, at, message: message.into() }
    }
}

/// A condition on objects of a city.
#[derive(Debug, Clone, PartialEq)]
pub struct Filter {
    expression: Expression,
    attributes: Vec<u32>,
}

impl Filter {
    /// Parses a filter for the objects of a city. Fails on texts over [`MAX_FILTER_BYTES`], expressions deeper than [`MAX_DEPTH`],
    /// unknown attributes, and comparisons of values of different types.
    pub fn parse(text: &str, schema: &Schema) -> Result<Self, FilterError> {
        let expression = Self::expression(text, schema).map_err(|Fault { fault, at, message }| {
            let before = text.get(..at).unwrap_or(text);
            FilterError { fault, at: before.chars().count() + 1, message }
        })?;
        let mut attributes = Vec::new();
        expression.visit_sources(&mut |source| {
            if let Source::Attribute(attribute) = source {
                attributes.push(attribute);
            }
        });
        attributes.sort_unstable();
        attributes.dedup();
        Ok(Self { expression, attributes })
    }

    fn expression(text: &str, schema: &Schema) -> Result<Expression, Fault> {
        if text.len() > MAX_FILTER_BYTES {
            let message = format!("a filter has at most {MAX_FILTER_BYTES} bytes: shorten it");
            return Err(Fault { fault: FilterFault::Size, at: text.floor_char_boundary(MAX_FILTER_BYTES), message });
        }
        parser::parse(text, schema)
    }

    /// The ids of the block's objects that meet the condition. Parents and parts in other blocks are not seen: see [`FilterBuilder`].
    pub fn select(&self, block: &ObjectBlock) -> RoaringBitmap {
        let parts = parts::by_whole(block, block, &self.attributes);
        let objects = block.ids().iter().enumerate().map(|(row, &id)| ObjectRow { block, id, row });
        objects.filter(|object| self.holds(*object, parts.get(&object.id))).map(|object| object.id).collect()
    }

    /// Whether an object with these parts, whose parent is in its block if anywhere, meets the condition.
    fn holds(&self, object: ObjectRow<'_>, parts: Option<&PartFacts>) -> bool {
        let parent = object.block.parent(object.id).and_then(|parent| ObjectRow::of(object.block, parent));
        self.expression.holds(&ObjectInFamily { object, parent, parts })
    }

    /// Indices of the attributes that the filter uses, ascending. Fields that every object has are not among them.
    pub fn attributes(&self) -> &[u32] {
        &self.attributes
    }
}

/// Where a value of an object comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    /// Index in the schema.
    Attribute(u32),
    Id,
    Identifier,
    Kind,
    /// Of the bounds, in metres. Nothing for kinds that lie on the ground.
    Height,
}

impl Source {
    /// The fields that every object has, in the order of their names.
    const FIELDS: [Self; FIELD_NAMES.len()] = [Self::Id, Self::Identifier, Self::Kind, Self::Height];

    /// The source of a name: an attribute of the schema or else a field. Heights as text, such as `12 m` of a map, do not hide the numbers
    /// that all objects have.
    pub(crate) fn of_name(name: &str, schema: &Schema) -> Option<Self> {
        let attribute = schema.index_of(name).map(|index| Self::Attribute(index as u32));
        let mut fields = FIELD_NAMES.iter().zip(Self::FIELDS);
        let field = fields.find(|(known, _)| **known == name).map(|(_, field)| field);
        let is_number = schema.index_of(name).is_some_and(|index| schema.attributes[index].value_type.is_number());
        if field == Some(Self::Height) && !is_number { field } else { attribute.or(field) }
    }

    pub(crate) fn value(self, block: &ObjectBlock, id: u32, row: usize) -> Option<ValueRef<'_>> {
        match self {
            Self::Attribute(attribute) => block.value_ref(row, attribute),
            Self::Id => Some(ValueRef::Integer(i64::from(id))),
            Self::Identifier => block.identifier(id).map(ValueRef::Text),
            Self::Kind => block.kind(id).map(FeatureKind::name).map(ValueRef::Text),
            Self::Height if block.kind(id).is_some_and(FeatureKind::is_level) => None,
            Self::Height => block.bounds(id).map(|bounds| ValueRef::Float(bounds.height_m())),
        }
    }
}

/// The most similar name of an attribute or field, for error messages.
pub(crate) fn similar_name<'a>(name: &str, schema: &'a Schema) -> Option<&'a str> {
    let attributes = schema.attributes.iter().map(|attribute| attribute.name.as_str());
    suggest::nearest(name, attributes.chain(FIELD_NAMES))
}

#[cfg(test)]
mod tests;
