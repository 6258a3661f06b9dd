//! Texts that say how objects are drawn, as command lines and pages have them, and the styles that follow.

use super::coloring::styles_of_filter;
use super::{CityObjects, FilteredOut, ObjectQuery, ObjectStyles, StyleBuilder};
use crate::source::FetchError;
use insula_objects::color::{ColorBy, ColorError, Legend, sampled_blocks};
use insula_objects::filter::{Filter, FilterError};
use insula_objects::value::ValueType;
use insula_objects::{Schema, Value};

/// How objects are to be drawn. Empty texts ask for nothing.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StyleRules {
    /// An attribute, `height` or `kind`; empty: objects have their own colours.
    pub attribute: String,
    /// Empty: the default of the attribute.
    pub palette: String,
    /// Values of the ends of the palette, if they are not those of the city.
    pub range: Option<[f64; 2]>,
    /// An expression; empty: all objects pass.
    pub filter: String,
    pub filtered_out: FilteredOut,
    /// Objects with larger values of the attribute are hidden. Dates are days since 1970-01-01.
    pub up_to: Option<f64>,
}

/// Why rules have no styles.
#[derive(Debug, thiserror::Error)]
pub enum RulesError {
    #[error("colour by {text}: {why}")]
    Color { text: String, why: ColorError },
    #[error("filter {text}: {why}")]
    Filter { text: String, why: FilterError },
    #[error("objects: {0}")]
    Fetch(#[from] FetchError),
}

/// Styles, and what explains them.
#[derive(Debug)]
pub struct StyledObjects {
    pub styles: ObjectStyles,
    pub legend: Option<Legend>,
    /// Number of objects that pass the filter.
    pub passing: usize,
}

impl StyleRules {
    /// Whether all objects are drawn as they are.
    pub fn is_empty(&self) -> bool {
        self.attribute.is_empty() && self.filter.is_empty()
    }

    /// Parses the texts. Fails if an attribute or a palette is unknown, or if the filter is not an expression.
    pub fn query(&self, schema: &Schema) -> Result<ObjectQuery, RulesError> {
        let color = match self.color_text() {
            Some(text) => match ColorBy::parse(&text, schema) {
                Ok(color) => Some(color),
                Err(why) => return Err(RulesError::Color { text, why }),
            },
            None => None,
        };
        let color = match (color, self.range) {
            (Some(color), Some(range)) => Some(color.with_range(range)),
            (color, _) => color,
        };
        let filter = self.parsed_filter(schema)?;
        let filtered_out = if self.limit().is_some() { FilteredOut::Hide } else { self.filtered_out };
        Ok(ObjectQuery { color, filter, filtered_out })
    }

    fn color_text(&self) -> Option<String> {
        match (self.attribute.is_empty(), self.palette.is_empty()) {
            (true, _) => None,
            (false, true) => Some(self.attribute.clone()),
            (false, false) => Some(format!("{}:{}", self.attribute, self.palette)),
        }
    }

    fn limit(&self) -> Option<f64> {
        self.up_to.filter(|value| value.is_finite() && !self.attribute.is_empty())
    }

    /// The filter and the limit. The filter is parsed alone before, so that an error has the place in what people wrote.
    fn parsed_filter(&self, schema: &Schema) -> Result<Option<Filter>, RulesError> {
        let own = Some(self.filter.clone()).filter(|text| !text.is_empty());
        let mut parsed = None;
        for text in [own, self.filter_text(schema)].into_iter().flatten() {
            let filter = Filter::parse(&text, schema);
            parsed = Some(filter.map_err(|why| RulesError::Filter { text, why })?);
        }
        Ok(parsed)
    }

