//! Parses a filter and checks its names and types.

use super::evaluate::{Comparison, Expression, Operand};
use super::lexer::{Positioned, Token, tokens};
use super::{Fault, FilterFault, MAX_DEPTH, Source, similar_name, suggest};
use crate::kind::FeatureKind;
use crate::schema::Schema;
use crate::value::{Value, ValueType, parse_date};

pub(super) fn parse(text: &str, schema: &Schema) -> Result<Expression, Fault> {
    let mut parser =
        Parser { tokens: tokens(text)?.into_iter().peekable(), end: text.len(), schema, depth: 0, is_compared: false };
    let expression = parser.any()?;
    match parser.tokens.next() {
        None => Ok(expression),
        Some((at, Token::Symbol(")"))) => fail(at, "this parenthesis was not opened: remove it"),
        Some((at, _)) => fail(at, "an operator is missing here: write && or || between conditions"),
    }
}

/// Attributes that an error names.
const EXAMPLES: usize = 3;

struct Parser<'a> {
    tokens: std::iter::Peekable<std::vec::IntoIter<Positioned>>,
    end: usize,
    schema: &'a Schema,
    depth: usize,
    /// Whether the next value stands on the right of a comparison, where texts are most often meant.
    is_compared: bool,
}

/// A condition, or a value that may become a part of one.
enum Term {
    Condition(Expression),
    /// With its offset.
    Value(usize, Operand),
    Null(usize),
}

fn fail<T>(at: usize, message: impl Into<String>) -> Result<T, Fault> {
    Err(Fault::syntax(at, message))
}

/// Fails with another fault than one of the expression.
fn fail_by<T>(fault: FilterFault, at: usize, message: impl Into<String>) -> Result<T, Fault> {
    Err(Fault { fault, at, message: message.into() })
}

