//! Evaluates a filter for one object.

use super::Source;
use super::parts::PartFacts;
use crate::block::ObjectBlock;
use crate::value::{Value, ValueRef, civil_from_days, parse_date};
use std::cmp::Ordering;

#[derive(Debug, Clone, Copy)]
pub(super) struct ObjectRow<'a> {
    pub(super) block: &'a ObjectBlock,
    pub(super) id: u32,
    pub(super) row: usize,
}

/// The object that a condition is about. It has the values of its parent where it has none of its own, and else those of its parts.
#[derive(Debug, Clone, Copy)]
pub(super) struct ObjectInFamily<'a> {
    pub(super) object: ObjectRow<'a>,
    pub(super) parent: Option<ObjectRow<'a>>,
    pub(super) parts: Option<&'a PartFacts>,
}

impl<'a> ObjectRow<'a> {
    /// `None` if the block does not have the object.
    pub(super) fn of(block: &'a ObjectBlock, id: u32) -> Option<Self> {
        block.row(id).map(|row| Self { block, id, row })
    }

    fn value(&self, source: Source) -> Option<ValueRef<'a>> {
        source.value(self.block, self.id, self.row)
    }
}

impl<'a> ObjectInFamily<'a> {
    fn value(&self, source: Source) -> Option<ValueRef<'a>> {
        let own = self.object.value(source);
        own.or_else(|| self.parent?.value(source)).or_else(|| self.parts?.value(source))
    }
}

/// A condition. The `part` of `Contains` is in lower case.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Expression {
    All(Vec<Expression>),
    Any(Vec<Expression>),
    Not(Box<Expression>),
    Compare { left: Operand, comparison: Comparison, right: Operand },
    OneOf { operand: Operand, values: Vec<Value> },
    Contains { operand: Operand, part: String },
    IsPresent(Operand),
    IsTrue(Operand),
}

/// A value of an object, or a constant.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Operand {
    Source(Source),
    Constant(Value),
    Year(Box<Operand>),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Comparison {
    Equal,
    NotEqual,
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
}

impl Comparison {
    pub(super) fn from_symbol(symbol: &str) -> Option<Self> {
        Some(match symbol {
            "==" => Self::Equal,
            "!=" => Self::NotEqual,
            "<" => Self::Less,
            "<=" => Self::LessOrEqual,
            ">" => Self::Greater,
            ">=" => Self::GreaterOrEqual,
            _ => return None,
        })
    }

    fn holds(self, order: Ordering) -> bool {
        match self {
            Self::Equal => order.is_eq(),
            Self::NotEqual => order.is_ne(),
            Self::Less => order.is_lt(),
            Self::LessOrEqual => order.is_le(),
            Self::Greater => order.is_gt(),
            Self::GreaterOrEqual => order.is_ge(),
        }
    }
}

impl Expression {
    pub(super) fn holds(&self, object: &ObjectInFamily<'_>) -> bool {
        match self {
            Self::All(parts) => parts.iter().all(|part| part.holds(object)),
            Self::Any(parts) => parts.iter().any(|part| part.holds(object)),
            Self::Not(part) => !part.holds(object),
            Self::Compare { left, comparison, right } => {
                let values = left.value(object).zip(right.value(object));
                values.and_then(|(left, right)| compare(left, right)).is_some_and(|order| comparison.holds(order))
            }
            Self::OneOf { operand, values } => operand.value(object).is_some_and(|found| {
                values.iter().any(|value| compare(found, value.borrowed()).is_some_and(Ordering::is_eq))
            }),
            Self::Contains { operand, part } => match operand.value(object) {
                Some(ValueRef::Text(text)) => text.to_lowercase().contains(part.as_str()),
                _ => false,
            },
            Self::IsPresent(operand) => operand.value(object).is_some(),
            Self::IsTrue(operand) => operand.value(object) == Some(ValueRef::Bool(true)),
        }
    }

    /// Calls `visit` with each source of a value.
    pub(super) fn visit_sources(&self, visit: &mut dyn FnMut(Source)) {
        match self {
            Self::All(parts) | Self::Any(parts) => parts.iter().for_each(|part| part.visit_sources(visit)),
            Self::Not(part) => part.visit_sources(visit),
            Self::Compare { left, right, .. } => {
                left.visit_sources(visit);
                right.visit_sources(visit);
            }
            Self::OneOf { operand, .. }
            | Self::Contains { operand, .. }
            | Self::IsPresent(operand)
            | Self::IsTrue(operand) => operand.visit_sources(visit),
        }
    }
}

impl Operand {
    fn value<'a>(&'a self, object: &ObjectInFamily<'a>) -> Option<ValueRef<'a>> {
        match self {
            Self::Source(source) => object.value(*source),
            Self::Constant(value) => Some(value.borrowed()),
            Self::Year(operand) => {
                let (year, _, _) = civil_from_days(days(operand.value(object)?)?);
                Some(ValueRef::Integer(i64::from(year)))
            }
        }
    }

    fn visit_sources(&self, visit: &mut dyn FnMut(Source)) {
        match self {
            Self::Source(source) => visit(*source),
            Self::Constant(_) => {}
            Self::Year(operand) => operand.visit_sources(visit),
        }
    }
}

/// The day number of a date, or of the date with which a text begins.
fn days(value: ValueRef<'_>) -> Option<i32> {
    match value {
        ValueRef::Date(days) => Some(days),
        ValueRef::Text(text) => parse_date(text.get(..10)?),
        _ => None,
    }
}

/// Compares two values. `None` if they cannot be compared.
fn compare(left: ValueRef<'_>, right: ValueRef<'_>) -> Option<Ordering> {
    match (left, right) {
        (ValueRef::Text(left), ValueRef::Text(right)) => Some(left.cmp(right)),
        (ValueRef::Integer(left), ValueRef::Integer(right)) => Some(left.cmp(&right)),
        (ValueRef::Bool(left), ValueRef::Bool(right)) => Some(left.cmp(&right)),
        (ValueRef::Date(_), _) | (_, ValueRef::Date(_)) => Some(days(left)?.cmp(&days(right)?)),
        (ValueRef::Bool(_), _) | (_, ValueRef::Bool(_)) => None,
        _ => number(left)?.partial_cmp(&number(right)?),
    }
}

/// A number, or that of a text.
fn number(value: ValueRef<'_>) -> Option<f64> {
    match value {
        ValueRef::Text(text) => text.trim().parse().ok(),
        _ => value.as_f64(),
    }
}