    fn filter_text(&self, schema: &Schema) -> Option<String> {
        let info = schema.attributes.iter().find(|info| info.name == self.attribute);
        let is_date = info.is_some_and(|info| info.value_type == ValueType::Date);
        let limit = self.limit().map(|value| format!("{} <= {}", quoted(&self.attribute), literal(value, is_date)));
        match (self.filter.is_empty(), limit) {
            (true, limit) => limit,
            (false, None) => Some(self.filter.clone()),
            (false, Some(limit)) => Some(format!("({}) && {limit}", self.filter)),
        }
    }
}

impl CityObjects {
    /// How all objects are drawn. Fetches all blocks, unless the source evaluates a filter. Fails if the rules are invalid, or if a block cannot be fetched.
    pub async fn styles(&self, rules: &StyleRules) -> Result<StyledObjects, RulesError> {
        let mut query = rules.query(self.schema())?;
        if rules.range.is_none()
            && let Some(color) = query.color.take()
        {
            query.color = Some(self.over_heights(color).await?);
        }
        if let (None, Some(text)) = (&query.color, rules.filter_text(self.schema()))
            && let Some(filtered) = self.filter(&text).await?
        {
            let styles = styles_of_filter(&filtered, query.filtered_out);
            return Ok(StyledObjects { styles, legend: None, passing: filtered.passing_wholes as usize });
        }
        let mut builder = StyleBuilder::default();
        if !rules.is_empty() {
            for block in 0..self.block_count() {
                if let Some(block) = self.block(block).await? {
                    builder.add(&block, &query);
                }
            }
            for [parents, block] in builder.apart() {
                if let (Some(parents), Some(block)) = (self.block(parents).await?, self.block(block).await?) {
                    builder.add_apart(&parents, &block, &query);
                }
            }
        }
        let legend = query.color.as_ref().map(ColorBy::legend);
        let (styles, passing) = builder.finish(&query);
        Ok(StyledObjects { styles, legend, passing })
    }

    /// The colours, over the heights that the city has if they are of those.
    async fn over_heights(&self, color: ColorBy) -> Result<ColorBy, FetchError> {
        if !color.is_of_heights() {
            return Ok(color);
        }
        let mut blocks = Vec::new();
        for block in sampled_blocks(self.block_count()) {
            blocks.extend(self.block(block).await?);
        }
        Ok(color.over_heights(blocks.iter().map(|block| &**block)))
    }
}

/// A name as filters have it.
fn quoted(name: &str) -> String {
    format!("`{}`", name.replace('\\', "\\\\").replace('`', "\\`"))
}

/// A value as filters have it.
fn literal(value: f64, is_date: bool) -> String {
    // The cast saturates.
    if is_date { Value::Date(value.round() as i32).to_string() } else { value.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insula_objects::SchemaBuilder;

    fn schema() -> Schema {
        let mut builder = SchemaBuilder::default();
        builder.add("a `b`", &Value::Date(1900));
        builder.add("year", &Value::Integer(1900));
        builder.finish(1)
    }

    #[test]
    fn a_limit_and_a_filter_become_one_expression() {
        let mut rules = StyleRules { attribute: "year".into(), up_to: Some(1900.0), ..StyleRules::default() };
        assert_eq!(rules.filter_text(&schema()).as_deref(), Some("`year` <= 1900"));
        assert_eq!(rules.query(&schema()).unwrap().filtered_out, FilteredOut::Hide);
        rules.filter = "height > 3 || kind == 'bridge'".into();
        rules.attribute = "a `b`".into();
        rules.palette = "magma".into();
        let expected = "(height > 3 || kind == 'bridge') && `a \\`b\\`` <= 1975-03-16";
        assert_eq!(rules.filter_text(&schema()).as_deref(), Some(expected));
        assert!(rules.query(&schema()).unwrap().filter.is_some());
        assert_eq!(rules.color_text().as_deref(), Some("a `b`:magma"));
        assert!(StyleRules::default().is_empty());
    }

    #[test]
    fn invalid_rules_fail_with_their_text() {
        let rules = StyleRules { filter: "yeer < 3".into(), ..StyleRules::default() };
        let error = rules.query(&schema()).unwrap_err().to_string();
        assert!(error.contains("filter yeer < 3") && error.contains("year"), "{error}");
        let limited = StyleRules { attribute: "year".into(), up_to: Some(1900.0), ..rules };
        assert_eq!(limited.query(&schema()).unwrap_err().to_string(), error, "the limit moves no place");
        let rules = StyleRules { attribute: "year".into(), palette: "magmy".into(), ..StyleRules::default() };
        assert!(rules.query(&schema()).unwrap_err().to_string().contains("magma"));
    }
}