impl Parser<'_> {
    /// Offset of the next token.
    fn at(&mut self) -> usize {
        self.tokens.peek().map_or(self.end, |(at, _)| *at)
    }

    /// Takes the next token if it is a symbol.
    fn take(&mut self, symbol: &str) -> bool {
        self.tokens.next_if(|(_, token)| matches!(token, Token::Symbol(found) if *found == symbol)).is_some()
    }

    fn expect(&mut self, symbol: &str, message: &str) -> Result<(), Fault> {
        if self.take(symbol) { Ok(()) } else { fail(self.at(), message) }
    }

    /// Runs a parser one level deeper.
    fn deeper<T>(&mut self, parse: impl FnOnce(&mut Self) -> Result<T, Fault>) -> Result<T, Fault> {
        if self.depth >= MAX_DEPTH {
            return fail_by(
                FilterFault::Size,
                self.at(),
                format!("a filter has at most {MAX_DEPTH} levels of parentheses: write it flatter"),
            );
        }
        self.depth += 1;
        let parsed = parse(self);
        self.depth -= 1;
        parsed
    }

    fn any(&mut self) -> Result<Expression, Fault> {
        let mut parts = vec![self.all()?];
        while self.take("||") {
            parts.push(self.all()?);
        }
        Ok(single(parts, Expression::Any))
    }

    fn all(&mut self) -> Result<Expression, Fault> {
        let mut parts = vec![self.not()?];
        while self.take("&&") {
            parts.push(self.not()?);
        }
        Ok(single(parts, Expression::All))
    }

    fn not(&mut self) -> Result<Expression, Fault> {
        if self.take("!") {
            return self.deeper(|parser| Ok(Expression::Not(Box::new(parser.not()?))));
        }
        self.comparison()
    }

    fn comparison(&mut self) -> Result<Expression, Fault> {
        let left = self.term()?;
        let at = self.at();
        if self.tokens.next_if(|(_, token)| *token == Token::In).is_some() {
            return self.one_of(at, left);
        }
        if self.take("~") {
            return self.contains(at, left);
        }
        let symbol =
            |token: &Token| if let Token::Symbol(symbol) = token { Comparison::from_symbol(symbol) } else { None };
        let Some(comparison) = self.tokens.peek().and_then(|(_, token)| symbol(token)) else {
            return match left {
                Term::Condition(expression) => Ok(expression),
                Term::Value(_, Operand::Source(source)) => Ok(self.alone(source)),
                Term::Value(at, _) | Term::Null(at) => {
                    fail(at, "a value is no condition: compare it, as in height > 20")
                }
            };
        };
        self.tokens.next();
        let right = self.compared_term()?;
        self.compare(at, left, comparison, right)
    }

    /// An attribute as a condition.
    fn alone(&self, source: Source) -> Expression {
        let operand = Operand::Source(source);
        match self.type_of(&operand) {
            ValueType::Bool => Expression::IsTrue(operand),
            _ => Expression::IsPresent(operand),
        }
    }

    fn compare(&self, at: usize, left: Term, comparison: Comparison, right: Term) -> Result<Expression, Fault> {
        let (left, right, value_at) = match (left, right) {
            (Term::Value(_, left), Term::Value(at, right)) => (left, right, at),
            (Term::Value(_, operand), Term::Null(_)) | (Term::Null(_), Term::Value(_, operand)) => {
                let is_present = Expression::IsPresent(operand);
                return match comparison {
                    Comparison::NotEqual => Ok(is_present),
                    Comparison::Equal => Ok(Expression::Not(Box::new(is_present))),
                    _ => fail(at, "null is not less or greater than a value: write == null or != null"),
                };
            }
            (Term::Condition(_), _) | (_, Term::Condition(_)) => {
                return fail(at, "conditions cannot be compared: combine them by && and ||");
            }
            (Term::Null(_), Term::Null(_)) => return fail(at, "null is compared with null: compare an attribute"),
        };
        let is_order = !matches!(comparison, Comparison::Equal | Comparison::NotEqual);
        if is_order && self.type_of(&left) == ValueType::Bool {
            return fail_by(FilterFault::Type, at, "true and false have no order: write == or !=");
        }
        let right = self.checked(&left, right, value_at)?;
        let left = self.checked(&right, left, at)?;
        Ok(Expression::Compare { left, comparison, right })
    }

    /// The rest of `operand in (value, ...)`.
    fn one_of(&mut self, at: usize, left: Term) -> Result<Expression, Fault> {
        let Term::Value(_, operand) = left else {
            return fail(at, "only values can be in a list: write an attribute before in");
        };
        self.expect("(", "a list is missing after in: write in (1, 2)")?;
        let mut values = Vec::new();
        loop {
            let at = self.at();
            match self.compared_term()? {
                Term::Value(at, value @ Operand::Constant(_)) => {
                    if let Operand::Constant(value) = self.checked(&operand, value, at)? {
                        values.push(value);
                    }
                }
                _ => return fail(at, "lists have texts, numbers, dates, true and false only: compare others by =="),
            }
            if !self.take(",") {
                break;
            }
        }
        self.expect(")", "a list has no end here: write , or )")?;
        Ok(Expression::OneOf { operand, values })
    }

    /// The rest of `operand ~ "text"`.
    fn contains(&mut self, at: usize, left: Term) -> Result<Expression, Fault> {
        let part_at = self.at();
        let (Term::Value(_, operand), right) = (left, self.compared_term()?) else {
            return fail(at, "only texts contain something: write an attribute before ~");
        };
        if self.type_of(&operand) != ValueType::Text {
            return fail_by(
                FilterFault::Type,
                at,
                format!("{} contains no text: compare it by ==", with_article(self.type_of(&operand))),
            );
        }
        match right {
            Term::Value(_, Operand::Constant(Value::Text(part))) => {
                Ok(Expression::Contains { operand, part: part.to_lowercase() })
            }
            _ => fail(part_at, "a text is missing after ~: write it in double quotes"),
        }
    }

    /// A value on the right of a comparison.
    fn compared_term(&mut self) -> Result<Term, Fault> {
        self.is_compared = true;
        self.term()
    }

    /// A value, or a condition in parentheses.
    fn term(&mut self) -> Result<Term, Fault> {
        let is_compared = std::mem::take(&mut self.is_compared);
        let Some((at, token)) = self.tokens.next() else {
            return fail(self.end, "the filter ends where a value is missing: add one");
        };
        match token {
            Token::Literal(value) => Ok(Term::Value(at, Operand::Constant(value))),
            Token::Null => Ok(Term::Null(at)),
            Token::Symbol("-") => match self.tokens.next() {
                Some((_, Token::Literal(Value::Integer(value)))) => {
                    Ok(Term::Value(at, Operand::Constant(Value::Integer(-value))))
                }
                Some((_, Token::Literal(Value::Float(value)))) => {
                    Ok(Term::Value(at, Operand::Constant(Value::Float(-value))))
                }
                _ => fail(at, "a number is missing after -: filters do not calculate"),
            },
            Token::Symbol("(") => {
                let expression = self.deeper(Self::any)?;
                self.expect(")", "a parenthesis is not closed: add )")?;
                Ok(Term::Condition(expression))
            }
            Token::Name { name, is_quoted } if !is_quoted && name == "year" && self.take("(") => {
                let operand = self.deeper(Self::term)?;
                self.expect(")", "a parenthesis is not closed: add )")?;
                match operand {
                    Term::Value(_, operand) if matches!(self.type_of(&operand), ValueType::Date | ValueType::Text) => {
                        Ok(Term::Value(at, Operand::Year(Box::new(operand))))
                    }
                    _ => fail_by(
                        FilterFault::Type,
                        at,
                        "only dates have a year: write an attribute of dates in the parentheses",
                    ),
                }
            }
            Token::Name { name, .. } => Ok(Term::Value(at, Operand::Source(self.source(&name, at, is_compared)?))),
            Token::In | Token::Symbol(_) => {
                fail(at, "a value is missing here: write an attribute, number, text or date")
            }
        }
    }

    /// Where the values of a name come from. Fails if there is no such attribute or field.
    fn source(&self, name: &str, at: usize, is_compared: bool) -> Result<Source, Fault> {
        if let Some(source) = Source::of_name(name, self.schema) {
            return Ok(source);
        }
        let hint = match similar_name(name, self.schema) {
            Some(similar) => format!("did you mean {similar}?"),
            None if is_compared => "write texts in double quotes".to_owned(),
            None => {
                let order = self.schema.display_order().into_iter();
                let names = order.filter_map(|index| self.schema.attributes.get(index)).map(|info| info.name.as_str());
                let shown = names.filter(|name| self.schema.is_shown(name)).take(EXAMPLES);
                let known: Vec<&str> = shown.chain(["height", "kind"]).collect();
                format!("write one that they have, such as {}", known.join(", "))
            }
        };
        fail_by(FilterFault::Name, at, format!("objects have no attribute {name}: {hint}"))
    }

    fn type_of(&self, operand: &Operand) -> ValueType {
        match operand {
            Operand::Source(Source::Attribute(attribute)) => {
                let attribute = self.schema.attributes.get(*attribute as usize);
                attribute.map_or(ValueType::Text, |attribute| attribute.value_type)
            }
            Operand::Source(Source::Id) | Operand::Year(_) => ValueType::Integer,
            Operand::Source(Source::Height) => ValueType::Float,
            Operand::Source(Source::Identifier | Source::Kind) => ValueType::Text,
            Operand::Constant(value) => value.type_of(),
        }
    }

    /// A constant as it is compared with `other`: a text becomes a date beside a date. Other operands stay as they are. Fails if
    /// the two cannot be compared.
    fn checked(&self, other: &Operand, operand: Operand, at: usize) -> Result<Operand, Fault> {
        let (wanted, found) = (self.type_of(other), self.type_of(&operand));
        if let (Operand::Source(Source::Kind), Operand::Constant(Value::Text(name))) = (other, &operand) {
            let names = FeatureKind::NAMES.map(|(name, _)| name);
            if !names.contains(&name.as_str()) {
                let hint = suggest::nearest(name, names).map_or(names.join(", "), str::to_owned);
                return fail_by(FilterFault::Name, at, format!("no kind has the name {name}: write {hint}"));
            }
        }
        if let (ValueType::Date, Operand::Constant(Value::Text(text))) = (wanted, &operand) {
            return match parse_date(text) {
                Some(days) => Ok(Operand::Constant(Value::Date(days))),
                None => fail_by(FilterFault::Type, at, format!("{text:?} is no date: write it as 2001-05-01")),
            };
        }
        let is_comparable = wanted == found
            || (wanted.is_number() && found.is_number())
            // Texts of an attribute may be numbers or begin with dates. Texts of a filter are meant to be texts.
            || (wanted == ValueType::Text && !matches!(other, Operand::Constant(_)) && found != ValueType::Bool)
            || (found == ValueType::Text && !matches!(operand, Operand::Constant(_)) && wanted != ValueType::Bool);
        if is_comparable {
            Ok(operand)
        } else {
            let [wanted, found] = [wanted, found].map(with_article);
            fail_by(FilterFault::Type, at, format!("{wanted} is compared with {found}: write {wanted}"))
        }
    }
}

fn with_article(value_type: ValueType) -> String {
    format!("{} {value_type}", if value_type == ValueType::Integer { "an" } else { "a" })
}

/// The only part, or a group of them.
fn single(mut parts: Vec<Expression>, group: impl FnOnce(Vec<Expression>) -> Expression) -> Expression {
    match parts.pop() {
        Some(part) if parts.is_empty() => part,
        last => {
            parts.extend(last);
            group(parts)
        }
    }
}
